"""The impact watch against a test of every period, and that it seldom looks."""

import numpy as np
import pytest

from swarm_mj.flight.environment import environment_from
from swarm_mj.scenarios.loading import load_scenario
from swarm_mj.smallbody.environment import Environment, LinearMotion
from swarm_mj.smallbody.gravity.point_mass import PointMass
from swarm_mj.smallbody.impact import ImpactWatch
from swarm_mj.smallbody.shape import ShapeModel
from swarm_mj.smallbody.solid_angle import points_inside

PERIOD = 0.5


@pytest.fixture(scope="module")
def environment(eros):
    return environment_from(load_scenario("eros-quick"), eros)


def fly_straight(eros, environment, start_A, speed, ticks=4000):
    """Ticks of impact, of those looked at, for straight flights in N towards the body's centre, passing it off centre."""
    watch = ImpactWatch(eros, environment, PERIOD)
    r0 = start_A @ environment.C_AN(0.0)
    ahead = np.cross(r0, [0.3, -0.5, 0.8])
    ahead /= np.linalg.norm(ahead, axis=1, keepdims=True)
    velocity = speed * (-r0 / np.linalg.norm(r0, axis=1, keepdims=True) + 0.3 * ahead)
    flying, hits, looks = np.ones(len(r0), bool), np.full(len(r0), -1), []
    still = np.zeros_like(r0)
    for tick in range(ticks):
        r = r0 + PERIOD * tick * velocity
        if tick >= watch.due:
            looks.append(tick)
            hit = watch.look(tick, r, velocity, still, flying)
            hits[hit] = tick
            flying &= ~hit
    return hits, looks, r0, velocity


def test_impacts_are_found_at_the_period_in_which_they_happen_and_misses_are_none(eros, environment):
    rng = np.random.default_rng(8)
    directions = rng.normal(size=(12, 3))
    start = 26e3 * directions / np.linalg.norm(directions, axis=1, keepdims=True)
    hits, looks, r0, velocity = fly_straight(eros, environment, start, 20.0)
    assert (hits >= 0).sum() >= 2
    assert (hits < 0).sum() >= 2
    for j in range(len(start)):
        # Every 200 m, and both ends of the period of impact; none of these grazes.
        ticks = np.array([*range(0, hits[j] - 1, 20), hits[j] - 1, hits[j]] if hits[j] >= 0 else range(0, 4000, 20))
        path_A = np.array([environment.C_AN(PERIOD * k) @ (r0[j] + PERIOD * k * velocity[j]) for k in ticks])
        inside = points_inside(path_A, eros.vertices, eros.faces)
        assert np.flatnonzero(inside).tolist() == ([len(ticks) - 1] if hits[j] >= 0 else [])
    assert len(looks) < 1500


def test_far_away_nobody_looks(eros, environment):
    hits, looks, _, _ = fly_straight(eros, environment, np.array([[1e6, 0.0, 0.0]]), 20.0)
    assert hits[0] == -1
    assert len(looks) < 5


def test_who_starts_inside_has_hit(eros, environment):
    watch = ImpactWatch(eros, environment, PERIOD)
    hit = watch.look(
        0, np.array([[100.0, 0.0, 0.0], [4e4, 0.0, 0.0]]), np.zeros((2, 3)), np.zeros((2, 3)), np.ones(2, bool)
    )
    assert hit.tolist() == [True, False]


def test_a_fall_on_the_middle_of_a_large_face_is_found_in_its_period_and_nobody_looks_before():
    # An octahedron at rest: the middle of a face is the edge over the square root of 3 away from every corner.
    corners = 1e4 * np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], float)
    faces = [[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]]
    nowhere = LinearMotion(np.zeros(3), np.zeros(3))
    still = Environment(gravity=PointMass(1.0), C_PN=np.eye(3), phase0=0.0, spin_rate=0.0, sun=nowhere, earth=nowhere)
    watch = ImpactWatch(ShapeModel(corners, faces), still, PERIOD)
    inward = -np.ones(3) / np.sqrt(3)
    middle, speed, looks = -1e4 / np.sqrt(3) * inward, 10.0, []
    for tick in range(5000):
        # It passes the face's plane 20 km away, after 4000.5 periods.
        r = middle - (20e3 + 0.5 * PERIOD * speed - PERIOD * speed * tick) * inward
        if tick < watch.due:
            continue
        looks.append(tick)
        if watch.look(tick, r[None], speed * inward[None], np.zeros((1, 3)), np.ones(1, bool))[0]:
            break
    assert tick == 4001
    assert len(looks) < 2000


def test_who_stands_still_is_hit_by_the_turning_body_in_its_period(eros, environment):
    # 12 km from the axis, where the long ends come by and the flanks do not.
    watch, r_A = ImpactWatch(eros, environment, PERIOD), np.array([[0.0, 12e3, 0.0], [0.0, -12e3, 1e3]])
    r_N, flying, hits = r_A @ environment.C_AN(0.0), np.ones(2, bool), {}
    for tick in range(12_000):
        if tick >= watch.due:
            hit = watch.look(tick, r_N, np.zeros((2, 3)), np.zeros((2, 3)), flying)
            hits |= dict.fromkeys(np.flatnonzero(hit).tolist(), tick)
            flying &= ~hit
    for j in range(2):
        ticks = np.array([*range(0, hits[j] - 1, 100), hits[j] - 1, hits[j]])
        path_A = np.array([environment.C_AN(PERIOD * tick) @ r_N[j] for tick in ticks])
        assert np.flatnonzero(points_inside(path_A, eros.vertices, eros.faces)).tolist() == [len(ticks) - 1]
