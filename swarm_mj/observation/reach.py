"""What a camera can show at most, if the body hid nothing: cells that are not in reach never count, whoever looks.

Sound for every observer, and close: what is in reach and yet does not count is hidden, or shows its share within a pixel of it.

- Limits and light are the criterion's own (`keeps_limits`), the field of view is the camera's; both a little wider, by far
  more than rounding.
- Whole cells must have their corners in the field of view.
- Observers that sample, some of them only cells too small to count, find no more samples than lie in the field of view.
- Observers that count pixels find no more than have their centres in a convex part of the picture: its area and half a pixel
  all around. That part is the cell within a polygon about the field of view.
"""

from __future__ import annotations

from math import atan, cos, pi, sin, sqrt
from typing import Any, NamedTuple

import numpy as np

from swarm_mj.compilation import jittable, kernel
from swarm_mj.mission.target import TargetRegion
from swarm_mj.observation.camera import Optics, in_field_of_view
from swarm_mj.observation.capture import Limits, keeps_limits, limits_of
from swarm_mj.observation.faceid import MIN_INRADIUS_PX
from swarm_mj.observation.observer import Observer
from swarm_mj.observation.raycast import barycentric_samples
from swarm_mj.scenarios.schema_imaging import Observation
from swarm_mj.spacecraft.attitude.algebra import times
from swarm_mj.typing import Array, Mask

#: By this share everything is wider than it is, so that no rounding decides.
WIDER = 1e-9
#: Sides of the polygon about a cone's picture; a square has four.
SIDES = 32


class Reach(NamedTuple):
    """A camera and a criterion in numbers, both wider than they are.

    Attributes:
        limits: Of range, emission and ground sampling distance, and the least share.
        optics: The field of view.
        weights: Barycentric coordinates of the samples, shape (samples, 3).
        sides: Outward unit normals of the polygon about the picture, shape (sides, 2).
        around: Cosine and sine of half a cone about the field of view and a pixel more.
        pixel: Width of a pixel in units of half the picture; 0: no pixels are counted.
        whole: Whether only whole cells count.
    """

    limits: Limits
    optics: Optics
    weights: Array
    sides: Array
    around: tuple[float, float]
    pixel: float
    whole: bool


class Cells(NamedTuple):
    """Cells in A [m]: centroids, outward unit normals, shapes (n, 3); corners, shape (n, 3, 3); radii about centroids, (n,)."""

    centroid: Array
    normal: Array
    corners: Array
    radius: Array


def reach_of(observer: Observer, criterion: Observation) -> Reach:
    """How far an observer's pictures reach by a criterion."""
    camera, limits = observer.camera, limits_of(criterion, observer.camera, observer.region)
    optics, sides = camera.optics, SIDES if camera.shape == "cone" else 4
    pixel = 2.0 / camera.resolution_px
    around = atan(optics.tan_half_angle * (1.0 + pixel) * (1.0 if optics.cone else sqrt(2.0)))
    angles = 2.0 * pi * np.arange(sides) / sides
    return Reach(
        limits=limits._replace(
            min_cos_emission=limits.min_cos_emission - WIDER,
            max_range=limits.max_range * (1.0 + WIDER),
            max_gsd=limits.max_gsd * (1.0 + WIDER),
            min_share=limits.min_share * (1.0 - WIDER),
            max_pixel_area=limits.max_pixel_area * (1.0 + WIDER),
        ),
        optics=Optics(optics.tan_half_angle * (1.0 + WIDER), optics.cone, 1.0, 1.0),
        weights=barycentric_samples(observer.samples),
        sides=np.column_stack((np.cos(angles), np.sin(angles))),
        around=(cos(around), sin(around)),
        pixel=pixel if observer.counts_pixels else 0.0,
        whole=criterion.whole,
    )


def cells_of(region: TargetRegion) -> Cells:
    """The cells of a target."""
    radius = np.linalg.norm(region.corners_A - region.centroid_A[:, None], axis=2).max(axis=1)
    return Cells(region.centroid_A, region.normal_A, np.ascontiguousarray(region.corners_A), (1.0 + WIDER) * radius)


@kernel
def in_reach(cells: Cells, reach: Reach, r_A: Array, C_CA: Array, light: Mask) -> Mask:
    """Which cells any of a camera's pictures might show, shape (n,), from `r_A` [m], shape (t, 3), and `C_CA`, shape (t, 3, 3).

    Which cells are lit is given for each picture, shape (t, n), or (1, n) where it is the same in all.
    """
    found = np.zeros(len(cells.centroid), np.bool_)
    for k in range(len(r_A)):
        lit = light[k % len(light)]
        for i in range(len(found)):
            if found[i] or not lit[i] or _far_outside(cells, reach, i, r_A[k], C_CA[k]):
                continue
            if _within_limits(cells, reach.limits, i, r_A[k]):
                found[i] = _might_show(cells.corners[i], reach, r_A[k], C_CA[k])
    return found


