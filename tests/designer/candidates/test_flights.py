"""Candidates are turned as spacecraft are commanded: towards what they look at, and without needless roll."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from swarm_mj.designer.candidates.flights import fly_candidates
from swarm_mj.scenarios.loading import load_scenario, parse_overrides

SWEEP = "behavior={name: target_sweep, parameters: {surface_radius_m: 8000, rows: 3, dwell_s: 60}}"


def shortest_turn(q_from, direction):
    """The attitude with +z on a direction that is nearest to another attitude."""
    z = q_from.apply([0.0, 0.0, 1.0])
    axis = np.cross(z, direction)
    angle = np.arctan2(np.linalg.norm(axis), z @ direction)
    return Rotation.from_rotvec(angle * axis / np.linalg.norm(axis)) * q_from


@pytest.fixture(scope="module", params=[(), (SWEEP,)], ids=["centre", "sweep"])
def flights(request):
    overrides = ["observation.criterion=arrival", "target.cell_size_m=null", "telemetry.interval_s=20", *request.param]
    return fly_candidates(load_scenario("eros-quick", parse_overrides(overrides)))


def aims_A(flights, k):
    """What candidates look at at one time, shape (n, 3) [m]."""
    plan, t = flights.plan, float(flights.times[k])
    points = getattr(plan.behavior, "points_A", None)
    if points is None:
        return np.zeros((flights.n, 3))
    start = np.arange(plan.behavior.n_observers) * len(points) // plan.behavior.n_observers
    return points[(start + int(t / 60.0)) % len(points)][: flights.n]


def test_cameras_look_at_what_their_behavior_names(flights):
    for k in np.flatnonzero(flights.observing.any(axis=1)):
        who = flights.observing[k]
        way = (aims_A(flights, k) - flights.r_A[k])[who]
        ahead = way / np.linalg.norm(way, axis=1, keepdims=True)
        np.testing.assert_allclose(flights.C_CA[k, who, 2], ahead, atol=1e-12)


def test_cameras_come_to_their_directions_by_shortest_turns_in_inertial_space(flights):
    environment = flights.plan.environment
    for j in (0, 17, flights.n - 1):
        q = Rotation.identity()
        for k, t in enumerate(flights.times):
            C_AN = environment.C_AN(float(t))
            aim = aims_A(flights, k)[j] if flights.observing[k, j] else np.zeros(3)
            way = (aim - flights.r_A[k, j]) @ C_AN
            q = shortest_turn(q, way / np.linalg.norm(way))
            np.testing.assert_allclose(flights.C_CA[k, j], q.as_matrix().T @ C_AN.T, atol=1e-9)


def test_the_visiting_points_are_reached_at_the_time_of_flight_and_speeds_are_relative_to_the_mothership(flights):
    deployment = flights.plan.deployment
    k = int(np.flatnonzero(flights.times == flights.plan.scenario.design.time_of_flight_s)[0])
    assert np.linalg.norm(flights.r_A[k] - flights.plan.points_A, axis=1).max() < 1e-3
    relative = deployment.v0_N[: flights.n] - deployment.mothership_velocity_N
    np.testing.assert_allclose(flights.delta_v, np.linalg.norm(relative, axis=1))


def test_a_replaced_seed_changes_no_candidate():
    scenario = load_scenario(
        "eros-quick", {"observation.criterion": "arrival", "dispersions.deployment_velocity_m_s": 1}
    )
    first, second = (fly_candidates(scenario.model_copy(update={"seed": seed})) for seed in (1, 2))
    assert np.array_equal(first.r_A, second.r_A)
