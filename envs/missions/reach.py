"""What the cameras of a swarm could see of a target if they looked everywhere at once: the bound that scores are scaled by."""

from __future__ import annotations

import numpy as np

from swarm_mj.observation.horizon_kernels import Scene
from swarm_mj.typing import Array, Mask, kernel

from ..kinematics import BodyRotation


@kernel
def cells_in_reach(
    scene: Scene, body: BodyRotation, r_N: Array, v_N: Array, until_s: Array, interval_s: float, wanted: Mask
) -> Mask:
    """Cells that some spacecraft passes within the limits of emission, range and ground sampling distance.

    Paths are taken as straight and nothing hides a cell, so that a few more count than can be seen.

    Args:
        scene: Cells and limits.
        body: How it turns.
        r_N: Where the spacecraft are let go, shape (n, 3) [m].
        v_N: How fast, shape (n, 3) [m/s].
        until_s: Until when each has a camera, shape (n,) [s].
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
        while t <= until_s[j]:
            _place(body, r_N[j], v_N[j], t, place)
            if np.sqrt(place[0] ** 2 + place[1] ** 2 + place[2] ** 2) <= farthest + scene.radius:
                for i in range(cells.shape[0]):
                    if wanted[i] and not found[i]:
                        x, y, z = place[0] - cells[i, 0], place[1] - cells[i, 1], place[2] - cells[i, 2]
                        height = x * cells[i, 3] + y * cells[i, 4] + z * cells[i, 5]
                        if height > 0.0:
                            square = x * x + y * y + z * z
                            cosine = height / np.sqrt(square)
                            near = square * limits.pixel_angle <= limits.max_gsd * height
                            found[i] = near and cosine >= limits.min_cos_emission and square <= limits.max_range**2
            t += interval_s
    return found


@kernel
def _place(body: BodyRotation, r_N: Array, v_N: Array, t: float, out: Array) -> None:
    phase = body.phase0 + body.spin_rate * t
    c, s, P = np.cos(phase), np.sin(phase), body.C_PN
    x, y, z = r_N[0] + t * v_N[0], r_N[1] + t * v_N[1], r_N[2] + t * v_N[2]
    px, py = P[0, 0] * x + P[0, 1] * y + P[0, 2] * z, P[1, 0] * x + P[1, 1] * y + P[1, 2] * z
    out[0], out[1], out[2] = c * px + s * py, c * py - s * px, P[2, 0] * x + P[2, 1] * y + P[2, 2] * z
