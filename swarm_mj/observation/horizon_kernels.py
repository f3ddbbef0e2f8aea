"""Newly seen cells of a picture by horizon maps, compiled: the criterion of `observe` and `HorizonObserver` in one pass.

A cell that was seen before, fails a limit, or lies beside the field of view costs a few nanoseconds, so that the time of a
picture is that of the few cells that it may add.
"""

from __future__ import annotations

from math import inf, radians
from typing import NamedTuple

import numpy as np

from swarm_mj.observation.capture import ObservationCriterion
from swarm_mj.observation.horizon import HorizonObserver, stands_clear
from swarm_mj.typing import Array, Array32, Mask, kernel

Vector = tuple[float, float, float]

_HIDDEN, _SHOWN, _DOUBTFUL = 0, 1, 2


class Scene(NamedTuple):
    """Target, horizon maps, camera and criterion.

    Attributes:
        cells: Centroid, normal (in A), bounding radius [m] and area [m^2] of each cell, shape (C, 8).
        points: Sample points in A, shape (C, samples, 3) [m].
        axes: Tangents and normal of each cell as rows, shape (C, 3, 3).
        sine: Sine of the horizon's elevation, shape (C, samples, azimuths + 1).
        highest: The largest of those, shape (C, samples).
        limits: Least cosine of emission, largest range [m], largest ground sampling distance [m], pixel angle [rad], tangent
            of the field of view's half-angle, 1 for a cone or 0 for a square, least visible share, shape (7,).
    """

    cells: Array
    points: Array
    axes: Array
    sine: Array32
    highest: Array32
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
        highest=maps.highest,
        limits=np.array(limits),
    )


@kernel
def new_cells(scene: Scene, r: Array, C: Array, inside: bool, seen: Mask, new: Mask) -> tuple[float, float, bool]:
    """Find the cells that a picture shows and nobody saw before.

    Args:
        scene: See `Scene`.
        r: Position of the camera in A, shape (3,) [m].
        C: Rotation from A to the camera frame, shape (3, 3).
        inside: Whether the camera is inside the body's bounding sphere, where the maps may hide what is in view.
        seen: Cells seen before, or otherwise of no interest, shape (C,).
        new: Receives the cells that are new, shape (C,).

    Returns:
        Their area [m^2], the pixels spent on them (area over the foreshortened square of the ground sampling distance), and
        whether some other cell is in doubt, because it may be in view although the maps hide it.
    """
    cells, limits, points, axes = scene.cells, scene.limits, scene.points, scene.axes
    sine, highest = scene.sine, scene.highest
    pose = (r[0], r[1], r[2]), (C[0, 0], C[0, 1], C[0, 2]), (C[1, 0], C[1, 1], C[1, 2]), (C[2, 0], C[2, 1], C[2, 2])
    (x, y, z), right, down, ahead = pose
    least, farthest, gsd, pixel, tan, cone = limits[0], limits[1], limits[2], limits[3], limits[4], limits[5] == 1.0
    area = pixels = 0.0
    doubt = False
    for i in range(seen.shape[0]):
        new[i] = False
        if seen[i]:
            continue
        dx, dy, dz = x - cells[i, 0], y - cells[i, 1], z - cells[i, 2]
        height = dx * cells[i, 3] + dy * cells[i, 4] + dz * cells[i, 5]
        if height <= 0.0:
            continue
        # A cell is beside the field of view if the ball around it is.
        u = abs(right[0] * dx + right[1] * dy + right[2] * dz)
        v = abs(down[0] * dx + down[1] * dy + down[2] * dz)
        depth = cells[i, 6] - (ahead[0] * dx + ahead[1] * dy + ahead[2] * dz)
        across = np.sqrt(u * u + v * v) if cone else max(u, v)
        if depth <= 0.0 or across - cells[i, 6] > tan * depth:
            continue
        distance = np.sqrt(dx * dx + dy * dy + dz * dz)
        cosine = height / distance
        if cosine < least or distance > farthest or distance * pixel > gsd * cosine:
            continue
        answer = _shows(points, axes, sine, highest, limits, pose, inside, i)
        doubt = doubt or answer == _DOUBTFUL
        if answer == _SHOWN:
            new[i] = True
            area += cells[i, 7]
            pixels += cells[i, 7] * cosine / (distance * pixel) ** 2
    return area, pixels, doubt


@kernel
def _shows(
    points: Array,
    axes: Array,
    sine: Array32,
    highest: Array32,
    limits: Array,
    pose: tuple[Vector, Vector, Vector, Vector],
    inside: bool,
    i: int,
) -> int:
    """Whether enough of a cell's sample points are in view; in doubt where they only may be, below the map's horizon."""
    samples, tan, cone = points.shape[1], limits[4], limits[5] == 1.0
    needed = max(1.0, limits[6] * samples)
    (rx, ry, rz), right, down, ahead = pose
    shown = blocked = 0
    for s in range(samples):
        left = samples - s
        if shown + left + (blocked if inside else 0) < needed:
            return _HIDDEN
        dx, dy, dz = rx - points[i, s, 0], ry - points[i, s, 1], rz - points[i, s, 2]
        z = axes[i, 2, 0] * dx + axes[i, 2, 1] * dy + axes[i, 2, 2] * dz
        u = -(right[0] * dx + right[1] * dy + right[2] * dz)
        v = -(down[0] * dx + down[1] * dy + down[2] * dz)
        reach = -tan * (ahead[0] * dx + ahead[1] * dy + ahead[2] * dz)
        if z <= 0.0 or reach <= 0.0 or (u * u + v * v > reach * reach if cone else max(abs(u), abs(v)) > reach):
            continue
        if stands_clear(axes[i], dx, dy, dz, z, sine[i, s], highest[i, s]):
            shown += 1
            if shown >= needed:
                return _SHOWN
        else:
            blocked += 1
    return _DOUBTFUL if inside and shown + blocked >= needed else _HIDDEN