@jittable
def _far_outside(cells: Cells, reach: Reach, i: int, r_A: Array, C_CA: Array) -> Any:
    """Whether the ball about a cell lies outside the cone about the picture, which is soon found out."""
    x, y, z = _to_camera(cells.centroid, C_CA, r_A, i)
    cosine, sine = reach.around
    return np.sqrt(x * x + y * y) * cosine - z * sine > cells.radius[i] * (1.0 + WIDER) + WIDER * abs(z)


@jittable
def _within_limits(cells: Cells, limits: Limits, i: int, r_A: Array) -> Any:
    squared, height = 0.0, 0.0
    for axis in range(3):
        to_camera = r_A[axis] - cells.centroid[i, axis]
        squared += to_camera * to_camera
        height += to_camera * cells.normal[i, axis]
    distance = np.sqrt(squared)
    return keeps_limits(limits, distance, height + WIDER * distance)


@kernel
def _might_show(corners: Array, reach: Reach, r_A: Array, C_CA: Array) -> bool:
    """Whether enough of a cell may be seen in a picture."""
    seen = np.empty((3, 3))
    inside, ahead = 0, 0
    for c in range(3):
        x, y, z = _to_camera(corners, C_CA, r_A, c)
        seen[c, 0], seen[c, 1], seen[c, 2] = x, y, z
        inside += in_field_of_view(reach.optics, x, y, z)
        ahead += z > 0.0
    if inside == 3 or reach.whole:
        return inside == 3
    if ahead < 3:
        return ahead > 0
    if reach.pixel > 0.0:
        share, inradius = _pixels(seen, reach)
        if share >= reach.limits.min_share or inradius >= MIN_INRADIUS_PX * (1.0 + WIDER):
            return share >= reach.limits.min_share
    samples = 0
    for weight in reach.weights:
        x, y, z = times(seen.T, weight)
        samples += in_field_of_view(reach.optics, x, y, z)
    return samples / len(reach.weights) >= reach.limits.min_share


@jittable
def _to_camera(corners: Array, C_CA: Array, r_A: Array, c: int) -> Any:
    return times(C_CA, (corners[c, 0] - r_A[0], corners[c, 1] - r_A[1], corners[c, 2] - r_A[2]))


@kernel
def _pixels(seen: Array, reach: Reach) -> tuple[float, float]:
    """The most pixels that a cell before the camera can have, over those expected of it; the radius of its incircle [px].

    Both of the whole picture. A part of it with finer pixels makes the share less and the circle larger.
    """
    polygon, count = np.empty((3 + len(reach.sides), 2)), 3
    for c in range(3):
        for axis in range(2):
            polygon[c, axis] = seen[c, axis] / (seen[c, 2] * reach.optics.tan_half_angle)
    whole, perimeter = _area(polygon, 3), 0.0
    for c in range(3):
        perimeter += np.hypot(polygon[c, 0] - polygon[c - 1, 0], polygon[c, 1] - polygon[c - 1, 1])
    clipped = np.empty_like(polygon)
    for side in reach.sides:
        count = _clip(polygon, count, side, 1.0 + reach.pixel, clipped)
        polygon, clipped = clipped, polygon
    inradius = 2.0 * whole / (perimeter * reach.pixel)
    if count == 0:
        return 0.0, inradius
    width, height = np.ptp(polygon[:count, 0]), np.ptp(polygon[:count, 1])
    return (_area(polygon, count) + reach.pixel * (width + height) + reach.pixel**2) / whole, inradius


@kernel
def _area(polygon: Array, count: int) -> float:
    twice = 0.0
    for i in range(count):
        j = (i + 1) % count
        twice += polygon[i, 0] * polygon[j, 1] - polygon[j, 0] * polygon[i, 1]
    return 0.5 * abs(twice)


@kernel
def _clip(polygon: Array, count: int, normal: Array, offset: float, kept: Array) -> int:
    """Write the part of a convex polygon on the inner side of a line into `kept`; returns its number of corners."""
    n = 0
    for i in range(count):
        j = (i + 1) % count
        here = offset - normal[0] * polygon[i, 0] - normal[1] * polygon[i, 1]
        there = offset - normal[0] * polygon[j, 0] - normal[1] * polygon[j, 1]
        if here >= 0.0:
            kept[n] = polygon[i]
            n += 1
        if (here >= 0.0) != (there >= 0.0):
            for axis in range(2):
                kept[n, axis] = polygon[i, axis] + (polygon[j, axis] - polygon[i, axis]) * here / (here - there)
            n += 1
    return n
