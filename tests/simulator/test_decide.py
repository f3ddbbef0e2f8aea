"""The arithmetic of a decision: lines of sight against finite differences of the motion, motors against their limits."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from swarm_mj.mission.behaviors import TargetKind
from swarm_mj.simulator.decide import (
    actuate,
    is_finite,
    locate_targets,
    mark_new_targets,
    read_motion,
    read_rotation,
)
from swarm_mj.simulator.slots import Peak, Slot

#: A body that turns in two minutes, so that every term of the motion of its surface is large.
SPIN, POLE_N = 0.05, np.array([0.36, -0.48, 0.8])
POINT_A, EARTH_N, EARTH_VELOCITY_N = (
    np.array([7e3, -4e3, 2e3]),
    np.array([8e5, -3e5, 5e5]),
    np.array([-30.0, 400.0, 70.0]),
)
START_N = np.array([[2e4, 1e3, -3e3], [-9e3, 8e3, 1.2e4]])
VELOCITY_N = np.array([[-40.0, 7.0, 3.0], [11.0, -25.0, 30.0]])
ACCELERATION_N = np.array([[0.8, -0.3, 0.2], [-0.5, 0.9, 0.7]])
KINDS = [TargetKind.SURFACE, TargetKind.SPACECRAFT, TargetKind.EARTH, TargetKind.ASTEROID]


def to_body(t):
    """Rotation from N to A: about the pole, from an attitude that is not special."""
    first = Rotation.from_rotvec([0.3, 0.2, -0.1])
    # Components in A of what is fixed in N turn backwards.
    return (first * Rotation.from_rotvec(-SPIN * t * POLE_N)).as_matrix()


def place(j, t):
    return START_N[j] + VELOCITY_N[j] * t + 0.5 * ACCELERATION_N[j] * t**2


def target(kind, t):
    """Where the target of spacecraft 0 is in N."""
    if kind == TargetKind.SURFACE:
        return to_body(t).T @ POINT_A
    if kind == TargetKind.SPACECRAFT:
        return place(1, t)
    return EARTH_N + t * EARTH_VELOCITY_N if kind == TargetKind.EARTH else np.zeros(3)


def lines_of_sight(kind, t):
    work = np.zeros((len(Slot), 2, 3))
    for j in range(2):
        work[Slot.R, j], work[Slot.V, j] = place(j, t), VELOCITY_N[j] + t * ACCELERATION_N[j]
    work[Slot.A] = ACCELERATION_N
    kinds, followed = np.array([kind, TargetKind.ASTEROID], np.int64), np.array([1, 0])
    earth_N = EARTH_N + t * EARTH_VELOCITY_N
    points = np.tile(POINT_A, (2, 1))
    locate_targets(kinds, followed, points, earth_N, EARTH_VELOCITY_N, SPIN * POLE_N, to_body(t), work)
    return work[[Slot.RHO, Slot.RHO_DOT, Slot.RHO_DDOT], 0]


@pytest.mark.parametrize("kind", KINDS)
def test_a_line_of_sight_and_its_derivatives_are_those_of_the_motion_of_both_ends(kind):
    h, t0 = 0.5, 13.0
    away = [target(kind, t) - place(0, t) for t in t0 + h * np.arange(-2, 3)]
    first = (away[0] - 8 * away[1] + 8 * away[3] - away[4]) / (12 * h)
    second = (-away[0] + 16 * away[1] - 30 * away[2] + 16 * away[3] - away[4]) / (12 * h**2)
    rho, rho_dot, rho_ddot = lines_of_sight(kind, t0)
    np.testing.assert_allclose(rho, away[2], rtol=1e-13)
    np.testing.assert_allclose(rho_dot, first, atol=1e-5)
    np.testing.assert_allclose(rho_ddot, second, atol=1e-6)


def test_a_fixed_direction_stays_where_it_is_however_the_spacecraft_flies():
    rho, rho_dot, rho_ddot = lines_of_sight(TargetKind.DIRECTION, 5.0)
    np.testing.assert_allclose(np.cross(rho, POINT_A), 0.0, atol=1e-3)
    assert rho @ POINT_A > 0.0
    assert not rho_dot.any() and not rho_ddot.any()


def actuated(torque, speed, gain=100.0):
    """Motor torques and peaks of wheels along x, y, z with 4 mN m and 600 rad/s."""
    motor, peaks = np.empty((1, 3)), np.zeros((1, 3))
    actuate(np.array([torque], float), -np.eye(3), gain, 4e-3, 600.0, np.array([speed]), motor, peaks)
    return motor[0], peaks[0]


def test_motors_turn_against_the_torque_on_the_body_and_never_pass_their_limit():
    motors, peaks = actuated([1e-3, 1.0, -1.0], [0.0, 0.0, 0.0])
    assert motors.tolist() == [-1e-3, -4e-3, 4e-3]
    assert peaks[Peak.MOTOR_TORQUE] == 4e-3 and peaks[Peak.CUT_HOLDS] == 1


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_full_wheel_is_driven_no_further_either_way_and_can_be_braked(sign):
    full = [sign * 600.0, sign * 599.9, sign * 600.0]
    motors, peaks = actuated([-sign * 2e-3, -sign * 2e-3, sign * 2e-3], full)
    # The second has 0.1 rad/s to go, and gains 100 rad/s for each N m in a hold.
    assert motors == pytest.approx([0.0, sign * 1e-3, -sign * 2e-3], abs=1e-12)
    assert peaks[Peak.WHEEL_SPEED] == 600.0 and peaks[Peak.CUT_HOLDS] == 1
    assert actuated([0.0, 0.0, sign * 2e-3], full)[1][Peak.CUT_HOLDS] == 0


def test_a_wheel_beyond_its_top_speed_is_left_alone_but_not_driven_back():
    assert actuated([1e-3, -1e-3, 0.0], [-601.0, 601.0, 601.0])[0].tolist() == [0.0, 0.0, 0.0]


def test_the_state_is_read_with_the_momentum_of_all_wheels_and_the_place_of_the_middle_of_the_hold():
    rng = np.random.default_rng(2)
    r, v, offset, omega = rng.normal(size=(4, 2, 3))
    speed, axes = rng.normal(size=(2, 4)), rng.normal(size=(4, 3))
    work, C_mid = np.zeros((len(Slot), 2, 3)), to_body(7.0)
    read_motion(r, v, offset, C_mid, 0.25, work)
    read_rotation(omega, speed, 3e-5, axes, work)
    np.testing.assert_allclose(work[Slot.MOMENTUM], 3e-5 * speed @ axes)
    np.testing.assert_allclose(work[Slot.R_A], (r + 0.25 * v + offset) @ C_mid.T)
    for slot, values in ((Slot.R, r), (Slot.V, v), (Slot.OMEGA, omega), (Slot.WHEEL, speed[:, :3])):
        assert np.array_equal(work[slot], values)


def test_no_number_of_a_state_may_be_other_than_finite():
    for part in range(5):
        state = [np.ones((2, k)) for k in (3, 3, 4, 3, 4)]
        assert is_finite(*state)
        state[part][1, -1] = np.inf if part % 2 else np.nan
        assert not is_finite(*state)


def test_a_target_is_new_where_its_kind_or_the_spacecraft_followed_is_another():
    kind, followed = np.array([1, 1, 0, 2]), np.array([3, 2, 0, 0])
    last_kind, last, new = np.array([1, 1, 2, 2]), np.array([3, 3, 0, 0]), np.ones(4, bool)
    assert mark_new_targets(kind, followed, last_kind, last, new)
    assert new.tolist() == [False, True, True, False]
    assert np.array_equal(last_kind, kind) and np.array_equal(last, followed)
    assert not mark_new_targets(kind, np.array([4, 0, 0, 0]), last_kind, last, new)
