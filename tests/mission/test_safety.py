"""Impacts and near-collisions on paths that can be worked out by hand."""

import numpy as np
import pytest

from swarm_mj.errors import MissionError, PathError
from swarm_mj.flight.environment import environment_from, load_body_shape
from swarm_mj.flight.plan import make_plan
from swarm_mj.mission import deployment
from swarm_mj.mission.safety import close_approaches, find_impacts, foreseen_impacts
from swarm_mj.scenarios.loading import load_scenario, parse_overrides, scenario_from
from swarm_mj.smallbody.shape import ShapeModel
from swarm_mj.smallbody.shape_harmonics import build_shape
from swarm_mj.smallbody.shape_io import save_shape

TIMES = np.arange(0.0, 101.0, 1.0)


def straight(start, velocity):
    return np.asarray(start) + TIMES[:, None] * np.asarray(velocity)


def test_a_path_through_the_body_hits_where_it_enters(eros):
    path = straight([0, 30e3, 0], [0, -600, 0])[:, None]
    (impact,) = find_impacts(eros, TIMES, path)
    assert impact.spacecraft == 0
    assert impact.longitude_deg == pytest.approx(90.0, abs=1.0)
    surface = eros.vertices[np.abs(eros.vertices[:, 0]) + np.abs(eros.vertices[:, 2]) < 600][:, 1].max()
    assert 30e3 - 600 * impact.time == pytest.approx(surface, abs=900)


def test_a_passage_through_a_lobe_between_two_samples_is_found(eros):
    path = np.array([[[-20e3, 0, 0]], [[20e3, 1, 1]]], float)
    assert len(find_impacts(eros, np.array([0.0, 1.0]), path)) == 1


def test_a_path_that_misses_is_no_impact(eros):
    path = np.stack((straight([-30e3, 20e3, 0], [600, 0, 0]), straight([-30e3, 0, 20e3], [600, 0, 0])), axis=1)
    assert find_impacts(eros, TIMES, path) == []


#: A ball of 1 km with the GM of a feather: flights are straight lines, from 10 km off, at 100 m/s, to points 5 km behind it.
BALL = {
    "name": "ball",
    "duration_s": 600,
    "body": {
        "name": "Ball",
        "shape": "ellipsoid",
        "semi_axes_m": [1000, 1000, 1000],
        "gravity": {"model": "point_mass", "parameters": {"gm": 1e-6}},
        "rotation": {"w_rate_deg_per_day": 0},
    },
}


@pytest.mark.parametrize("aside", [50.0, 500.0, 900.0, 980.0, 995.0, 1100.0])
def test_an_impact_is_foreseen_where_a_straight_path_is_deep_in_the_body_and_never_where_it_only_grazes(aside):
    scenario = scenario_from(BALL)
    shape = load_body_shape(scenario.body)
    environment = environment_from(scenario, shape)
    start, end = np.array([-10_000.0, aside, 0.0]), np.array([[5_000.0, aside, 0.0], [5_000.0, 9_000.0, 0.0]])
    to_N = environment.C_AN(0.0)
    found = foreseen_impacts(shape, environment, start @ to_N, end @ to_N, (0.0, 150.0), 200.0)
    if aside < 985.0:
        (impact,) = found
        # The ellipsoid's mesh lies a little below the sphere; instants are whole seconds.
        assert impact.spacecraft == 0 and impact.time == pytest.approx(100.0 - np.sqrt(1e6 - aside**2) / 100.0, abs=1.6)
    else:
        assert found == []


def test_a_path_through_the_body_is_refused_before_flights_are_solved(monkeypatch):
    """Through Eros by its polyhedron: to solve such flights takes minutes, and each step counts all faces."""
    monkeypatch.setattr(deployment, "solve_transfers", lambda *given: pytest.fail("flights are being solved"))
    changes = {"mothership.position_A_m": [0, -30_000, 0], "body.gravity": {"model": "polyhedron"}}
    with pytest.raises(PathError, match=r"sc1 hits 433 Eros at t = 32\d s, latitude 2\d.\d deg") as refused:
        make_plan(load_scenario("eros-config1", {**changes, "design.visiting_points": [7]}), check_separation=False)
    assert refused.value.spacecraft == (0,)


def test_a_near_collision_between_samples_is_found_with_its_time_and_distance():
    # They pass at t = 50.5 s, 3 m apart, at 200 m/s: 100 m apart at the nearest samples.
    first = straight([0, 0, 0], [0, 0, 0])
    second = straight([-50.5 * 200, 3, 0], [200, 0, 0])
    (approach,) = close_approaches(TIMES, np.stack((first, second), axis=1), closer_than=10.0, after=0.0)
    assert (approach.first, approach.second) == (0, 1)
    assert approach.time == pytest.approx(50.5)
    assert approach.distance == pytest.approx(3.0)


