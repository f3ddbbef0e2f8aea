"""State transition matrices: closed form of a circular orbit, finite differences, the symplectic rule, composition."""

import numpy as np
import pytest

from swarm_mj.errors import MissionError
from swarm_mj.flight.plan import make_plan
from swarm_mj.mission.corrections import gravity_gradient, inverse_transition, transitions
from swarm_mj.mission.trajectories import propagate
from swarm_mj.scenarios.loading import load_scenario
from tests.relative_motion import clohessy_wiltshire

GM = 4.46e5
J = np.block([[np.zeros((3, 3)), np.eye(3)], [-np.eye(3), np.zeros((3, 3))]])


def point_mass(t, r):
    return -GM * r / np.linalg.norm(r, axis=1, keepdims=True) ** 3


def in_hill_axes(t, rate):
    """From inertial deviations to those in radial, along-track and cross-track components that turn with the orbit."""
    c, s = np.cos(rate * t), np.sin(rate * t)
    turn = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
    cross = np.array([[0, -rate, 0], [rate, 0, 0], [0, 0, 0]])
    return np.block([[turn, np.zeros((3, 3))], [-cross @ turn, turn]])


def scaled(phi, span):
    """Free of units, so that all blocks can be compared with one tolerance."""
    scale = np.repeat((1.0, span), 3)
    return phi * scale[:, None] / scale


def test_about_a_circular_orbit_it_is_the_closed_form_of_clohessy_and_wiltshire():
    radius = 30_000.0
    rate = np.sqrt(GM / radius**3)
    times = np.array([0.0, 0.3, 0.9]) * 2 * np.pi / rate
    flown = transitions(point_mass, np.array([[radius, 0, 0]]), np.array([[0, radius * rate, 0]]), times)
    for k, t in enumerate(times):
        expected = np.linalg.inv(in_hill_axes(t, rate)) @ clohessy_wiltshire(rate, t) @ in_hill_axes(0.0, rate)
        assert np.abs(scaled(flown.phi[k, 0] - expected, 1 / rate)).max() < 1e-7


@pytest.fixture(scope="module", params=["eros-config1", "bennu-slow", "fast-flyby"])
def flyby(request):
    plan = make_plan(load_scenario(request.param), check_separation=False)
    n, span = plan.n, plan.scenario.design.time_of_flight_s
    start = np.tile(plan.deployment.r0_N, (n, 1)), plan.deployment.v0_N
    flown = transitions(plan.environment.acceleration_N, *start, np.array([0.0, 0.4 * span, span]))
    return plan, flown, span


def test_every_block_is_the_finite_difference_of_flights(flyby):
    plan, flown, span = flyby
    j, step = plan.n - 1, 1e-6 * np.linalg.norm(plan.deployment.r0_N)
    change = np.diag(np.repeat((step, step / span), 3))
    states = np.concatenate((flown.r_N[0, j], flown.v_N[0, j])) + np.vstack((change, -change))
    r, v = propagate(plan.environment.acceleration_N, states[:, :3], states[:, 3:], np.array([0.0, span]))
    ends = np.concatenate((r[-1], v[-1]), axis=1)
    differences = ((ends[:6] - ends[6:]) / (2.0 * np.diag(change)[:, None])).T
    assert np.abs(scaled(differences - flown.phi[-1, j], span)).max() < 1e-7


def test_it_is_symplectic_because_the_forces_are_conservative(flyby):
    _, flown, span = flyby
    scale = np.repeat((1.0, span), 3)
    phi = flown.phi[-1] * scale[:, None] / scale
    assert np.abs(phi.swapaxes(1, 2) @ J @ phi - J).max() < 1e-10


def test_parts_of_a_flight_compose(flyby):
    plan, flown, span = flyby
    later = transitions(plan.environment.acceleration_N, flown.r_N[1], flown.v_N[1], flown.times[1:])
    assert np.abs(scaled(flown.phi[2] @ inverse_transition(flown.phi[1], span) - later.phi[-1], span)).max() < 1e-10
    assert np.abs(scaled(inverse_transition(flown.phi[-1], span) @ flown.phi[-1] - np.eye(6), span)).max() < 1e-12


def test_the_trajectory_that_carries_it_is_the_planned_one(flyby):
    plan, flown, _ = flyby
    assert np.linalg.norm(flown.r_N[-1] - plan.deployment.destination_N, axis=1).max() < 1e-3


def test_the_gradient_of_a_point_mass_is_its_closed_form():
    r = np.array([[20_000.0, -3_000.0, 7_000.0], [1e9, 2e9, -1e8]])
    distance = np.linalg.norm(r, axis=1)[:, None, None]
    expected = GM * (3.0 * r[:, :, None] * r[:, None, :] / distance**5 - np.eye(3) / distance**3)
    acceleration, gradient = gravity_gradient(point_mass, 0.0, r)
    assert np.array_equal(acceleration, point_mass(0.0, r))
    assert np.abs((gradient - expected) * distance**3 / GM).max() < 1e-8


def test_a_fall_into_a_point_mass_is_an_error():
    with pytest.raises(MissionError, match="cannot be integrated|evaluations reached"):
        transitions(point_mass, np.array([[10.0, 0, 0]]), np.zeros((1, 3)), np.array([0.0, 1e4]))
