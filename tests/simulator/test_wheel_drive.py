"""Friction against the differential equation, allocation against linear algebra, motors against their limits."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from swarm_mj.simulator.wheel_drive import WheelState, drive
from swarm_mj.spacecraft.wheels import allocate, speed_after

J = 2.4e-5


def integrate(speed, motor, coulomb, viscous, time):
    """Friction that is smooth within 1e-4 rad/s of rest, by an implicit integrator."""
    right = lambda _, w: (motor - coulomb * np.tanh(w / 1e-4) - viscous * w) / J  # noqa: E731
    return solve_ivp(right, (0, time), [speed], method="Radau", rtol=1e-9, atol=1e-9).y[0, -1]


@pytest.mark.parametrize(
    ("speed", "motor", "coulomb", "viscous"),
    [
        (300.0, 0.0, 2e-4, 0.0),
        (300.0, 0.0, 0.0, 1e-5),
        (-300.0, 0.0, 2e-4, 1e-5),
        (2.0, 0.0, 2e-4, 1e-6),
        (5.0, -1e-3, 2e-4, 1e-6),
        (-5.0, 1e-3, 2e-4, 0.0),
        (0.0, 1e-3, 2e-4, 1e-5),
        (0.0, 1e-4, 2e-4, 1e-5),
        (100.0, 3e-3, 2e-4, 1e-5),
        (1.0, 1e-4, 2e-4, 1e-6),
    ],
)
def test_wheel_speed_under_friction_is_that_of_the_differential_equation(speed, motor, coulomb, viscous):
    expected = integrate(speed, motor, coulomb, viscous, 0.5)
    assert speed_after(speed, motor, coulomb, viscous, J, 0.5) == pytest.approx(expected, abs=2e-4, rel=1e-7)


def test_without_friction_a_wheel_keeps_its_speed_and_many_short_holds_give_what_one_long_hold_gives():
    assert speed_after(100.0, 0.0, 0.0, 0.0, J, 10.0) == 100.0
    speed = 100.0
    for _ in range(100):
        speed = speed_after(speed, 1e-5, 3e-5, 1e-6, J, 0.5)
    assert speed == pytest.approx(speed_after(100.0, 1e-5, 3e-5, 1e-6, J, 50.0), rel=1e-9)


PYRAMID = np.array([[1, 1, 1], [-1, 1, 1], [-1, -1, 1], [1, -1, 1]]) / np.sqrt(3)
SKEWED = np.vstack((np.eye(3), np.ones(3) / np.sqrt(3)))


@pytest.mark.parametrize("axes", [PYRAMID, SKEWED])
@pytest.mark.parametrize("lost", range(4))
def test_any_three_of_four_wheels_give_every_torque_and_the_lost_one_nothing(axes, lost):
    healthy = np.arange(4) != lost
    allocation = allocate(axes, healthy)
    assert (allocation[lost] == 0).all()
    assert np.allclose(-axes.T @ allocation, np.eye(3), atol=1e-12)


def test_four_wheels_share_a_torque_with_the_least_sum_of_squares():
    rng, torque = np.random.default_rng(1), np.array([1.0, -2.0, 0.5])
    best = allocate(PYRAMID, np.ones(4, bool)) @ torque
    null = np.linalg.svd(PYRAMID.T)[2][3]
    assert np.allclose(-PYRAMID.T @ best, torque)
    assert all(np.linalg.norm(best) < np.linalg.norm(best + k * null) for k in rng.normal(size=5))


def test_with_two_wheels_the_torque_they_span_is_as_asked_and_with_none_nothing_is():
    allocation = allocate(np.eye(3), np.array([True, False, True]))
    assert np.allclose(-np.eye(3) @ allocation @ [1.0, 2.0, 3.0], [1.0, 0.0, 3.0])
    assert not allocate(np.eye(3), np.zeros(3, bool)).any()


def driven(torque, speed, **changes):
    n, w = speed.shape
    none, allocation = np.zeros((n, w)), -np.tile(np.eye(3), (n, 1, 1))
    inertia, motor, bearing = np.full((n, w), J), np.empty((n, w)), np.empty((n, w))
    wheels = WheelState(
        none + 1.0, none > 0, none, none, none, allocation, inertia, motor, bearing, none == 0
    )._replace(**changes)
    drive(torque, wheels, speed, 0.5, 4e-3, 600.0, np.zeros(n, bool), np.zeros((n, 3)))
    return motor, bearing


def test_a_healthy_wheel_gives_what_is_asked_a_weakened_one_its_part_a_lost_one_nothing():
    motor, bearing = driven(np.full((1, 3), 1e-3), np.zeros((1, 3)), effectiveness=np.array([[1.0, 0.3, 0.0]]))
    assert np.allclose(motor, [[-1e-3, -3e-4, 0.0]])
    assert np.allclose(bearing, 0.0)


def test_no_motor_passes_its_limits_and_a_full_wheel_is_not_pushed_further():
    motor, _ = driven(np.array([[1.0, -1.0, 1e-3]]), np.array([[0.0, 0.0, -600.0]]))
    assert np.allclose(motor, [[-4e-3, 4e-3, 0.0]])


def test_a_stuck_wheel_ignores_its_command_and_is_brought_back_to_its_speed():
    stuck, held = np.array([[True, False, False]]), np.array([[250.0, 0.0, 0.0]])
    motor, _ = driven(np.full((1, 3), 1e-3), np.array([[250.0, 0.0, 0.0]]), stuck=stuck, stuck_speed=held)
    assert motor[0, 0] == 0.0
    motor, _ = driven(np.full((1, 3), 1e-3), np.array([[249.0, 0.0, 0.0]]), stuck=stuck, stuck_speed=held)
    assert 249.0 + motor[0, 0] * 0.5 / J == pytest.approx(250.0)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_wheel_reaches_its_top_speed_and_no_more_whichever_way_it_turns(sign):
    speed = sign * np.array([[600.0, 599.9, 600.0]])
    motor, _ = driven(-sign * np.array([[2e-3, 2e-3, -2e-3]]), speed)
    after = speed + motor * 0.5 / J
    assert after[0, :2] == pytest.approx([sign * 600.0] * 2, abs=1e-9)
    assert motor[0, 2] == pytest.approx(-sign * 2e-3)


def test_bearings_take_the_momentum_that_the_friction_law_says():
    speed = np.array([[300.0, -300.0, 200.0]])
    coulomb, viscous = np.array([[2e-4, 2e-4, 0.0]]), np.array([[0.0, 0.0, 1e-5]])
    motor, bearing = driven(np.array([[-1e-3, 1e-3, 0.0]]), speed, coulomb=coulomb, viscous=viscous)
    # Dry friction is constant far from rest; under viscous friction alone the speed falls exponentially.
    decayed = 200.0 * (np.exp(-1e-5 * 0.5 / J) - 1.0)
    assert motor[0] == pytest.approx([1e-3, -1e-3, 0.0])
    assert bearing[0] == pytest.approx([-2e-4, 2e-4, J * decayed / 0.5], rel=1e-9)


def test_a_dead_spacecraft_drives_no_wheel_but_friction_goes_on():
    none = np.zeros((1, 3))
    wheels = WheelState(
        none + 1,
        none > 0,
        none,
        none + 2e-4,
        none,
        -np.eye(3)[None],
        none + J,
        np.empty((1, 3)),
        np.empty((1, 3)),
        none == 0,
    )
    peaks = np.zeros((1, 3))
    drive(np.full((1, 3), 1.0), wheels, none + 300.0, 0.5, 4e-3, 600.0, np.ones(1, bool), peaks)
    assert not wheels.motor.any() and wheels.bearing == pytest.approx(-2e-4)
    assert peaks[0].tolist() == [300.0, 0.0, 0.0]


def test_a_swarms_wheels_are_driven_as_those_of_each_spacecraft_alone():
    """Stuck, weak, dry, oily and standing wheels beside each other, by compiled code and by Python one at a time."""
    rng, (n, w) = np.random.default_rng(4), (11, 4)
    some = lambda share: rng.random((n, w)) < share  # noqa: E731
    state = WheelState(
        np.where(some(0.3), rng.random((n, w)), 1.0),
        some(0.15),
        300.0 * rng.normal(size=(n, w)),
        np.where(some(0.6), 2e-4 * rng.random((n, w)), 0.0),
        np.where(some(0.4), 1e-5 * rng.random((n, w)), 0.0),
        rng.normal(size=(n, w, 3)),
        J * (1.0 + 0.1 * rng.random((n, w))),
        *np.full((2, n, w), np.nan),
        np.ones((n, w), bool),
    )
    torque, speed = 2e-3 * rng.normal(size=(n, 3)), np.where(some(0.2), 0.0, 10.0 ** rng.uniform(-1, 2.7, (n, w)))
    dead, found = np.arange(n) == 6, []
    for function in (drive, drive.py_func):
        ours = WheelState(*(part.copy() for part in state))
        peaks = np.zeros((n, 3))
        function(torque, ours, speed * np.sign(state.allocation[:, :, 0]), 0.5, 4e-3, 600.0, dead, peaks)
        found.append((ours.motor, ours.bearing, peaks))
    for compiled, python in zip(*found, strict=True):
        assert np.isfinite(python).all() and np.array_equal(compiled, python)
    assert (found[0][2][:, 2] > 0).any() and not found[0][0][6, ~state.stuck[6]].any()
