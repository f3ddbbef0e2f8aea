"""SwarmPointing-v0: the conventions of others, one flight behind three interfaces, and physics that is checked from outside."""

import copy
import pickle

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation
from swarm_mj.envs.pointing.batch import PointingBatch
from swarm_mj.envs.pointing.config import REFERENCES
from swarm_mj.envs.pointing.env import SwarmPointingVectorEnv
from swarm_mj.envs.pointing.parallel import swarm_pointing_v0
from swarm_mj.envs.pointing.policies import POLICIES, LawPolicy, fly, fly_policy
from swarm_mj.envs.pointing.steps import assess, no_state
from swarm_mj.envs.pointing.task import make_pointing_task

from swarm_mj.errors import ScenarioError
from swarm_mj.flight.fly import make_simulation
from swarm_mj.mission.behaviors import TargetKind
from swarm_mj.spacecraft.control.sliding_mode import MrpSlidingMode

ID = "swarm_mj.envs:SwarmPointing-v0"
SHORT = {"holds": 2, "hold_s": 10.0}


@pytest.fixture(scope="module")
def task():
    return make_pointing_task()


@pytest.fixture(scope="module")
def env():
    made = gymnasium.make(ID, **SHORT).unwrapped
    yield made
    made.close()


def test_numbers_of_numpy_and_of_python_make_one_task(task):
    again = make_pointing_task(holds=np.int64(2), references=list(REFERENCES))
    assert again.fingerprint == task.fingerprint != make_pointing_task(holds=1).fingerprint


def direction_N(batch, e=0, ahead_s=0.0):
    """From the spacecraft to its target by plain geometry, also a moment from now, shape (3,)."""
    flights, t = batch.flights, float(batch.time_s[e]) + ahead_s
    environment, r = batch.task.plan.environment, flights.state(e).r_N[0] + ahead_s * flights.state(e).v_N[0]
    target = {
        int(TargetKind.ASTEROID): np.zeros(3),
        int(TargetKind.SURFACE): environment.C_AN(t).T @ flights.flights.vector[e, 0],
        int(TargetKind.EARTH): np.asarray(environment.earth.at(t)),
        int(TargetKind.DIRECTION): r + flights.flights.vector[e, 0],
    }[int(flights.flights.kind[e, 0])]
    return (target - r) / np.linalg.norm(target - r)


def rate_left(batch, e=0):
    """Of the body relative to a frame that follows the line of sight by the shortest way [rad/s]."""
    slope = (direction_N(batch, e, 0.1) - direction_N(batch, e, -0.1)) / 0.2
    C_NB = Rotation.from_quat(batch.flights.state(e).q_BN[0], scalar_first=True)
    return np.linalg.norm(C_NB.apply(batch.flights.state(e).omega_B[0]) - np.cross(direction_N(batch, e), slope))


def boresight_N(batch, e=0):
    return Rotation.from_quat(batch.flights.state(e).q_BN[0], scalar_first=True).as_matrix()[:, 2]


@pytest.mark.parametrize("observation", ["state", "camera"])
def test_gymnasium_and_pettingzoo_find_nothing_to_object_to(observation):
    from pettingzoo.test import parallel_api_test

    made = gymnasium.make(ID, observation=observation, render_mode="rgb_array", **SHORT)
    check_env(made.unwrapped)
    assert made.unwrapped.render().shape == (384, 384, 3)
    parallel_api_test(swarm_pointing_v0.parallel_env(observation=observation, **SHORT), num_cycles=60)


