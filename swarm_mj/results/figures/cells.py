"""The target's cells in the plane, as seen from the body's centre: angles east and north of the target's axis."""

from __future__ import annotations

from matplotlib.axes import Axes

from swarm_mj.mission.target import TargetRegion, angles
from swarm_mj.results.figures.view import shade, triangles, unit
from swarm_mj.typing import Array

#: More than on the whole body: here the colour tells what was seen.
AMBIENT = 0.6
#: With more cells than these, borders would cover the cells.
MAX_BORDERED = 1000


def draw_cells(ax: Axes, region: TargetRegion, colours: Array, ambient: float = AMBIENT) -> None:
    """Paint the cells in given colours (n, 3), lit from the north-west so that relief shows; not with `ambient` 1."""
    east, north, _ = region.axes_A
    lamp = unit(region.area @ region.normal_A) + 0.5 * north - 0.4 * east
    shaded = shade(colours, region.normal_A, lamp, ambient)
    bordered = region.n_cells <= MAX_BORDERED
    ax.add_collection(
        triangles(
            angles(region.corners_A, region.axes_A),
            facecolors=shaded,
            edgecolors="white" if bordered else shaded,
            linewidths=0.5 if bordered else 0.2,
            zorder=1,
        )
    )
    ax.set_aspect("equal")
    ax.autoscale_view()
    ax.margins(0.07)
