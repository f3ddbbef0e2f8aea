"""Multiple shooting: a transfer in parts, for where shooting in one is too sensitive to its start.

Over a long coast in strong gravity the arrival depends on the start velocity so steeply that Newton's method from a straight
line diverges, or its iterates fall into the body. Here the flight is cut into parts whose states are all unknown; Newton's
method closes the gaps between them and the miss at the end together (Stoer and Bulirsch, Introduction to Numerical Analysis,
section 7.3.5). Each part bends little, so that the first guess need only go round the body. Frame N, metres, seconds.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import block_diag

from swarm_mj.errors import MissionError
from swarm_mj.mission.trajectories import SHOOTING_TOLERANCE, SHOOTING_TOLERANCE_M, AccelerationN, propagate
from swarm_mj.typing import Array

#: Numbers of parts that are tried in turn, and iterations with each.
PARTS, MAX_ITERATIONS = (8, 24), 40
#: Least share of Newton's step that is tried before a number of parts is given up.
LEAST_STEP = 1.0 / 256.0
#: Steps of place and velocity for the Jacobian, as shares of the way and of the mean speed.
STEP = 1e-6
#: How far off the straight line between its ends the first guess keeps from the body's centre, as a share of the nearer end.
CLEARANCE = 0.5


def shoot_in_parts(
    forces: AccelerationN, r0: Array, destination: Array, time_of_flight: float
) -> tuple[Array, float] | None:
    """The start velocity that carries one body from a point to another.

    Args:
        forces: Function (t, r (n, 3)) -> (n, 3) [m/s^2]; t = 0 is the start.
        r0: Start, shape (3,) [m].
        destination: Shape (3,) [m].
        time_of_flight: [s].

    Returns:
        The velocity (3,) [m/s] and the remaining miss [m] of one integration from start to end; None where none is found.
    """
    scale = max(float(np.linalg.norm(r0)), float(np.linalg.norm(destination)))
    tolerance = max(SHOOTING_TOLERANCE_M, SHOOTING_TOLERANCE * scale)
    for parts in PARTS:
        times = np.linspace(0.0, time_of_flight, parts + 1)
        try:
            v0 = _newton(forces, _guess(r0, destination, times), destination, times, tolerance)
            if v0 is not None:
                return _polished(forces, r0, v0, destination, time_of_flight, tolerance)
        except (MissionError, np.linalg.LinAlgError):
            continue
    return None


def _guess(r0: Array, destination: Array, times: Array) -> Array:
    """States at the beginning of every part, shape (parts, 6): along an arc about the body, at an even pace."""
    share = (times / times[-1])[:, None]
    start, end = np.linalg.norm(r0), np.linalg.norm(destination)
    straight = r0 + share * (destination - r0)
    nearest = np.linalg.norm(straight, axis=1).min()
    r = straight
    if nearest < CLEARANCE * min(start, end):
        r = _turned(r0 / start, destination / end, share) * (start + share * (end - start))
    v = np.diff(r, axis=0) / np.diff(times)[:, None]
    return np.hstack((r[:-1], v))


def _turned(a: Array, b: Array, share: Array) -> Array:
    """Unit vectors on the great circle from a to b, shape (parts + 1, 3)."""
    angle = float(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b))
    across = b - (a @ b) * a
    if np.linalg.norm(across) < 1e-9:  # opposite ends: any way round will do
        across = np.cross(a, np.eye(3)[np.argmin(np.abs(a))])
    across = across / np.linalg.norm(across)
    return np.cos(share * angle) * a + np.sin(share * angle) * across


def _newton(forces: AccelerationN, states: Array, destination: Array, times: Array, tolerance: float) -> Array | None:
    """Newton's method with shortened steps; the start velocity, or None where the gaps do not close."""
    reach = float(np.linalg.norm(states[:, :3], axis=1).max())
    size = np.repeat([reach, reach / (times[1] - times[0])], 3)
    gaps, jacobian = _gaps(forces, states, destination, times)
    for _ in range(MAX_ITERATIONS):
        if np.linalg.norm(gaps[:, :3], axis=1).max() < tolerance:
            return states[0, 3:]
        step, length, left = _solved(jacobian, gaps), 1.0, np.linalg.norm(gaps / size)
        while True:
            try:
                tried = _gaps(forces, states - length * step, destination, times)
            except MissionError:  # that step leads into the body
                tried = gaps, jacobian
            if np.linalg.norm(tried[0] / size) < (1.0 - 0.1 * length) * left:
                break
            length *= 0.5
            if length < LEAST_STEP:
                return None
        states, (gaps, jacobian) = states - length * step, tried
    return None


def _gaps(forces: AccelerationN, states: Array, destination: Array, times: Array) -> tuple[Array, Array]:
    """Gaps at the end of every part, shape (parts, 6), the last one's velocity 0; and derivatives of the ends (parts, 6, 6)."""
    parts = len(states)
    gaps, slopes = np.zeros((parts, 6)), np.empty((parts, 6, 6))
    for k in range(parts):
        steps = STEP * np.repeat([np.linalg.norm(states[k, :3]), max(np.linalg.norm(states[k, 3:]), 1e-3)], 3)
        starts = np.vstack((states[k], states[k] + np.diag(steps), states[k] - np.diag(steps)))

        def law(t: float, r: Array, first: float = times[k]) -> Array:
            return forces(first + t, r)

        r, v = propagate(law, starts[:, :3], starts[:, 3:], np.array([0.0, times[k + 1] - times[k]]))
        ends = np.hstack((r[-1], v[-1]))
        slopes[k] = ((ends[1:7] - ends[7:]) / (2.0 * steps[:, None])).T
        if k + 1 < parts:
            gaps[k] = ends[0] - states[k + 1]
        else:
            gaps[k, :3] = ends[0, :3] - destination
    return gaps, slopes


def _solved(slopes: Array, gaps: Array) -> Array:
    """Newton's step, shape (parts, 6); the first place is given and the last velocity free."""
    parts = len(gaps)
    matrix = block_diag(*slopes) - np.eye(6 * parts, k=6)
    step = np.zeros(6 * parts)
    step[3:] = np.linalg.solve(matrix[:-3, 3:], gaps.ravel()[:-3])
    return step.reshape(parts, 6)


def _polished(
    forces: AccelerationN, r0: Array, v0: Array, destination: Array, time_of_flight: float, tolerance: float
) -> tuple[Array, float] | None:
    """What the parts found, flown in one; a last Newton step or two take away what adds up over the parts."""
    times, best = np.array([0.0, time_of_flight]), (v0, np.inf)
    for _ in range(6):
        step = STEP * max(float(np.linalg.norm(v0)), 1e-3)
        starts = v0 + step * np.vstack((np.zeros(3), np.eye(3), -np.eye(3)))
        ends = propagate(forces, np.broadcast_to(r0, starts.shape), starts, times)[0][-1]
        miss = float(np.linalg.norm(ends[0] - destination))
        if miss < best[1]:
            best = v0, miss
        if miss < tolerance:
            return v0, miss
        v0 = v0 - np.linalg.solve((ends[1:4] - ends[4:]).T / (2.0 * step), ends[0] - destination)
    # Sensitive flights leave more than a millionth of a metre to the integrator's last digits.
    return best if best[1] < 1e3 * tolerance else None
