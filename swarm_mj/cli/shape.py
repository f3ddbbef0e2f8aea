"""The commands `build-shape` and `load-shape`."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from swarm_mj.cli.common import add_command
from swarm_mj.errors import ShapeError

if TYPE_CHECKING:
    from swarm_mj.smallbody.shape import ShapeModel


def add(commands: argparse._SubParsersAction) -> None:
    """Add the commands to the parser."""
    build = add_command(commands, "build-shape", _build, "build the mesh of a packaged body from its harmonics")
    build.add_argument("body", nargs="?", default="eros", metavar="NAME", help="eros (default), bennu or itokawa")
    build.add_argument("--frequency", type=int, metavar="N", help="of the geodesic mesh: 20 N^2 faces (default 20)")
    load = add_command(commands, "load-shape", _load, "check and describe a shape file")
    load.add_argument("file", type=Path, metavar="FILE", help="OBJ, PLY, STL, PDS .tab or SPICE .bds")
    load.add_argument(
        "--unit",
        choices=("m", "km"),
        help="unit of FILE (default: m, but km for .tab and .bds; asked for where both may be)",
    )
    load.add_argument(
        "--radius-range",
        nargs=2,
        type=float,
        metavar=("LOW", "HIGH"),
        help="largest vertex radius of FILE that is believed [m] (default: 50 to 2e6); a scenario's body.radius_range_m",
    )
    for command in (build, load):
        command.add_argument("--out", type=Path, metavar="OBJ", help="write the mesh here, in metres")


def _build(arguments: argparse.Namespace) -> int:
    from swarm_mj.smallbody.shape_harmonics import FREQUENCY, build_shape

    shape = build_shape(arguments.body, FREQUENCY if arguments.frequency is None else arguments.frequency)
    return _describe(shape, arguments.out)


def _load(arguments: argparse.Namespace) -> int:
    return _describe(_read(arguments), arguments.out)


def _describe(shape: ShapeModel, out: Path | None) -> int:
    from swarm_mj.smallbody.shape_check import shown_size
    from swarm_mj.smallbody.shape_io import save_shape

    print(
        f"{shape.name}: {len(shape.vertices)} vertices, {len(shape.faces)} faces, closed, normals outward; "
        f"volume {shown_size(shape.volume, 3)}, area {shown_size(shape.surface_area, 2)}, "
        f"radius up to {shown_size(shape.max_radius, 1)}"
    )
    if out:
        save_shape(shape, out)
        print(f"wrote {out}")
    return 0


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
