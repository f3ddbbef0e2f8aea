"""The virtual structure: a point that moves, and where every spacecraft has to be relative to it, at any time.

All of it is fixed before release and known aboard. A spacecraft's path is its place in the structure as planned; relative to
another spacecraft, or to the mean of some, the differences between paths count.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from swarm_mj.mission.trajectories import AccelerationN, propagate
from swarm_mj.typing import Array

#: Between two nodes of a path [s], and how many there are at most: cubic in between, a flyby errs by less than 1e-6 m.
NODE_S, MOST_NODES = 5.0, 20_001


@dataclass(frozen=True, eq=False, kw_only=True)
class Structure:
    """Paths of n spacecraft and of the point that they are about, in N."""

    path: CubicHermiteSpline  #: places by time, of shape (n, 3) [m]
    centre: CubicHermiteSpline  #: the point's place by time, shape (3,) [m]
    gravity: AccelerationN  #: function (t, r (k, 3)) -> (k, 3) [m/s^2], as flight software has it
    free: bool  #: whether the paths are free flights; otherwise all are accelerated as the point is
    start_s: float  #: from when on they are held, to the end of the flight [s]

    def states(self, t: float) -> tuple[Array, Array]:
        """Positions [m] and velocities [m/s] of all, each of shape (n, 3)."""
        return self.path(t), self.path(t, 1)

    def offsets(self, t: float) -> tuple[Array, Array]:
        """The same relative to the point."""
        r, v = self.states(t)
        return r - self.centre(t), v - self.centre(t, 1)

    def accelerations(self, t: float) -> Array:
        """Of the paths, shape (n, 3) [m/s^2]."""
        where = self.path(t)
        if self.free:
            return np.asarray(self.gravity(t, where))
        return np.broadcast_to(self.gravity(t, self.centre(t)[None]), where.shape)

    def holding(self, t: float) -> Array:
        """Acceleration by thrust that each needs on its path, shape (n, 3) [m/s^2]."""
        return np.asarray(self.accelerations(t) - self.gravity(t, self.path(t)))


def nodes(duration_s: float) -> Array:
    """Times of a path's nodes [s]."""
    return np.linspace(0.0, duration_s, int(np.clip(np.ceil(duration_s / NODE_S), 2, MOST_NODES - 1)) + 1)


def planned_structure(gravity: AccelerationN, times: Array, r_N: Array, v_N: Array, start_s: float) -> Structure:
    """Everybody as planned, about the mean of all.

    Args:
        gravity: See `Structure`.
        times: Of the planned states, increasing, shape (k,) [s].
        r_N: Shape (k, n, 3) [m].
        v_N: Shape (k, n, 3) [m/s].
        start_s: See `Structure`.
    """
    path, centre = CubicHermiteSpline(times, r_N, v_N), CubicHermiteSpline(times, r_N.mean(axis=1), v_N.mean(axis=1))
    return Structure(path=path, centre=centre, gravity=gravity, free=True, start_s=start_s)


def offset_structure(planned: Structure, times: Array, offsets_N: Array, rates_N: Array | None) -> Structure:
    """Offsets from a point that coasts on from the mean of the planned places at the structure's start.

    Args:
        planned: What the start is taken from.
        times: Nodes, increasing, from 0 on [s].
        offsets_N: Shape (n, 3) [m].
        rates_N: Relative velocities at the start from which all coast on, shape (n, 3) [m/s]; None: the offsets stay.
    """
    start, gravity = planned.start_s, planned.gravity
    r0, v0 = planned.centre(start), planned.centre(start, 1)
    centre_r, centre_v = _coast(gravity, start, times, r0[None], v0[None])
    if rates_N is None:
        r, v = centre_r + offsets_N, np.broadcast_to(centre_v, (len(times), *offsets_N.shape))
    else:
        r, v = _coast(gravity, start, times, r0 + offsets_N, v0 + rates_N)
    return Structure(
        path=CubicHermiteSpline(times, r, v),
        centre=CubicHermiteSpline(times, centre_r[:, 0], centre_v[:, 0]),
        gravity=gravity,
        free=rates_N is not None,
        start_s=start,
    )


def _coast(gravity: AccelerationN, start: float, times: Array, r0: Array, v0: Array) -> tuple[Array, Array]:
    """Free flights through states at the start, at all times, before the start as well."""
    r, v = np.empty((len(times), *r0.shape)), np.empty((len(times), *r0.shape))
    late = times >= start
    after = np.unique(np.append(start, times[late]))
    r[late], v[late] = (states[-int(late.sum()) :] for states in _flown(gravity, r0, v0, after))
    before = np.append(start, times[~late][::-1])
    r[~late], v[~late] = (states[:0:-1] for states in _flown(gravity, r0, v0, before))
    return r, v


def _flown(gravity: AccelerationN, r0: Array, v0: Array, times: Array) -> tuple[Array, Array]:
    return propagate(gravity, r0, v0, times) if len(times) > 1 else (r0[None], v0[None])
