"""Shapes from SPICE's digital shape kernels (DSK, type 2: plates), in km, by SpiceyPy."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from swarm_mj.errors import ShapeError
from swarm_mj.io.spice import MAX_NAME, spice_errors, spiceypy
from swarm_mj.typing import Array, Ints

#: Bytes that a vertex and a plate take at least: more are promised than the file can hold where it is cut short.
VERTEX_BYTES, PLATE_BYTES = 24, 12


def read_dsk(path: Path) -> tuple[Array, Ints]:
    """Read vertices (V, 3) in km and triangles (F, 3) counted from 0, of a file with one segment of plates.

    Raises:
        ShapeError: It is no DSK, is broken, or holds another number or type of segments.
    """
    spice, name = spiceypy(), str(path)
    if len(name) > MAX_NAME or not name.isascii():
        raise ShapeError(f"{path}: SPICE takes names of at most {MAX_NAME} ASCII characters; move the file")
    with spice_errors(f"{path}", "give a DSK with one segment of type 2, whole", ShapeError):
        handle = spice.dasopr(name)
        try:
            segment = spice.dlabfs(handle)
            if _has_another(spice, handle, segment) or spice.dskgd(handle, segment).dtype != 2:
                raise ShapeError(
                    f"{path}: has several segments, or one that is not of type 2 (plates); write one with MKDSK"
                )
            vertices, plates = spice.dskz02(handle, segment)
            if vertices * VERTEX_BYTES + plates * PLATE_BYTES > path.stat().st_size:
                raise ShapeError(
                    f"{path}: promises {vertices} vertices and {plates} plates, more than it holds; get it again"
                )
            corners = np.asarray(spice.dskv02(handle, segment, 1, vertices), np.float64)
            return corners, np.asarray(spice.dskp02(handle, segment, 1, plates), np.int64) - 1
        finally:
            spice.reset()
            spice.dascls(handle)


def _has_another(spice: Any, handle: int, segment: Any) -> bool:
    """Whether another segment follows."""
    try:
        spice.dlafns(handle, segment)
    except spice.NotFoundError:
        return False
    return True
