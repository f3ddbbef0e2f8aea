"""SwarmDownlink-v0: bits and energy are conserved, rates are those of `dataflow`, and no policy passes the optimum."""

import itertools
import pickle

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from swarm_mj.envs.downlink.baselines import fly_downlink, greedy, random_policy, recorded, round_robin, split
from swarm_mj.envs.downlink.batch import DownlinkBatch
from swarm_mj.envs.downlink.bound import value_bound
from swarm_mj.envs.downlink.config import DownlinkConfig
from swarm_mj.envs.downlink.world import PER_SLOT, DownlinkTask, Paths

from swarm_mj.dataflow.ground import NETWORKS
from swarm_mj.dataflow.link_budget import rates_bit_s
from swarm_mj.dataflow.network import Network
from swarm_mj.dataflow.optimum import optimum
from swarm_mj.dataflow.radios import CATALOGUE
from swarm_mj.errors import ScenarioError

ID = "swarm_mj.envs:SwarmDownlink-v0"
#: Two spacecraft, four slots, three products: every list of actions can be tried.
TINY = {
    "scenario": "itokawa-slow",
    "step_s": 1800.0,
    "horizon_s": 7200.0,
    "products": 3,
    "storage_bit": 1.2e7,
    "draw": {"products": 3, "size_bit": 2e6, "lifetime": 0.3, "lifetime_most": 1.0, "gap_most_s": 3600.0},
    "power": {"battery_J": 6e4},
}


@pytest.fixture(scope="module")
def task():
    return DownlinkTask(DownlinkConfig())


@pytest.fixture(scope="module")
def tiny():
    return DownlinkTask(DownlinkConfig(**TINY))


def test_numbers_of_numpy_and_of_python_make_one_task(tiny):
    given = {name: np.array(value)[()] if isinstance(value, (int, float)) else value for name, value in TINY.items()}
    assert DownlinkTask(DownlinkConfig(**given)).fingerprint == tiny.fingerprint


def batch_of(task, seeds):
    batch = DownlinkBatch(task, len(seeds))
    batch.reset(dict(enumerate(seeds)))
    return batch


def to_earth_alone(bits, slots, n):
    """Capacities of links to Earth, without crosslinks."""
    return np.concatenate([np.zeros((slots, n, n), np.int64), np.full((slots, n, 1), bits)], axis=2)


def legal(batch, rng):
    """Any allowed choices."""
    weights = rng.random(batch.tables.action_mask.shape) * batch.tables.action_mask
    return weights.argmax(axis=2)


def test_bits_and_energy_are_conserved_and_charge_stays_between_empty_and_full(task):
    batch, rng = batch_of(task, range(6)), np.random.default_rng(1)
    state, charge_J = batch.state, batch.state.charge_J.copy()
    previous = state.charge_J.copy()
    for _ in range(task.config.slots):
        # Choices that are not allowed are idle, so any may be given.
        batch.step(np.where(rng.random((6, 5)) < 0.5, legal(batch, rng), rng.integers(0, 7, (6, 5))))
        aboard = state.hold.sum(axis=(1, 2))
        assert (state.made_bit == state.on_earth.sum(axis=1) + aboard + state.lost_bit).all()
        assert (state.hold >= 0).all() and (state.hold.sum(axis=2) <= task.config.storage_bit).all()
        balance = charge_J + state.brought_J + state.unmet_J - state.spent_J - state.spilled_J
        assert balance == pytest.approx(state.charge_J, abs=1e-3)
        assert (state.charge_J >= 0.0).all() and (state.charge_J <= 144e3).all()
        # No more can be lost than what everything on takes.
        assert (previous - state.charge_J <= (5.0 + 33.7 + 3.0) * 600.0 + 200.0 + 144e3 * ~state.alive).all()
        previous = state.charge_J.copy()
    made = np.where(batch.conditions.ready < task.config.slots, batch.conditions.size, 0).sum(axis=1)
    assert (state.made_bit == made).all() and not state.hold.any()
    assert state.lost_bit.min() > 0 and state.on_earth.sum() > 0


