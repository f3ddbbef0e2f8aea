"""How long each spacecraft has held its target, from telemetry alone.

`mode` and `tracked_spacecraft` tell when the kind of target or the spacecraft followed changes. That a surface point or a
direction was exchanged for another of its kind shows in the lines of sight: those to one point of the body meet there.
"""

from __future__ import annotations

import numpy as np
import xarray as xr

from swarm_mj.mission.behaviors import TargetKind
from swarm_mj.spacecraft.attitude.mrp import dcm
from swarm_mj.typing import Array, Mask

#: Lines of sight to one point of the body pass each other by no more than this [m]; they are recorded far more finely.
SAME_POINT_M = 1e-3
#: Two directions are one where they differ by no more than this [rad].
SAME_DIRECTION_RAD = 1e-6


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
