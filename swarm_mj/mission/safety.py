"""Dangers of a planned flight: impact with the asteroid and near-collisions inside the swarm."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from scipy.spatial import cKDTree

from swarm_mj.errors import MissionError
from swarm_mj.mission.trajectories import ROUGH, propagate, rough_transfers
from swarm_mj.smallbody.environment import Environment
from swarm_mj.smallbody.occultation import segments_blocked
from swarm_mj.smallbody.rotation import sub_point
from swarm_mj.smallbody.shape import ShapeModel
from swarm_mj.smallbody.solid_angle import points_inside
from swarm_mj.typing import Array, Mask

#: Time between the points at which a planned flight is checked for impact and near-collision [s], and how many at most.
CHECK_INTERVAL_S, MAX_CHECKS = 1.0, 100_000
#: Points of a straight line at which it is looked whether a flight may lead into the body.
STRAIGHT_CHECKS = 2000
#: Of the largest radius: a ball that lies inside the body about a place on a path is proof of an impact; and how far past the
#: surface such places are looked for, in these radii.
SURE, DEPTHS = 0.01, (2.0, 5.0, 10.0, 20.0, 40.0, 80.0)


@dataclass(frozen=True)
class Impact:
    """A spacecraft enters the body."""

    spacecraft: int
    time: float
    latitude_deg: float
    longitude_deg: float


@dataclass(frozen=True)
class CloseApproach:
    """The least distance of two spacecraft after the grace time."""

    first: int
    second: int
    time: float
    distance: float


def check_times(duration_s: float) -> Array:
    """Instants at which a flight is checked [s], from 0 to its end.

    They are a grid of their own, so that what is found does not depend on how much telemetry is asked for.
    """
    return np.linspace(0.0, duration_s, 1 + min(MAX_CHECKS, max(1, round(duration_s / CHECK_INTERVAL_S))))


def find_impacts(shape: ShapeModel, times: Array, r_A: Array) -> list[Impact]:
    """First impact of every spacecraft that hits the body.

    The path between samples is taken as straight; where it first crosses the surface, it hits.

    Args:
        shape: The body.
        times: Shape (t,) [s].
        r_A: Positions in A, shape (t, n, 3) [m].
    """
    near = _near_surface(shape, r_A)
    impacts = []
    for j in range(r_A.shape[1]):
        path = np.ascontiguousarray(r_A[:, j])
        crossing = np.zeros(len(path), dtype=np.bool_)
        crossing[:1] = points_inside(path[:1], shape.vertices, shape.faces)
        legs = np.flatnonzero(near[:, j])
        crossing[legs] |= segments_blocked(path[legs], path[legs + 1], shape.vertices, shape.faces, shape.max_radius)
        if crossing.any():
            k = int(np.argmax(crossing))
            impacts.append(Impact(j, float(times[k]), *sub_point(path[k], np.eye(3))))
    return impacts


def foreseen_impacts(
    shape: ShapeModel,
    environment: Environment,
    r0_N: Array,
    destinations_N: Array,
    span: tuple[float, float],
    end_s: float,
) -> list[Impact]:
    """First impacts of flights that surely lead into the body, found long before `solve_transfers` finds those flights.

    Inside the body a polyhedron's field has kinks at every face, between which the integrator takes small steps. So paths whose
    straight line crosses the body are found roughly. One is believed to hit where a ball about a place on it that is far larger
    than its error lies inside the body.

    Args:
        shape: The body.
        environment: Forces, and how the body turns.
        r0_N: Common start, shape (3,) [m].
        destinations_N: Shape (n, 3) [m].
        span: Start and arrival, past the epoch [s].
        end_s: Until when they fly on [s].
    """
    start, arrival = span
    v0 = (destinations_N - r0_N) / (arrival - start)
    times = np.linspace(start, end_s, STRAIGHT_CHECKS)
    straight_A = _in_body(environment, times, r0_N + (times - start)[:, None, None] * v0)
    near = np.array([impact.spacecraft for impact in find_impacts(shape, times, straight_A)], np.int64)
    if not len(near):
        return []
    times = start + check_times(end_s - start)

    def forces(t: float, r_N: Array) -> Array:
        return environment.acceleration_N(start + t, r_N)

    try:
        v0, misses = rough_transfers(forces, r0_N, destinations_N[near], arrival - start)
        r_N, _ = propagate(forces, np.tile(r0_N, (len(near), 1)), v0, times - start, rtol=ROUGH)
    except MissionError:
        return []
    r_A, sure = _in_body(environment, times, r_N), SURE * shape.max_radius
    return [
        replace(impact, spacecraft=int(near[impact.spacecraft]))
        for impact in find_impacts(shape, times, r_A)
        if misses[impact.spacecraft] < 0.1 * sure and _deep(shape, r_A[times >= impact.time, impact.spacecraft], sure)
    ]


def _in_body(environment: Environment, times: Array, r_N: Array) -> Array:
    """Positions in A of those in N at some times, each of shape (t, n, 3)."""
    return np.einsum("kij,knj->kni", np.array([environment.C_AN(t) for t in times]), r_N)


def _deep(shape: ShapeModel, path_A: Array, radius: float) -> bool:
    """Whether a ball of a radius [m] about a place of a path lies inside the body, by six points on it."""
    steps = np.linalg.norm(np.diff(path_A, axis=0), axis=1).cumsum()
    places = path_A[1:][np.unique(np.searchsorted(steps, radius * np.array(DEPTHS)).clip(max=len(steps) - 1))]
    ball = places[:, None] + radius * np.vstack((np.eye(3), -np.eye(3)))
    return bool(
        points_inside(ball.reshape(-1, 3), shape.vertices, shape.faces).reshape(len(places), 6).all(axis=1).any()
    )


def _near_surface(shape: ShapeModel, r_A: Array) -> Mask:
    """Which legs of the paths, shape (t - 1, n), may touch the surface: not one whose middle keeps clear of all vertices."""
    middle, half = 0.5 * (r_A[:-1] + r_A[1:]), 0.5 * np.linalg.norm(np.diff(r_A, axis=0), axis=2)
    near = np.linalg.norm(middle, axis=2) <= shape.max_radius + half
    distance, _ = cKDTree(shape.vertices).query(middle[near])
    near[near] = distance <= shape.vertex_reach + half[near]
    return near


def close_approaches(
    times: Array, r_BN_N: Array, *, closer_than: float, after: float, release_s: Array | None = None
) -> list[CloseApproach]:
    """Pairs that come closer than allowed.

    The relative motion between samples is taken as straight, so that a close passage between two samples is found.

    Args:
        times: Shape (t,) [s].
        r_BN_N: Positions, shape (t, n, 3) [m].
        closer_than: Distance [m].
        after: Grace time past the release [s]: all spacecraft leave the mothership from one point.
        release_s: Of each, past the epoch, shape (n,) [s]; None: all at the epoch. Nothing counts while one is aboard.
    """
    released = np.zeros(r_BN_N.shape[1]) if release_s is None else release_s
    approaches = []
    for i, j in combinations(range(r_BN_N.shape[1]), 2):
        late = np.flatnonzero(times >= after + max(released[i], released[j]))
        if late.size < 2:
            continue
        relative = r_BN_N[late, j] - r_BN_N[late, i]
        time, distance = _closest(times[late], relative)
        if distance < closer_than:
            approaches.append(CloseApproach(i, j, time, distance))
    return approaches


def _closest(times: Array, relative: Array) -> tuple[float, float]:
    start, step = relative[:-1], np.diff(relative, axis=0)
    length2 = np.einsum("ki,ki->k", step, step)
    s = np.clip(-np.einsum("ki,ki->k", start, step) / np.where(length2 > 0, length2, 1.0), 0.0, 1.0)
    distance = np.linalg.norm(start + s[:, None] * step, axis=1)
    k = int(np.argmin(distance))
    return float(times[k] + s[k] * (times[k + 1] - times[k])), float(distance[k])
