"""Face-ID buffers drawn by compiled code: which face is under each pixel, as OpenGL says it, on any machine and in any thread.

Each triangle that turns its outer side to the camera is filled row by row: its edges give the span of pixel centres between
them, and a depth buffer keeps the nearest. Everything is done in double precision but the depth that is kept, 1/Z in single
precision (1 mm at 20 km), and on one core. Two triangles compute the edge they share from the same two corners in the same
order, so that no pixel between them is lost.

A triangle of a body seen whole covers some ten rows of some ten pixels: too few for loops whose ends a processor cannot
foresee. So decisions are replaced by arithmetic that the compiler turns into vector instructions: whole groups of `LANES`
pixels and of `ROWS` rows are computed, and what lies beyond the end of a span is written back as it was.
"""

from __future__ import annotations

from math import ceil, floor
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from swarm_mj.compilation import jittable, kernel
from swarm_mj.observation.camera import CameraModel, CameraPose
from swarm_mj.observation.projection import PictureWindow
from swarm_mj.typing import Array, Array32, Ints, Ints32

Depth = Array32
Picture = NDArray[np.uint32]
#: Column, row and 1/Z.
Corner = tuple[float, float, float]

#: Pixels of a row that are computed at once. Groups may begin at any pixel: buffers are longer than the picture by as much.
LANES = 16
#: Rows of a triangle that are computed at once, likewise.
ROWS = 8
#: Nearest depth drawn, over the extent of the body.
NEAREST = 1e-7


class Mesh(NamedTuple):
    """What is drawn.

    Attributes:
        vertices: In A [m], shape (v, 3).
        faces: Vertex indices, counter-clockwise seen from outside, shape (f, 3).
    """

    vertices: Array
    faces: Ints32


def make_mesh(vertices: Array, faces: NDArray[np.integer]) -> Mesh:
    """Of copies: Numba compiles apart what takes an array that is read-only."""
    return Mesh(np.array(vertices, np.float64, order="C"), np.array(faces, np.int32, order="C"))


class View(NamedTuple):
    """From where it is drawn.

    Attributes:
        r_A: Camera position in A [m], shape (3,).
        pixel_from_A: Maps a position relative to the camera to (column Z, row Z, Z), with Z the distance along the line of
            sight, shape (3, 3); columns count to the right and rows upwards, pixel i covers i to i + 1.
        near: Smallest Z drawn [m]; what is nearer is cut off.
    """

    r_A: Array
    pixel_from_A: Array
    near: float


class Canvas(NamedTuple):
    """What it is drawn on.

    Attributes:
        picture: Receives the face plus one, 0 for the sky; row by row, shape (size^2 + LANES,).
        depth: Scratch, shape (size^2 + LANES,).
        row_span: First and last column of each row that are in the field of view, shape (size, 2).
        projected: Scratch, shape (v, 3).
        chosen: Scratch, shape (f + 1,).
    """

    picture: Picture
    depth: Depth
    row_span: Ints32
    projected: Array
    chosen: Ints32


def make_canvas(size: int, vertices: int, faces: int) -> Canvas:
    """For a square picture of some size of a mesh with so many vertices and faces."""
    return Canvas(
        picture=np.empty(size**2 + LANES, np.uint32),
        depth=np.empty(size**2 + LANES, np.float32),
        row_span=np.full((size, 2), (0, size - 1), np.int32),
        projected=np.empty((vertices, 3)),
        chosen=np.empty(faces + 1, np.int32),
    )


