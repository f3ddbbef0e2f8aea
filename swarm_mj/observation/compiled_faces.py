"""Face-ID buffers drawn by compiled code: the same pictures as OpenGL's, on any machine and in any thread."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from swarm_mj.observation.camera import CameraModel, CameraPose
from swarm_mj.observation.projection import Window
from swarm_mj.observation.raster import LANES, draw_faces
from swarm_mj.typing import Array

#: Nearest depth drawn, over the extent of the body.
NEAREST = 1e-7


class CompiledFaces:
    """Draws the number of the face under each pixel, in double precision on one core.

    Args:
        vertices: Of the body in A [m], shape (v, 3).
        faces: Vertex indices, counter-clockwise seen from outside, shape (f, 3).
        camera: The camera; its resolution is that of the buffer.
    """

    note = "face-ID buffers drawn by compiled code"

    def __init__(self, vertices: Array, faces: NDArray[np.integer], camera: CameraModel) -> None:
        self.camera = camera
        self._vertices = np.ascontiguousarray(vertices, np.float64)
        self._faces = np.ascontiguousarray(faces, np.int32)
        self._near = NEAREST * float(np.ptp(vertices, axis=0).max())
        self._picture_from_camera = np.array([[1.0 / camera.tan_half_angle], [1.0 / camera.tan_half_angle], [1.0]])
        size = camera.resolution_px
        self._projected = np.empty_like(self._vertices)
        self._chosen = np.empty(len(faces) + 1, np.int32)
        self._row_span = np.full((size, 2), (0, size - 1), np.int32)
        self._depth = np.empty(size**2 + LANES, np.float32)
        self._pixels = np.empty(size**2 + LANES, np.uint32)
        self._picture = self._pixels[: size**2].reshape(size, size)

    def draw(self, pose: CameraPose, window: Window) -> NDArray[np.uint32]:
        """Draw a window of the picture, see `FaceDrawer.draw`."""
        if self.camera.shape == "cone":
            self._find_spans(window)
        draw_faces(
            self._vertices,
            self._faces,
            pose.r_A,
            self._pixel_from_picture(window) @ self._picture_from_body(pose),
            self._near,
            self._row_span,
            self._projected,
            self._chosen,
            self._depth,
            self._pixels,
        )
        return self._picture

    def _picture_from_body(self, pose: CameraPose) -> Array:
        """Homogeneous picture coordinates, (x, y) = (X, Y) / Z, of positions relative to the camera in A."""
        return self._picture_from_camera * pose.C_CA

    def _pixel_from_picture(self, window: Window) -> Array:
        """Columns and rows (upwards) from homogeneous picture coordinates (y down)."""
        across, down = self.camera.resolution_px / (window.high - window.low)
        return np.array([[across, 0.0, -across * window.low[0]], [0.0, -down, down * window.high[1]], [0.0, 0.0, 1.0]])

    def _find_spans(self, window: Window) -> None:
        """Write the first and last column of each row whose centre is in a cone."""
        size = self.camera.resolution_px
        across, down = (window.high - window.low) / size
        y = window.high[1] - (np.arange(size) + 0.5) * down
        reach = np.sqrt(np.maximum(1.0 - y**2, 0.0))
        self._row_span[:, 0] = np.clip(np.ceil((-reach - window.low[0]) / across - 0.5), 0, size)
        self._row_span[:, 1] = np.clip(np.floor((reach - window.low[0]) / across - 0.5), -1, size - 1)
        self._row_span[np.abs(y) > 1.0] = 0, -1

    def close(self) -> None:
        """Nothing to release."""
