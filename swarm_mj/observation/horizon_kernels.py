"""Newly seen cells of a picture by horizon maps, compiled: the criterion of `capture` and `HorizonObserver` in one pass.

A cell that was seen before, fails a limit, or lies beside the field of view costs a few nanoseconds, so that the time of a
picture is that of the few cells that it may add.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from swarm_mj.compilation import allocation_free
from swarm_mj.errors import MissionError
from swarm_mj.observation.camera import Optics
from swarm_mj.observation.capture import Limits, keeps_limits, limits_of, pixels_on, shows_enough
from swarm_mj.observation.horizon import Horizon, HorizonObserver, Sight, look_at_cell
from swarm_mj.scenarios.schema_imaging import Observation
from swarm_mj.spacecraft.attitude.algebra import Vector, combine, dot
from swarm_mj.typing import Array, Mask


class Scene(NamedTuple):
    """Target, horizon maps, camera and criterion.

    Attributes:
        cells: Of each the centroid in A [m], the unit normal, the radius of the ball about the centroid that holds it [m], and
            its area [m^2], shape (C, 8).
        horizon: The maps.
        optics: The camera's field of view.
        radius: Of the body's bounding sphere [m].
        limits: Of the criterion, but for the light, which changes with time.
        samples: Least number of sample points of a cell that must be in view.
    """

    cells: Array
    horizon: Horizon
    optics: Optics
    radius: float
    limits: Limits
    samples: int


def make_scene(observer: HorizonObserver, criterion: Observation) -> Scene:
    """Gather what `new_cells` needs.

    Raises:
        MissionError: The criterion asks for whole cells, which sample points alone do not tell, or limits motion blur.
    """
    if criterion.whole:
        raise MissionError(f"min_fraction {criterion.min_fraction} asks for whole cells: judge them by `observe`")
    if criterion.needs_motion:
        raise MissionError(
            f"max_motion_blur_px {criterion.max_motion_blur_px}: compiled pictures do not know rates: judge them by `observe`"
        )
    region, limits = observer.region, limits_of(criterion, observer.camera, observer.region)
    radius = np.linalg.norm(region.corners_A - region.centroid_A[:, None], axis=2).max(axis=1)
    samples = observer.horizon.samples
    return Scene(
        cells=np.column_stack([region.centroid_A, region.normal_A, radius, region.area]),
        horizon=observer.horizon.arrays,
        optics=observer.camera.optics,
        radius=float(region.mesh.max_radius),
        limits=limits,
        samples=next(count for count in range(1, samples + 1) if shows_enough(limits, count / samples)),
    )


@allocation_free
def new_cells(
    scene: Scene, camera: Sight, seen: Mask, new: Mask, answer: NDArray[np.int8]
) -> tuple[float, float, bool]:
    """Find the cells that a picture shows and nobody saw before.

    Args:
        scene: See `Scene`.
        camera: Where the picture is taken from.
        seen: Cells seen before, or otherwise of no interest, shape (C,).
        new: Receives the cells that are new, shape (C,).
        answer: Scratch, shape (samples,).

    Returns:
        Their area [m^2], the pixels spent on them, and whether some other cell is in doubt, because it may be in view although
        the maps hide it.
    """
    cells, horizon, limits, needed = scene.cells, scene.horizon, scene.limits, scene.samples
    area = pixels = 0.0
    doubt = False
    for i in range(seen.shape[0]):
        new[i] = False
        if seen[i]:
            continue
        way = combine(1.0, camera.r_A, -1.0, (cells[i, 0], cells[i, 1], cells[i, 2]))
        height, radius, cell_area = dot(way, (cells[i, 3], cells[i, 4], cells[i, 5])), cells[i, 6], cells[i, 7]
        if height <= 0.0 or _beside(camera, way, radius):
            continue
        distance = np.sqrt(dot(way, way))
        if not keeps_limits(limits, distance, height):
            continue
        shown, blocked = look_at_cell(horizon, camera, i, needed, answer)
        if shown >= needed:
            new[i] = True
            area += cell_area
            pixels += pixels_on(limits, cell_area, distance, height)
        elif camera.inside and shown + blocked >= needed:
            doubt = True
    return area, pixels, doubt


@allocation_free
def _beside(camera: Sight, way: Vector, radius: float) -> bool:
    """Whether a ball lies beside the field of view, the camera being at `way` from its centre: then its cell does, too."""
    optics = camera.optics
    u, v = abs(dot(camera.right, way)), abs(dot(camera.down, way))
    depth = radius - dot(camera.ahead, way)
    across = np.sqrt(u * u + v * v) if optics.cone else max(u, v)
    return depth <= 0.0 or across - radius > optics.tan_half_angle * depth
