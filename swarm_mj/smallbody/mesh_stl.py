"""Meshes as STL, text or binary: a heap of triangles whose equal corners are welded into shared vertices."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from swarm_mj.errors import ShapeError
from swarm_mj.typing import Array, Ints

HEADER_BYTES = 84
#: One triangle of a binary file: normal, three corners, attribute.
TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
#: Blanks of a line, not ends of lines: a pattern that may cross them takes hours on a file of empty lines.
_VERTEX = re.compile(rb"^[ \t]*vertex[ \t]+(.*)$", re.MULTILINE | re.IGNORECASE)
_END_OF_FACET = re.compile(rb"^[ \t]*endfacet", re.MULTILINE | re.IGNORECASE)


def read_stl(path: Path) -> tuple[Array, Ints]:
    """Read vertices (V, 3) in the file's unit and triangles (F, 3); vertices stand in the order they are first met.

    Raises:
        ShapeError: neither form of STL, or cut short.
    """
    data = path.read_bytes()
    # Binary files may also begin with "solid"; only the size tells them apart.
    corners = _binary_corners(data) if _is_binary(data) else _text_corners(data, path)
    return weld(corners)


def weld(corners: Array) -> tuple[Array, Ints]:
    """Merge exactly equal corners.

    Args:
        corners: corners of the triangles, three after three, shape (3 F, 3).

    Returns:
        Vertices (V, 3) in the order they are first met, and triangles (F, 3).
    """
    positive_zeros = corners + 0.0
    _, first, inverse = np.unique(positive_zeros, axis=0, return_index=True, return_inverse=True)
    order = np.argsort(first)
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    return positive_zeros[first[order]], rank[inverse.ravel()].reshape(-1, 3)


def _is_binary(data: bytes) -> bool:
    if len(data) < HEADER_BYTES:
        return False
    count = int.from_bytes(data[HEADER_BYTES - 4 : HEADER_BYTES], "little")
    return len(data) == HEADER_BYTES + count * TRIANGLE.itemsize


def _binary_corners(data: bytes) -> Array:
    triangles = np.frombuffer(data, dtype=TRIANGLE, offset=HEADER_BYTES)
    return triangles["corners"].reshape(-1, 3).astype(np.float64)


def _text_corners(data: bytes, path: Path) -> Array:
    if data.lstrip()[:5].lower() != b"solid" or b"\0" in data:
        raise ShapeError(f"{path}: not STL, or a binary STL cut short or with bytes added; export or download it again")
    rows = [row.split() for row in _VERTEX.findall(data)]
    if len(rows) % 3 or len(rows) != 3 * len(_END_OF_FACET.findall(data)):
        raise ShapeError(
            f"{path}: the last facet, {len(rows) // 3}, is incomplete: the file is cut short, export it again"
        )
    try:
        return np.array(rows, dtype=np.float64).reshape(-1, 3)
    except ValueError as error:
        raise ShapeError(
            f"{path}: a line 'vertex x y z' does not hold three numbers ({error}); export it again"
        ) from error
