"""The environment flies what `swarm-mj run` flies: the same attitudes, coverage and links for the same targets and seed."""

from dataclasses import dataclass, replace
from typing import ClassVar

import gymnasium
import numpy as np
import pytest
import swarm_mj.envs  # noqa: F401
import trimesh

from swarm_mj.flight.fly import simulate
from swarm_mj.flight.observe import observe_flight
from swarm_mj.flight.plan import make_plan
from swarm_mj.mission.behaviors import TargetKind, Targets
from swarm_mj.scenarios.loading import load_scenario

CENTRE, EARTH, HOLD = 16, 22, 23
SEED = 12
SEEN = ["observation.observer=horizon", f"seed={SEED}"]


@dataclass(frozen=True)
class LookAt:
    """All spacecraft look at one thing throughout."""

    kind: TargetKind
    point_A: tuple[float, float, float] = (0.0, 0.0, 0.0)
    n: int = 5
    dedicated_communications: ClassVar[bool] = False

    def targets(self, view, memory):
        return Targets(
            np.full(self.n, int(self.kind)), np.zeros(self.n, np.int64), np.tile(np.array(self.point_A), (self.n, 1))
        ), memory


def fly(env, action):
    """Fly one action to the end; all infos."""
    env.reset(seed=0, options={"flight_seed": SEED})
    infos, done = [], False
    while not done:
        *_, reward, terminated, truncated, info = env.step(action)
        infos.append(info | {"reward": reward})
        done = terminated or truncated
    return infos


@pytest.fixture(scope="module")
def roles():
    env = gymnasium.make("SwarmObserve-v0").unwrapped
    yield env
    env.close()


@pytest.mark.parametrize("patch", [None, 5, 12])
def test_a_held_role_flies_and_sees_what_the_command_line_does(roles, patch):
    fly(roles, np.full(5, CENTRE if patch is None else patch))
    plan = make_plan(load_scenario("eros-observe", SEEN))
    if patch is None:
        behavior = LookAt(TargetKind.ASTEROID)
    else:
        behavior = LookAt(TargetKind.SURFACE, tuple(roles.patches.centre_A[patch]))
    plan = replace(plan, behavior=behavior)
    telemetry = simulate(plan)
    result = observe_flight(plan, telemetry)
    assert np.array_equal(roles.state.r_BN_N, telemetry["r_BN_N"].values[-1])
    assert np.array_equal(roles.state.omega_BN_B, telemetry["omega_BN_B"].values[-1])
    assert np.array_equal(roles.first_seen_s, result.coverage.first_seen_s, equal_nan=True)
    assert roles.batch.totals.percent[0] == result.coverage.percent > 5.0


def test_at_the_pointing_level_the_scenarios_behaviour_still_elects_and_talks():
    env = gymnasium.make("SwarmObserve-v0", control="pointing").unwrapped
    fly(env, np.zeros(10, np.float32))
    telemetry = simulate(make_plan(load_scenario("eros-observe", SEEN)))
    elected = np.flatnonzero(telemetry["mode"].values[-1] == TargetKind.EARTH)
    roles = env.observation_layout.split(env.batch.observation[0])["role"]
    assert np.array_equal(np.flatnonzero(roles[:, TargetKind.EARTH]), elected)
    assert roles[:, TargetKind.SPACECRAFT].sum() == 4
    env.close()


def test_pointing_looks_at_the_surface_point_of_its_action():
    env = gymnasium.make("SwarmObserve-v0", control="pointing").unwrapped
    action = np.array([[-0.9, -0.9], [0.9, -0.9], [0.0, 0.0], [-0.9, 0.9], [0.5, -0.3]], np.float32)
    env.reset(seed=0)
    for _ in range(50):
        observation, *_ = env.step(action.ravel())
    parts = env.observation_layout.split(observation)
    assert np.linalg.norm(parts["sigma_BR"], axis=1).max() < 1e-3
    region = env.plan.region
    body = trimesh.Trimesh(region.vertices, region.faces, process=False)
    r_A = parts["position"].astype(float) * 35_000.0
    where, ray, _ = body.ray.intersects_location(r_A, parts["boresight"].astype(float), multiple_hits=False)
    assert sorted(ray) == [0, 1, 2, 3, 4]
    where = where[np.argsort(ray)]
    east, north, out = (where @ region.axes_A.T).T
    tangent = np.column_stack([east, north]) / out[:, None] / np.tan(region.side_half_angle)
    # 100 m of the target's half width of about 1.9 km: the axis lags and the coordinates are single precision.
    assert np.abs(tangent - action).max() < 0.05
    env.close()


