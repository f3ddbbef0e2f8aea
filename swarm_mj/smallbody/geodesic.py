"""Geodesic icosahedra: nearly even triangulations of the unit sphere.

Each of the twenty faces of an icosahedron is cut into f x f equal triangles whose corners are then pushed out to the
sphere (class I of Coxeter's scheme), which gives 10 f^2 + 2 vertices and 20 f^2 faces.
"""

from __future__ import annotations

import numpy as np

from swarm_mj.errors import ShapeError
from swarm_mj.typing import Array, Ints

#: Five million faces: more than any use of the mesh bears.
MAX_FREQUENCY = 500
GOLDEN_RATIO = (1.0 + 5.0**0.5) / 2.0


def geodesic_icosahedron(frequency: int) -> tuple[Array, Ints]:
    """Triangulate the unit sphere.

    Args:
        frequency: parts f into which each edge of the icosahedron is cut, from 1.

    Returns:
        Unit vectors, shape (10 f^2 + 2, 3), numbered from north to south and within a parallel by east longitude; and
        faces, shape (20 f^2, 3), counter-clockwise from outside, in the order of their lowest vertices.

    Raises:
        ShapeError: the frequency is below 1 or above MAX_FREQUENCY.
    """
    if not 1 <= frequency <= MAX_FREQUENCY:
        raise ShapeError(f"frequency = {frequency}: must be from 1 to {MAX_FREQUENCY}")
    weights, pattern = _subdivision(frequency)
    corners = _icosahedron()
    points = np.einsum("kc,fcd->fkd", weights, corners).reshape(-1, 3)
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    faces = (np.arange(len(corners))[:, None, None] * len(weights) + pattern).reshape(-1, 3)
    return _numbered(points, faces)


def _icosahedron() -> Array:
    """Corners of the faces of the icosahedron with vertices (0, +-1, +-phi) and cyclic, shape (20, 3, 3)."""
    rectangle = np.array([[0.0, s, t * GOLDEN_RATIO] for s in (-1, 1) for t in (-1, 1)])
    vertices = np.concatenate([np.roll(rectangle, shift, axis=1) for shift in range(3)])
    distance = np.linalg.norm(vertices[:, None] - vertices, axis=2)
    adjacent = np.isclose(distance, 2.0)
    faces = [
        (i, j, k) if np.linalg.det(vertices[[i, j, k]]) > 0.0 else (i, k, j)
        for i, j, k in np.argwhere(adjacent[:, :, None] & adjacent[:, None] & adjacent)
        if i < j < k
    ]
    return vertices[faces]


def _subdivision(frequency: int) -> tuple[Array, Ints]:
    """Barycentric weights of a triangle's grid points (k, 3) and the small triangles between them (f^2, 3)."""
    grid = [(i, j) for i in range(frequency + 1) for j in range(frequency + 1 - i)]
    index = {point: k for k, point in enumerate(grid)}
    upright = [(index[i, j], index[i + 1, j], index[i, j + 1]) for i, j in grid if i + j < frequency]
    below = [(i, j) for i, j in grid if i + j < frequency - 1]
    inverted = [(index[i + 1, j], index[i + 1, j + 1], index[i, j + 1]) for i, j in below]
    weights = np.array([(frequency - i - j, i, j) for i, j in grid]) / frequency
    return weights, np.array(upright + inverted)


def _numbered(points: Array, faces: Ints) -> tuple[Array, Ints]:
    """Weld the points that neighbouring faces share and number everything from north to south and east."""
    # Rounding hides differences in the last bits, so that numbers do not depend on the machine.
    x, y, z = np.round(points, 9).T + 0.0
    longitude = np.round(np.mod(np.arctan2(y, x), 2.0 * np.pi), 9)
    _, first, inverse = np.unique(
        np.column_stack([-z + 0.0, longitude]), axis=0, return_index=True, return_inverse=True
    )
    welded = inverse.ravel()[faces]
    lowest_first = np.take_along_axis(welded, (welded.argmin(axis=1)[:, None] + np.arange(3)) % 3, axis=1)
    return points[first], lowest_first[np.lexsort(lowest_first.T[::-1])]
