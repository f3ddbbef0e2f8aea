"""The target's cells in the plane, as seen from the body's centre: angles east and north of the target's axis.

Several targets stand side by side, each about its own axis; a cell that belongs to several is drawn in the first of them.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from matplotlib.axes import Axes

from swarm_mj.figures.style import annotate, label, tidy
from swarm_mj.figures.view import shade, triangles, unit
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


def flat_cells(region: TargetRegion) -> Array:
    """Corners of all cells as they are drawn, shape (n, 3, 2) [deg]."""
    flat, offsets = np.empty((region.n_cells, 3, 2)), flat_offsets(region)
    for k in reversed(range(len(region.targets))):
        cells = region.cells_of(k)
        flat[cells] = angles(region.corners_A[cells], region.targets[k].axes_A) + offsets[k]
    return flat


def finish_cells(ax: Axes, region: TargetRegion, *, brief: bool = False) -> None:
    """Name the axes, and several targets by letters above them; briefly where there is little room."""
    tidy(ax)
    ax.grid(False)
    where = "" if brief else " of the target's centre"
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
    lamp = unit(region.area @ region.normal_A) + 0.5 * north - 0.4 * east
    shaded = shade(colours, region.normal_A, lamp, ambient)
    bordered = region.n_cells <= MAX_BORDERED
    edges, width = ("white", 0.5) if bordered else (shaded, 0.2)
    cells = triangles(flat_cells(region), facecolors=shaded, edgecolors=edges, linewidths=width, zorder=1)
    ax.add_collection(cells)
    ax.set_aspect("equal")
    ax.autoscale_view()
    ax.margins(0.07)
    finish_cells(ax, region, brief=brief)