@pytest.mark.parametrize("seed", range(5))
def test_the_closest_approach_is_that_of_a_thousand_times_finer_samples(seed):
    # Curved paths with uneven samples: the closest point lies anywhere on a leg, or at an end of one.
    rng = np.random.default_rng(seed)
    times = np.cumsum(rng.uniform(0.5, 2.0, 6))
    paths = rng.normal(0.0, 300.0, (6, 2, 3))
    fine = np.linspace(times[0], times[-1], 50_001)
    relative = np.column_stack([np.interp(fine, times, paths[:, 1, k] - paths[:, 0, k]) for k in range(3)])
    distance = np.linalg.norm(relative, axis=1)
    (approach,) = close_approaches(times, paths, closer_than=1e4, after=0.0)
    assert approach.distance == pytest.approx(distance.min(), rel=1e-3)
    assert approach.time == pytest.approx(fine[distance.argmin()], abs=0.02)


def test_who_turns_away_at_a_sample_or_came_from_one_has_not_been_nearer():
    # Before and after the legs that were flown, their straight lines go through the other spacecraft.
    out_and_back = np.array(
        [[0.0, 90.0, 30.0], [100.0, 0.0, 0.0], [50.0, 0.0, 0.0], [80.0, 40.0, 0.0], [160.0, 80.0, 0.0]]
    )
    paths = np.stack((np.zeros((5, 3)), out_and_back), axis=1)
    (approach,) = close_approaches(np.arange(5.0), paths, closer_than=200.0, after=1.0)
    assert (approach.time, approach.distance) == (2.0, 50.0)


def test_only_pairs_nearer_than_allowed_are_named():
    paths = np.stack(
        (straight([0, 0, 0], [0, 0, 0]), straight([0, 9, 0], [1, 0, 0]), straight([0, 0, 30], [0, 0, 1])), axis=1
    )
    found = close_approaches(TIMES, paths, closer_than=10.0, after=0.0)
    assert [(a.first, a.second, a.distance) for a in found] == [(0, 1, 9.0)]


#: A regular octahedron: the middle of a face is as far from the corners as it can be, the edge over the square root of 3.
OCTAHEDRON = ShapeModel(
    1e4 * np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], float),
    [[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]],
)


def test_a_path_through_the_middle_of_a_large_face_hits_though_no_vertex_is_near():
    # The face's plane is x + y + z = 1e4; short legs, so that the legs' own length does not help.
    inward = -np.ones(3) / np.sqrt(3)
    times = np.arange(0.0, 100.0)
    path = (1e4 / 3 * np.ones(3) - 295.0 * inward) + 10.0 * times[:, None] * inward
    (impact,) = find_impacts(OCTAHEDRON, times, path[:, None])
    assert impact.time == 29.0
    assert impact.latitude_deg == pytest.approx(np.degrees(np.arctan(1 / np.sqrt(2))))
    assert impact.longitude_deg == pytest.approx(45.0)


def test_the_grace_time_after_deployment_is_left_out():
    apart = np.stack((straight([0, 0, 0], [1, 0, 0]), straight([0, 0, 0], [-1, 0, 0])), axis=1)
    assert close_approaches(TIMES, apart, closer_than=10.0, after=0.0)
    assert close_approaches(TIMES, apart, closer_than=10.0, after=10.0) == []


def test_a_mission_that_hits_the_asteroid_is_refused_with_place_and_time(tmp_path):
    # A polyhedron's field is finite inside the body, so that a path through it exists; a coarse mesh makes it quick.
    save_shape(build_shape("eros", 6), tmp_path / "coarse.obj")
    through = [
        f"body.shape={tmp_path / 'coarse.obj'}",
        "body.gravity={model: polyhedron, parameters: {gm: 446275.472004}}",
        "mothership.position_A_m=[0, -30000, 0]",
        "design.visiting_points=[1, 2]",
    ]
    with pytest.raises(MissionError, match=r"sc1 hits 433 Eros at t = \d+ s, latitude"):
        make_plan(load_scenario("eros-quick", parse_overrides(through)))


def test_two_spacecraft_with_the_same_point_are_reported():
    plan = make_plan(load_scenario("eros-quick", {"design.visiting_points": [12, 12]}))
    assert plan.near_collisions
    assert plan.near_collisions[0].distance == pytest.approx(0.0, abs=1e-3)
