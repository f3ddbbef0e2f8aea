"""Pictures of E flights by horizon maps, compiled: every picture that is due, one after another."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from swarm_mj.compilation import kernel
from swarm_mj.observation.capture import takes_picture
from swarm_mj.observation.horizon import sight_of
from swarm_mj.observation.horizon_kernels import Scene, new_cells
from swarm_mj.spacecraft.attitude.algebra import relative_dcm
from swarm_mj.typing import Ints, Mask

from .kinematics import Kinematics, PerMission, Tracking
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


@kernel
def take_pictures(
    scenes: PerMission[Scene],
    constants: PerMission[PictureConstants],
    mission: Ints,
    now: Kinematics,
    totals: EpisodeTotals,
    tracking: Tracking,
    light: Mask,
    due: Mask,
    doubts: Mask,
) -> None:
    """Let every observer that looks at the body take its picture, one after another, and record the cells that are new.

    Args:
        scenes: Target, maps, camera and criterion, by mission.
        constants: By mission.
        mission: Of each flight, shape (E,).
        now: At the instant of the pictures.
        totals: Written to.
        tracking: What each spacecraft tracks, and whose camera is off.
        light: Cells that are lit now, shape (E, C); of no flights where light does not change.
        due: Flights in which pictures are due, shape (E,).
        doubts: Receives which pictures may show more than the maps could tell, shape (E, n).
    """
    skipped, new = np.empty(totals.seen.shape[1], np.bool_), np.empty(totals.seen.shape[1], np.bool_)
    C_CA, changes = np.empty((3, 3)), light.shape[0] > 0
    for m in range(len(scenes)):
        some = False
        for e in range(due.shape[0]):
            some = some or (due[e] and mission[e] == m)
        if not some:
            continue
        scene, of = scenes[m], constants[m]
        cells = scene.cells.shape[0]
        answer = np.empty(scene.horizon.points.shape[1], np.int8)
        for e in range(due.shape[0]):
            if not (due[e] and mission[e] == m):
                continue
            for i in range(cells):
                dark = changes and not light[e, i]
                skipped[i] = totals.seen[e, i] or not totals.target[e, i] or dark
            for j in range(of.n_observers):
                works = not (totals.lost[e, j] or tracking.blind[e, j])
                if not takes_picture(j, of.n_observers, tracking.kind[e, j], works):
                    continue
                relative_dcm(now.C_BN[e, j], now.C_AN[e], C_CA)
                camera = sight_of(now.r_A[e, j], C_CA, scene.optics, scene.radius)
                area, pixels, doubt = new_cells(scene, camera, skipped[:cells], new[:cells], answer)
                doubts[e, j] = doubt
                if area > 0.0:
                    bits = pixels * of.bits_per_pixel
                    record_cells(totals, e, j, new[:cells], area, bits, of.storage_bit)
                    for i in range(cells):
                        skipped[i] = skipped[i] or new[i]
