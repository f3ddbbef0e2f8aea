"""Where the lens puts what it sees: pixels of a rectangular detector, with Brown's distortion.

Detector coordinates count pixels to the right and down from the upper left corner of the picture: pixel (i, j) covers i to
i + 1 and j to j + 1, so that its centre lies at i + 0.5. An undistorted image point is (x, y) = (X, Y) / Z in the camera's
frame C; the distorted one is

    x_d = x (1 + k1 r^2 + k2 r^4 + k3 r^6) + 2 p1 x y + p2 (r^2 + 2 x^2),
    y_d = y (1 + k1 r^2 + k2 r^4 + k3 r^6) + p1 (r^2 + 2 y^2) + 2 p2 x y,       r^2 = x^2 + y^2

(Brown 1966, Photogrammetric Engineering 32, 444; in the order of OpenCV). The detector sees focal_px x_d + width / 2.
"""

from __future__ import annotations

from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from swarm_mj.observation.camera import CameraModel
from swarm_mj.typing import Array

#: Rounds of Newton's method by which distortion is undone; it doubles its digits in each.
ROUNDS = 12


class Distortion(NamedTuple):
    """Brown's coefficients for image points at unit distance."""

    k1: float = 0.0
    k2: float = 0.0
    p1: float = 0.0
    p2: float = 0.0
    k3: float = 0.0


#: A lens that bends nothing.
STRAIGHT = Distortion()


class _Lens(NamedTuple):
    width: int
    height: int
    focal_px: float
    distortion: Distortion
    centre_x: float
    centre_y: float


class Lens(_Lens):
    """A detector behind a lens.

    Attributes:
        width: Pixels along x.
        height: Pixels along y.
        focal_px: Focal length over the size of a pixel.
        distortion: Brown's coefficients.
        centre_x: Detector coordinates of the line of sight [px]: of a whole picture its middle.
        centre_y: Likewise.
    """

    @cached_property
    def centre(self) -> Array:
        """Detector coordinates of the line of sight [px], shape (2,)."""
        return np.array([self.centre_x, self.centre_y])

    def zoomed(self, low: Array, high: Array, times: int) -> Lens:
        """A part of the detector, from a corner to another [px], with so many pixels in the place of each along its sides."""
        width, height = ((high - low) * times).tolist()
        x, y = ((self.centre - low) * times).tolist()
        return Lens(int(width), int(height), self.focal_px * times, self.distortion, x, y)

    @property
    def is_distorted(self) -> bool:
        """Whether straight lines are bent."""
        return any(self.distortion)

    def to_pixels(self, points_C: ArrayLike) -> Array:
        """Detector coordinates [px], shape (..., 2), of points in C, shape (..., 3), that lie ahead."""
        points = np.asarray(points_C, np.float64)
        image = points[..., :2] / points[..., 2:]
        return self.focal_px * (self.distorted(image) if self.is_distorted else image) + self.centre

    def to_image(self, pixels: ArrayLike) -> Array:
        """Undistorted image points (X, Y) / Z, shape (..., 2), of detector coordinates [px], same shape."""
        image = (np.asarray(pixels, np.float64) - self.centre) / self.focal_px
        return self._undistorted(image) if self.is_distorted else image

    def distorted(self, image: Array) -> Array:
        """Image points as the lens moves them, shape (..., 2)."""
        (k1, k2, p1, p2, k3), (x, y) = self.distortion, np.moveaxis(image, -1, 0)
        r2 = x * x + y * y
        radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
        return np.stack(
            (
                x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
                y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
            ),
            axis=-1,
        )

    def distortion_jacobian(self, image: Array) -> Array:
        """Derivatives of `distorted`, shape (..., 2, 2)."""
        (k1, k2, p1, p2, k3), (x, y) = self.distortion, np.moveaxis(image, -1, 0)
        r2 = x * x + y * y
        radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
        slope = 2.0 * (k1 + r2 * (2.0 * k2 + 3.0 * r2 * k3))
        xx = radial + x * x * slope + 2.0 * p1 * y + 6.0 * p2 * x
        yy = radial + y * y * slope + 6.0 * p1 * y + 2.0 * p2 * x
        xy = x * y * slope + 2.0 * p1 * x + 2.0 * p2 * y
        return np.stack((np.stack((xx, xy), -1), np.stack((xy, yy), -1)), -2)

    def _undistorted(self, image: Array) -> Array:
        found = image.copy()
        for _ in range(ROUNDS):
            step = np.linalg.solve(self.distortion_jacobian(found), (image - self.distorted(found))[..., None])[..., 0]
            found += step
            if np.abs(step).max(initial=0.0) < 1e-14:
                break
        return found

    def pixel_jacobian(self, points_C: ArrayLike) -> Array:
        """Derivatives of `to_pixels`, shape (..., 2, 3) [px/m]."""
        points = np.asarray(points_C, np.float64)
        image, depth = points[..., :2] / points[..., 2:], points[..., 2:]
        flat = (
            np.concatenate((np.broadcast_to(np.eye(2), (*image.shape, 2)), -image[..., None]), axis=-1)
            / depth[..., None]
        )
        bent = self.distortion_jacobian(image) @ flat if self.is_distorted else flat
        return self.focal_px * bent


def lens_of(camera: CameraModel, distortion: Distortion = STRAIGHT) -> Lens:
    """The lens of a camera whose picture has `resolution_px` along its longer side."""
    size = camera.resolution_px
    width, height = (max(1, round(side * size)) for side in camera.sides)
    return Lens(width, height, 0.5 * size / camera.tan_half_angle, distortion, 0.5 * width, 0.5 * height)