class CompiledFaces:
    """Draws the number of the face under each pixel, in double precision on one core.

    Args:
        vertices: Of the body in A [m], shape (v, 3).
        faces: Vertex indices, counter-clockwise seen from outside, shape (f, 3).
        camera: The camera; its resolution is that of the buffer.
    """

    note = "face-ID buffers drawn by compiled code"

    def __init__(self, vertices: Array, faces: NDArray[np.integer], camera: CameraModel) -> None:
        self.camera, size = camera, camera.resolution_px
        self._mesh = make_mesh(vertices, faces)
        self._near = NEAREST * float(np.ptp(vertices, axis=0).max())
        self._picture_from_camera = np.array([[1.0 / camera.tan_half_angle], [1.0 / camera.tan_half_angle], [1.0]])
        self._canvas = make_canvas(size, len(vertices), len(faces))

    def draw(self, pose: CameraPose, window: PictureWindow) -> Picture:
        """Draw a window of the picture, see `OpenGlFaces.draw`."""
        size = self.camera.resolution_px
        if self.camera.shape == "cone":
            self._find_spans(window)
        pixel_from_A = self._pixel_from_picture(window) @ self._picture_from_body(pose)
        draw_faces(self._mesh, View(pose.r_A, pixel_from_A, self._near), self._canvas)
        return self._canvas.picture[: size**2].reshape(size, size)

    def _picture_from_body(self, pose: CameraPose) -> Array:
        """Homogeneous picture coordinates, (x, y) = (X, Y) / Z, of positions relative to the camera in A."""
        return self._picture_from_camera * pose.C_CA

    def _pixel_from_picture(self, window: PictureWindow) -> Array:
        """Columns and rows (upwards) from homogeneous picture coordinates (y down)."""
        across, down = self.camera.resolution_px / (window.high - window.low)
        return np.array([[across, 0.0, -across * window.low[0]], [0.0, -down, down * window.high[1]], [0.0, 0.0, 1.0]])

    def _find_spans(self, window: PictureWindow) -> None:
        """Write the first and last column of each row whose centre is in a cone."""
        size, row_span = self.camera.resolution_px, self._canvas.row_span
        across, down = (window.high - window.low) / size
        y = window.high[1] - (np.arange(size) + 0.5) * down
        reach = np.sqrt(np.maximum(1.0 - y**2, 0.0))
        row_span[:, 0] = np.clip(np.ceil((-reach - window.low[0]) / across - 0.5), 0, size)
        row_span[:, 1] = np.clip(np.floor((reach - window.low[0]) / across - 0.5), -1, size - 1)
        row_span[np.abs(y) > 1.0] = 0, -1

    def close(self) -> None:
        """Nothing to release."""


@kernel
def draw_faces(mesh: Mesh, view: View, canvas: Canvas) -> None:
    """Draw a mesh."""
    (vertices, faces), (r_A, pixel_from_A, near) = mesh, view
    picture, depth, row_span, projected, chosen = canvas
    size = row_span.shape[0]
    spans = np.empty((3, size + ROWS))
    depth[:] = 0.0
    picture[:] = 0
    for v in range(vertices.shape[0]):
        x, y, z = _to_pixels(vertices, v, r_A, pixel_from_A)
        ahead = z >= near
        projected[v, 2] = 1.0 / z if ahead else 0.0
        projected[v, 0], projected[v, 1] = x * projected[v, 2], y * projected[v, 2]
    for i in range(_choose(faces, projected, size, chosen)):
        f = chosen[i]
        a, b, c = corner(projected, faces[f, 0]), corner(projected, faces[f, 1]), corner(projected, faces[f, 2])
        if a[2] > 0.0 and b[2] > 0.0 and c[2] > 0.0:
            _fill(a, b, c, f, size, spans, depth, picture)
        else:
            _fill_beyond(mesh, view, f, size, spans, depth, picture)
    # Cut off at the end, once, what lies beside a round field of view.
    for row in range(size):
        picture[row * size : row * size + row_span[row, 0]] = 0
        picture[row * size + row_span[row, 1] + 1 : (row + 1) * size] = 0


@kernel
def draw_projected(mesh: Mesh, canvas: Canvas) -> None:
    """Draw a mesh whose vertices are projected: columns, rows upwards, and a nearness above 0 that is linear on the picture."""
    faces, (picture, depth, row_span, projected, chosen) = mesh.faces, canvas
    size = row_span.shape[0]
    spans = np.empty((3, size + ROWS))
    depth[:] = 0.0
    picture[:] = 0
    for i in range(_choose(faces, projected, size, chosen)):
        f = chosen[i]
        a, b, c = corner(projected, faces[f, 0]), corner(projected, faces[f, 1]), corner(projected, faces[f, 2])
        _fill(a, b, c, f, size, spans, depth, picture)


