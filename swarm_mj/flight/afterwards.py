"""Where the swarm is and how it points after its flight, while data are still being sent.

The paths go on in the same force field, without wheels and pictures. Attitude is taken as settled: the relays point their +z at
Earth, the others at the nearest relay, turned from their last attitude the shortest way.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from swarm_mj.dataflow.contacts import Instants
from swarm_mj.errors import MissionError
from swarm_mj.flight.plan import Plan
from swarm_mj.mission.behaviors import TargetKind
from swarm_mj.mission.safety import find_impacts
from swarm_mj.mission.trajectories import propagate
from swarm_mj.simulator.telemetry import working
from swarm_mj.spacecraft.attitude.mrp import dcm
from swarm_mj.typing import Array, Ints, Mask

#: Relative tolerance of the paths afterwards: 1 m in 10,000 km, which no link notices.
RTOL = 1e-7


class Course(NamedTuple):
    """Where the swarm is after its flight.

    Attributes:
        t: Rising, past the end of the flight [s], shape (m,).
        r_BN_N: Positions, shape (m, n, 3) [m], of those lost at their last place.
        works: Who works, shape (m, n).
    """

    t: Array
    r_BN_N: Array
    works: Mask


def flown_instants(plan: Plan, telemetry: xr.Dataset, times: Array) -> Instants:
    """The swarm at the samples of a flight nearest to some times [s], shape (m,)."""
    sampled = telemetry["time"].values
    k = np.clip(np.rint(np.interp(times, sampled, np.arange(len(sampled)))), 0, len(sampled) - 1).astype(np.int64)
    return Instants(
        t=sampled[k],
        r_BN_N=telemetry["r_BN_N"].values[k],
        C_BN=dcm(telemetry["sigma_BN"].values[k]),
        C_AN=dcm(telemetry["sigma_AN"].values[k]),
        earth_N=np.array([plan.environment.earth.at(t) for t in sampled[k]]).reshape(-1, 3),
        mode=telemetry["mode"].values[k].astype(np.int64),
        tracked=telemetry["tracked_spacecraft"].values[k].astype(np.int64),
        works=working(telemetry)[k],
    )


def paths_afterwards(plan: Plan, telemetry: xr.Dataset, times: Array) -> Course:
    """Positions after the flight and who has not hit the body by then.

    Args:
        plan: What was flown.
        telemetry: The flight.
        times: Rising, past the end of the flight [s], shape (m,).
    """
    if not len(times):
        return Course(times, np.empty((0, plan.n, 3)), np.empty((0, plan.n), np.bool_))
    end = float(telemetry["time"].values[-1])
    r, v = (telemetry[name].values[-1] for name in ("r_BN_N", "v_BN_N"))
    works = working(telemetry)[-1]
    grid = np.concatenate(([end], times))
    path, alive = np.repeat(r[None], len(grid), axis=0), np.repeat(works[None], len(grid), axis=0)
    C_AN = np.array([plan.environment.C_AN(t) for t in grid])
    left = np.flatnonzero(works)
    for spacecraft, reached in _paths(plan, r, v, grid, left):
        path[: len(reached), spacecraft] = reached
        path[len(reached) :, spacecraft] = reached[-1]
        alive[len(reached) :, spacecraft] = False
    for impact in find_impacts(plan.shape, grid, np.einsum("kab,knb->kna", C_AN, path[:, left])):
        alive[grid > impact.time, left[impact.spacecraft]] = False
    return Course(times, path[1:], alive[1:])


def _paths(plan: Plan, r: Array, v: Array, grid: Array, left: Ints) -> list[tuple[Ints, Array]]:
    """Spacecraft and their positions: of all together, or where one of them ends inside the body of each by itself."""
    if not len(left):
        return []
    together = _path(plan, r[left], v[left], grid)
    if len(together) == len(grid) or len(left) == 1:
        return [(left, together)]
    return [(left[k : k + 1], _path(plan, r[left[k : k + 1]], v[left[k : k + 1]], grid)) for k in range(len(left))]


def _path(plan: Plan, r: Array, v: Array, grid: Array) -> Array:
    """Positions along `grid` [s] as far as the paths can be integrated, shape (at most len(grid), n, 3) [m]."""
    try:
        return propagate(plan.environment.acceleration_N, r, v, grid, rtol=RTOL)[0]
    except MissionError:
        return r[None] if len(grid) <= 2 else _path(plan, r, v, grid[: len(grid) // 2 + 1])


def instants_afterwards(plan: Plan, telemetry: xr.Dataset, course: Course, relays: Ints) -> Instants:
    """The swarm after its flight.

    Args:
        plan: What was flown.
        telemetry: The flight.
        course: From `paths_afterwards`; whoever speaks to Earth, the paths are the same.
        relays: Who speaks to Earth at each time: numbers from 0, shape (m, k).
    """
    times, r_N, works = course
    earth_N = np.array([plan.environment.earth.at(t) for t in times]).reshape(-1, 3)
    mode, tracked = roles(r_N, works, relays)
    towards = np.take_along_axis(r_N, np.maximum(tracked, 0)[..., None], axis=1) - r_N
    towards = np.where((mode == TargetKind.EARTH)[..., None], earth_N[:, None] - r_N, towards)
    return Instants(
        t=times,
        r_BN_N=r_N,
        C_BN=turned(dcm(telemetry["sigma_BN"].values[-1]), towards),
        C_AN=np.array([plan.environment.C_AN(t) for t in times]).reshape(-1, 3, 3),
        earth_N=earth_N,
        mode=mode,
        tracked=tracked,
        works=works,
    )


def roles(r_N: Array, works: Mask, relays: Ints) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Modes and whom each tracks, each of shape (m, n): relays Earth, the others the nearest relay that works.

    Who finds no relay keeps tracking the body.
    """
    m, n = works.shape
    is_relay = np.zeros((m, n), np.bool_)
    np.put_along_axis(is_relay, relays, True, axis=1)
    is_relay &= works
    mode, tracked = np.full((m, n), TargetKind.ASTEROID, np.int64), np.full((m, n), -1, np.int64)
    for k in np.flatnonzero(is_relay.any(axis=1)):
        found = np.flatnonzero(is_relay[k])
        distance = np.linalg.norm(r_N[k][:, None] - r_N[k][None, found], axis=-1)
        tracked[k] = found[np.argmin(distance, axis=1)]
        mode[k] = TargetKind.SPACECRAFT
    mode[is_relay], tracked[is_relay] = TargetKind.EARTH, -1
    return mode, tracked


