"""The target divided into a fixed number of patches: what an agent sees of the coverage, and what a role can aim at.

The pyramid that bounds the target is divided into k x k equal parts along its east and north tangents, so that the number
of patches depends neither on the mesh nor on the subdivision into cells. Frame A, metres.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import isqrt

import numpy as np

from swarm_mj.errors import ScenarioError
from swarm_mj.mission.target import TargetRegion
from swarm_mj.typing import Array, Indices

from ..arguments import is_whole


@dataclass(frozen=True, eq=False)
class Patches:
    """Groups of target cells, numbered row by row from the south-west, west to east.

    Attributes:
        of_cell: Patch of each cell, shape (n_cells,).
        cell_area: Area of each cell [m^2], shape (n_cells,).
        area: Area of each patch [m^2], shape (count,).
        centre_A: Mean of each patch's surface in A [m], shape (count, 3).
    """

    of_cell: Indices
    cell_area: Array
    area: Array
    centre_A: Array

    @property
    def count(self) -> int:
        """Number of patches."""
        return len(self.area)

    def normals_A(self, region: TargetRegion) -> Array:
        """Mean normals of the patches of a target, shape (count, 3)."""
        normal = np.column_stack(
            [np.bincount(self.of_cell, region.area * region.normal_A[:, i], self.count) for i in range(3)]
        )
        return np.asarray(normal / np.linalg.norm(normal, axis=1, keepdims=True))


def make_patches(region: TargetRegion, count: int) -> Patches:
    """Divide a target into a square number of patches.

    Raises:
        ScenarioError: The count is no square number, or so large that a patch holds no cell.
    """
    k = isqrt(max(count, 0)) if is_whole(count) else 0
    if k < 1 or k * k != count or count > region.n_cells:
        raise ScenarioError(
            f"patches = {count!r}: must be a whole square number such as 4, 9, 16 or 25, and at most the number of "
            f"cells of this target, {region.n_cells}"
        )
    column, row = np.clip(np.floor((tangents(region, region.centroid_A).T + 1.0) * (0.5 * k)), 0, k - 1).astype(int)
    return _patches(region, k * row + column, count)


def make_sphere_patches(region: TargetRegion, count: int) -> Patches:
    """Divide a whole body by direction from its centre: six faces of a cube about A's axes, each into k x k equal angles.

    Faces come as +x, -x, +y, -y, +z, -z; within each, rows by the second and columns by the first of the other two axes.

    Raises:
        ScenarioError: The count is not 6 k^2, or so large that a patch holds no cell.
    """
    k = isqrt(max(count // 6, 0)) if is_whole(count) else 0
    if k < 1 or 6 * k * k != count:
        raise ScenarioError(
            f"patches = {count!r}: must be six times a square number, such as 6, 24, 54 or 96, for a whole body"
        )
    points, rows = region.centroid_A, np.arange(region.n_cells)
    axis = np.argmax(np.abs(points), axis=1)
    out = points[rows, axis]
    others = np.sort((axis[:, None] + np.array([1, 2])) % 3, axis=1)
    angle = np.arctan(points[rows[:, None], others] / np.abs(out)[:, None]) / (np.pi / 4)
    column, row = np.clip(np.floor((angle.T + 1.0) * (0.5 * k)), 0, k - 1).astype(int)
    return _patches(region, k * k * (2 * axis + (out < 0.0)) + k * row + column, count)


def _patches(region: TargetRegion, of_cell: Indices, count: int) -> Patches:
    area = np.asarray(np.bincount(of_cell, region.area, count), dtype=np.float64)
    if not area.all():
        raise ScenarioError(
            f"patches = {count}: patch {int(np.argmin(area))} holds no cell of this target ({region.n_cells} cells); "
            "take fewer patches or a smaller target.cell_size_m"
        )
    moment = [np.bincount(of_cell, region.area * region.centroid_A[:, i], count) for i in range(3)]
    return Patches(of_cell, region.area, area, np.column_stack(moment) / area[:, None])


def tangents(region: TargetRegion, points_A: Array) -> Array:
    """East and north tangents of points seen from the body's centre, -1 to 1 inside the pyramid, shape (n, 2)."""
    east, north, out = (points_A @ region.axes_A.T).T
    return np.column_stack([east / out, north / out]) / np.tan(region.side_half_angle)