@jittable
def _to_pixels(vertices: Array, v: int, r_A: Array, m: Array) -> Corner:
    x, y, z = vertices[v, 0] - r_A[0], vertices[v, 1] - r_A[1], vertices[v, 2] - r_A[2]
    return (
        m[0, 0] * x + m[0, 1] * y + m[0, 2] * z,
        m[1, 0] * x + m[1, 1] * y + m[1, 2] * z,
        m[2, 0] * x + m[2, 1] * y + m[2, 2] * z,
    )


@jittable
def corner(projected: Array, v: int) -> Corner:
    """Where a vertex is on the picture."""
    return projected[v, 0], projected[v, 1], projected[v, 2]


@jittable
def twice_area(a: Corner, b: Corner, c: Corner) -> float:
    """Twice the area on the picture [px^2], positive when the outer side is seen."""
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


@jittable
def _rows(a: Corner, b: Corner, c: Corner, size: int) -> tuple[int, int]:
    """First and last row whose centre line crosses a triangle; the first is above the last when there is none."""
    low, high = max(min(a[1], b[1], c[1]), 0.0), min(max(a[1], b[1], c[1]), float(size))
    return int(ceil(min(low, float(size)) - 0.5)), int(floor(max(high, 0.0) - 0.5))


@jittable
def _choose(faces: Ints32, projected: Array, size: int, chosen: Ints32) -> int:
    """Write which triangles may have pixels, in their order, and return how many they are.

    Half of the faces look away, and a processor cannot foresee which. So each is written, and stays if the count moves on.
    """
    n = 0
    for f in range(faces.shape[0]):
        a, b, c = corner(projected, faces[f, 0]), corner(projected, faces[f, 1]), corner(projected, faces[f, 2])
        ahead = (a[2] > 0.0) & (b[2] > 0.0) & (c[2] > 0.0)
        across = (min(a[0], b[0], c[0]) <= size) & (max(a[0], b[0], c[0]) >= 0.0)
        bottom, top = _rows(a, b, c, size)
        seen = ahead & across & (bottom <= top) & (twice_area(a, b, c) > 0.0)
        cut = (not ahead) & ((a[2] > 0.0) | (b[2] > 0.0) | (c[2] > 0.0))
        chosen[n] = f
        n += seen | cut
    return n


@jittable
def _fill_beyond(mesh: Mesh, view: View, f: int, size: int, spans: Array, depth: Depth, picture: Picture) -> None:
    """Fill the part of a triangle that lies beyond `near`: a triangle or a quadrangle."""
    face, near = mesh.faces[f], view.near
    cut, count = np.empty((4, 3)), 0
    for k in range(3):
        xa, ya, za = _to_pixels(mesh.vertices, face[k], view.r_A, view.pixel_from_A)
        xb, yb, zb = _to_pixels(mesh.vertices, face[(k + 1) % 3], view.r_A, view.pixel_from_A)
        if za >= near:
            cut[count] = xa / za, ya / za, 1.0 / za
            count += 1
        if (za >= near) != (zb >= near):
            share = (near - za) / (zb - za)
            cut[count] = (xa + share * (xb - xa)) / near, (ya + share * (yb - ya)) / near, 1.0 / near
            count += 1
    for k in range(2, count):
        _fill(corner(cut, 0), corner(cut, k - 1), corner(cut, k), f, size, spans, depth, picture)


