"""Pictures of E flights by horizon maps, compiled; and what can be seen of a target at all.

Every picture that is due is taken, one after another. What can be seen is what the Sun lights, and what cameras that look
everywhere at once pass, the bound of scores.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from swarm_mj.compilation import kernel
from swarm_mj.observation.capture import keeps_limits, takes_picture
from swarm_mj.observation.horizon import look_at_cell, sight_of
from swarm_mj.observation.horizon_kernels import Scene, new_cells
from swarm_mj.spacecraft.attitude.algebra import relative_dcm
from swarm_mj.typing import Array, Ints, Mask

from .kinematics import BodyRotation, Kinematics, PerMission, Tracking
from .totals import EpisodeTotals, record_cells

#: How far off what stands far off is taken to stand, in radii of the body; and by how much directions to it differ at most,
#: from point to point of the body [rad], with room to spare.
FAR, SLACK = 1e4, 3e-4


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


@kernel
def cells_in_reach(
    scene: Scene, body: BodyRotation, r_N: Array, v_N: Array, duration_s: float, interval_s: float, wanted: Mask
) -> Mask:
    """Cells that some spacecraft passes within the limits of emission, range and ground sampling distance.

    Paths are taken as straight and nothing hides a cell, so that a few more count than can be seen.

    Args:
        scene: Cells and limits.
        body: How it turns.
        r_N: Where the spacecraft are released, shape (n, 3) [m].
        v_N: How fast, shape (n, 3) [m/s].
        duration_s: Of the flight [s].
        interval_s: Between pictures [s].
        wanted: Cells of interest, shape (C,).
    """
    cells, limits = scene.cells, scene.limits
    found = np.zeros(cells.shape[0], np.bool_)
    # No cell is nearer than the bounding sphere's surface.
    farthest = limits.max_gsd / limits.pixel_angle
    place = np.empty(3)
    for j in range(r_N.shape[0]):
        t = interval_s
        while t <= duration_s:
            _place(body, r_N[j], v_N[j], t, place)
            if np.sqrt(place[0] ** 2 + place[1] ** 2 + place[2] ** 2) <= farthest + scene.radius:
                for i in range(cells.shape[0]):
                    if wanted[i] and not found[i]:
                        x, y, z = place[0] - cells[i, 0], place[1] - cells[i, 1], place[2] - cells[i, 2]
                        height = x * cells[i, 3] + y * cells[i, 4] + z * cells[i, 5]
                        square = x * x + y * y + z * z
                        # By far the most fail here, which takes neither root nor division; a cell seen from behind does, too.
                        if square * limits.pixel_angle <= limits.max_gsd * height and height > 0.0:
                            cosine = height / np.sqrt(square)
                            found[i] = cosine >= limits.min_cos_emission and square <= limits.max_range**2
            t += interval_s
    return found


@kernel
def cells_passed(scene: Scene, r_A: Array, lit: Mask) -> Mask:
    """Cells of which each spacecraft is within the limits of emission, range and sampling distance at some picture, (m, C).

    Nothing hides a cell, so that a few more count than can be seen.

    Args:
        scene: Cells and limits.
        r_A: Places at the T pictures, shape (T, m, 3) [m].
        lit: Cells with light that counts then, shape (T, C).
    """
    cells, limits = scene.cells, scene.limits
    found = np.zeros((r_A.shape[1], cells.shape[0]), np.bool_)
    for k in range(r_A.shape[0]):
        for j in range(r_A.shape[1]):
            for i in range(cells.shape[0]):
                if lit[k, i] and not found[j, i]:
                    x, y, z = r_A[k, j, 0] - cells[i, 0], r_A[k, j, 1] - cells[i, 1], r_A[k, j, 2] - cells[i, 2]
                    height = x * cells[i, 3] + y * cells[i, 4] + z * cells[i, 5]
                    if height > 0.0 and keeps_limits(limits, np.sqrt(x * x + y * y + z * z), height):
                        found[j, i] = True
    return found


@kernel
def cells_in_view(scene: Scene, direction_A: Array, C_CA: Array, needed: int, highest: Array) -> Mask:
    """Cells that a camera far out sees, `FAR` radii of the body away, by at least so many of their sample points, shape (C,).

    Args:
        scene: Cells, horizon maps and field of view.
        direction_A: Where the camera stands, a unit vector, shape (3,).
        C_CA: How it is turned, shape (3, 3).
        needed: Sample points.
        highest: Sine of the highest elevation of each cell's horizons, shape (C,).
    """
    r_A = FAR * scene.radius * direction_A
    camera, cells = sight_of(r_A, C_CA, scene.optics, scene.radius), scene.cells
    answer, found = np.empty(scene.horizon.points.shape[1], np.int8), np.empty(cells.shape[0], np.bool_)
    # All points of a cell see the camera in the same direction, almost, and it sees all of them if it looks at the body.
    narrow = scene.optics.tan_half_angle < 2.0 * SLACK
    for i in range(cells.shape[0]):
        normal = cells[i, 3] * direction_A[0] + cells[i, 4] * direction_A[1] + cells[i, 5] * direction_A[2]
        if narrow or -SLACK <= normal <= highest[i] + SLACK:
            found[i] = look_at_cell(scene.horizon, camera, i, needed, answer)[0] >= needed
        else:
            found[i] = normal > 0.0
    return found


@kernel
def _place(body: BodyRotation, r_N: Array, v_N: Array, t: float, out: Array) -> None:
    phase = body.phase0 + body.spin_rate * t
    c, s, P = np.cos(phase), np.sin(phase), body.C_PN
    x, y, z = r_N[0] + t * v_N[0], r_N[1] + t * v_N[1], r_N[2] + t * v_N[2]
    px, py = P[0, 0] * x + P[0, 1] * y + P[0, 2] * z, P[1, 0] * x + P[1, 1] * y + P[1, 2] * z
    out[0], out[1], out[2] = c * px + s * py, c * py - s * px, P[2, 0] * x + P[2, 1] * y + P[2, 2] * z