@pytest.mark.parametrize("observation", ["state", "camera"])
def test_single_vector_and_agents_fly_the_same_numbers(observation):
    seed, rng = 12, np.random.default_rng(0)
    agents = swarm_pointing_v0.parallel_env(observation=observation, **SHORT)
    n = len(agents.possible_agents)
    vector = SwarmPointingVectorEnv(n, observation=observation, **SHORT)
    single = gymnasium.make(ID, observation=observation, **SHORT)
    by_agent, _ = agents.reset(options={"flight_seed": seed})
    of_all, infos = vector.reset(options={"flight_seed": seed, "spacecraft": list(range(1, n + 1))})
    of_one, info = single.reset(options={"flight_seed": seed, "spacecraft": 3})
    assert info["spacecraft"] == 3 and infos["spacecraft"].tolist() == [1, 2, 3, 4, 5]
    truncated = False
    while not truncated:
        same(by_agent["sc3"], of_one)
        same({"whole": of_all} if observation == "state" else of_all, of_one, 2)
        action = rng.uniform(-1.0, 1.0, (n, 3)).astype(np.float32)
        by_agent, rewards, _, _, told = agents.step(dict(zip(agents.agents, action, strict=True)))
        of_all, reward, _, over, infos = vector.step(action)
        of_one, one, _, truncated, info = single.step(action[2])
        assert rewards["sc3"] == reward[2] == one
        assert told["sc3"] == info and infos["error_deg"][2] == info["error_deg"]
        assert over.all() == truncated
    assert not agents.agents


def same(some, one, e=None):
    parts = one if isinstance(one, dict) else {"whole": one}
    some = some if isinstance(some, dict) else {"whole": some}
    for name, part in parts.items():
        assert np.array_equal(some[name] if e is None else some[name][e], part)


def test_an_episode_does_not_depend_on_what_flies_beside_it(task):
    alone, many, action = PointingBatch(task, 1), PointingBatch(task, 7), np.array([[0.3, -0.2, 0.05]])
    alone.reset({0: 5})
    many.reset({e: 5 if e == 4 else e for e in range(7)})
    for _ in range(30):
        alone.step(action)
        many.step(np.where(np.arange(7)[:, None] == 4, action, -action))
    assert np.array_equal(alone.numbers[0], many.numbers[4])
    assert not np.array_equal(alone.numbers[0], many.numbers[3])


def test_the_attitude_obeys_the_gyrostats_equations(task):
    """Against scipy's integration of J domega/dt = -u A - omega x (J omega + A^T h), the wheels' axes being those of B."""
    batch, rng = PointingBatch(task, 1), np.random.default_rng(3)
    batch.reset({0: 8})
    properties = task.plan.properties
    J, spin = properties.inertia_effective_B, properties.wheel_spin_inertia
    state = batch.flights.state(0)
    q, omega, wheel = (part[0].copy() for part in (state.q_BN, state.omega_B, state.wheel_speed))
    h = spin * (wheel + omega)  # absolute momentum along each axis
    y = np.concatenate([q, omega, h])
    for _ in range(20):
        action = rng.uniform(-0.2, 0.2, 3).astype(np.float32)
        u = properties.max_wheel_torque * action.astype(float)

        def rates(_, y, u=u):
            w, (a, b, c) = y[4:7], y[4:7]
            turn = 0.5 * np.array([[0, -a, -b, -c], [a, 0, c, -b], [b, -c, 0, a], [c, b, -a, 0]]) @ y[:4]
            return np.concatenate([turn, np.linalg.solve(J, -u - np.cross(w, J @ w + y[7:])), u])

        y = solve_ivp(rates, (0.0, 0.5), y, method="DOP853", rtol=1e-12, atol=1e-14).y[:, -1]
        batch.step(action[None])
    assert (
        np.abs(batch.flights.state(0).q_BN[0] * np.sign(batch.flights.state(0).q_BN[0, 0] * y[0]) - y[:4]).max() < 1e-6
    )
    assert np.allclose(batch.flights.state(0).omega_B[0], y[4:7], atol=1e-7)


def test_positions_are_those_of_the_swarms_flyby(task):
    simulation, batch = make_simulation(task.plan), PointingBatch(task, 1)
    batch.reset({0: 21}, 4)
    for _ in range(40):
        batch.step(np.zeros((1, 3)))
    simulation.fly(int(batch.flights.flights.tick[0]))
    assert np.linalg.norm(simulation.state.r_N[3] - batch.flights.state(0).r_N[0]) < 1e-6


