"""Planned burns that take their time: when thrust begins and ends, and the path while it pushes.

A burn pushes along its change of velocity with the same force until the rocket equation gives it; propellant leaves along
the force, so that the mass falls at force over exhaust speed. Frame N, metres, seconds.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from swarm_mj.mission.trajectories import AccelerationN, PlannedBurn, Push, propagate
from swarm_mj.typing import Array


class TimedBurn(NamedTuple):
    """When a planned burn is flown.

    Attributes:
        planned: The burn.
        start: [s].
        duration: At full thrust [s].
        mass: At its start [kg].
    """

    planned: PlannedBurn
    start: float
    duration: float
    mass: float


def propellant_for(speed: float, mass: float, exhaust_speed: float) -> float:
    """Propellant [kg] that a change of velocity [m/s] takes from a mass [kg] on at an exhaust speed [m/s]: rocket equation."""
    return float(-mass * np.expm1(-speed / exhaust_speed))


def lasts(push: Push, speed: float, mass: float) -> float:
    """How long a change of velocity takes from some mass on [s]."""
    return propellant_for(speed, mass, push.exhaust_speed) * push.exhaust_speed / push.force


def timed_burns(burns: Sequence[PlannedBurn], push: Push, mass: Array) -> list[list[TimedBurn]]:
    """When each spacecraft flies the planned `burns` by `push`, in order of time; burns of nothing are left out.

    `mass` is that at the start, shape (n,) [kg]; each burn leaves less for the next.
    """
    left = np.array(mass, float)
    found: list[list[TimedBurn]] = [[] for _ in left]
    for burn in sorted(burns, key=lambda burn: burn.t):
        speed, j = float(np.linalg.norm(burn.delta_v_N)), burn.spacecraft
        if speed == 0.0:
            continue
        before = float(left[j])
        duration = lasts(push, speed, before)
        found[j].append(TimedBurn(burn, burn.t - 0.5 * duration, duration, before))
        left[j] -= propellant_for(speed, before, push.exhaust_speed)
    return found


def fly_burning(
    forces: AccelerationN,
    r0: Array,
    v0: Array,
    times: Array,
    burns: Sequence[TimedBurn],
    push: Push,
    *,
    rtol: float = 1e-12,
) -> tuple[Array, Array]:
    """The path of one spacecraft that burns on its way.

    Args:
        forces: Function (t, r (n, 3)) -> (n, 3) [m/s^2] in N, t past the epoch.
        r0: Start, shape (3,) [m].
        v0: Shape (3,) [m/s].
        times: Increasing, the first is the start [s], shape (t,).
        burns: Its own, in order of time, none before the start.
        push: By which they are flown.
        rtol: See `propagate`.

    Returns:
        Positions and velocities, each of shape (t, 3).
    """
    edges = [edge for burn in burns for edge in (burn.start, burn.start + burn.duration)]
    edges = [float(times[0]), *(edge for edge in edges if times[0] < edge < times[-1]), float(times[-1])]
    r, v = np.empty((len(times), 3)), np.empty((len(times), 3))
    r[0], v[0] = r0, v0
    state = np.asarray(r0, float)[None], np.asarray(v0, float)[None]
    for begin, end in zip(edges[:-1], edges[1:], strict=True):
        if end <= begin:
            continue
        middle = 0.5 * (begin + end)
        burning = next((b for b in burns if b.start <= middle <= b.start + b.duration), None)
        inside = np.flatnonzero((times > begin) & (times <= end))
        instants, which = np.unique(np.concatenate(([begin, end], times[inside])), return_inverse=True)
        law = forces if burning is None else _thrusting(forces, burning, push)
        rs, vs = propagate(law, *state, instants, rtol=rtol)
        r[inside], v[inside] = rs[which[2:], 0], vs[which[2:], 0]
        state = rs[-1], vs[-1]
    return r, v


def _thrusting(forces: AccelerationN, burn: TimedBurn, push: Push) -> AccelerationN:
    force_N = push.force * burn.planned.delta_v_N / np.linalg.norm(burn.planned.delta_v_N)
    flow = push.force / push.exhaust_speed

    def law(t: float, r: Array) -> Array:
        return np.asarray(forces(t, r) + force_N / (burn.mass - flow * (t - burn.start)))

    return law