def test_a_spacecraft_that_talks_spends_what_its_transmitter_takes_and_loses_the_sun(task):
    # Worked out anew: nothing drawn fails, one product on each, a pass throughout.
    drawn = task.draw(np.random.default_rng(0))
    slots, size = task.config.slots, np.zeros(24, np.int64)
    size[:5] = 600_000
    full = drawn._replace(
        capacity_bit=to_earth_alone(1_200_000, slots, 5),
        sun_J=np.full((slots, 5), 7000.0),
        earth_J=np.full((slots, 5), 300.0),
        lost_slot=np.full(5, slots),
        charge_J=np.full(5, 50e3),
        origin=np.arange(24) % 5,
        size=size,
        value=size / size.sum(),
        ready=np.where(size > 0, 0, slots),
        expiry=np.full(24, slots),
        order=np.arange(24),
    )
    batch = DownlinkBatch(task, 1)
    batch.place(0, full)
    batch.observe()
    result = batch.step(np.array([[1, 1, 1, 0, 0]]))
    # The first two take half of the slot each, and nothing of it is left for the third.
    assert batch.state.on_earth[0, :5].tolist() == [600_000, 600_000, 0, 0, 0]
    assert result.terms[0, 0] == pytest.approx(2 / 5)
    talked = 50e3 + 300.0 - 3000.0 - 200.0 - 33.7 * 600.0 / 2.0
    assert batch.state.charge_J[0, :2] == pytest.approx([talked, talked], rel=1e-6)
    assert batch.state.charge_J[0, 2] == pytest.approx(50e3 + 300.0 - 3000.0 - 200.0)
    assert batch.state.charge_J[0, 3:] == pytest.approx(50e3 + 7000.0 - 3000.0)


def test_rates_are_those_of_the_link_budget_for_the_same_geometry(task):
    slots = task.config.slots
    paths = task.draw_paths(np.random.default_rng(3))
    contacts, station = task.contacts(paths, np.ones(slots * PER_SLOT, bool))
    part_s, uhf, iris = 300.0, CATALOGUE["uhf_omni"], CATALOGUE[task.given.link.earth.radio]
    stations = NETWORKS[task.given.link.ground.network]
    for slot in (40, 100, 143):
        samples = range(PER_SLOT * slot, PER_SLOT * (slot + 1))
        apart = [np.linalg.norm(paths.r_BN_N[k, 0] - paths.r_BN_N[k, 3]) for k in samples]
        assert contacts.swarm_bit[slot, 0, 3] == int(part_s * rates_bit_s(uhf, uhf.g_over_t_db_k, apart).sum())
        heard = 0.0
        for k in samples:
            if station[k] >= 0:
                away = np.linalg.norm(paths.earth_N[k] - paths.r_BN_N[k, 2])
                heard += part_s * float(rates_bit_s(iris, stations[station[k]].g_over_t_db_k, away))
        assert contacts.earth_bit[slot, 2] == int(heard)
    nothing, _ = task.contacts(paths, np.zeros(slots * PER_SLOT, bool))
    assert not nothing.earth_bit.any() and contacts.earth_bit.any()


def test_panels_bring_nothing_behind_the_body_and_the_sine_of_the_angle_to_the_sun_beside_earth(task):
    t, earth_N = np.zeros(2 * task.config.slots), np.array([task.plan.environment.earth.at(0.0)] * 288)
    sun_N = task.plan.environment.sun.at(0.0)
    to_sun, to_earth = sun_N / np.linalg.norm(sun_N), earth_N[0] / np.linalg.norm(earth_N[0])
    aside = np.cross(to_sun, [0.0, 0.0, 1.0])
    aside /= np.linalg.norm(aside)
    radius = float(np.linalg.norm(task.plan.shape.vertices, axis=1).max())
    places = [-3.0 * radius * to_sun, 3.0 * radius * to_sun, -3.0 * radius * to_sun + 1.5 * radius * aside]
    r_N = np.tile(np.array([*places, *places[:2]]), (288, 1, 1))
    sun_J, earth_J = task.sunlight(Paths(t, r_N, earth_N))
    full = 35.0 * 600.0 / (np.linalg.norm(sun_N) / 149_597_870_700.0) ** 2
    assert sun_J[0] == pytest.approx([0.0, full, full, 0.0, full], rel=1e-9)
    sine = np.sqrt(1.0 - (to_sun @ to_earth) ** 2)
    assert earth_J[0] == pytest.approx(sine * sun_J[0], rel=1e-3)


