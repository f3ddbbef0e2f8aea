"""Pictures of E flights by horizon maps, compiled: every picture that is due, one after another."""

from __future__ import annotations

import numpy as np

from swarm_mj.observation.horizon import sight_of
from swarm_mj.observation.horizon_kernels import Scene, new_cells
from swarm_mj.spacecraft.attitude.algebra import relative_dcm
from swarm_mj.typing import Array, Mask, kernel

from .kinematics import Kinematics
from .totals import EpisodeTotals, record_cells


@kernel
def take_pictures(
    scene: Scene,
    bits_per_pixel: float,
    now: Kinematics,
    totals: EpisodeTotals,
    takes: Mask,
    area: Array,
    doubt: Mask,
) -> bool:
    """Let spacecraft take pictures, one after another, and record the cells that are new.

    Args:
        scene: Target, maps, camera and criterion.
        bits_per_pixel: Data of a picture.
        now: At the instant of the pictures.
        totals: Written to.
        takes: Who takes a picture, shape (E, n).
        area: Receives in addition the newly seen area of each flight, shape (E,) [m^2].
        doubt: Receives which pictures may show more than the maps could tell, shape (E, n).

    Returns:
        Whether there are such.
    """
    any_doubt, new, C_CA = False, np.empty(totals.seen.shape[1], np.bool_), np.empty((3, 3))
    for e in range(takes.shape[0]):
        for j in range(takes.shape[1]):
            doubt[e, j] = False
            if not takes[e, j]:
                continue
            relative_dcm(now.C_BN[e, j], now.C_AN[e], C_CA)
            camera = sight_of(now.r_A[e, j], C_CA, scene.optics, scene.radius)
            gained, pixels, doubt[e, j] = new_cells(scene, camera, totals.seen[e], new)
            any_doubt = any_doubt or doubt[e, j]
            if gained > 0.0:
                record_cells(totals, e, j, new, now.t[e], gained, pixels * bits_per_pixel)
                area[e] += gained
    return any_doubt
