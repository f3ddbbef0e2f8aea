"""The command `fly`."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from swarm_mj.cli.common import DEFAULT_OUT, DEFAULT_SCENARIOS, add_common, overrides_of
from swarm_mj.errors import OutputError
from swarm_mj.figures.drawing import prepare_drawing

if TYPE_CHECKING:
    from rich.console import Console


def add(commands: argparse._SubParsersAction) -> None:
    """Add the command to the parser."""
    fly = commands.add_parser(
        "fly",
        help="fly one or more scenarios and write their results",
        description="Fly scenarios: trajectories, attitude, observed area, telemetry and figures, one folder each.",
    )
    fly.add_argument(
        "scenario",
        nargs="*",
        default=list(DEFAULT_SCENARIOS),
        metavar="NAME_OR_FILE",
        help=f"packaged name or YAML file (default: {' '.join(DEFAULT_SCENARIOS)})",
    )
    fly.add_argument(
        "--out",
        type=Path,
        metavar="DIR",
        help=f"result folder (default: {DEFAULT_OUT}/NAME; of several scenarios: the folder that holds theirs)",
    )
    fly.add_argument(
        "--design", metavar="DESIGN", help="fly this design: a design.json of `swarm-mj design`, or a packaged name"
    )
    fly.add_argument(
        "--policy",
        metavar="NAME_OR_FILE",
        help="who points at what: a policy file of examples/train_sb3.py, trained (the packaged one), body_centre, "
        "target_centre, sweep, greedy or greedy_ahead",
    )
    add_common(fly, seed_of="the random initial attitudes")
    fly.add_argument("--no-report", action="store_true", help="write no report.html")
    fly.set_defaults(command=_fly)


def _fly(arguments: argparse.Namespace) -> int:
    if not arguments.no_figures:
        prepare_drawing()  # before anything heavy is imported: it takes the other process as long to get ready as this one
    from rich.console import Console

    from swarm_mj.api.flight import check, fly
    from swarm_mj.api.scenario import load
    from swarm_mj.cli.tables import results_table
    from swarm_mj.io.progress import progress_bars

    overrides = overrides_of(arguments)
    scenarios = [load(name, overrides, design=arguments.design, policy=arguments.policy) for name in arguments.scenario]
    folders = _folders(arguments.out, [scenario.name for scenario in scenarios])
    for scenario, folder in zip(scenarios, folders, strict=True):
        check(scenario, folder)  # what is refused is so before another one is flown
    console, report = Console(), not arguments.no_report
    flown = []
    with progress_bars(console, arguments.quiet) as bars:
        for scenario, folder in zip(scenarios, folders, strict=True):
            flight = fly(
                scenario, out=folder, figures=not arguments.no_figures, pdf=arguments.pdf, report=report, progress=bars
            )
            flown.append((folder, flight.summary, flight.findings))
    console.print(results_table([summary for _, summary, _ in flown]))
    for folder, summary, findings in flown:
        _print_notes(console, summary, findings, folder)
    for folder, summary, _ in flown if report else ():
        console.print(f"{summary['scenario']}: report in {folder / 'report.html'}", soft_wrap=True, highlight=False)
    return 0


def _folders(out: Path | None, names: Sequence[str]) -> list[Path]:
    """Where the results go.

    Raises:
        OutputError: Two scenarios have the same name.
    """
    if out is not None and len(names) == 1:
        return [out]
    if len(set(names)) < len(names):
        raise OutputError("two scenarios have the same name; give them folders of their own with --out, one call each")
    return [(out or DEFAULT_OUT) / name for name in names]


def _print_notes(console: Console, summary: dict[str, Any], findings: Sequence[str], folder: Path) -> None:
    notes = [summary["description"]] if summary["description"] else []
    notes += [summary["observer_note"]] if summary["observer"] != "faceid" else []
    for words in [*notes, *findings, f"files in {folder}"]:
        console.print(f"{summary['scenario']}: {words}", soft_wrap=True, highlight=False, markup=False)
