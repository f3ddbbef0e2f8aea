"""Lines and fields of view around the spacecraft: trails, fields of view, dashed lines of sight."""

from __future__ import annotations

from collections.abc import Callable

import mujoco
import numpy as np

from swarm_mj.rendering.frame import Instant
from swarm_mj.rendering.model import DrawingModel
from swarm_mj.rendering.palette import TRAIL, rgba
from swarm_mj.typing import Array

#: Next free geom of a scene, None when it is full.
NextGeom = Callable[[], mujoco.MjvGeom | None]

LINE = mujoco.mjtGeom.mjGEOM_LINE
#: Widths of lines [pixel].
SIGHT_WIDTH, EDGE_WIDTH, TRAIL_WIDTH = 2.0, 1.0, 1.0
#: Opacity of a field of view, of its edges and of trails.
FIELD_ALPHA, EDGE_ALPHA, TRAIL_ALPHA = 0.07, 0.45, 0.55
#: Dashes over the body's radius; in greater number they are longer.
DASH, MAX_DASHES = 0.045, 40
#: Fields of view with more corners are round and have no edges.
MAX_EDGES = 4
#: Length of a line of sight without end over the body's radius.
FREE_SIGHT = 0.8


def decorate(next_geom: NextGeom, model: DrawingModel, instant: Instant, width_scale: float = 1.0) -> None:
    """Add the lines and fields of view of an instant to a model's scene; `width_scale` is of lines, for large pictures."""
    radius = float(model.mjmodel.stat.extent)
    length, tips = sights(instant, radius)
    colours, working = instant.colours, np.flatnonzero(instant.works).tolist()
    for j in working:
        for start, end in dashes(instant.r_BN_N[j], tips[j], DASH * radius):
            line(next_geom(), start, end, width_scale * SIGHT_WIDTH, rgba(colours[j]))
    looking = np.flatnonzero(instant.looks_at_body).tolist()
    rims = {j: instant.r_BN_N[j] + length[j] * model.rim_C @ instant.cameras[j] for j in looking}
    for j, rim in rims.items():
        for corner in rim if len(rim) <= MAX_EDGES else ():
            line(next_geom(), instant.r_BN_N[j], corner, width_scale * EDGE_WIDTH, rgba(colours[j], EDGE_ALPHA))
    for path in np.moveaxis(instant.trail_N[:, working], 1, 0):
        for start, end in zip(path[:-1], path[1:], strict=True):
            line(next_geom(), start, end, width_scale * TRAIL_WIDTH, rgba(TRAIL, TRAIL_ALPHA))
    for j, rim in rims.items():
        for first, second in zip(rim, np.roll(rim, -1, axis=0), strict=True):
            corners = np.array([instant.r_BN_N[j], second, first])
            triangle(next_geom, corners, rgba(colours[j], FIELD_ALPHA))


def sights(instant: Instant, radius: float) -> tuple[Array, Array]:
    """Lengths (n,) [m] and ends (n, 3) [m] in N of the lines of sight around a body of some radius [m]."""
    length = np.where(instant.sight_length > 0.0, instant.sight_length, FREE_SIGHT * radius)
    return length, instant.r_BN_N + length[:, None] * instant.boresight_N


def dashes(start: Array, end: Array, length: float) -> list[tuple[Array, Array]]:
    """Cut a line into dashes with gaps as long as they are; the first begins at the start, the last ends at the end."""
    distance = float(np.linalg.norm(end - start))
    count = int(np.clip(np.ceil(0.5 * (distance / length + 1.0)), 1, MAX_DASHES))
    cuts = start + np.linspace(0.0, 1.0, 2 * count)[:, None] * (end - start)
    return [(cuts[2 * k], cuts[2 * k + 1]) for k in range(count)]


_ZERO, _ONES, _UNIT = np.zeros(3), np.ones(3), np.eye(3).ravel()


def line(
    geom: mujoco.MjvGeom | None, start: Array, end: Array, width: float, colour: tuple[float, float, float, float]
) -> None:
    """Make a geom a line between two points (3,) [m], of a width [pixel]."""
    if geom is not None:
        mujoco.mjv_initGeom(geom, LINE, _ZERO, _ZERO, _UNIT, np.array(colour, np.float32))
        mujoco.mjv_connector(geom, LINE, width, start, end)
        geom.emission = 1.0


def triangle(next_geom: NextGeom, corners: Array, colour: tuple[float, float, float, float]) -> None:
    """Add a triangle with corners (3, 3) [m], seen from the side from which they run counter-clockwise."""
    geom = next_geom()
    if geom is not None:
        # MuJoCo's has its corners at the origin and at the sizes along its x and y axes: the matrix shears that.
        first, second = corners[1] - corners[0], corners[2] - corners[0]
        normal = np.cross(first, second)
        normal /= max(float(np.linalg.norm(normal)), 1e-12)
        kind = mujoco.mjtGeom.mjGEOM_TRIANGLE
        mujoco.mjv_initGeom(geom, kind, _ONES, corners[0], _UNIT, np.array(colour, np.float32))
        geom.mat[:] = np.stack((first, second, normal), axis=1)
        geom.emission = 1.0
