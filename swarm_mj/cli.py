"""The command line `swarm-mj`. Heavy modules are imported by the commands that need them, so that help is quick."""

from __future__ import annotations

import argparse
import json
import signal
import sys
import threading
from collections.abc import Sequence
from pathlib import Path

from swarm_mj import __version__
from swarm_mj.errors import SwarmError

DEFAULT_OUT = Path("results")
DEFAULT_SCENARIOS = ("eros-config1", "eros-config2")


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit status: 0 done, 1 a named error, 130 interrupted."""
    arguments = _parser().parse_args(argv)
    if threading.current_thread() is threading.main_thread():
        # Whoever ends the program politely gets the same tidy end as Ctrl-C.
        signal.signal(signal.SIGTERM, _interrupt)
    try:
        return int(arguments.command(arguments) or 0)
    except SwarmError as error:
        print(f"swarm-mj: error: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("\nswarm-mj: interrupted; nothing half-written was left behind", file=sys.stderr)
        return 130
    except BrokenPipeError:
        return 0


def _interrupt(number: int, frame: object) -> None:
    raise KeyboardInterrupt


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="swarm-mj", description="Fly CubeSat swarms past small bodies and measure what their cameras see."
    )
    parser.add_argument("--version", action="version", version=f"swarm-mj {__version__}")
    commands = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)
    _add_run(commands)
    _add_design(commands)
    _add_scenarios(commands)
    _add_shape(commands)
    _add_validate(commands)
    return parser


def _add_run(commands: argparse._SubParsersAction) -> None:
    run = commands.add_parser(
        "run",
        help="fly one or more scenarios and write their results",
        description="Fly scenarios: trajectories, attitude, observed area, telemetry and figures, one folder each.",
    )
    run.add_argument(
        "scenario",
        nargs="*",
        default=list(DEFAULT_SCENARIOS),
        metavar="NAME_OR_FILE",
        help=f"packaged name or YAML file (default: {' '.join(DEFAULT_SCENARIOS)})",
    )
    run.add_argument(
        "--out",
        type=Path,
        metavar="DIR",
        help=f"result folder (default: {DEFAULT_OUT}/NAME; of several scenarios: the folder that holds theirs)",
    )
    run.add_argument(
        "--design", metavar="DESIGN", help="fly this design: a design.json of `swarm-mj design`, or a packaged name"
    )
    _add_common(run, seed_of="the random initial attitudes")
    run.set_defaults(command=_run)


def _add_common(command: argparse.ArgumentParser, *, seed_of: str) -> None:
    """Arguments of every command that works on a scenario and writes a folder."""
    command.add_argument("--seed", type=int, metavar="N", help=f"seed of {seed_of}")
    command.add_argument(
        "--set",
        action="append",
        default=[],
        dest="overrides",
        metavar="KEY=VALUE",
        help="change one value, e.g. camera.half_angle_deg=3; may be repeated",
    )
    command.add_argument("--no-figures", action="store_true", help="write no pictures")
    command.add_argument("--quiet", action="store_true", help="no progress bar")


def _overrides(arguments: argparse.Namespace) -> list[str]:
    """What `--set` and `--seed` ask for."""
    seed = [] if arguments.seed is None else [f"seed={arguments.seed}"]
    return [*arguments.overrides, *seed]


def _run(arguments: argparse.Namespace) -> int:
    from swarm_mj.runner import run_many
    from swarm_mj.scenarios.loading import load_scenario, read_design

    overrides = _overrides(arguments)
    if arguments.design is not None:
        points = read_design(arguments.design)
        overrides += [f"design.reference={json.dumps(arguments.design)}", f"design.visiting_points={points}"]
    scenarios = [load_scenario(name, overrides) for name in arguments.scenario]
    single = arguments.out is not None and len(scenarios) == 1
    parent = arguments.out or DEFAULT_OUT
    folders = [parent if single else parent / scenario.name for scenario in scenarios]
    run_many(scenarios, folders, figures=not arguments.no_figures, quiet=arguments.quiet)
    return 0


def _add_design(commands: argparse._SubParsersAction) -> None:
    design = commands.add_parser(
        "design",
        help="find the fewest spacecraft that see the whole target",
        description="Design a swarm: the fewest observers that see the whole target, by genetic algorithm and with proof.",
    )
    design.add_argument(
        "scenario", nargs="?", default=DEFAULT_SCENARIOS[0], metavar="NAME_OR_FILE", help="packaged name or YAML file"
    )
    design.add_argument("--out", type=Path, metavar="DIR", help=f"result folder (default: {DEFAULT_OUT}/NAME-design)")
    design.add_argument("--fold", type=int, metavar="K", help="every face must be seen by at least K spacecraft")
    design.add_argument("--pareto", action="store_true", help="trade spacecraft against delta-v and area too (NSGA-II)")
    design.add_argument(
        "--compare", action="store_true", help="print how the minimum grows with demands beyond the paper"
    )
    design.add_argument("--workers", type=int, metavar="N", help="processes for the pictures (default: one per core)")
    _add_common(design, seed_of="the genetic algorithm")
    design.set_defaults(command=_design)


def _design(arguments: argparse.Namespace) -> int:
    from swarm_mj.design_runner import run_design
    from swarm_mj.scenarios.loading import load_scenario

    overrides = _overrides(arguments)
    if arguments.fold is not None:
        overrides.append(f"designer.fold={arguments.fold}")
    scenario = load_scenario(arguments.scenario, overrides)
    run_design(
        scenario,
        arguments.out or DEFAULT_OUT / f"{scenario.name}-design",
        pareto=arguments.pareto,
        compare=arguments.compare,
        figures=not arguments.no_figures,
        quiet=arguments.quiet,
        workers=arguments.workers,
    )
    return 0


def _add_scenarios(commands: argparse._SubParsersAction) -> None:
    scenarios = commands.add_parser(
        "scenarios",
        help="list the packaged scenarios, print one, or print the schema",
        description="List the packaged scenarios; with a NAME print that file, a start for your own.",
    )
    scenarios.add_argument("name", nargs="?", metavar="NAME", help="print this packaged scenario")
    scenarios.add_argument("--json-schema", action="store_true", help="print the JSON schema of scenario files")
    scenarios.set_defaults(command=_scenarios)


def _scenarios(arguments: argparse.Namespace) -> int:
    from swarm_mj.scenarios.loading import load_scenario, packaged_names, packaged_text
    from swarm_mj.scenarios.schema import Scenario

    if arguments.json_schema:
        print(json.dumps(Scenario.model_json_schema(), indent=2))
    elif arguments.name:
        print(packaged_text(arguments.name), end="")
    else:
        width = max(map(len, packaged_names()))
        for name in packaged_names():
            print(f"{name:{width}}  {' '.join(load_scenario(name).description.split())}")
    return 0


def _add_shape(commands: argparse._SubParsersAction) -> None:
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


def _add_validate(commands: argparse._SubParsersAction) -> None:
    validate = commands.add_parser(
        "validate",
        help="run the physics checks on the installed program",
        description="Compare the installed program with independent references; exit status 1 if a check fails.",
    )
    validate.add_argument(
        "--only", action="append", default=[], metavar="NAME", help="run this check or group; may be repeated"
    )
    validate.add_argument("--json", type=Path, metavar="FILE", help="write the results as JSON")
    validate.add_argument("--markdown", type=Path, metavar="FILE", help="write the results as a Markdown page")
    validate.add_argument("--quiet", action="store_true", help="no progress bar")
    validate.set_defaults(command=_validate)


def _validate(arguments: argparse.Namespace) -> int:
    from swarm_mj.validation.runner import run_validation

    return run_validation(arguments.only, arguments.json, arguments.markdown, arguments.quiet)


if __name__ == "__main__":
    sys.exit(main())
