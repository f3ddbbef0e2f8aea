"""Small pictures of a body for agents: grey, a mask and depth of many cameras at once, by the compiled rasteriser alone.

Visibility is that of `raster`: the face under each pixel's centre and its depth, in double precision. What is seen is shaded
flat by Lambert's law, without shadows that the body casts on itself. A camera whose cone of view misses the body's bounding
sphere gets an empty picture at once. One core draws some thousands of pictures of 64 x 64 pixels a second of a mesh of 2,000
faces; the time goes with the faces, so that a mesh of more is better simplified before.
"""

from __future__ import annotations

from math import sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from swarm_mj.compilation import jittable, kernel
from swarm_mj.observation.camera import CameraModel
from swarm_mj.observation.raster import NEAREST, Canvas, Mesh, View, draw_faces, make_canvas, make_mesh
from swarm_mj.typing import Array, Array32, Mask

#: Pixels along a side unless said otherwise.
SIDE_PX = 64


class Thumbnails(NamedTuple):
    """Pictures of P cameras, size S; row 0 is the top row, and the camera's +x looks to the right.

    Attributes:
        grey: Cosine of the angle of incidence of the light, 0 where it does not shine and in the sky, shape (P, S, S).
        mask: Whether the face is one of those marked, shape (P, S, S).
        depth: Distance along the line of sight [m], 0 in the sky, shape (P, S, S).
    """

    grey: Array32
    mask: Mask
    depth: Array32


class _Body(NamedTuple):
    """What is drawn: the mesh, outward unit normals (f, 3), and the radius of its bounding sphere about the origin [m]."""

    mesh: Mesh
    normals: Array
    radius: float


class ThumbnailDrawer:
    """Draws small pictures of a body.

    Args:
        vertices: Of the body in A [m], shape (v, 3).
        faces: Vertex indices, counter-clockwise seen from outside, shape (f, 3).
        camera: Square field of view; its resolution is that of the pictures.
    """

    def __init__(self, vertices: Array, faces: NDArray[np.integer], camera: CameraModel) -> None:
        size, corners = camera.resolution_px, np.asarray(vertices, np.float64)[faces]
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        self.camera = camera
        radius = float(np.linalg.norm(vertices, axis=1).max())
        self._body = _Body(make_mesh(vertices, faces), np.ascontiguousarray(normals), radius)
        self._near = NEAREST * float(np.ptp(vertices, axis=0).max())
        self._canvas = make_canvas(size, len(vertices), len(faces))

    def blank(self, count: int) -> Thumbnails:
        """So many pictures of the sky."""
        shape = (count, self.camera.resolution_px, self.camera.resolution_px)
        return Thumbnails(np.zeros(shape, np.float32), np.zeros(shape, np.bool_), np.zeros(shape, np.float32))

    def draw(self, r_A: Array, C_CA: Array, light_A: Array | None, marked: Mask, out: Thumbnails) -> None:
        """Draw pictures; nothing is remembered of those before.

        Args:
            r_A: Cameras in A, shape (P, 3) [m].
            C_CA: Rotations from A to the cameras, shape (P, 3, 3).
            light_A: Unit vectors to the light in A, shape (P, 3); None: it shines from the camera.
            marked: Faces for the mask, shape (P, f), or (1, f) for all the same.
            out: Receives the pictures.
        """
        light = np.zeros_like(r_A) if light_A is None else light_A
        tan, near = self.camera.tan_half_angle, self._near
        _draw(self._body, self._canvas, (tan, near), r_A, C_CA, light, marked, out)


@kernel
def _draw(
    body: _Body,
    canvas: Canvas,
    optics: tuple[float, float],
    r_A: Array,
    C_CA: Array,
    light_A: Array,
    marked: Mask,
    out: Thumbnails,
) -> None:
    tan, near = optics
    size = canvas.row_span.shape[0]
    pixel_from_A = np.empty((3, 3))
    for p in range(r_A.shape[0]):
        if not _may_see(C_CA[p], r_A[p], body.radius, tan):
            out.grey[p], out.mask[p], out.depth[p] = 0.0, False, 0.0
            continue
        for k in range(3):
            z = 0.5 * size * C_CA[p, 2, k]
            pixel_from_A[0, k] = 0.5 * size * C_CA[p, 0, k] / tan + z
            pixel_from_A[1, k] = z - 0.5 * size * C_CA[p, 1, k] / tan
            pixel_from_A[2, k] = C_CA[p, 2, k]
        draw_faces(body.mesh, View(r_A[p], pixel_from_A, near), canvas)
        for row in range(size):
            for column in range(size):
                at, up = row * size + column, size - 1 - row
                face = int(canvas.picture[at]) - 1
                if face < 0:
                    out.grey[p, up, column], out.mask[p, up, column], out.depth[p, up, column] = 0.0, False, 0.0
                    continue
                out.grey[p, up, column] = _lambert(body.mesh, body.normals, face, light_A[p], r_A[p])
                out.mask[p, up, column] = marked[p if marked.shape[0] > 1 else 0, face]
                out.depth[p, up, column] = 1.0 / canvas.depth[at]


@jittable
def _may_see(C: Array, r: Array, radius: float, tan: float) -> bool:
    """Whether a sphere about the origin reaches into a camera's square pyramid."""
    x = -(C[0, 0] * r[0] + C[0, 1] * r[1] + C[0, 2] * r[2])
    y = -(C[1, 0] * r[0] + C[1, 1] * r[1] + C[1, 2] * r[2])
    z = -(C[2, 0] * r[0] + C[2, 1] * r[1] + C[2, 2] * r[2])
    reach = z * tan + radius * sqrt(1.0 + tan * tan)
    return (z > -radius) & (abs(x) <= reach) & (abs(y) <= reach)


@jittable
def _lambert(mesh: Mesh, normals: Array, face: int, light: Array, r: Array) -> float:
    x, y, z = light[0], light[1], light[2]
    if x == 0.0 and y == 0.0 and z == 0.0:  # the light is at the camera
        corner = mesh.vertices[mesh.faces[face, 0]]
        x, y, z = r[0] - corner[0], r[1] - corner[1], r[2] - corner[2]
        scale = 1.0 / sqrt(x * x + y * y + z * z)
        x, y, z = scale * x, scale * y, scale * z
    return max(0.0, normals[face, 0] * x + normals[face, 1] * y + normals[face, 2] * z)
