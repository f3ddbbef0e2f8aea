"""The target's cells in the plane, as seen from the body's centre: angles east and north of the target's axis.

Several targets stand side by side, each about its own axis; a cell that belongs to several is drawn in the first of them. A
target that reaches around the body is drawn by longitude and latitude instead (equirectangular), and all others with it.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import FuncFormatter

from swarm_mj.figures.maps import POLAR, latitude_longitude
from swarm_mj.figures.style import annotate, label, tidy
from swarm_mj.figures.view import shade, triangles
from swarm_mj.mission.target import TargetRegion, angles
from swarm_mj.scenarios.itinerary import target_name
from swarm_mj.typing import Array

#: More than on the whole body: here the colour tells what was seen.
AMBIENT = 0.6
#: With more cells than these, borders would cover the cells.
MAX_BORDERED = 1000


def flat_offsets(region: TargetRegion) -> Array:
    """How far east of its own place each target of a region is drawn, shape (targets, 2) [deg]."""
    wide = [2.0 * np.degrees(target.side_half_angle) for target in region.targets]
    gap = 0.15 * max(wide)
    centres = np.cumsum([0.0, *(0.5 * (a + b) + gap for a, b in pairwise(wide))])
    return np.column_stack((centres, np.zeros(len(wide))))


def flat_points(region: TargetRegion, target: int, points_A: Array) -> Array:
    """Points (..., 3) as they are drawn in one of a region's targets, shape (..., 2) [deg]."""
    if region.is_wide:
        latitude, longitude = latitude_longitude(points_A, region.centre_longitude_deg)
        return np.stack((longitude, latitude), axis=-1)
    return angles(points_A, region.targets[target].axes_A) + flat_offsets(region)[target]


def flat_cells(region: TargetRegion) -> Array:
    """Corners of all cells as they are drawn, shape (n, 3, 2) [deg]."""
    flat = np.empty((region.n_cells, 3, 2))
    for k in reversed(range(len(region.targets))):
        cells = region.cells_of(k)
        flat[cells] = flat_points(region, k, region.corners_A[cells])
    if region.is_wide:
        return in_one_piece(flat, flat_points(region, 0, region.centroid_A))
    return flat


def in_one_piece(corners: Array, middle: Array) -> Array:
    """Corners of cells (n, 3, 2) by longitude and latitude [deg], each cell around its middle (n, 2), over the map's edge too.

    A corner on a pole, whose longitude says nothing, has that of the middle.
    """
    longitude = corners[..., 0] - 360.0 * np.rint((corners[..., 0] - middle[:, None, 0]) / 360.0)
    longitude = np.where(np.abs(corners[..., 1]) > 90.0 - POLAR, middle[:, None, 0], longitude)
    return np.stack((longitude, corners[..., 1]), axis=-1)


def finish_cells(ax: Axes, region: TargetRegion, *, brief: bool = False) -> None:
    """Name the axes, and several targets by letters above them; briefly where there is little room."""
    tidy(ax)
    ax.grid(False)
    where = "" if brief else " of the target's centre"
    if region.is_wide:
        label(ax, "east longitude [deg]", "latitude [deg]")
        ax.xaxis.set_major_formatter(FuncFormatter(lambda longitude, _: f"{longitude % 360.0:g}"))
        return
    label(ax, f"angle east{where} [deg]", f"angle north{where} [deg]")
    if not region.parts:
        return
    for k, (target, offset) in enumerate(zip(region.parts, flat_offsets(region), strict=True)):
        top = offset + [0.0, np.degrees(target.side_half_angle)]
        annotate(ax, target_name(k), top, (0.0, 5.0), va="baseline", fontweight="bold", zorder=7)


def draw_cells(
    ax: Axes, region: TargetRegion, colours: Array, ambient: float = AMBIENT, *, brief: bool = False
) -> None:
    """Paint the cells in given colours (n, 3), lit from the north-west so that relief shows; not with `ambient` 1."""
    east, north, _ = region.axes_A
    lamp = region.facing_A + 0.5 * north - 0.4 * east
    shaded = shade(colours, region.normal_A, lamp, ambient)
    if region.is_wide:  # lit from straight above everywhere: one lamp would make a night that is none
        outward = region.centroid_A / np.linalg.norm(region.centroid_A, axis=1, keepdims=True)
        level = np.clip(np.einsum("ij,ij->i", outward, region.normal_A), 0.0, 1.0)[:, None]
        shaded = np.clip(colours * (ambient + (1.0 - ambient) * level), 0.0, 1.0)
    bordered = region.n_cells <= MAX_BORDERED
    edges, width = ("white", 0.5) if bordered else (shaded, 0.2)
    cells = triangles(flat_cells(region), facecolors=shaded, edgecolors=edges, linewidths=width, zorder=1)
    ax.add_collection(cells)
    ax.set_aspect("equal")
    ax.autoscale_view()
    ax.margins(0.07)
    finish_cells(ax, region, brief=brief)