@jittable
def _fill(a: Corner, b: Corner, c: Corner, f: int, size: int, spans: Array, depth: Depth, picture: Picture) -> None:
    """Fill one triangle; `spans` is scratch for the first and last column of each row and 1/Z at the first."""
    (xa, ya, za), (xb, yb, zb), (xc, yc, zc) = a, b, c
    area, (bottom, top) = twice_area(a, b, c), _rows(a, b, c, size)
    if not area > 0.0:
        return
    z_x = ((zb - za) * (yc - ya) - (zc - za) * (yb - ya)) / area
    z_y = ((zc - za) * (xb - xa) - (zb - za) * (xc - xa)) / area
    left_ab, right_ab, slope_ab = _edge(xa, ya, xb, yb)
    left_bc, right_bc, slope_bc = _edge(xb, yb, xc, yc)
    left_ca, right_ca, slope_ca = _edge(xc, yc, xa, ya)
    for i in range((top - bottom + ROWS) // ROWS * ROWS):
        y = bottom + i + 0.5
        left = max(left_ab + slope_ab * y, left_bc + slope_bc * y, left_ca + slope_ca * y, 0.0)
        right = min(right_ab + slope_ab * y, right_bc + slope_bc * y, right_ca + slope_ca * y, float(size))
        # Within the picture on the other side too, and were they no numbers, lest an index leads beyond the buffers.
        first = ceil((left if left < size else float(size)) - 0.5)
        spans[0, i] = first
        spans[1, i] = floor((right if right > 0.0 else 0.0) - 0.5)
        spans[2, i] = za + z_y * (y - ya) + z_x * (first + 0.5 - xa)
    number, narrow = np.uint32(f + 1), max(xa, xb, xc) - min(xa, xb, xc) < LANES - 1
    for i in range(top - bottom + 1):
        first = int(spans[0, i])
        count = int(spans[1, i]) - first + 1
        # One group whatever the row, where that is enough: a row without a pixel is not left out, but changes nothing.
        computed = LANES if narrow else max(count + LANES - 1, 0) // LANES * LANES
        # Unsigned, since indices that might be negative would each be tested for it.
        start, z = np.uintp((bottom + i) * size + first), spans[2, i]
        for k in range(np.uintp(computed)):
            nearness = np.float32(z + z_x * np.int32(k))
            # Nothing is farther than 1/Z = 0, so that what lies beyond the span stays as it is.
            nearness = nearness if np.int32(k) < count else np.float32(0.0)
            picture[start + k] = number if nearness > depth[start + k] else picture[start + k]
            depth[start + k] = max(depth[start + k], nearness)


@jittable
def _edge(xa: float, ya: float, xb: float, yb: float) -> tuple[float, float, float]:
    """Where an edge bounds a row on the left and on the right, x + slope y; +-1e300: not at all."""
    up, down = yb > ya, yb < ya
    slope = (xb - xa) / (yb - ya) if up or down else 0.0
    x = (xa if up else xb) - slope * (ya if up else yb)
    return (x if down else -1e300), (x if up else 1e300), slope


@kernel
def count_pixels(picture: Picture, numbers: Picture, boxes: Ints32, counts: Ints) -> None:
    """Count the pixels of some faces, looking for each only where it can be.

    Args:
        picture: Face plus one of each pixel, shape (size, size).
        numbers: Face plus one of those that are counted, shape (n,).
        boxes: First column and row that a face may have pixels in, and last, within the picture, shape (n, 4).
        counts: Receives the number of pixels of each, shape (n,).
    """
    size = picture.shape[1]
    in_column = np.zeros(size + LANES, np.int32)
    for i in range(numbers.shape[0]):
        # Whole groups of columns, which are counted side by side: a wider box holds no other pixel of the face.
        first, stop = boxes[i, 0] // LANES * LANES, min((boxes[i, 2] // LANES + 1) * LANES, size)
        # Unsigned, since indices that might be negative would each be tested for it.
        start, width, number = np.uintp(first), np.uintp(max(stop - first, 0)), numbers[i]
        for k in range(width):
            in_column[k] = 0
        for row in range(boxes[i, 1], boxes[i, 3] + 1):
            line = np.uintp(row)
            for k in range(width):
                in_column[k] += np.int32(picture[line, start + k] == number)
        total = 0
        for k in range(width):
            total += in_column[k]
        counts[i] = total


@kernel
def box_pixels(boxes: Ints32) -> int:
    """Sum of the pixels in all boxes, see `count_pixels`."""
    pixels = 0
    for i in range(boxes.shape[0]):
        pixels += max(boxes[i, 2] - boxes[i, 0] + 1, 0) * max(boxes[i, 3] - boxes[i, 1] + 1, 0)
    return pixels
