"""Pictures of E flights by horizon maps, compiled: every picture that is due, one after another."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from swarm_mj.observation.capture import takes_picture
from swarm_mj.observation.horizon import sight_of
from swarm_mj.observation.horizon_kernels import Scene, new_cells
from swarm_mj.spacecraft.attitude.algebra import relative_dcm
from swarm_mj.typing import Array, Ints, Mask, lean

from .kinematics import Kinematics
from .totals import EpisodeTotals, record_cells


class PictureConstants(NamedTuple):
    """What all pictures share besides the scene.

    Attributes:
        n_observers: Number of spacecraft that take pictures, the first ones.
        bits_per_pixel: Data of a picture.
        storage_bit: Most that a spacecraft holds [bit].
    """

    n_observers: int
    bits_per_pixel: float
    storage_bit: float


class Gained(NamedTuple):
    """What pictures of E flights bring, and room for how they are judged.

    Attributes:
        area: Grows by the newly seen area of each flight, shape (E,) [m^2].
        doubt: Receives which pictures may show more than the maps could tell, shape (E, n).
        new: Scratch, shape (C,).
        answer: Scratch, shape (samples,).
        C_CA: Scratch, shape (3, 3).
    """

    area: Array
    doubt: Mask
    new: Mask
    answer: NDArray[np.int8]
    C_CA: Array


def nothing_gained(scene: Scene, area: Array, n: int) -> Gained:
    """Before pictures of n spacecraft, with the areas so far, shape (E,) [m^2], which will grow."""
    cells, samples = scene.horizon.points.shape[:2]
    doubt, new = np.zeros((len(area), n), np.bool_), np.empty(cells, np.bool_)
    return Gained(area, doubt, new, np.empty(samples, np.int8), np.empty((3, 3)))


@lean
def take_pictures(
    scene: Scene,
    constants: PictureConstants,
    now: Kinematics,
    totals: EpisodeTotals,
    kind: Ints,
    blind: Mask,
    due: Mask,
    gained: Gained,
) -> None:
    """Let every observer that looks at the body take its picture, one after another, and record the cells that are new.

    Args:
        scene: Target, maps, camera and criterion.
        constants: See `PictureConstants`.
        now: At the instant of the pictures.
        totals: Written to.
        kind: What each spacecraft tracks, shape (E, n).
        blind: Whose camera is off, shape (E, n).
        due: Flights in which pictures are due, shape (E,).
        gained: Written to.
    """
    observers, new, C_CA = constants.n_observers, gained.new, gained.C_CA
    for e in range(due.shape[0]):
        if not due[e]:
            continue
        for j in range(observers):
            if not takes_picture(j, observers, kind[e, j], not (totals.lost[e, j] or blind[e, j])):
                continue
            relative_dcm(now.C_BN[e, j], now.C_AN[e], C_CA)
            camera = sight_of(now.r_A[e, j], C_CA, scene.optics, scene.radius)
            area, pixels, doubt = new_cells(scene, camera, totals.seen[e], new, gained.answer)
            gained.doubt[e, j] = doubt
            if area > 0.0:
                bits = pixels * constants.bits_per_pixel
                record_cells(totals, e, j, new, now.t[e], area, bits, constants.storage_bit)
                gained.area[e] += area
