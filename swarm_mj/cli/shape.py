"""The commands `build-shape`, `load-shape` and `fit-harmonics`."""

from __future__ import annotations

import argparse
from math import hypot
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
    fit = add_command(
        commands,
        "fit-harmonics",
        _fit,
        "gravity of a homogeneous shape as spherical harmonics",
        "Fit spherical harmonics to the gravity of a shape of constant density, for `body.gravity` of a scenario.",
    )
    fit.add_argument("--degree", type=int, default=36, metavar="N", help="highest degree (default 36)")
    mass = fit.add_mutually_exclusive_group(required=True)
    mass.add_argument("--gm", type=float, metavar="GM", help="gravitational parameter [m^3/s^2]")
    mass.add_argument("--density", type=float, metavar="RHO", help="density [kg/m^3]")
    for command in (load, fit):
        command.add_argument("file", type=Path, metavar="FILE", help="OBJ, PLY, STL, PDS .tab or SPICE .bds")
        command.add_argument(
            "--unit",
            choices=("m", "km"),
            help="unit of FILE (default: m, but km for .tab and .bds; asked for where both may be)",
        )
        command.add_argument(
            "--radius-range",
            nargs=2,
            type=float,
            metavar=("LOW", "HIGH"),
            help="largest vertex radius of FILE that is believed [m] (default: 50 to 2e6); a scenario's body.radius_range_m",
        )
    fit.add_argument("--out", type=Path, metavar="YAML", help="write what `body.gravity` of a scenario reads here")
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
        f"radius up to {shown_size(shape.max_radius, 1)}, centre of volume {hypot(*shape.centroid):.3g} m from "
        "the origin"
    )
    if out:
        save_shape(shape, out)
        print(f"wrote {out}")
    return 0


def _fit(arguments: argparse.Namespace) -> int:
    from swarm_mj.io.atomic import write_text
    from swarm_mj.smallbody.gravity.polyhedron import FAR_DEGREE, Polyhedron
    from swarm_mj.smallbody.gravity.truncation import gravity_text, truncated_field, truncation_errors

    if not 2 <= arguments.degree <= FAR_DEGREE:
        raise ShapeError(f"--degree {arguments.degree}: must be from 2 to {FAR_DEGREE}")
    body = Polyhedron(_read(arguments), density=arguments.density, gm=arguments.gm)
    field = truncated_field(body, arguments.degree)
    found = [
        f"{body.shape.name} of constant density to degree {field.degree}; it holds beyond the reference radius alone",
        *(f"at {share:g} radii ({share * field.reference_radius:.6g} m) off by up to {most:.1e} of the attraction"
          for share, most in truncation_errors(body, field)),
    ]  # fmt: skip
    print("\n".join(found))
    if arguments.out:
        write_text(arguments.out, gravity_text(field, found))
        print(f'wrote {arguments.out}: for body.gravity, e.g. --set body.gravity="$(cat {arguments.out})"')
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
