"""The command `shape`."""

from __future__ import annotations

import argparse
from pathlib import Path


def add(commands: argparse._SubParsersAction) -> None:
    """Add the command to the parser."""
    shape = commands.add_parser(
        "shape",
        help="build the Eros mesh from its harmonics, or check a shape file",
        description="Without FILE: build the mesh of 433 Eros from its shape harmonics. With FILE: check and describe it.",
    )
    shape.add_argument("file", nargs="?", type=Path, metavar="FILE", help="OBJ, PLY, STL or PDS .tab to check")
    shape.add_argument("--unit", choices=("m", "km"), help="unit of FILE (default: m, but km for .tab)")
    shape.add_argument(
        "--frequency", type=int, default=20, metavar="N", help="of the geodesic mesh: 20 N^2 faces (default 20)"
    )
    shape.add_argument("--out", type=Path, metavar="OBJ", help="write the mesh here, in metres")
    shape.set_defaults(command=_shape)


def _shape(arguments: argparse.Namespace) -> int:
    from swarm_mj.smallbody.shape_harmonics import build_eros
    from swarm_mj.smallbody.shape_io import load_shape, save_obj

    if arguments.file:
        shape = load_shape(arguments.file, unit=arguments.unit)
    else:
        shape = build_eros(arguments.frequency)
    print(
        f"{shape.name}: {len(shape.vertices)} vertices, {len(shape.faces)} faces, closed, normals outward; "
        f"volume {shape.volume / 1e9:.1f} km^3, area {shape.surface_area / 1e6:.1f} km^2, "
        f"radius up to {shape.max_radius / 1e3:.3f} km"
    )
    if arguments.out:
        save_obj(shape, arguments.out)
        print(f"wrote {arguments.out}")
    return 0
