"""Meshes as PLY, text or binary, read by trimesh after the counts in the header were compared with the file's size."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from swarm_mj.errors import ShapeError
from swarm_mj.typing import Array, Ints

#: A header longer than this is not one [bytes].
MAX_HEADER_BYTES = 65_536
#: First words of the lines of a header; the parser behind understands others too, so that a count could pass unseen.
HEADER_WORDS = {b"ply", b"format", b"comment", b"obj_info", b"element", b"property"}


def read_ply(path: Path) -> tuple[Array, Ints]:
    """Read vertices (V, 3) in the file's unit and triangles (F, 3) counted from 0.

    Raises:
        ShapeError: not PLY, cut short, or without a mesh.
    """
    import trimesh  # takes as long to import as a body to be read, and few bodies come as PLY

    _check_header(path)
    try:
        mesh = trimesh.load_mesh(path, file_type="ply", process=False, skip_materials=True)
        return np.asarray(mesh.vertices, dtype=np.float64), np.asarray(mesh.faces, dtype=np.int64)
    except Exception as error:  # trimesh raises whatever its parser trips over
        raise ShapeError(f"{path}: not a readable PLY mesh ({error}); it may be cut short, export it again") from error


def _check_header(path: Path) -> None:
    with open(path, "rb") as file:
        header, end, body = file.read(MAX_HEADER_BYTES).partition(b"end_header")
    if not header.startswith(b"ply") or not end:
        raise ShapeError(f"{path}: does not begin with a PLY header; export or download it again")
    for line in header.splitlines():
        if line.split()[:1] and line.split()[0] not in HEADER_WORDS:
            raise ShapeError(f"{path}: header line {line[:60]!r} is no statement of PLY; export or download it again")
    available = path.stat().st_size - len(header) - len(end)
    # Of an endless number its first digits say enough: they promise more than any file holds.
    found = re.findall(rb"^[ \t]*element\s+(\S+)\s+(\d+)", header, re.MULTILINE)
    elements = {kind.decode(errors="replace"): int(count[:18]) for kind, count in found}
    for kind in ("vertex", "face"):
        if elements.get(kind, 0) == 0:
            raise ShapeError(f"{path}: holds no {kind} elements; export it as a triangle mesh")
    for kind, count in elements.items():
        # Every element takes at least a byte: a count beyond that would only exhaust the memory.
        if count > available:
            raise ShapeError(f"{path}: promises {count} {kind} elements in {available} bytes: it is cut short")
