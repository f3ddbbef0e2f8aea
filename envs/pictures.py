"""Pictures of E flights by horizon maps, compiled: every picture that is due, one after another."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from swarm_mj.observation.horizon_kernels import Scene, new_cells
from swarm_mj.spacecraft.attitude.algebra import relative_dcm
from swarm_mj.typing import Array, Mask, kernel

from .kinematics import Kinematics
from .totals import EpisodeTotals, record_cells


class PictureConstants(NamedTuple):
    """What all pictures share besides the scene.

    Attributes:
        max_radius: Of the body's vertices [m]; inside that sphere the maps may hide what is in view.
        bits_per_pixel: Data of a picture.
    """

    max_radius: float
    bits_per_pixel: float


@kernel
def take_pictures(
    scene: Scene,
    constants: PictureConstants,
    now: Kinematics,
    totals: EpisodeTotals,
    takes: Mask,
    area: Array,
    doubt: Mask,
) -> bool:
    """Let spacecraft take pictures, one after another, and record the cells that are new.

    Args:
        scene: Target, maps, camera and criterion.
        constants: See `PictureConstants`.
        now: At the instant of the pictures.
        totals: Written to.
        takes: Who takes a picture, shape (E, n).
        area: Receives in addition the newly seen area of each flight, shape (E,) [m^2].
        doubt: Receives which pictures may show more than the maps could tell, shape (E, n).

    Returns:
        Whether there are such.
    """
    any_doubt, radius = False, constants.max_radius
    new, C_CA = np.empty(totals.seen.shape[1], np.bool_), np.empty((3, 3))
    for e in range(takes.shape[0]):
        for j in range(takes.shape[1]):
            doubt[e, j] = False
            if not takes[e, j]:
                continue
            r = now.r_A[e, j]
            relative_dcm(now.C_BN[e, j], now.C_AN[e], C_CA)
            inside = r[0] * r[0] + r[1] * r[1] + r[2] * r[2] < radius * radius
            gained, pixels, doubt[e, j] = new_cells(scene, r, C_CA, inside, totals.seen[e], new)
            any_doubt = any_doubt or doubt[e, j]
            if gained > 0.0:
                record_cells(totals, e, j, new, now.t[e], gained, pixels * constants.bits_per_pixel)
                area[e] += gained
    return any_doubt
