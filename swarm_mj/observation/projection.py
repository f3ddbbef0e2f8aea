"""Cells as they fall on the picture, in double precision.

Picture coordinates: x to the right, y down, in units of half the picture's width, so that the square field of view is
[-1, 1] x [-1, 1] whatever the half-angle.
"""

from dataclasses import dataclass
from math import floor, sqrt

import numpy as np

from swarm_mj.compilation import jittable, kernel
from swarm_mj.observation.camera import CameraModel
from swarm_mj.typing import Array, Ints32, Mask

Boxes = Ints32

#: Keeps the radius of a cell that is a point from being no number.
TINY = float(np.finfo(float).tiny)


@dataclass(frozen=True)
class PictureWindow:
    """A rectangle of the picture: `low` and `high` corners in picture coordinates, shape (2,)."""

    low: Array
    high: Array


WHOLE_PICTURE = PictureWindow(np.array([-1.0, -1.0]), np.array([1.0, 1.0]))


@dataclass(frozen=True)
class PictureCells:
    """Triangles on the picture.

    Attributes:
        corners: Picture coordinates, shape (n, 3, 2); meaningless for cells that are not `ahead`.
        ahead: Cells whose corners all lie before the camera, shape (n,).
        in_picture: Cells that may reach into the field of view, shape (n,).
    """

    corners: Array
    ahead: Mask
    in_picture: Mask

    def window(self, chosen: Mask) -> PictureWindow:
        """Smallest window that holds the chosen cells, as far as they are in the picture."""
        if not self.ahead[chosen].all():
            return WHOLE_PICTURE
        points = self.corners[chosen].reshape(-1, 2)
        window = PictureWindow(np.maximum(points.min(axis=0), -1.0), np.minimum(points.max(axis=0), 1.0))
        return window if (window.high > window.low).all() else WHOLE_PICTURE

    def pixels(self, window: PictureWindow, resolution_px: int) -> tuple[Array, Array]:
        """Area [px^2] and radius of the inscribed circle [px] of each cell when `window` fills a square picture."""
        across, down = resolution_px / (window.high - window.low)
        return _measure(self.corners, across, down)

    def boxes(self, window: PictureWindow, resolution_px: int) -> Ints32:
        """Pixels that each cell may cover when `window` fills a square picture, with a margin of one.

        Returns:
            First column and row and last column and row, rows counted upwards, shape (n, 4); the first is beyond the last
            where there are none.
        """
        across, down = resolution_px / (window.high - window.low)
        left, top = window.low
        return _boxes(self.corners, left, top, across, down, resolution_px)


def project(corners_C: Array, camera: CameraModel) -> PictureCells:
    """Project triangles, shape (n, 3, 3), given in the camera frame [m]."""
    return PictureCells(*_project(np.ascontiguousarray(corners_C), camera.tan_half_angle))


@kernel
def _project(corners_C: Array, tan_half_angle: float) -> tuple[Array, Mask, Mask]:
    """Corners on the picture, whether all lie ahead, and whether the cell may reach into the field of view."""
    n = corners_C.shape[0]
    corners, ahead, in_picture = np.empty((n, 3, 2)), np.empty(n, np.bool_), np.empty(n, np.bool_)
    for i in range(n):
        before = 0
        for k in range(3):
            before += corners_C[i, k, 2] > 0.0
        ahead[i], in_picture[i] = before == 3, before > 0
        for k in range(3):
            reach = (corners_C[i, k, 2] if ahead[i] else 1.0) * tan_half_angle
            corners[i, k, 0], corners[i, k, 1] = corners_C[i, k, 0] / reach, corners_C[i, k, 1] / reach
        for axis in range(2 if ahead[i] else 0):
            low, high = _extent(corners, i, axis)
            in_picture[i] &= low < 1.0 and high > -1.0
    return corners, ahead, in_picture


@jittable
def _extent(corners: Array, i: int, axis: int) -> tuple[float, float]:
    a, b, c = corners[i, 0, axis], corners[i, 1, axis], corners[i, 2, axis]
    return min(a, b, c), max(a, b, c)


@kernel
def _measure(corners: Array, across: float, down: float) -> tuple[Array, Array]:
    """Area and radius of the inscribed circle [px], with `across` and `down` pixels to a unit of the picture."""
    n = corners.shape[0]
    area, inradius = np.empty(n), np.empty(n)
    for i in range(n):
        ax, ay = corners[i, 0, 0] * across, corners[i, 0, 1] * down
        bx, by = corners[i, 1, 0] * across, corners[i, 1, 1] * down
        cx, cy = corners[i, 2, 0] * across, corners[i, 2, 1] * down
        area[i] = 0.5 * abs((bx - ax) * (cy - ay) - (by - ay) * (cx - ax))
        perimeter = sqrt((bx - ax) ** 2 + (by - ay) ** 2)
        perimeter += sqrt((cx - bx) ** 2 + (cy - by) ** 2)
        perimeter += sqrt((ax - cx) ** 2 + (ay - cy) ** 2)
        inradius[i] = 2.0 * area[i] / max(perimeter, TINY)
    return area, inradius


@kernel
def _boxes(corners: Array, left: float, top: float, across: float, down: float, size: int) -> Boxes:
    """See `PictureCells.boxes`; the picture's corner at `left` and `top` is that of the first column and the last row."""
    boxes = np.empty((corners.shape[0], 4), np.int32)
    for i in range(corners.shape[0]):
        low, high = _extent(corners, i, 0)
        boxes[i, 0], boxes[i, 2] = _inside((low - left) * across - 1.0, (high - left) * across + 1.0, size)
        low, high = _extent(corners, i, 1)
        boxes[i, 1], boxes[i, 3] = _inside(size - (high - top) * down - 1.0, size - (low - top) * down + 1.0, size)
    return boxes


@jittable
def _inside(low: float, high: float, size: int) -> tuple[int, int]:
    return int(min(max(low, 0.0), float(size))), int(floor(max(min(high, size - 1.0), -1.0)))