def test_motor_torques_spin_the_wheels_up_by_the_commanded_momentum():
    env = gymnasium.make("SwarmObserve-v0", control="torque").unwrapped
    env.reset(seed=0)
    inertia = env.plan.properties.wheel_spin_inertia

    def wheel_momentum():
        return inertia * (env.state.wheel_speed + env.state.omega_BN_B)  # about its own axis, relative to N

    before = wheel_momentum()
    action = np.zeros((5, 3), np.float32)
    action[:, 0], action[2, 1] = [0.05, -0.05, 0.02, 0.0, 0.01], 0.04
    env.step(action.ravel())
    assert np.allclose(env.batch.flights.ctrl.reshape(5, 3), 0.004 * action, rtol=1e-6, atol=1e-15)
    gained = wheel_momentum() - before
    # A wheel's axial momentum changes by the motor torque plus the gyroscopic torque of a symmetric rotor, which is nil.
    assert np.allclose(gained, 0.004 * action * 10.0, atol=2e-7)
    env.close()


def test_rewards_sum_to_what_was_seen_and_delivered(roles):
    roles.reset(seed=3)
    rng = np.random.default_rng(0)
    totals, infos = dict.fromkeys(roles.reward_weights, 0.0), []
    for k in range(150):
        action = rng.integers(0, 17, 5) if k < 80 else np.array([EARTH, 17, 17, 17, 17])
        _, reward, terminated, truncated, info = roles.step(action)
        assert reward == sum(info["reward_terms"].values())
        infos.append(info)
        for name, value in info["reward_terms"].items():
            totals[name] += value
        if terminated or truncated:
            break
    assert totals["seen"] == pytest.approx(info["coverage_percent"] / 100.0, abs=1e-12)
    assert totals["delivered"] * roles.task.nominal_bit == pytest.approx(info["delivered_bit"], rel=1e-9)
    assert info["delivered_bit"] > 1e5
    assert totals["effort"] < 0.0
    # Nothing is lost on the way: what is aboard plus what was delivered only grows, and stays while nobody takes pictures.
    held = np.array([sum(i["stored_bit"]) + i["delivered_bit"] for i in infos])
    assert (np.diff(held) >= -1e-3).all()
    assert held[80:] == pytest.approx(held[-1], rel=1e-12)


def test_earth_receives_at_its_rate_and_only_while_the_dish_points_there(roles):
    roles.reset(seed=0)
    for _ in range(60):
        roles.step(np.array([5, 6, 9, 10, CENTRE]))
    open_steps = closed_steps = 0
    for _ in range(40):
        stored, before = roles.batch.totals.stored[0].copy(), roles.batch.totals.delivered[0]
        *_, info = roles.step(np.array([EARTH, HOLD, HOLD, HOLD, HOLD]))
        state = roles.state
        to_earth = roles.plan.environment.earth.at(state.t) - state.r_BN_N[0]
        angle = np.degrees(np.arccos(np.clip(state.boresight_N[0] @ to_earth / np.linalg.norm(to_earth), -1, 1)))
        expected = min(stored[0], 8e3 * 10.0) if angle < 5.0 else 0.0
        assert info["delivered_bit"] - before == pytest.approx(expected, abs=1e-6)
        open_steps, closed_steps = open_steps + (angle >= 5.0), closed_steps + (angle < 5.0)
    assert open_steps > 0 and closed_steps > 10


def test_a_spacecraft_told_to_hold_keeps_its_boresight(roles):
    roles.reset(seed=0)
    for _ in range(30):
        roles.step(np.full(5, CENTRE))
    at_order = roles.state.boresight_N
    sc2_to_itself = np.array([HOLD, CENTRE + 2, HOLD, HOLD, HOLD])
    for _ in range(20):
        roles.step(sc2_to_itself)
    turned = np.degrees(np.arccos(np.clip((roles.state.boresight_N * at_order).sum(1), -1, 1)))
    assert turned.max() < 0.05
    assert (roles.batch.flights.kind == TargetKind.DIRECTION).all()


def test_a_target_seen_and_delivered_ends_the_episode():
    env = gymnasium.make("SwarmObserve-v0", complete=2.0).unwrapped
    env.reset(seed=0)
    for k in range(150):
        action = np.full(5, 5)
        if k >= 52:
            action = np.full(5, EARTH)
        *_, terminated, truncated, info = env.step(action)
        if terminated or truncated:
            break
    assert (terminated, truncated, info["end"]) == (True, False, "complete")
    assert info["coverage_percent"] >= 2.0 and sum(info["stored_bit"]) < 1.0
    env.close()


def test_the_visit_criterion_counts_only_the_instant_of_the_visit():
    scenario = load_scenario("eros-observe", ["observation.criterion=visit", *SEEN])
    env = gymnasium.make("SwarmObserve-v0", scenario=scenario).unwrapped
    infos = fly(env, np.full(5, CENTRE))
    gains = {i["time_s"] for i in infos if i["reward_terms"]["seen"] > 0}
    assert gains == {610.0}  # the step that begins at the visit, 600 s
    plan = replace(make_plan(scenario), behavior=LookAt(TargetKind.ASTEROID))
    result = observe_flight(plan, simulate(plan))
    assert infos[-1]["coverage_percent"] == result.coverage.percent
    assert result.coverage.percent < result.passage.percent
    env.close()


