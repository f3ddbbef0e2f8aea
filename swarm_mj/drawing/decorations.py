"""Lines and pyramids around the spacecraft: trails, fields of view, dashed lines of sight."""

from __future__ import annotations

from collections.abc import Callable

import mujoco
import numpy as np
from numpy.typing import NDArray

from swarm_mj.drawing.instant import Instant
from swarm_mj.drawing.model import DrawingModel
from swarm_mj.drawing.palette import MODES, TRAIL, rgba
from swarm_mj.mission.behaviors import TargetKind

Array = NDArray[np.float64]

#: Next free geom of a scene, None when it is full.
NextGeom = Callable[[], mujoco.MjvGeom | None]

LINE = mujoco.mjtGeom.mjGEOM_LINE
#: Widths of lines [pixel].
SIGHT_WIDTH, EDGE_WIDTH, TRAIL_WIDTH = 2.0, 1.0, 1.0
#: Opacity of a field of view, of its edges and of trails.
PYRAMID_ALPHA, EDGE_ALPHA, TRAIL_ALPHA = 0.10, 0.45, 0.55
#: Dashes over the body's radius; in greater number they are longer.
DASH, MAX_DASHES = 0.045, 40
#: Length of a line of sight without end over the body's radius.
FREE_SIGHT = 0.8


def decorate(next_geom: NextGeom, model: DrawingModel, instant: Instant, width_scale: float = 1.0) -> None:
    """Add the lines and pyramids of an instant to a scene.

    Args:
        next_geom: Hands out the scene's free geoms.
        model: The model whose meshes the scene knows.
        instant: What to draw.
        width_scale: Factor on the widths of lines, for large pictures.
    """
    radius = float(model.mjmodel.stat.extent)
    length, tips = sights(instant, radius)
    half = np.tan(np.radians(0.5 * model.mjmodel.cam_fovy[model.cameras[0]]))
    for j in range(instant.n):
        colour = MODES[TargetKind(int(instant.kind[j]))]
        r = instant.r_BN_N[j]
        for start, end in dashes(r, tips[j], DASH * radius):
            _line(next_geom(), start, end, width_scale * SIGHT_WIDTH, rgba(colour))
        if instant.looks_at_body[j]:
            sides = length[j] * np.array([half, half, 1.0])
            for corner in ((-1, -1, 1), (1, -1, 1), (1, 1, 1), (-1, 1, 1)):
                edge = r + (sides * corner) @ instant.C_BN[j]
                _line(next_geom(), r, edge, width_scale * EDGE_WIDTH, rgba(colour, EDGE_ALPHA))
    for j in range(instant.n):
        for start, end in zip(instant.trail_N[:-1, j], instant.trail_N[1:, j], strict=True):
            _line(next_geom(), start, end, width_scale * TRAIL_WIDTH, rgba(TRAIL, TRAIL_ALPHA))
    for j in np.flatnonzero(instant.looks_at_body).tolist():
        colour = MODES[TargetKind(int(instant.kind[j]))]
        sides = length[j] * np.array([half, half, 1.0])
        _pyramid(next_geom(), model, instant.r_BN_N[j], sides[:, None] * instant.C_BN[j], rgba(colour, PYRAMID_ALPHA))


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


_ZERO, _UNIT = np.zeros(3), np.eye(3).ravel()


def _line(
    geom: mujoco.MjvGeom | None, start: Array, end: Array, width: float, colour: tuple[float, float, float, float]
) -> None:
    if geom is not None:
        mujoco.mjv_initGeom(geom, LINE, _ZERO, _ZERO, _UNIT, np.array(colour, np.float32))
        mujoco.mjv_connector(geom, LINE, width, start, end)
        geom.emission = 1.0


def _pyramid(
    geom: mujoco.MjvGeom | None,
    model: DrawingModel,
    r: Array,
    stretched: Array,
    colour: tuple[float, float, float, float],
) -> None:
    """Add a pyramid with its apex at `r`; the rows of `stretched` are its half sides and its height in N [m]."""
    if geom is not None:
        # MuJoCo moved the mesh into its inertial frame. A mesh takes no size: it is stretched by its matrix.
        mesh, turn = model.pyramid, np.empty(9)
        mujoco.mju_quat2Mat(turn, model.mjmodel.mesh_quat[mesh])
        place = r + model.mjmodel.mesh_pos[mesh] @ stretched
        mujoco.mjv_initGeom(geom, mujoco.mjtGeom.mjGEOM_MESH, _ZERO, place, _UNIT, np.array(colour, np.float32))
        geom.mat[:] = stretched.T @ turn.reshape(3, 3)
        geom.dataid = 2 * mesh
        geom.emission = 1.0
