"""Cells as they fall on the picture, in double precision.

Picture coordinates: x to the right, y down, in units of half the picture's width, so that the square field of view is
[-1, 1] x [-1, 1] whatever the half-angle.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swarm_mj.observation.camera import CameraModel


@dataclass(frozen=True)
class Window:
    """A rectangle of the picture: `low` and `high` corners in picture coordinates, shape (2,)."""

    low: NDArray[np.float64]
    high: NDArray[np.float64]


WHOLE_PICTURE = Window(np.array([-1.0, -1.0]), np.array([1.0, 1.0]))


@dataclass(frozen=True)
class PictureCells:
    """Triangles on the picture.

    Attributes:
        corners: Picture coordinates, shape (n, 3, 2); meaningless for cells that are not `ahead`.
        ahead: Cells whose corners all lie before the camera, shape (n,).
        in_picture: Cells that may reach into the field of view, shape (n,).
    """

    corners: NDArray[np.float64]
    ahead: NDArray[np.bool_]
    in_picture: NDArray[np.bool_]

    def window(self, chosen: NDArray[np.bool_]) -> Window:
        """Smallest window that holds the chosen cells, as far as they are in the picture."""
        if not self.ahead[chosen].all():
            return WHOLE_PICTURE
        points = self.corners[chosen].reshape(-1, 2)
        window = Window(np.maximum(points.min(axis=0), -1.0), np.minimum(points.max(axis=0), 1.0))
        return window if (window.high > window.low).all() else WHOLE_PICTURE

    def pixels(self, window: Window, resolution_px: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Area [px^2] and radius of the inscribed circle [px] of each cell when `window` fills a square picture."""
        corners = self.corners * (resolution_px / (window.high - window.low))
        a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
        area = 0.5 * np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
        perimeter = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2).sum(axis=1)
        return area, 2.0 * area / np.maximum(perimeter, np.finfo(float).tiny)


def project(corners_C: NDArray[np.float64], camera: CameraModel) -> PictureCells:
    """Project triangles, shape (n, 3, 3), given in the camera frame [m]."""
    depth = corners_C[..., 2]
    ahead = np.asarray(np.all(depth > 0.0, axis=1))
    safe = np.where(ahead[:, None], depth, 1.0)
    corners = corners_C[..., :2] / (safe * camera.tan_half_angle)[..., None]
    overlaps = np.all((corners.min(axis=1) < 1.0) & (corners.max(axis=1) > -1.0), axis=1)
    return PictureCells(corners, ahead, np.asarray((ahead & overlaps) | (~ahead & np.any(depth > 0.0, axis=1))))