def test_errors_and_rewards_are_those_of_plain_geometry(env):
    """The reward says what an agent does well: each term worked out anew from the state after the step."""
    task, kinds = env.task, set()
    for seed in range(8):
        env.reset(options={"flight_seed": seed})
        for k in range(40):
            aimed = int(env.batch.flights.flights.kind[0, 0])
            vector = env.batch.flights.flights.vector[0, 0].copy()
            action = np.array([0.4, -0.3, 0.02], np.float32) * np.cos(0.4 * k).astype(np.float32)
            _, reward, _, _, info = env.step(action)
            if (k + 1) % 20 == 0:
                env.batch.flights.flights.kind[0, 0], env.batch.flights.flights.vector[0, 0] = aimed, vector
            los = direction_N(env.batch)
            angle = np.arccos(np.clip(los @ boresight_N(env.batch), -1.0, 1.0))
            assert info["error_deg"] == pytest.approx(np.degrees(angle), abs=1e-5)
            terms, share = info["reward_terms"], task.config.step_s / task.duration_s
            assert terms["precise"] == pytest.approx(80.0 * share / (1.0 + angle / np.radians(2.0)), rel=1e-5)
            assert terms["coarse"] == pytest.approx(-40.0 * share * angle / np.pi, rel=1e-6)
            rate = min(1.0, rate_left(env.batch) / 0.1)
            assert terms["rate"] == pytest.approx(-10.0 * share * rate, rel=1e-4)
            assert terms["effort"] == pytest.approx(-5.0 * share * np.mean(action.astype(float) ** 2), rel=1e-6)
            assert reward == pytest.approx(sum(terms.values()))
            kinds.add(aimed)
            if (k + 1) % 20 == 0 and k < 39:
                env.batch.flights.flights.kind[0], env.batch.flights.flights.vector[0] = (
                    env.batch.kind[0, 1],
                    env.batch.vector[0, 1],
                )
    assert len(kinds) == 4


def test_observed_errors_lead_to_the_reference(env):
    """Turned back by sigma_BR, +z looks at the target that holds next, also right after a new one was given."""
    for seed in range(6):
        env.reset(options={"flight_seed": seed})
        for k in range(21):
            observation, *_ = env.step(np.array([0.1, 0.1, 0.0], np.float32))
            if k in (3, 19, 20):
                parts = env.task.layout.split(observation)
                sigma = parts["sigma_BR"].astype(float)
                half = np.arctan(np.linalg.norm(sigma))
                turned = Rotation.from_rotvec(4.0 * half * sigma / np.linalg.norm(sigma))  # from R to B
                C_NB = Rotation.from_quat(env.batch.flights.state(0).q_BN[0], scalar_first=True)
                assert np.allclose((C_NB * turned.inv()).as_matrix()[:, 2], direction_N(env.batch), atol=1e-5)
                assert parts["hold_left"][0] == pytest.approx(1.0 if k == 19 else 1.0 - ((k + 1) % 20) / 20)


def test_the_reference_rate_is_that_of_the_line_of_sight(task):
    batch = PointingBatch(task, 1)
    for seed in range(4):
        batch.reset({0: seed})
        before, seen = direction_N(batch), []
        for _ in range(2):
            batch.step(np.zeros((1, 3)))
            seen.append((direction_N(batch), batch.numbers[0].copy(), batch.flights.state(0).q_BN[0].copy()))
        (_, observation, q), (after, *_) = seen[0], seen[1]
        slope = (after - before) / 1.0
        rate_N = Rotation.from_quat(q, scalar_first=True).apply(0.01 * task.layout.split(observation)["omega_RN"])
        assert np.allclose(np.cross(rate_N, seen[0][0]), slope, atol=1e-6)


def test_a_reference_is_held_after_the_time_without_a_break_and_not_before(task):
    batch, policy = PointingBatch(task, 1), POLICIES["quick PD"]
    batch.reset({0: 2})
    run, held_at = 0, None
    for k in range(120):
        batch.step(policy(task, batch.numbers))
        run = run + 1 if np.degrees(batch.state.error[0]) <= 2.0 else 0
        if batch.state.held[0, 0] and held_at is None:
            held_at = k
            assert run == 20
        assert batch.state.held[0, 0] == (held_at is not None)
    assert held_at is not None and not batch.success[0]
    assert batch.state.steady[0] == 0  # the next reference has not been looked at


def test_a_break_begins_the_time_of_a_hold_anew(task):
    constants, state = task.constants, no_state(1, 2)
    steady = constants.steady_steps
    assert 2 * steady <= constants.hold_steps
    held = []
    for within in [True] * (steady - 1) + [False] + [True] * steady:
        error = np.array([0.9 if within else 1.1]) * constants.tolerance
        assess(constants, error, np.zeros(1), np.zeros(1), np.ones(1, np.bool_), state)
        held.append(bool(state.held[0, 0]))
    assert held == [False] * (2 * steady - 1) + [True]


