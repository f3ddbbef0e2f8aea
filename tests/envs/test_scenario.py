"""SwarmObserve-v0 over one flyby of one's own: that of `swarm-mj fly`, with rewards, data and faults as documented."""

import copy
import json
import pickle
from dataclasses import dataclass, replace
from typing import ClassVar

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from pettingzoo.test import parallel_api_test
from swarm_mj.envs.observe.config import EnvConfig
from swarm_mj.envs.observe.episodes import Episodes
from swarm_mj.envs.observe.parallel import SwarmObserveParallelEnv
from swarm_mj.envs.policies.baselines import greedy

from swarm_mj.flight.fly import simulate
from swarm_mj.flight.plan import make_plan
from swarm_mj.mission.behaviors import TargetKind, Targets
from swarm_mj.observation.capture import lit_cells, observe
from swarm_mj.observation.raycast import RayTracer
from swarm_mj.scenarios.loading import load_scenario, parse_overrides

ID = "swarm_mj.envs:SwarmObserve-v0"
EARTH, N = 16, 5
HOLD = 17 + np.arange(N)
KERNEL = ["physics.stepper=kernel"]


def eros(*changes):
    """The flyby of `eros-observe`, changed."""
    return load_scenario("eros-observe", parse_overrides(changes))


def begun(count=1, seeds=(12, 13, 14), given=None, **arguments):
    """Episodes of that flyby."""
    episodes = Episodes(EnvConfig(**{"scenario": eros()} | arguments), count)
    episodes.reset(dict(enumerate(seeds[:count])), given)
    return episodes


def step(episodes, choice):
    """The same choice in every episode."""
    return episodes.fly(np.tile(choice, (episodes.count, 1)), np.ones(episodes.count, np.bool_))


@pytest.fixture(scope="module")
def flown():
    """Two episodes flown by the greedy rule, decision by decision: tables, results, facts, and the episodes."""
    episodes, tables, results, facts = begun(2), [], [], []
    tables.append(episodes.entities())
    for _ in range(75):
        results.append(episodes.fly(greedy(tables[-1]), np.ones(2, np.bool_)))
        tables.append(episodes.entities())
        facts.append(episodes.infos())
    yield tables, results, facts, episodes
    episodes.close()


@dataclass(frozen=True)
class LookAt:
    """The behaviour of a swarm that looks at one point of the body throughout."""

    point_A: tuple[float, ...]
    dedicated_communications: ClassVar[bool] = False

    def targets(self, view, memory):
        points = np.tile(np.array(self.point_A), (N, 1))
        return Targets(np.full(N, int(TargetKind.SURFACE)), np.zeros(N, np.int64), points), memory


def test_an_episode_is_the_flight_of_the_command_line_with_that_seed():
    episodes = begun()
    mission = episodes.mission_of(0)
    for _ in range(40):
        step(episodes, np.full(N, 5))
    plan = make_plan(eros("seed=12", "telemetry.interval_s=0.5", *KERNEL))
    telemetry = simulate(replace(plan, behavior=LookAt(tuple(mission.patches.centre_A[5]))))
    r_N = telemetry["r_BN_N"].values[int(np.argmin(abs(telemetry["time"].values - 800.0)))]
    assert episodes.now.r[0] == pytest.approx(r_N, abs=1e-6)
    episodes.close()


