"""The command `shape`."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from swarm_mj.errors import ShapeError

if TYPE_CHECKING:
    from swarm_mj.smallbody.shape import ShapeModel


def add(commands: argparse._SubParsersAction) -> None:
    """Add the command to the parser."""
    shape = commands.add_parser(
        "shape",
        help="build the mesh of a packaged body from its harmonics, or check a shape file",
        description="Without FILE: build the mesh of a packaged body from its harmonics. With FILE: check and describe it.",
    )
    shape.add_argument(
        "file", nargs="?", type=Path, metavar="FILE", help="OBJ, PLY, STL, PDS .tab or SPICE .bds to check"
    )
    shape.add_argument("--body", metavar="NAME", help="eros (default), bennu or itokawa; not with FILE")
    shape.add_argument("--unit", choices=("m", "km"), help="unit of FILE (default: m, but km for .tab and .bds)")
    shape.add_argument(
        "--radius-range",
        nargs=2,
        type=float,
        metavar=("LOW", "HIGH"),
        help="largest vertex radius of FILE that is believed [m] (default: 50 to 2e6); a scenario's body.radius_range_m",
    )
    shape.add_argument(
        "--frequency", type=int, metavar="N", help="of the geodesic mesh: 20 N^2 faces (default 20); not with FILE"
    )
    shape.add_argument("--out", type=Path, metavar="OBJ", help="write the mesh here, in metres")
    shape.set_defaults(command=_shape)


def _shape(arguments: argparse.Namespace) -> int:
    from swarm_mj.smallbody.shape_check import shown_size
    from swarm_mj.smallbody.shape_harmonics import FREQUENCY, build_body
    from swarm_mj.smallbody.shape_io import save_obj

    _check_together(arguments)
    if arguments.file:
        shape = _read(arguments)
    else:
        shape = build_body(arguments.body or "eros", FREQUENCY if arguments.frequency is None else arguments.frequency)
    print(
        f"{shape.name}: {len(shape.vertices)} vertices, {len(shape.faces)} faces, closed, normals outward; "
        f"volume {shown_size(shape.volume, 3)}, area {shown_size(shape.surface_area, 2)}, "
        f"radius up to {shown_size(shape.max_radius, 1)}"
    )
    if arguments.out:
        save_obj(shape, arguments.out)
        print(f"wrote {arguments.out}")
    return 0


def _check_together(arguments: argparse.Namespace) -> None:
    """Refuse what would be ignored: a mesh is built or read, and each has options of its own."""
    building = {"--body": arguments.body, "--frequency": arguments.frequency}
    reading = {"--unit": arguments.unit, "--radius-range": arguments.radius_range}
    for option, value in (building if arguments.file else reading).items():
        if value is not None and arguments.file:
            raise ShapeError(
                f"{option} {value}: is for building a packaged body, not for {arguments.file}; leave out one"
            )
        if value is not None:
            raise ShapeError(f"{option}: says how a FILE is read; give the FILE, or leave it out")


def _read(arguments: argparse.Namespace) -> ShapeModel:
    from swarm_mj.smallbody.shape_check import BODY_RADIUS_RANGE_M, BodySizeError
    from swarm_mj.smallbody.shape_io import load_shape

    low, high = arguments.radius_range or BODY_RADIUS_RANGE_M
    if not 0.0 < low < high:
        raise ShapeError(f"--radius-range {low:g} {high:g}: must be two numbers above 0 [m], the smaller one first")
    try:
        return load_shape(arguments.file, unit=arguments.unit, expect_radius_m=(low, high))
    except BodySizeError as error:
        raise ShapeError(error.advised("give --unit {unit}", "give --radius-range LOW HIGH (m)")) from None
