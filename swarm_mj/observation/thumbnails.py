"""Small pictures of a body for agents: grey, a mask and depth of many cameras at once, by the compiled rasteriser alone.

Visibility is that of `raster`: the face under each pixel's centre and its depth, in double precision. What is seen is shaded
flat: by a reflectance law of `photometry` with the shadows that the body casts on itself, or plainly by the cosine of incidence
without. A camera whose cone of view misses the body's bounding sphere gets an empty picture at once. The time goes with the
faces, so that a mesh of more than some thousands is better simplified before.
"""

from __future__ import annotations

from math import sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from swarm_mj.compilation import jittable, kernel
from swarm_mj.observation.camera import CameraModel
from swarm_mj.observation.photometry import Surface, radiance_factor, surface_of
from swarm_mj.observation.raster import NEAREST, Canvas, Mesh, View, draw_faces, make_canvas, make_mesh
from swarm_mj.observation.shadows import SunMap, draw_from_sun, frame, is_lit, make_sun_map, turn_to
from swarm_mj.scenarios.schema_photometry import Photometry
from swarm_mj.typing import Array, Array32, Mask

#: Pixels along a side unless said otherwise.
SIDE_PX = 64
#: Places along a side of the map from the Sun, which holds the whole body.
SUN_SIDE = 512
#: What reflects as the cosine of incidence.
PLAIN = surface_of(Photometry(law="lambert", albedo=1.0))


class Thumbnails(NamedTuple):
    """Pictures of P cameras, size S; row 0 is the top row, and the camera's +x looks to the right.

    Attributes:
        grey: Radiance factor, 0 where the light does not shine and in the sky, shape (P, S, S).
        mask: Whether the face is one of those marked, shape (P, S, S).
        depth: Distance along the axis of the camera, Z in C [m], 0 in the sky, shape (P, S, S).
    """

    grey: Array32
    mask: Mask
    depth: Array32


class _Body(NamedTuple):
    """What is drawn.

    Attributes:
        mesh: The mesh.
        normals: Outward unit normals, shape (f, 3).
        radius: Of its bounding sphere about the origin [m].
        surface: How it reflects.
        sun: The body as the Sun sees it.
        shadows: Whether it casts shadows on itself.
    """

    mesh: Mesh
    normals: Array
    radius: float
    surface: Surface
    sun: SunMap
    shadows: bool


class ThumbnailDrawer:
    """Draws small pictures of a body.

    Args:
        vertices: Of the body in A [m], shape (v, 3).
        faces: Vertex indices, counter-clockwise seen from outside, shape (f, 3).
        camera: Square field of view; its resolution is that of the pictures.
        surface: How the body reflects, with the shadows that it casts on itself; None: the cosine of incidence, without.
    """

    def __init__(
        self, vertices: Array, faces: NDArray[np.integer], camera: CameraModel, surface: Surface | None = None
    ) -> None:
        size, corners = camera.resolution_px, np.asarray(vertices, np.float64)[faces]
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        self.camera = camera
        radius = float(np.linalg.norm(vertices, axis=1).max())
        sun = make_sun_map(make_canvas(SUN_SIDE, len(vertices), len(faces)))
        mesh, shadows = make_mesh(vertices, faces), surface is not None
        self._body = _Body(mesh, np.ascontiguousarray(normals), radius, surface or PLAIN, sun, shadows)
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
    pixel_from_A, drawn = np.empty((3, 3)), np.zeros(3)
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
        x, y, z = light_A[p, 0], light_A[p, 1], light_A[p, 2]
        shadows = body.shadows and (x != 0.0 or y != 0.0 or z != 0.0)
        if shadows and (x != drawn[0] or y != drawn[1] or z != drawn[2]):
            drawn[0], drawn[1], drawn[2] = x, y, z
            turn_to(body.sun, x, y, z)
            frame(body.sun, -body.radius, -body.radius, body.radius, body.radius)
            draw_from_sun(body.mesh, body.sun)
        for row in range(size):
            down = tan * (1.0 - (2 * row + 1) / size)
            for column in range(size):
                at, up = row * size + column, size - 1 - row
                face = int(canvas.picture[at]) - 1
                if face < 0:
                    out.grey[p, up, column], out.mask[p, up, column], out.depth[p, up, column] = 0.0, False, 0.0
                    continue
                across, depth = tan * ((2 * column + 1) / size - 1.0), 1.0 / canvas.depth[at]
                # From the camera to the place that the pixel's centre shows.
                C = C_CA[p]
                sight = (
                    C[0, 0] * across + C[1, 0] * down + C[2, 0],
                    C[0, 1] * across + C[1, 1] * down + C[2, 1],
                    C[0, 2] * across + C[1, 2] * down + C[2, 2],
                )
                out.grey[p, up, column] = _shade(body, face, light_A[p], r_A[p], sight, depth, shadows)
                out.mask[p, up, column] = marked[p if marked.shape[0] > 1 else 0, face]
                out.depth[p, up, column] = depth


@jittable
def _shade(
    body: _Body, face: int, light: Array, r: Array, sight: tuple[float, float, float], depth: float, shadows: bool
) -> float:
    """Radiance factor of a place of a face at a depth along a line of sight whose third component in C is 1."""
    n, scale = body.normals[face], 1.0 / sqrt(sight[0] ** 2 + sight[1] ** 2 + sight[2] ** 2)
    mu = -scale * (n[0] * sight[0] + n[1] * sight[1] + n[2] * sight[2])
    if light[0] == 0.0 and light[1] == 0.0 and light[2] == 0.0:  # it is at the camera
        return radiance_factor(body.surface, mu, mu, 1.0)
    mu0 = n[0] * light[0] + n[1] * light[1] + n[2] * light[2]
    if mu0 <= 0.0:
        return 0.0
    if shadows:
        axes, grid = body.sun.axes, body.sun.grid
        column, row = -grid[0], -grid[1]
        for k in range(3):
            at = r[k] + depth * sight[k]
            column += axes[0, k] * at
            row += axes[1, k] * at
        if not is_lit(body.mesh, body.sun, face, column / grid[2], row / grid[2]):
            return 0.0
    cos_phase = -scale * (light[0] * sight[0] + light[1] * sight[1] + light[2] * sight[2])
    return radiance_factor(body.surface, mu0, mu, cos_phase)


@jittable
def _may_see(C: Array, r: Array, radius: float, tan: float) -> bool:
    """Whether a sphere about the origin reaches into a camera's square pyramid."""
    x = -(C[0, 0] * r[0] + C[0, 1] * r[1] + C[0, 2] * r[2])
    y = -(C[1, 0] * r[0] + C[1, 1] * r[1] + C[1, 2] * r[2])
    z = -(C[2, 0] * r[0] + C[2, 1] * r[1] + C[2, 2] * r[2])
    reach = z * tan + radius * sqrt(1.0 + tan * tan)
    return (z > -radius) & (abs(x) <= reach) & (abs(y) <= reach)