def test_the_last_pictures_of_a_flight_count():
    # The flight ends at the visit, so that the pictures of the last instant, and only these, are taken.
    scenario = load_scenario("eros-observe", ["duration_s=600", "observation.criterion=visit", *SEEN])
    env = gymnasium.make("SwarmObserve-v0", scenario=scenario).unwrapped
    infos = fly(env, np.full(5, CENTRE))
    plan = replace(make_plan(scenario), behavior=LookAt(TargetKind.ASTEROID))
    result = observe_flight(plan, simulate(plan))
    assert infos[-1]["coverage_percent"] == result.coverage.percent > 5.0
    assert infos[-1]["reward_terms"]["seen"] == pytest.approx(result.coverage.percent / 100.0)
    env.close()


def test_the_observation_tells_time_positions_and_patches(roles):
    roles.reset(seed=0)
    for _ in range(60):
        observation, *_ = roles.step(np.full(5, CENTRE))
    parts = roles.observation_layout.split(observation)
    assert parts["time_left"] == pytest.approx(1.0 - 600.0 / 1500.0)
    # At 600 s every observer is at its visiting point, which the plan gives in A.
    assert np.allclose(parts["position"] * 35_000.0, roles.plan.points_A, atol=0.1 + 0.002)
    assert np.allclose(np.linalg.norm(parts["boresight"], axis=1), 1.0, atol=1e-6)
    assert np.allclose((parts["boresight"] * parts["x_axis"]).sum(1), 0.0, atol=1e-6)
    # The body's centre is looked at: boresights run against positions.
    unit = parts["position"] / np.linalg.norm(parts["position"], axis=1, keepdims=True)
    assert ((parts["boresight"] * unit).sum(1) < -0.99999).all()
    seen, area = roles.batch.totals.seen[0], roles.plan.region.area
    assert parts["patches"] @ roles.patches.area / area.sum() == pytest.approx(parts["seen"], abs=1e-6)
    assert parts["seen"] == pytest.approx(area[seen].sum() / area.sum(), abs=1e-6)


def test_velocities_are_the_rate_of_the_positions_in_the_turning_frame(roles):
    scenario = load_scenario("eros-observe")
    env = gymnasium.make("SwarmObserve-v0", scenario=scenario, step_s=0.5).unwrapped
    env.reset(seed=0)
    rows = [env.observation_layout.split(env.step(np.full(5, CENTRE))[0]) for _ in range(3)]
    state_r = [row["position"].astype(float) * 35_000.0 for row in rows]
    speed = rows[1]["velocity"].astype(float) * 50.0
    # Single precision keeps 30 km to 2 mm, over 1 s.
    assert np.allclose((state_r[2] - state_r[0]) / 1.0, speed, atol=0.01)
    env.close()


def test_what_goes_wrong_is_drawn_anew_for_every_episode_and_replays():
    changes = [
        "mass_percent=5",
        "gyro_angular_random_walk_deg_sqrt_h=0.15",
        "attitude_deg=10",
        "wheel_coulomb_n_m=1e-5",
    ]
    scenario = load_scenario("eros-observe", [f"dispersions.{change}" for change in changes])
    env = gymnasium.make("SwarmObserve-v0", scenario=scenario).unwrapped
    assert env.batch.why_python

    def fly_some(seed):
        env.reset(options={"flight_seed": seed})
        return np.array([env.step(np.full(5, CENTRE))[0] for _ in range(20)])

    first, again, other = fly_some(1), fly_some(1), fly_some(2)
    assert np.array_equal(first, again)
    assert not np.allclose(first[:, 6:9], other[:, 6:9], atol=1e-3)
    env.close()


def test_a_spacecraft_lost_to_a_fault_takes_no_more_pictures_and_the_others_go_on():
    lost = '[{"kind": "spacecraft_lost", "spacecraft": "sc2", "at_s": 200}]'
    env = gymnasium.make("SwarmObserve-v0", scenario=load_scenario("eros-observe", [f"faults={lost}"])).unwrapped
    whole = gymnasium.make("SwarmObserve-v0").unwrapped
    seen, terms = [], []
    for each in (env, whole):
        each.reset(options={"flight_seed": 3})
        for _ in range(80):
            observation, _, terminated, truncated, info = each.step(np.array([5, 6, 9, 10, CENTRE]))
            assert not (terminated or truncated)
            terms.append(info["reward_terms"]["loss"])
        seen.append(info["coverage_percent"])
    assert env.batch.totals.lost[0].tolist() == [False, True, False, False, False]
    assert 1.0 < seen[0] < seen[1]
    imaging = env.observation_layout.split(env.batch.observation[0])["imaging"].ravel()
    assert imaging.tolist() == [1.0, 0.0, 1.0, 1.0, 1.0]
    assert set(terms) == {0.0}  # a fault is nobody's mistake
    env.close()
