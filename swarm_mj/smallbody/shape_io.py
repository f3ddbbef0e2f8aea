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
from swarm_mj.scenarios import constants
from swarm_mj.smallbody.mesh_files import read_dsk, read_obj, read_ply, read_stl, read_tab
from swarm_mj.smallbody.shape import ShapeModel
from swarm_mj.smallbody.shape_check import BODY_RADIUS_RANGE_M, UnknownUnitError, check_shape
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
#: Largest radius [m] up to which kilometres are thought of where a file does not say: Ceres has 0.48e6 m.
LARGEST_M = 6e5
#: Densities of bodies that are believed [kg/m^3]; readings in m and in km are a factor of 1e9 apart.
DENSITIES = (1.0, 1e5)
#: What `save_shape` writes at the top of its files.
METRES_COMMENT = "# metres, body-fixed frame A"
#: Larger files are refused [bytes]: about three million faces, beyond what gravity and coverage can use, read in 2 GB.
MAX_FILE_BYTES = 128 * 2**20


def load_shape(
    path: str | os.PathLike[str],
    *,
    unit: Unit | None = None,
    name: str | None = None,
    expect_radius_m: tuple[float, float] = BODY_RADIUS_RANGE_M,
    gm: float | None = None,
) -> ShapeModel:
    """Read and check a shape model.

    Args:
        path: an .obj, .ply (text or binary), .stl (text or binary), PDS .tab or SPICE .bds file. Polygons with more than three
            corners are cut into a fan of triangles about the first; texture, colour and normals are ignored.
        unit: unit of length in the file; None: kilometres for .tab and .bds, metres for the others, of which those are refused
            whose size would be believed in kilometres as well, unless they say that they hold metres, as `save_shape` does.
        name: what messages call the body; None: the file's name.
        expect_radius_m: lowest and highest believable distance of the farthest vertex from the origin [m].
        gm: of the body [m^3/s^2], by whose density the unit is judged where none is given; None: not known.

    Returns:
        The shape in metres, frame A being the frame of the file.

    Raises:
        ShapeError: the file cannot be read, or the mesh is not one closed body; the message says where and what to do.
    """
    path = Path(path)
    reader, usual_unit = _reader(path)
    given, unit = unit, usual_unit if unit is None else unit
    if unit not in METRES:
        raise ShapeError(f"{path}: unit {unit!r} is unknown; use one of {', '.join(map(repr, METRES))}")
    with reading(
        path, "give a shape model, reduced by trimesh's mesh.simplify_quadric_decimation if need be", ShapeError
    ):
        require_file(path, MAX_FILE_BYTES)
        vertices, faces = reader(path)
    shape = check_shape(vertices * METRES[unit], faces, name or path.name, expect_radius_m=expect_radius_m)
    if given is None:
        _check_unit(shape, unit, expect_radius_m, gm, told=unit == "km" or _says_metres(path))
    return shape


def _check_unit(
    shape: ShapeModel, unit: Unit, believed_m: tuple[float, float], gm: float | None, *, told: bool
) -> None:
    """See that a body was read in the unit that it is meant in; `told`: whether the format or the file says so."""
    other: Unit = "m" if unit == "km" else "km"
    larger = METRES[other] / METRES[unit]
    if gm is not None:
        density = gm / (constants.GRAVITATIONAL_CONSTANT * shape.volume)
        low, high = DENSITIES
        if low <= density <= high:
            return
        if low <= density / larger**3 <= high:
            raise UnknownUnitError(
                f"{shape.name}: read in {unit} its density by GM = {gm:g} m^3/s^2 is {density:.3g} kg/m^3, in {other} "
                f"{density / larger**3:.3g} kg/m^3",
                other,
            )
    if not told and believed_m[0] <= shape.max_radius * larger <= min(believed_m[1], LARGEST_M):
        raise UnknownUnitError(
            f"{shape.name}: the farthest vertex is {shape.max_radius:.4g} from the origin, in metres or kilometres, which the "
            "file does not say",
            other,
        )


def _says_metres(path: Path) -> bool:
    """Whether a file is an OBJ that `save_shape` has written."""
    if path.suffix.lower() != ".obj":
        return False
    with open(path, "rb") as file:
        return METRES_COMMENT.encode() in file.read(4096)


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
    lines = [f"# {' '.join(shape.name.split())}", f"{METRES_COMMENT}, faces counter-clockwise from outside"]
    lines += [f"v {x!r} {y!r} {z!r}" for x, y, z in shape.vertices.tolist()]
    lines += [f"f {i} {j} {k}" for i, j, k in (shape.faces + 1).tolist()]
    with writing(path, "choose another file"):
        write_text(path, "\n".join(lines) + "\n")


def _reader(path: Path) -> tuple[Callable[[Path], Mesh], Unit]:
    try:
        return READERS[path.suffix.lower()]
    except KeyError:
        raise ShapeError(f"{path}: ending {path.suffix!r} is unknown; use one of {', '.join(READERS)}") from None
