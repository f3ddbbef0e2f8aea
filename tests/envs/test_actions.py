"""What actions do at each level of control, and which are refused."""

import gymnasium
import numpy as np
import pytest
import trimesh

from swarm_mj.flight.fly import simulate
from swarm_mj.flight.plan import make_plan
from swarm_mj.mission.behaviors import TargetKind
from swarm_mj.scenarios.loading import load_scenario

from .flights import CENTRE, HOLD, ID, fly

SEED = 12


@pytest.fixture(scope="module", params=["torque", "pointing", "role"])
def env(request):
    env = gymnasium.make(ID, control=request.param)
    yield env
    env.close()


def test_at_the_pointing_level_the_scenarios_behaviour_still_elects_and_talks():
    env = gymnasium.make(ID, control="pointing").unwrapped
    fly(env, np.zeros(10, np.float32), SEED)
    telemetry = simulate(make_plan(load_scenario("eros-observe", [f"seed={SEED}"])))
    elected = np.flatnonzero(telemetry["mode"].values[-1] == TargetKind.EARTH)
    roles = env.observation_layout.split(env.batch.observation[0])["role"]
    assert np.array_equal(np.flatnonzero(roles[:, TargetKind.EARTH]), elected)
    assert roles[:, TargetKind.SPACECRAFT].sum() == 4
    env.close()


def test_pointing_looks_at_the_surface_point_of_its_action():
    env = gymnasium.make(ID, control="pointing").unwrapped
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
    env = gymnasium.make(ID, control="torque", step_s=10.0).unwrapped
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


def test_four_wheels_share_the_torque_that_the_action_would_exert():
    env = gymnasium.make(
        ID, scenario=load_scenario("eros-observe", ["spacecraft.wheel_layout=pyramid"]), control="torque"
    ).unwrapped
    env.reset(seed=0)
    action = np.random.default_rng(0).uniform(-0.1, 0.1, (5, 4))
    env.step(action.ravel().astype(np.float32))
    axes, motor = env.plan.properties.wheel_axes_B, env.batch.flights.ctrl.reshape(5, 4)
    assert motor @ axes == pytest.approx(0.004 * action @ axes, rel=1e-5, abs=1e-10)
    # The least of all torques with that effect: nothing in the direction that has none.
    idle = np.linalg.svd(axes.T)[2][-1]
    assert motor @ idle == pytest.approx(np.zeros(5), abs=1e-12)
    assert np.abs(0.004 * action @ idle).min() > 1e-5
    env.close()


def test_the_caller_may_change_its_action_afterwards():
    ends = []
    for spoil in (False, True):
        env = gymnasium.make(ID, control="torque")
        env.reset(seed=0)
        action = np.full(15, 0.01, np.float32)
        env.step(action)
        if spoil:
            action[:] = 1.0
        ends.append(env.step(np.zeros(15, np.float32))[0])
        env.close()
    assert np.array_equal(*ends)


def test_actions_outside_the_space_are_refused_before_anything_moves(env):
    env.reset(seed=0)
    inner, space = env.unwrapped, env.action_space
    before = inner.batch.flights.qpos.copy()
    good = space.sample()
    bad = [good[:-1], good + 100, np.full(good.shape, np.nan), "left", None]
    for action in bad:
        with pytest.raises(gymnasium.error.InvalidAction, match="action space"):
            inner.step(action)
    assert np.array_equal(inner.batch.flights.qpos, before)
    inner.step(list(good))


def test_a_choice_that_does_not_exist_is_refused_whoever_makes_it(roles):
    roles.reset(seed=0)
    for choice in (-1, 24, 10**12):
        with pytest.raises(gymnasium.error.InvalidAction, match="choices .* must be 0 to 23"):
            roles.batch.step(np.full((1, 5), choice))
    roles.batch.step(np.full((1, 5), 23))
