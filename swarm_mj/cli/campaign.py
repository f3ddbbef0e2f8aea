"""The commands `campaign` and `compare-classes`."""

from __future__ import annotations

import argparse
import shlex
from pathlib import Path
from typing import TYPE_CHECKING

from swarm_mj.cli.common import (
    DEFAULT_OUT,
    add_command,
    add_figures,
    add_overrides,
    add_quiet,
    bars_for,
    overrides_of,
    show_table,
    tell,
)
from swarm_mj.io.machine import check_workers

if TYPE_CHECKING:
    from swarm_mj.campaigns.loading import Resolved


def add(commands: argparse._SubParsersAction) -> None:
    """Add the commands to the parser."""
    campaign = add_command(
        commands,
        "campaign",
        _campaign,
        "fly many runs with drawn parameters, on all cores or a Dask cluster",
        "Fly a campaign: scenarios with drawn parameters, one row of results a run, and what they say in sum. "
        "An interrupted campaign goes on with --resume.",
    )
    campaign.add_argument(
        "file",
        metavar="FILE",
        help="YAML file of the campaign, or the name of a packaged one; or a scenario, which is flown with "
        "one seed after the other",
    )
    campaign.add_argument("--out", type=Path, metavar="DIR", help=f"result folder (default: {DEFAULT_OUT}/NAME)")
    campaign.add_argument(
        "--runs",
        type=int,
        metavar="N",
        help="flights of each scenario, instead of the file's runs (with --resume and --replay: the folder's); of each point "
        "of a grid; of the two base samples of saltelli",
    )
    add_flying(campaign, "camera.half_angle_deg=3, in all its scenarios")
    campaign.add_argument("--scheduler", metavar="ADDRESS", help="fly on the Dask cluster there, e.g. tcp://host:8786")
    campaign.add_argument("--replay", type=int, metavar="ROW", help="fly this row again, alone, and compare")
    classes = add_command(
        commands,
        "compare-classes",
        _classes,
        "fly the swarm classes 0 to 4 through the same dispersed encounters with losses, and compare them",
        "Fly the swarm classes 0 to 4 of a scenario through the same dispersed encounters, in which each "
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
    add_flying(classes)
    classes.add_argument(
        "--no-places", action="store_true", help="leave out classes 3 and 4 with visiting points planned for them"
    )


def add_flying(command: argparse.ArgumentParser, example: str = "camera.half_angle_deg=3") -> None:
    """Arguments of the commands that fly a campaign."""
    command.add_argument("--workers", type=int, metavar="N", help="processes (default: one per core)")
    add_overrides(command, example)
    command.add_argument("--resume", action="store_true", help="go on with what the result folder holds")
    add_figures(command)
    add_quiet(command)


def _campaign(arguments: argparse.Namespace) -> int:
    check_workers(arguments.workers)
    resolved, folder = _loaded(arguments)
    return _replay(arguments, resolved, folder) if arguments.replay is not None else _fly(arguments, resolved, folder)


def _fly(arguments: argparse.Namespace, resolved: Resolved, folder: Path) -> int:
    from swarm_mj.campaigns.runner import run_campaign

    with bars_for(arguments) as bars:
        flown = run_campaign(
            resolved,
            folder,
            workers=arguments.workers,
            scheduler=arguments.scheduler,
            resume=arguments.resume,
            bars=bars,
            figures=not arguments.no_figures,
            going_on=_going_on(arguments),
        )
    from swarm_mj.campaigns.summary import group_table, sobol_findings, summary_table

    for table in filter(None, (summary_table(flown.summary), group_table(flown.summary))):
        show_table(bars.console, table)
    failed = [row for row in flown.results.to_pylist() if row["status"] == "failed"]
    lines = sobol_findings(flown.summary)
    lines += [f"row {r['row']} ({r['scenario']}, seed {r['seed']}) failed: {r['error']}" for r in failed[:5]]
    if failed:
        lines.append(f"{len(failed)} failed; replay one with --replay {failed[0]['row']}")
    tell(bars.console, *lines, f"{resolved.campaign.name}: files in {folder}")
    return 0


def _replay(arguments: argparse.Namespace, resolved: Resolved, folder: Path) -> int:
    from swarm_mj.campaigns.runner import replay

    again = replay(resolved, arguments.replay, folder)
    shown = ("scenario", "seed", *again.values, "status", "error", "covered", "coverage_percent")
    told = [f"{name}: {again.row[name]}" for name in shown if again.row.get(name) is not None]
    if again.differs is None:
        told.append(f"{folder} holds no row {arguments.replay} to compare with")
    else:
        words = f"differs in {', '.join(again.differs)}" if again.differs else "is the same, bit for bit"
        told.append(f"row {arguments.replay} of {folder} {words}")
    print("\n".join(told))
    return 1 if again.differs else 0


def _loaded(arguments: argparse.Namespace) -> tuple[Resolved, Path]:
    """The campaign and its folder; what goes on or is replayed has as many runs as when it began, unless --runs says else."""
    from swarm_mj.campaigns.loading import load_campaign
    from swarm_mj.campaigns.manifest import kept_runs

    overrides = overrides_of(arguments)
    resolved = load_campaign(arguments.file, overrides, runs=arguments.runs)
    name, runs = resolved.campaign.name, resolved.campaign.runs
    folder = arguments.out or DEFAULT_OUT / name
    if arguments.runs is None and (arguments.resume or arguments.replay is not None):
        kept = kept_runs(folder, resolved.campaign)
        if kept != runs:
            print(f"{name}: runs = {kept}, with which it began in {folder}; the file says {runs}")
            resolved = load_campaign(arguments.file, overrides, runs=kept)
    return resolved, folder


def _going_on(arguments: argparse.Namespace) -> str:
    """The command that goes on with what this one began; the number of runs stands in the folder."""
    words = ["swarm-mj", "campaign", arguments.file]
    for option in ("out", "workers", "scheduler"):
        value = getattr(arguments, option)
        if value is not None:
            words += [f"--{option}", str(value)]
    words += [word for text in arguments.overrides for word in ("--set", text)]
    words += ["--no-figures"] if arguments.no_figures else []
    words += ["--quiet"] if arguments.quiet else []
    return shlex.join([*words, "--resume"])


def _classes(arguments: argparse.Namespace) -> int:
    from swarm_mj.api.campaign import compare_classes
    from swarm_mj.campaigns.classes import table_by_lost, table_of_classes

    folder = arguments.out or DEFAULT_OUT / f"{Path(arguments.scenario).stem}-classes"
    with bars_for(arguments) as bars:
        compared = compare_classes(
            arguments.scenario,
            overrides_of(arguments),
            runs=arguments.runs,
            out=folder,
            workers=arguments.workers,
            places=not arguments.no_places,
            resume=arguments.resume,
            figures=not arguments.no_figures,
            progress=bars,
        )
    print(table_of_classes(compared.classes), table_by_lost(compared.classes), sep="\n")
    print(f"{arguments.scenario}: files in {folder}")
    return 0
