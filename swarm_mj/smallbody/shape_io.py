"""Read shape models of any body from OBJ, PLY, STL, PDS plate (.tab) or SPICE (.bds) files, and write OBJ.

Nothing is believed: counts are compared with the size of the file before memory is taken, every number is checked, and
the mesh must bound one body (`check_shape`). Text formats are read line by line, so that errors can name the line.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Literal

from swarm_mj.errors import ShapeError
from swarm_mj.io.atomic import write_text
from swarm_mj.io.records import reading, require_file, writing
from swarm_mj.smallbody.mesh_files import read_dsk, read_obj, read_ply, read_stl, read_tab
from swarm_mj.smallbody.shape import ShapeModel
from swarm_mj.smallbody.shape_check import BODY_RADIUS_RANGE_M, check_shape
from swarm_mj.typing import Array, Ints

Unit = Literal["m", "km"]
Mesh = tuple[Array, Ints]

#: Metres per unit of length.
METRES = {"m": 1.0, "km": 1000.0}
#: Reader and unit of length of each file ending.
READERS: dict[str, tuple[Callable[[Path], Mesh], Unit]] = {
    ".obj": (read_obj, "m"),
    ".ply": (read_ply, "m"),
    ".stl": (read_stl, "m"),
    ".tab": (read_tab, "km"),
    ".bds": (read_dsk, "km"),
}
#: Larger files are refused [bytes]: about three million faces, beyond what gravity and coverage can use, read in 2 GB.
MAX_FILE_BYTES = 128 * 2**20


def load_shape(
    path: str | os.PathLike[str],
    *,
    unit: Unit | None = None,
    name: str | None = None,
    expect_radius_m: tuple[float, float] = BODY_RADIUS_RANGE_M,
) -> ShapeModel:
    """Read and check a shape model.

    Args:
        path: an .obj, .ply (text or binary), .stl (text or binary), PDS .tab or SPICE .bds file. Polygons with more than three
            corners are cut into a fan of triangles about the first; texture, colour and normals are ignored.
        unit: unit of length in the file; None: kilometres for .tab and .bds, metres for the others.
        name: what messages call the body; None: the file's name.
        expect_radius_m: lowest and highest believable distance of the farthest vertex from the origin [m].

    Returns:
        The shape in metres, frame A being the frame of the file.

    Raises:
        ShapeError: the file cannot be read, or the mesh is not one closed body; the message says where and what to do.
    """
    path = Path(path)
    reader, usual_unit = _reader(path)
    unit = usual_unit if unit is None else unit
    if unit not in METRES:
        raise ShapeError(f"{path}: unit {unit!r} is unknown; use one of {', '.join(map(repr, METRES))}")
    with reading(
        path, "give a shape model, reduced by trimesh's mesh.simplify_quadric_decimation if need be", ShapeError
    ):
        require_file(path, MAX_FILE_BYTES)
        vertices, faces = reader(path)
    return check_shape(vertices * METRES[unit], faces, name or path.name, expect_radius_m=expect_radius_m)


def save_shape(shape: ShapeModel, path: str | os.PathLike[str]) -> None:
    """Write a shape as OBJ in metres; the same shape always gives the same bytes, and reading it back the same numbers.

    The file appears whole or not at all: it is written under another name beside its place and then moved.

    Args:
        shape: the shape to write.
        path: the .obj file to make or replace.

    Raises:
        OutputError: the file cannot be written; what stood there before is untouched.
    """
    path = Path(path)
    lines = [f"# {' '.join(shape.name.split())}", "# metres, body-fixed frame A, faces counter-clockwise from outside"]
    lines += [f"v {x!r} {y!r} {z!r}" for x, y, z in shape.vertices.tolist()]
    lines += [f"f {i} {j} {k}" for i, j, k in (shape.faces + 1).tolist()]
    with writing(path, "choose another file"):
        write_text(path, "\n".join(lines) + "\n")


def _reader(path: Path) -> tuple[Callable[[Path], Mesh], Unit]:
    try:
        return READERS[path.suffix.lower()]
    except KeyError:
        raise ShapeError(f"{path}: ending {path.suffix!r} is unknown; use one of {', '.join(READERS)}") from None
