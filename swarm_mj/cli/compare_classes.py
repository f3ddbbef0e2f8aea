"""The command `compare-classes`."""

from __future__ import annotations

import argparse
from pathlib import Path

from swarm_mj.cli.common import DEFAULT_OUT, add_overrides, overrides_of


def add(commands: argparse._SubParsersAction) -> None:
    """Add the command to the parser."""
    classes = commands.add_parser(
        "compare-classes",
        help="fly the swarm classes 0 to 4 through the same dispersed encounters with losses, and compare them",
        description="Fly the swarm classes 0 to 4 of a scenario through the same dispersed encounters, in which each "
        "spacecraft is lost with a chance of 0 to 40 %, and write tables and figures of what each class sees, delivers and "
        "costs. An interrupted comparison goes on with --resume.",
    )
    classes.add_argument(
        "scenario", nargs="?", default="eros-observe", help="packaged name or file (default: eros-observe)"
    )
    classes.add_argument(
        "--out", type=Path, metavar="DIR", help=f"result folder (default: {DEFAULT_OUT}/SCENARIO-classes)"
    )
    classes.add_argument("--runs", type=int, default=200, metavar="N", help="encounters (default: 200)")
    classes.add_argument("--workers", type=int, metavar="N", help="processes (default: one per core)")
    classes.add_argument(
        "--no-places", action="store_true", help="leave out classes 3 and 4 with visiting points planned for them"
    )
    add_overrides(classes)
    classes.add_argument("--resume", action="store_true", help="go on with the comparison in the result folder")
    classes.add_argument("--no-figures", action="store_true", help="write no pictures")
    classes.add_argument("--quiet", action="store_true", help="no progress bar")
    classes.set_defaults(command=_classes)


def _classes(arguments: argparse.Namespace) -> int:
    from rich.console import Console

    from swarm_mj.api.classes import compare_classes
    from swarm_mj.campaigns.classes_report import table_by_lost, table_of_classes
    from swarm_mj.io.progress import progress_bars

    console = Console()
    folder = arguments.out or DEFAULT_OUT / f"{Path(arguments.scenario).stem}-classes"
    with progress_bars(console, arguments.quiet) as bars:
        compared = compare_classes(
            arguments.scenario,
            overrides_of(arguments),
            runs=arguments.runs,
            out=folder,
            workers=arguments.workers,
            places=not arguments.no_places,
            resume=arguments.resume,
            figures=not arguments.no_figures,
            progress=bars if bars is not None else False,
        )
    if not arguments.quiet:
        print(table_of_classes(compared.classes))
        print(table_by_lost(compared.classes))
    print(f"{arguments.scenario}: files in {folder}")
    return 0