def test_no_policy_passes_the_best_of_all_lists_nor_that_the_proven_bound(tiny):
    lists = np.array(list(itertools.product(itertools.product((0, 1, 3), (0, 1, 2)), repeat=4)))
    batch, better = DownlinkBatch(tiny, len(lists)), 0
    for seed in (1, 4, 5, 7):
        drawn = tiny.draw(np.random.default_rng(seed))
        for e in range(len(lists)):
            batch.place(e, drawn)
        batch.observe()
        for k in range(4):
            batch.step(lists[:, k])
        best, bound = batch.state.delivered.max(), value_bound(tiny, drawn)
        values = [fly_downlink(tiny, policy, [seed])[1][0] for policy in (round_robin, greedy, random_policy(0))]
        assert max(values) <= best + 1e-12 <= bound + 1e-6
        better += best > values[0] + 1e-9
        # Seen as a list of actions, the best one brings the same again.
        k = int(batch.state.delivered.argmax())
        assert fly_downlink(tiny, recorded(list(lists[k])), [seed])[1][0] == best
    assert better > 0


def test_with_endless_power_and_time_the_bound_is_the_optimum_of_the_data_flow(tiny):
    endless = DownlinkTask(DownlinkConfig(**TINY | {"power": {"battery_J": 1e12, "slew_s": 0.0}}))
    for seed in range(4):
        drawn = endless.draw(np.random.default_rng(seed))
        drawn = drawn._replace(expiry=np.full(3, 4), charge_J=np.full(2, 1e12))
        if seed % 2:  # one cannot talk to Earth, so that the other has to
            drawn.capacity_bit[:, drawn.origin[0], 2] = 0
        bits = np.zeros((2, 3), np.int64)
        bits[drawn.origin, np.arange(3)] = drawn.size
        network = Network(
            edges_s=1800.0 * np.arange(5),
            swarm_bit=drawn.capacity_bit[:, :, :2],
            earth_bit=drawn.capacity_bit[:, :, 2],
            storage_bit=np.full(2, int(1.2e7)),
            access=endless.access,
            half_duplex=endless.half_duplex,
            earth_channels=1,
            value=drawn.value,
            bits=bits,
            ready=np.where(bits > 0, drawn.ready, 4),
        )
        assert value_bound(endless, drawn) == pytest.approx(optimum(network, whole=True).value, abs=1e-6)


@pytest.mark.parametrize(("charge_J", "arrives"), [(60e3, 0.0), (64e3, 1.0)])
def test_the_bound_knows_what_it_takes_to_talk(tiny, charge_J, arrives):
    # One product of a whole slot; the Sun brings what is always on, and nothing while the dish points at Earth.
    drawn = tiny.draw(np.random.default_rng(0))
    power = DownlinkConfig(**TINY).powers
    base_J, takes_J = power.base_W * 1800.0, (power.earth_W + 0.5 * power.base_W) * 1800.0
    assert 60e3 < takes_J < 66e3
    alone = drawn._replace(
        capacity_bit=to_earth_alone(7_200_000, 4, 2),
        sun_J=np.full((4, 2), base_J),
        earth_J=np.full((4, 2), 0.5 * base_J),
        charge_J=np.array([takes_J - 62e3 + charge_J, 0.0]),
        origin=np.zeros(3, np.int64),
        size=np.array([7_200_000, 0, 0]),
        value=np.array([1.0, 0.0, 0.0]),
        ready=np.array([0, 4, 4]),
        expiry=np.full(3, 4),
    )
    task = DownlinkTask(DownlinkConfig(**TINY | {"power": {"battery_J": 1e5}}))
    assert value_bound(task, alone._replace(sun_J=alone.sun_J - 1e-9)) == pytest.approx(arrives, abs=1e-6)