def test_the_laws_beat_doing_nothing_and_anything(task):
    worth = {name: fly_policy(task, policy, 16).total_reward.mean() for name, policy in POLICIES.items()}
    assert worth["quick PD"] > worth["sliding mode"] > worth["PD"] > worth["zero"] > worth["random"]
    assert fly_policy(task, POLICIES["quick PD"], 16).held.all()


def test_a_policy_gives_what_the_law_gives_in_flight(task):
    """The law flown by the simulation itself decides of the same errors; only the line's acceleration is not observed."""
    law = MrpSlidingMode(feed_forward=False)

    def act(batch):
        return LawPolicy(law)(task, batch.numbers)

    assert fly(task, act, 4).total_reward == pytest.approx(
        fly_policy(task, POLICIES["sliding mode"], 4).total_reward, abs=0.5
    )


def test_going_back_brings_the_same_numbers_in_any_environment(env):
    env.reset(seed=4)
    actions = [env.action_space.sample() for _ in range(6)]
    for action in actions[:3]:
        env.step(action)
    state, other = env.get_state(), copy.deepcopy(env)
    first = [env.step(action) for action in actions[3:]]
    vector = SwarmPointingVectorEnv(2, **SHORT)
    vector.reset(seed=0)
    vector.set_state(1, pickle.loads(pickle.dumps(state)))
    env.set_state(state)
    for k, action in enumerate(actions[3:]):
        observation, reward, *_, info = env.step(action)
        assert np.array_equal(observation, first[k][0]) and reward == first[k][1] and info == first[k][-1]
        assert np.array_equal(other.step(action)[0], observation)
        assert np.array_equal(vector.step(np.array([action, action]))[0][1], observation)
    assert env.reset()[1]["flight_seed"] == other.reset()[1]["flight_seed"]


def test_autoreset_hands_over_the_last_observation():
    vector = SwarmPointingVectorEnv(
        2, autoreset_mode=AutoresetMode.SAME_STEP, observation="camera", holds=1, hold_s=5.0
    )
    vector.reset(seed=1)
    for _ in range(10):
        observation, _, _, truncated, infos = vector.step(np.zeros((2, 3), np.float32))
    assert truncated.all() and (observation["state"][:, -1] == 1.0).all()
    assert infos["final_obs"][1]["state"][-1] == 0.0 and infos["final_obs"][1]["image"].shape == (3, 64, 64)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ({"observation": "pixels"}, "observation"),
        ({"references": ["moon"]}, "references"),
        ({"observation": "camera", "references": ["earth"]}, "references"),
        ({"holds": 0}, "holds"),
        ({"hold_s": 0.7}, "hold_s"),
        ({"holds": 100}, "duration_s"),
        ({"step_s": 0.75}, "step_s"),
        ({"tolerance_deg": "two"}, "tolerance_deg"),
        ({"tolerance_deg": 0.0}, "tolerance_deg = 0: must be above 0"),
        ({"light": "lamp"}, "light"),
        ({"reward_weights": [1.0]}, r"reward_weights = \[1.0\]: must be a mapping"),
        ({"reward_weights": {"speed": 1.0}}, "reward_weights"),
        ({"overrides": {"dispersions.mass_percent": 1}}, "dispersions"),
        ({"overrides": ["spacecraft.mass_kg=9"]}, "overrides = .*must be a mapping of dotted keys"),
    ],
)
def test_what_does_not_fit_is_refused_by_name(arguments, said):
    with pytest.raises(Exception, match=said) as told:
        gymnasium.make(ID, **arguments)
    assert isinstance(told.value, ScenarioError)


def test_options_are_checked(env):
    for options in ({"spacecraft": 0}, {"spacecraft": 6}, {"spacecraft": "sc1"}, {"place": 1}):
        with pytest.raises(ScenarioError, match="reset option"):
            env.reset(options=options)
    with pytest.raises(ScenarioError, match="GiB"):
        SwarmPointingVectorEnv(10**9, **SHORT)