def test_cells_are_seen_where_the_observer_itself_sees_them():
    """Picture by picture, with the observer and the criterion of the scenario in the place of compiled maps."""
    episodes = begun()
    mission = episodes.mission_of(0)
    seen = np.zeros(mission.plan.region.n_cells, np.bool_)
    taken = episodes.take_pictures

    def judged(due):
        taken(due)
        now = episodes.now
        for j in range(N):
            C_CA = now.C_BN[0, j] @ now.C_AN[0].T
            sun_A = now.C_AN[0] @ mission.plan.environment.sun.at(float(now.t[0]))
            seen[:] |= observe(mission.observer, now.r_A[0, j], C_CA, mission.criterion, sun_A)

    episodes.take_pictures = judged
    for k in range(45):
        step(episodes, np.full(N, (k // 3) % 16))
    assert seen.sum() > 30
    assert np.array_equal(seen, episodes.totals.seen[0])
    episodes.close()


def test_rewards_add_up_and_every_bit_is_aboard_or_on_earth(flown):
    _, results, facts, episodes = flown
    terms, mission = np.sum([result.terms for result in results], axis=0), episodes.mission_of(0)
    for result in results:
        assert result.reward == pytest.approx(result.terms.sum(axis=1), abs=1e-15)
    yardstick = episodes.sheet.yardstick_area / mission.plan.region.total_area
    assert (0.5 < yardstick).all() and (yardstick <= 1.0).all()
    assert terms[:, 0] == pytest.approx(facts[-1]["coverage_percent"] / 100.0, rel=1e-9)
    assert terms[:, 1] == pytest.approx(facts[-1]["delivered_bit"] / (mission.nominal_bit * yardstick), rel=1e-9)
    for told in facts:
        held = told["stored_bit"].sum(axis=1) + told["delivered_bit"] + told["lost_bit"]
        assert held == pytest.approx(told["seen_bit"], rel=1e-9)
    assert (terms[:, 0] > 0.6).all() and (terms[:, 1] > 0.2).all() and not facts[-1]["lost_bit"].any()


def test_the_yardstick_of_area_is_what_planned_paths_pass_within_reach(flown):
    _, _, _, episodes = flown
    totals = episodes.totals
    mission = episodes.mission_of(0)
    reached = mission._passed.any(axis=0)
    assert (totals.seen[:, : len(reached)] <= reached).all()
    assert episodes.sheet.yardstick_area == pytest.approx(mission.patches.cell_area[reached].sum())


def test_the_rays_of_a_time_are_traced_once_whatever_was_asked_before(monkeypatch):
    first_hit, asked = RayTracer.first_hit, []
    monkeypatch.setattr(RayTracer, "first_hit", lambda *rays: asked.append(rays) or first_hit(*rays))
    for times in ((0.0, 15000.0), (15000.0, 0.0)):  # all is lit, and two cells are
        mission = EnvConfig(scenario=eros()).make_mission(0)
        for t in (*times, 14321.5):
            mission.lit_at(t)
        asked.clear()
        lit = [mission.lit_at(t) for t in (*times, *times)]
        mission.lit_at(14321.5)
        assert not asked
        world = mission.plan.environment
        suns = [world.C_AN(t) @ world.sun.at(t) for t in (*times, *times)]
        fresh = [lit_cells(mission.observer, mission.criterion, sun_A) for sun_A in suns]
        assert np.array_equal(lit, fresh) and not np.array_equal(lit[0], lit[1])
        mission.close()


def test_a_full_spacecraft_loses_what_its_pictures_bring_and_the_cells_count_as_seen():
    episodes = begun(scenario=eros("data.storage_bit=5000"))
    for k in range(35):
        step(episodes, np.array([5 + k // 18, *HOLD[1:]]))
    told = episodes.info(0)
    assert told["seen_bit"] > 10_000.0 and told["coverage_percent"] > 0.1
    assert told["stored_bit"] == [5000.0, 0.0, 0.0, 0.0, 0.0]
    assert told["lost_bit"] == pytest.approx(told["seen_bit"] - 5000.0, rel=1e-9)
    episodes.close()


def test_who_hits_the_body_is_lost_and_the_others_fly_on():
    episodes = begun()
    mission = episodes.mission_of(0)
    inner, k = episodes.flights._of(0)
    for _ in range(2):
        step(episodes, HOLD)
    now = inner.batch.state(k)
    qpos, qvel = np.hstack((now.r_N, now.q_BN)), np.hstack((now.v_N, now.omega_B, now.wheel_speed))
    # Straight for the centre, so near that it arrives within the decision.
    qpos[2, :3] *= 1.5 * mission.plan.shape.max_radius / np.linalg.norm(qpos[2, :3])
    qvel[2, :3] = -qpos[2, :3] / 20.0
    inner.batch.place(k, qpos, qvel)
    result = step(episodes, HOLD)
    step(episodes, HOLD)
    result = step(episodes, HOLD) if not episodes.totals.lost.any() else result
    assert episodes.totals.lost[0].tolist() == [False, False, True, False, False]
    assert result.end[0] == 0 and not result.terms.any()
    episodes.close()


def test_faults_of_the_scenario_happen_and_its_camera_takes_no_more_pictures():
    faults = [{"kind": "spacecraft_lost", "spacecraft": "sc2", "at_s": 100}]
    faults.append({"kind": "camera_off", "spacecraft": "sc1", "at_s": 50})
    episodes = begun(scenario=eros(f"faults={json.dumps(faults)}"))
    for _ in range(8):
        step(episodes, np.full(N, 5))
    table = episodes.entities()["spacecraft"][0]
    assert table[:, 0].tolist() == [1, 0, 1, 1, 1] and table[0, 1] == 0.0
    assert episodes.info(0)["alive"] == [True, False, True, True, True]
    episodes.close()


def test_agents_are_shown_what_the_flight_software_knows_and_rewards_follow_the_truth():
    noise = ["spacecraft.sensors={gyro_angular_random_walk_deg_sqrt_h: 5, star_tracker_noise_arcsec: 1800}"]
    episodes = begun(scenario=eros(*noise))
    for _ in range(30):
        step(episodes, np.full(N, 5))
    mission, table = episodes.mission_of(0), episodes.entities()["spacecraft"][0]
    believed = episodes.estimate.C_BN[0, :, 2] @ episodes.now.C_AN[0].T @ mission.axes_A.T
    true = episodes.now.C_BN[0, :, 2] @ episodes.now.C_AN[0].T @ mission.axes_A.T
    assert table[:, 16:19] == pytest.approx(believed, abs=1e-6)
    assert (np.linalg.norm(believed - true, axis=1) > 1e-5).all()
    episodes.close()


def test_it_is_an_environment_of_gymnasium_and_pettingzoo_and_states_are_taken_up():
    env = gymnasium.make(ID, scenario="eros-observe", candidates=4, observation="flat").unwrapped
    check_env(env, skip_render_check=True)
    env.reset(seed=3)
    for _ in range(10):
        env.step(np.zeros(N, np.int64))
    state, twin = env.get_state(), pickle.loads(pickle.dumps(env))
    vector = gymnasium.make_vec(ID, num_envs=3, scenario="eros-observe", candidates=4, threads=2, observation="flat")
    vector.reset(seed=1)
    vector.set_state(2, state)
    for k in range(6):
        observation, reward, *_ = env.step(np.full(N, k % 5))
        rows, rewards, *_ = vector.step(np.full((3, N), k % 5))
        assert np.array_equal(rows[2], observation) and rewards[2] == reward
        assert np.array_equal(twin.step(np.full(N, k % 5))[0], observation)
    for one in (env, twin, vector):
        one.close()
    agents = SwarmObserveParallelEnv(scenario="eros-observe")
    parallel_api_test(agents, num_cycles=80)
    agents.close()


def test_by_the_graph_agents_know_what_has_reached_them():
    near = SwarmObserveParallelEnv(scenario="eros-observe", knowledge="graph", observation="entities")
    apart = SwarmObserveParallelEnv(scenario=eros("link.max_range_m=1"), knowledge="graph", observation="entities")
    full = SwarmObserveParallelEnv(scenario="eros-observe", knowledge="full", observation="entities")
    begun, *_ = (env.reset(options={"flight_seed": 4})[0] for env in (near, apart, full))
    kept = copy.deepcopy(begun)
    for k in range(32):
        choice = {agent: (k // 4 + j) % 16 for j, agent in enumerate(full.agents)}
        shown, others, told = (env.step(choice)[0] for env in (near, apart, full))
    # What was shown once stays as it was.
    assert all(np.array_equal(part, kept["sc1"][name]) for name, part in begun["sc1"].items())
    # All hear one another: they know all.
    for agent, own in told.items():
        for name, part in own.items():
            assert shown[agent][name] == pytest.approx(part, abs=1e-6), (agent, name)
    # Nobody hears anybody: what oneself has seen, and the others flying straight on, as they were turned at the release.
    seen = {agent: 1.0 - part["patches"][:, 0] for agent, part in others.items()}
    assert sum(part.sum() for part in seen.values()) > 0.0 and len({part.tobytes() for part in seen.values()}) > 1
    assert others["sc1"]["others"][0, 10:13] == pytest.approx(told["sc1"]["others"][0, 10:13], abs=0.05)
    assert others["sc1"]["others"][0, 16:19] != pytest.approx(told["sc1"]["others"][0, 16:19], abs=0.05)
    state = apart.get_state()
    again = apart.set_state(pickle.loads(pickle.dumps(state)))
    for agent, part in again.items():
        assert all(np.array_equal(part[name], others[agent][name]) for name in part)
    for env in (near, apart, full):
        env.close()


def test_a_dedicated_communications_spacecraft_takes_no_pictures_and_has_no_worth():
    episodes = Episodes(EnvConfig(scenario="bennu-slow"), 1)
    episodes.reset({0: 3})
    for _ in range(20):
        episodes.fly(np.full((1, 4), 5), np.ones(1, np.bool_))
    tables = episodes.entities()
    assert episodes.n == 4 and tables["spacecraft"][0, :, 1].tolist() == [1, 1, 1, 0]
    assert not tables["pairs"][0, 3, :, 0].any() and (episodes.totals.first_by[0] < 3).all()
    episodes.close()
