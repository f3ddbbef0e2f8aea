"""Compiled drawing of face-ID buffers: which face is under each pixel, without OpenGL.

Each triangle that turns its outer side to the camera is filled row by row: its edges give the span of pixel centres between
them, and a depth buffer keeps the nearest. Everything is done in double precision but the depth that is kept, 1/Z in single
precision (1 mm at 20 km), and on one core. Two triangles compute the edge they share from the same two corners in the same
order, so that no pixel between them is lost.
"""

from __future__ import annotations

from math import ceil, floor

import numpy as np
from numba import njit
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int32]
Picture = NDArray[np.uint32]


@njit(cache=True, nogil=True, error_model="numpy")
def draw_faces(
    vertices: Floats,
    faces: Ints,
    r_A: Floats,
    pixel_from_A: Floats,
    near: float,
    row_span: Ints,
    projected: Floats,
    depth: NDArray[np.float32],
    picture: Picture,
) -> None:
    """Draw a mesh.

    Args:
        vertices: In A [m], shape (v, 3).
        faces: Vertex indices, counter-clockwise seen from outside, shape (f, 3).
        r_A: Camera position in A [m], shape (3,).
        pixel_from_A: Maps a position relative to the camera to (column Z, row Z, Z), with Z the distance along the line of
            sight, shape (3, 3); columns count to the right and rows upwards, pixel i covers i to i + 1.
        near: Smallest Z drawn [m]; what is nearer is cut off.
        row_span: First and last column of each row that are in the field of view, shape (rows, 2).
        projected: Scratch, shape (v, 3).
        depth: Scratch, shape (rows, columns).
        picture: Receives the face plus one, 0 for the sky, shape (rows, columns).
    """
    depth[:] = 0.0
    picture[:] = 0
    for v in range(vertices.shape[0]):
        x, y, z = _to_pixels(vertices, v, r_A, pixel_from_A)
        ahead = z >= near
        projected[v, 2] = 1.0 / z if ahead else 0.0
        projected[v, 0], projected[v, 1] = x * projected[v, 2], y * projected[v, 2]
    for f in range(faces.shape[0]):
        a, b, c = projected[faces[f, 0]], projected[faces[f, 1]], projected[faces[f, 2]]
        if a[2] > 0.0 and b[2] > 0.0 and c[2] > 0.0:
            _fill(a[0], a[1], a[2], b[0], b[1], b[2], c[0], c[1], c[2], f, row_span, depth, picture)
        elif a[2] > 0.0 or b[2] > 0.0 or c[2] > 0.0:
            _fill_beyond(vertices, faces[f], r_A, pixel_from_A, near, f, row_span, depth, picture)


@njit(cache=True, nogil=True, error_model="numpy")
def _to_pixels(vertices: Floats, v: int, r_A: Floats, m: Floats) -> tuple[float, float, float]:
    x, y, z = vertices[v, 0] - r_A[0], vertices[v, 1] - r_A[1], vertices[v, 2] - r_A[2]
    return (
        m[0, 0] * x + m[0, 1] * y + m[0, 2] * z,
        m[1, 0] * x + m[1, 1] * y + m[1, 2] * z,
        m[2, 0] * x + m[2, 1] * y + m[2, 2] * z,
    )


@njit(cache=True, nogil=True, error_model="numpy")
def _fill_beyond(
    vertices: Floats,
    face: Ints,
    r_A: Floats,
    pixel_from_A: Floats,
    near: float,
    f: int,
    row_span: Ints,
    depth: NDArray[np.float32],
    picture: Picture,
) -> None:
    """Fill the part of a triangle that lies beyond `near`: a triangle or a quadrangle."""
    cut, count = np.empty((4, 3)), 0
    for corner in range(3):
        xa, ya, za = _to_pixels(vertices, face[corner], r_A, pixel_from_A)
        xb, yb, zb = _to_pixels(vertices, face[(corner + 1) % 3], r_A, pixel_from_A)
        if za >= near:
            cut[count] = xa / za, ya / za, 1.0 / za
            count += 1
        if (za >= near) != (zb >= near):
            share = (near - za) / (zb - za)
            cut[count] = (xa + share * (xb - xa)) / near, (ya + share * (yb - ya)) / near, 1.0 / near
            count += 1
    a = cut[0]
    for corner in range(2, count):
        b, c = cut[corner - 1], cut[corner]
        _fill(a[0], a[1], a[2], b[0], b[1], b[2], c[0], c[1], c[2], f, row_span, depth, picture)


@njit(cache=True, nogil=True, error_model="numpy")
def _fill(
    xa: float,
    ya: float,
    za: float,
    xb: float,
    yb: float,
    zb: float,
    xc: float,
    yc: float,
    zc: float,
    f: int,
    row_span: Ints,
    depth: NDArray[np.float32],
    picture: Picture,
) -> None:
    """Fill one triangle, corners as column, row and 1/Z."""
    area = (xb - xa) * (yc - ya) - (yb - ya) * (xc - xa)
    rows, columns = picture.shape
    if not area > 0.0 or min(xa, xb, xc) > columns or max(xa, xb, xc) < 0.0:
        return
    low, high = max(min(ya, yb, yc), 0.0), min(max(ya, yb, yc), float(rows))
    if not low <= high:
        return
    z_x = ((zb - za) * (yc - ya) - (zc - za) * (yb - ya)) / area
    z_y = ((zc - za) * (xb - xa) - (zb - za) * (xc - xa)) / area
    left_ab, right_ab, slope_ab = _edge(xa, ya, xb, yb)
    left_bc, right_bc, slope_bc = _edge(xb, yb, xc, yc)
    left_ca, right_ca, slope_ca = _edge(xc, yc, xa, ya)
    number = np.uint32(f + 1)
    for row in range(int(ceil(low - 0.5)), int(floor(high - 0.5)) + 1):
        y = row + 0.5
        left = max(left_ab + slope_ab * y, left_bc + slope_bc * y, left_ca + slope_ca * y, 0.0)
        right = min(right_ab + slope_ab * y, right_bc + slope_bc * y, right_ca + slope_ca * y, float(columns))
        first = max(int(ceil(left - 0.5)), row_span[row, 0])
        last = min(int(floor(right - 0.5)), row_span[row, 1])
        if first > last:
            continue
        z = za + z_y * (y - ya) + z_x * (first + 0.5 - xa)
        nearest, drawn = depth[row, first : last + 1], picture[row, first : last + 1]
        for k in range(nearest.shape[0]):
            nearness = np.float32(z + z_x * k)
            if nearness > nearest[k]:
                nearest[k] = nearness
                drawn[k] = number


@njit(cache=True, nogil=True, error_model="numpy")
def _edge(xa: float, ya: float, xb: float, yb: float) -> tuple[float, float, float]:
    """Where an edge bounds a row on the left and on the right, x + slope y; +-1e300: not at all."""
    if ya == yb:
        return -1e300, 1e300, 0.0
    slope = (xb - xa) / (yb - ya)
    if yb > ya:
        return -1e300, xa - slope * ya, slope
    return xb - slope * yb, 1e300, slope


@njit(cache=True, nogil=True, error_model="numpy")
def count_pixels(picture: Picture, counts: NDArray[np.int64]) -> None:
    """Count the pixels of each face, run by run; `counts`, shape (faces + 1,), begins with the sky."""
    counts[:] = 0
    face, run = np.uint32(0), 0
    for number in picture.ravel():
        if number == face:
            run += 1
        else:
            counts[face] += run
            face, run = number, 1
    counts[face] += run