def test_looking_pays_and_a_list_of_actions_does_not(task):
    seeds, actions = range(8), []
    _, looked = fly_downlink(task, greedy, seeds)
    _, turns = fly_downlink(task, round_robin, seeds)
    fly_downlink(task, greedy, [102], actions)
    _, listed = fly_downlink(task, recorded(actions), seeds)
    _, chance = fly_downlink(task, random_policy(0), seeds)
    assert looked.mean() > turns.mean() + 0.1
    assert looked.mean() > listed.mean() + 0.3
    assert turns.mean() > chance.mean() + 0.1


def test_gymnasium_accepts_it_with_either_observation():
    for observation in ("flat", "dict"):
        env = gymnasium.make(ID, observation=observation, **TINY).unwrapped
        check_env(env, skip_render_check=True)


@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
def test_the_vector_flies_the_same_episodes_as_single_ones_bit_for_bit(mode):
    vector = gymnasium.make_vec(ID, num_envs=3, vectorization_mode="vector_entry_point", autoreset_mode=mode, **TINY)
    singles = [gymnasium.make(ID, **TINY).unwrapped for _ in range(3)]
    rows, _ = vector.reset(seed=5)
    own = [env.reset(seed=5 + e)[0] for e, env in enumerate(singles)]
    rng, over = np.random.default_rng(0), [False] * 3
    for _ in range(14):
        assert all(np.array_equal(rows[e], own[e]) for e in range(3))
        actions = rng.integers(0, 4, (3, 2))
        rows, rewards, terminated, truncated, _ = vector.step(actions)
        for e, env in enumerate(singles):
            if over[e] and mode == "NextStep":
                own[e], reward, ended, cut = env.reset()[0], 0.0, False, False
            else:
                own[e], reward, ended, cut, _ = env.step(actions[e])
            over[e] = ended or cut
            if over[e] and mode == "SameStep":
                own[e] = env.reset()[0]
            assert (rewards[e], terminated[e], truncated[e]) == (reward, ended, cut)


def test_agents_that_decide_each_for_itself_fly_the_same_episode():
    zoo = pytest.importorskip("pettingzoo.test")
    from swarm_mj.envs.downlink.parallel import swarm_downlink_v0

    many, one = swarm_downlink_v0.parallel_env(**TINY), gymnasium.make(ID, observation="dict", **TINY).unwrapped
    zoo.parallel_api_test(many, num_cycles=20)
    told, _ = many.reset(seed=6)
    tables, _ = one.reset(seed=6)
    for choices in ([1, 1], [3, 0], [0, 2], [1, 1]):
        assert np.array_equal(told["sc2"]["observation"]["products"], tables["products"])
        assert np.array_equal(told["sc2"]["action_mask"], tables["action_mask"][1])
        told, rewards, ends, cuts, _ = many.step({"sc1": choices[0], "sc2": choices[1]})
        tables, reward, ended, cut, _ = one.step(np.array(choices))
        assert (rewards["sc1"], ends["sc1"], cuts["sc2"]) == (reward, ended, cut)
        if not many.agents:
            break
    assert not many.agents


def test_a_state_can_be_taken_up_and_an_environment_pickled():
    env = gymnasium.make(ID, **TINY).unwrapped
    env.reset(seed=1)
    state, twin = env.get_state(), pickle.loads(pickle.dumps(env))
    first = [env.step(np.array([1, 1])) for _ in range(2)]
    env.set_state(state)
    for flown in (env, twin):
        for observation, reward, *_ in first:
            again = flown.step(np.array([1, 1]))
            assert np.array_equal(again[0], observation) and again[1] == reward


def test_a_flat_observation_holds_the_tables(task):
    flat, tables = (gymnasium.make(ID, observation=kind, **TINY).unwrapped for kind in ("flat", "dict"))
    row, _ = flat.reset(seed=3)
    named, info = tables.reset(seed=3)
    parts = split(flat.task, row)
    assert all(np.array_equal(parts[name], named[name]) for name in named)
    assert np.array_equal(info["action_mask"], named["action_mask"])
    with pytest.raises(ScenarioError, match="draw: unknown 'colour'"):
        gymnasium.make(ID, draw={"colour": 1.0})
    with pytest.raises(ScenarioError, match="omnidirectional"):
        gymnasium.make(ID, overrides={"link.crosslink.antenna": "hemispherical"})
