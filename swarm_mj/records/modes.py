"""What each spacecraft tracks over time and for how long it has, from telemetry alone.

`mode` and `tracked_spacecraft` tell when the kind of target or the spacecraft followed changes. That a surface point or a
direction was exchanged for another of its kind shows in the lines of sight: those to one point of the body meet there.
"""

from __future__ import annotations

import json
from typing import NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from swarm_mj.mission.behaviors import TargetKind
from swarm_mj.spacecraft.attitude.mrp import dcm
from swarm_mj.typing import Array, Mask

#: Numbers of the modes of spacecraft that no longer work, and that have not left, after the flag values of `mode`; all
#: from LOST on point nowhere.
LOST, ABOARD = len(TargetKind), len(TargetKind) + 1
#: Lines of sight to one point of the body pass each other by no more than this [m]; they are recorded far more finely.
SAME_POINT_M = 1e-3
#: Two directions are one where they differ by no more than this [rad].
SAME_DIRECTION_RAD = 1e-6


class Run(NamedTuple):
    """A stretch of samples with one target: first and last time [s], mode."""

    start: float
    end: float
    mode: int


def modes_shown(telemetry: xr.Dataset) -> NDArray[np.int8]:
    """What each spacecraft tracks, `LOST` from when it no longer works, `ABOARD` until it leaves, shape (time, spacecraft)."""
    mode = telemetry["mode"].values.astype(np.int8)
    for name, instead in (("released", ABOARD), ("operational", LOST)):
        if name in telemetry:
            mode = np.where(telemetry[name].values == 1, mode, np.int8(instead))
    return mode


def events_of(telemetry: xr.Dataset, j: int) -> list[float]:
    """Times of the faults of spacecraft j and of what followed from them, in order [s]."""
    name = str(telemetry["spacecraft"].values[j])
    events = json.loads(telemetry.attrs.get("events", "[]"))
    return sorted({float(event["time_s"]) for event in events if event["spacecraft"] == name})


def runs(telemetry: xr.Dataset, j: int) -> list[Run]:
    """Stretches in which spacecraft j tracks one target, or is lost, in order of time; each ends where the next begins."""
    mode = modes_shown(telemetry)[:, j]
    tracked = np.where(mode >= LOST, -1, telemetry["tracked_spacecraft"].values[:, j])
    times = telemetry["time"].values
    first = np.flatnonzero(np.append(True, (np.diff(mode) != 0) | (np.diff(tracked) != 0)))
    ends = np.append(times[first[1:]], times[-1])
    return [Run(float(times[k]), float(end), int(mode[k])) for k, end in zip(first, ends, strict=True)]


def intervals(flag: Mask, times: Array) -> list[tuple[float, float]]:
    """Start and length [s] of the stretches in which a flag holds; each sample stands until the next."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], flag, [False])).astype(np.int8)))
    until = np.append(times, times[-1])
    return [(float(until[a]), float(until[b] - until[a])) for a, b in edges.reshape(-1, 2)]


def held_s(telemetry: xr.Dataset) -> Array:
    """Time since the target last changed, to the sample [s], shape (time, spacecraft); the first sample begins anew."""
    times = telemetry["time"].values
    begins = np.where(_new_target(telemetry), times[1:, None], times[0])
    since = np.maximum.accumulate(np.vstack((np.full(begins.shape[1], times[0]), begins)), axis=0)
    return np.asarray(times[:, None] - since)


def _new_target(telemetry: xr.Dataset) -> Mask:
    """Whether the target differs from that of the sample before, shape (time - 1, spacecraft)."""
    mode, tracked = telemetry["mode"].values, telemetry["tracked_spacecraft"].values
    r_N, sight_N = telemetry["r_BN_N"].values, telemetry["line_of_sight_N"].values
    C_AN = dcm(telemetry["sigma_AN"].values)
    r_A, sight_A = (np.einsum("tij,tnj->tni", C_AN, vector) for vector in (r_N, sight_N))
    before = mode[:-1]
    changed = (np.diff(mode, axis=0) != 0) | (np.diff(tracked, axis=0) != 0)
    if "released" in telemetry:
        changed |= np.diff(telemetry["released"].values, axis=0) != 0
    changed |= (before == TargetKind.SURFACE) & (_distance(r_A, sight_A) > SAME_POINT_M)
    turn = np.linalg.norm(np.diff(sight_N, axis=0), axis=2)
    return np.asarray(changed | ((before == TargetKind.DIRECTION) & (turn > SAME_DIRECTION_RAD)))


def _distance(r_A: Array, sight_A: Array) -> Array:
    """Least distance between the line of sight of each sample and the next, shape (time - 1, spacecraft) [m]."""
    step, normal = np.diff(r_A, axis=0), np.cross(sight_A[:-1], sight_A[1:])
    size = np.linalg.norm(normal, axis=2)
    across = np.abs(np.einsum("tnj,tnj->tn", step, normal)) / np.where(size > 0.0, size, 1.0)
    aside = np.linalg.norm(np.cross(step, sight_A[:-1]), axis=2)
    return np.where(size > SAME_DIRECTION_RAD, across, aside)