def turned(C_BN: Array, towards_N: Array) -> Array:
    """Attitudes turned the shortest way so that +z points along directions.

    Args:
        C_BN: Rotations from N to B, shape (n, 3, 3).
        towards_N: Directions of any length, shape (m, n, 3); where zero, the attitude stays.

    Returns:
        Shape (m, n, 3, 3).
    """
    old = np.broadcast_to(C_BN[:, 2], towards_N.shape)
    length = np.linalg.norm(towards_N, axis=-1, keepdims=True)
    new = np.where(length > 0.0, towards_N / np.where(length > 0.0, length, 1.0), old)
    # Turned by half a turn about x first where it would be a half turn itself, whose axis is open.
    opposite = np.einsum("mni,mni->mn", old, new) < -0.5
    half = np.where(opposite[..., None, None], np.diag((1.0, -1.0, -1.0)), np.eye(3))
    start = half @ C_BN
    old = start[..., 2, :]
    # Rodrigues: R = I + [w] + [w]^2 / (1 + c), w = old x new; components of B's axes turn with it.
    w, c = np.cross(old, new), np.einsum("mni,mni->mn", old, new)
    zero = np.zeros(c.shape)
    W = np.stack((zero, -w[..., 2], w[..., 1], w[..., 2], zero, -w[..., 0], -w[..., 1], w[..., 0], zero), -1)
    W = W.reshape(*c.shape, 3, 3)
    R = np.eye(3) + W + W @ W / (1.0 + c)[..., None, None]
    return start @ R.swapaxes(-1, -2)


def earthward(telemetry: xr.Dataset) -> Ints:
    """Who speaks to Earth at the end of a flight, numbers from 0; empty where nobody does."""
    return np.flatnonzero(telemetry["mode"].values[-1] == TargetKind.EARTH)


def joined(earlier: Instants, later: Instants) -> Instants:
    """Instants of a flight and of the time after it."""
    return Instants(**{name: np.concatenate((value, getattr(later, name))) for name, value in vars(earlier).items()})
