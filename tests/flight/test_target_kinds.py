"""Targets of a scenario: the lit part in closed form, weights in P_TO, what is never lit, aims and spread points."""

import numpy as np
import pytest

from swarm_mj.designer.candidates.flights import farthest_apart
from swarm_mj.errors import MissionError, ScenarioError
from swarm_mj.flight.environment import environment_from, epoch_state, load_body_shape
from swarm_mj.flight.light import lit_sometime
from swarm_mj.flight.plan import make_plan
from swarm_mj.flight.targets import pyramid_about, target_from, true_target
from swarm_mj.mission.behaviors import SwarmView, TargetKind
from swarm_mj.mission.target import whole_body
from swarm_mj.scenarios.loading import load_scenario
from swarm_mj.scenarios.schema import Target

LIMIT = 70.0
BALL = {
    "name": "ball",
    "duration_s": 1200,
    "body": {
        "name": "Ball", "shape": "ellipsoid", "semi_axes_m": [7e3, 7e3, 7e3],
        "gravity": {"model": "point_mass", "parameters": {"gm": 4e5}},
        # A quarter of a turn in the flight.
        "rotation": {"w_rate_deg_per_day": 360.0 * 18.0},
    },
    "target": {"region": "lit", "cell_size_m": None},
    "observation": {"max_incidence_deg": LIMIT, "interval_s": 30},
    "behavior": {"name": "adaptable_roles"},
}  # fmt: skip
FRAME = [[80, -10], [100, -10], [100, 10], [80, 10], [80, -10]]


def ball(**changes):
    return load_scenario(BALL, {key.replace("__", "."): value for key, value in changes.items()})


@pytest.fixture(scope="module")
def shape():
    return load_body_shape(ball().body)


def swept_cap(declination, limit, turn):
    """Solid angle of a cap about the subsolar point, swept by a turn of the body, by a sum over latitudes in closed form.

    At each latitude the cap spans a half-width w of longitude with cos w = (cos limit - sin d sin f) / (cos d cos f), and the
    turn adds to it.
    """
    latitude = np.linspace(-np.pi / 2, np.pi / 2, 200_001)
    with np.errstate(invalid="ignore", divide="ignore"):
        cosine = (np.cos(limit) - np.sin(declination) * np.sin(latitude)) / (np.cos(declination) * np.cos(latitude))
    half = np.arccos(np.clip(cosine, -1.0, 1.0))
    width = np.where(half > 0.0, np.minimum(2.0 * half + turn, 2.0 * np.pi), 0.0)
    return float(np.trapezoid(width * np.cos(latitude), latitude))


def sun_latitude(scenario):
    around = epoch_state(scenario)
    return float(np.arcsin((around.C_PN @ around.sun.at(0.0))[2] / np.linalg.norm(around.sun.at(0.0))))


@pytest.mark.parametrize(("lit_at", "turn"), [("passage", np.pi / 2), ("arrival", 0.0)])
def test_the_lit_part_of_a_ball_is_a_cap_swept_by_its_turn(shape, lit_at, turn):
    """Faces are lit as a whole or not: 2 per cent are the faces along the border, of 8,000."""
    scenario = ball(target__lit_at=lit_at)
    region = target_from(scenario, shape)
    exact = swept_cap(sun_latitude(scenario), np.radians(LIMIT), turn) / (4.0 * np.pi)
    assert region.total_area / shape.face_areas.sum() == pytest.approx(exact, rel=0.006)
    assert region.kind == "lit" and region.n_visiting < len(shape.vertices)


def test_the_lit_part_lies_where_the_body_has_turned_it(shape):
    scenario = ball(target__lit_at="arrival", design__time_of_flight_s=900.0)
    region, environment = target_from(scenario, shape), environment_from(scenario, shape)
    middle, sun_A = region.area @ region.normal_A, environment.C_AN(900.0) @ environment.sun.at(900.0)
    assert middle @ sun_A / (np.linalg.norm(middle) * np.linalg.norm(sun_A)) > np.cos(np.radians(1.0))


def test_what_is_lit_sometime_is_the_union_of_the_instants(shape):
    scenario, whole = ball(), whole_body(shape)
    around, times = epoch_state(scenario), np.array([0.0, 600.0, 1200.0])
    each = [lit_sometime(whole, around, times[k : k + 1], LIMIT, tracer=None) for k in range(3)]
    assert (lit_sometime(whole, around, times, LIMIT, tracer=None) == np.any(each, axis=0)).all()
    assert not np.array_equal(each[0], each[2])


def test_a_shifted_polygon_lies_as_far_from_its_plan_as_the_draw_says(shape):
    scenario = ball(target__region="polygon", target__polygon=[FRAME], dispersions__target_m=500.0, seed=3)
    planned = target_from(scenario, shape)
    moved = true_target(scenario, shape, planned)
    from swarm_mj.simulator.faults.dispersions import target_shift

    middles = [region.area @ region.centroid_A / region.total_area for region in (planned, moved)]
    assert np.linalg.norm(middles[1] - middles[0]) == pytest.approx(
        np.hypot(*target_shift(scenario.dispersions, 3)), rel=0.02
    )
    assert moved.total_area == pytest.approx(planned.total_area, rel=0.01)


def test_sweeps_take_the_pyramid_about_a_polygon_and_refuse_a_whole_body():
    about = pyramid_about(Target(region="polygon", polygon=[FRAME]))
    assert (about.latitude_deg, about.longitude_deg, about.edges) == (
        pytest.approx(0.0, abs=1e-6),
        pytest.approx(90.0),
        "side",
    )
    with pytest.raises(MissionError, match="too far around the body"):
        pyramid_about(Target(region="body"))


def test_a_target_says_once_where_it_is():
    for keys, words in (
        ({"target.region": "polygon"}, "give one of polygon and polygon_file"),
        ({"target.polygon": [FRAME]}, "says nothing with region = lit"),
        ({"dispersions.target_m": 5.0}, "must be 0 with target.region = lit"),
    ):
        with pytest.raises(ScenarioError, match=words):
            load_scenario(BALL, keys)


def test_an_observer_may_look_at_the_ground_below_its_point(shape):
    changes = {"target__region": "pyramid", "design__visiting_points": [3, 9], "design__time_of_flight_s": 600.0}
    plan = make_plan(ball(**changes, design__observers=[{"aim": "point"}, {"aim": "centre"}]), check_separation=False)
    view = SwarmView(600.0, plan.points_A, np.zeros((2, 3)), np.eye(3))
    targets, _ = plan.behavior.targets(view, None)
    assert targets.kind.tolist() == [TargetKind.SURFACE, TargetKind.ASTEROID]
    below = plan.points_A[0] * (7e3 / np.linalg.norm(plan.points_A[0]))
    assert targets.vector[0] == pytest.approx(below, abs=1.0)


def test_spread_points_are_farther_apart_than_any_is_from_them():
    """That is what makes the choice at most twice as wide as the best one (Gonzalez 1985)."""
    points = np.random.default_rng(0).normal(size=(500, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    chosen = points[farthest_apart(points, 20)]
    between = np.linalg.norm(chosen[:, None] - chosen[None], axis=2)[~np.eye(20, dtype=bool)].min()
    assert np.linalg.norm(points[:, None] - chosen[None], axis=2).min(axis=1).max() <= between
    assert farthest_apart(points, None).tolist() == farthest_apart(points, 900).tolist() == list(range(500))
