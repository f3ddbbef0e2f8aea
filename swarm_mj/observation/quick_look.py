"""Newly seen cells of a picture by horizon maps, compiled: the criterion of `observe` and the maps of `HorizonObserver` in one pass.

A cell that was seen before, fails a limit, or lies beside the field of view costs a few nanoseconds, so that the time of a
picture is that of the few cells that it may add.
"""

from __future__ import annotations

from math import inf, radians
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from swarm_mj.observation.coverage import ObservationCriterion
from swarm_mj.observation.horizon import HorizonObserver, above

Array = NDArray[np.float64]


class Scene(NamedTuple):
    """Target, horizon maps, camera and criterion.

    Attributes:
        cells: Centroid, normal (in A), bounding radius [m] and area [m^2] of each cell, shape (C, 8).
        points: Sample points in A, shape (C, samples, 3) [m].
        axes: Tangents and normal of each cell as rows, shape (C, 3, 3).
        sine: Sine of the horizon's elevation, shape (C, samples, azimuths + 1).
        limits: Least cosine of emission, largest range [m], largest ground sampling distance [m], pixel angle [rad], tangent
            of the field of view's half-angle, 1 for a cone or 0 for a square, least visible share, shape (7,).
    """

    cells: Array
    points: Array
    axes: Array
    sine: NDArray[np.float32]
    limits: Array


def make_scene(observer: HorizonObserver, criterion: ObservationCriterion) -> Scene:
    """Gather what `new_cells` needs; light, which changes with time, is not part of it."""
    region, camera, maps = observer.region, observer.camera, observer.horizon
    reach = np.linalg.norm(region.corners_A - region.centroid_A[:, None], axis=2).max(axis=1)
    emission = criterion.max_emission_deg
    least = 0.0 if emission is None else max(0.0, float(np.cos(radians(min(emission, 90.0)))))
    # Any visible part at all is more than nothing and less than one sample in any number of them.
    share = 1e-9 if criterion.any_pixel else criterion.min_fraction
    limits = [least, criterion.max_range_m or inf, criterion.max_gsd_m or inf, camera.pixel_angle]
    limits += [camera.tan_half_angle, float(camera.shape == "cone"), share]
    return Scene(
        cells=np.column_stack([region.centroid_A, region.normal_A, reach, region.area]),
        points=np.ascontiguousarray(maps.points),
        axes=np.ascontiguousarray(maps.axes),
        sine=np.ascontiguousarray(maps.sine),
        limits=np.array(limits),
    )


@njit(cache=True, nogil=True, error_model="numpy")
def new_cells(scene: Scene, r: Array, C: Array, seen: NDArray[np.bool_], new: NDArray[np.bool_]) -> tuple[float, float]:
    """Find the cells that a picture shows and nobody saw before.

    Args:
        scene: See `Scene`.
        r: Position of the camera in A, outside the body's bounding sphere, shape (3,) [m].
        C: Rotation from A to the camera frame, shape (3, 3).
        seen: Cells seen before, or otherwise of no interest, shape (C,).
        new: Receives the cells that are new, shape (C,).

    Returns:
        Their area [m^2], and the pixels spent on them: area over the foreshortened square of the ground sampling distance.
    """
    area = pixels = 0.0
    for i in range(seen.shape[0]):
        new[i] = False
        if not seen[i] and _shows(scene, r, C, i):
            new[i] = True
            cell = scene.cells[i]
            dx, dy, dz = r[0] - cell[0], r[1] - cell[1], r[2] - cell[2]
            distance = np.sqrt(dx * dx + dy * dy + dz * dz)
            cosine = (dx * cell[3] + dy * cell[4] + dz * cell[5]) / distance
            area += cell[7]
            pixels += cell[7] * cosine / (distance * scene.limits[3]) ** 2
    return area, pixels


@njit(cache=True, nogil=True, error_model="numpy")
def _shows(scene: Scene, r: Array, C: Array, i: int) -> bool:
    cell, limits = scene.cells[i], scene.limits
    dx, dy, dz = r[0] - cell[0], r[1] - cell[1], r[2] - cell[2]
    height = dx * cell[3] + dy * cell[4] + dz * cell[5]
    if height <= 0.0:
        return False
    distance = np.sqrt(dx * dx + dy * dy + dz * dz)
    cosine = height / distance
    if cosine < limits[0] or distance > limits[1] or distance * limits[3] > limits[2] * cosine:
        return False
    tan, cone = limits[4], limits[5] == 1.0
    if _beside(C, dx, dy, dz, cell[6], tan, cone):
        return False
    count, samples = 0, scene.points.shape[1]
    for s in range(samples):
        count += _sample_in_view(scene, r, C, i, s, tan, cone)
    return count > 0 and count >= limits[6] * samples


@njit(cache=True, nogil=True, error_model="numpy")
def _beside(C: Array, dx: float, dy: float, dz: float, reach: float, tan: float, cone: bool) -> bool:
    """Whether a ball of that radius around the point that the camera sees along -d lies outside the field of view."""
    u = abs(C[0, 0] * dx + C[0, 1] * dy + C[0, 2] * dz)
    v = abs(C[1, 0] * dx + C[1, 1] * dy + C[1, 2] * dz)
    depth = reach - (C[2, 0] * dx + C[2, 1] * dy + C[2, 2] * dz)
    across = np.sqrt(u * u + v * v) if cone else max(u, v)
    return depth <= 0.0 or across - reach > tan * depth


@njit(cache=True, nogil=True, error_model="numpy")
def _sample_in_view(scene: Scene, r: Array, C: Array, i: int, s: int, tan: float, cone: bool) -> bool:
    axes, point = scene.axes[i], scene.points[i, s]
    dx, dy, dz = r[0] - point[0], r[1] - point[1], r[2] - point[2]
    z = axes[2, 0] * dx + axes[2, 1] * dy + axes[2, 2] * dz
    if z <= 0.0:
        return False
    u = -(C[0, 0] * dx + C[0, 1] * dy + C[0, 2] * dz)
    v = -(C[1, 0] * dx + C[1, 1] * dy + C[1, 2] * dz)
    reach = -tan * (C[2, 0] * dx + C[2, 1] * dy + C[2, 2] * dz)
    if reach <= 0.0 or (u * u + v * v > reach * reach if cone else max(abs(u), abs(v)) > reach):
        return False
    x = axes[0, 0] * dx + axes[0, 1] * dy + axes[0, 2] * dz
    y = axes[1, 0] * dx + axes[1, 1] * dy + axes[1, 2] * dz
    length = np.sqrt(dx * dx + dy * dy + dz * dz)
    return above(x / length, y / length, z / length, scene.sine[i, s])
