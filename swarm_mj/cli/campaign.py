"""The command `campaign`."""

from __future__ import annotations

import argparse
import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Any

from swarm_mj.cli.common import DEFAULT_OUT, add_overrides, overrides_of
from swarm_mj.errors import OutputError

if TYPE_CHECKING:
    from swarm_mj.campaigns.loading import Resolved


def add(commands: argparse._SubParsersAction) -> None:
    """Add the command to the parser."""
    campaign = commands.add_parser(
        "campaign",
        help="fly many runs with drawn parameters, on all cores or a Dask cluster",
        description="Fly a campaign: scenarios with drawn parameters, one row of results a run, and what they say in sum. "
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
    campaign.add_argument("--workers", type=int, metavar="N", help="processes (default: one per core)")
    campaign.add_argument("--scheduler", metavar="ADDRESS", help="fly on the Dask cluster there, e.g. tcp://host:8786")
    campaign.add_argument("--resume", action="store_true", help="go on with the campaign in the result folder")
    campaign.add_argument("--replay", type=int, metavar="ROW", help="fly this row again, alone, and compare")
    add_overrides(campaign, "camera.half_angle_deg=3, in all its scenarios")
    campaign.add_argument("--no-figures", action="store_true", help="write no pictures")
    campaign.add_argument("--quiet", action="store_true", help="no progress bar")
    campaign.set_defaults(command=_campaign)


def _campaign(arguments: argparse.Namespace) -> int:
    if arguments.workers is not None and arguments.workers < 1:
        raise OutputError(f"--workers {arguments.workers}: must be at least 1")
    resolved, folder = _loaded(arguments)
    return _replay(arguments, resolved, folder) if arguments.replay is not None else _fly(arguments, resolved, folder)


def _fly(arguments: argparse.Namespace, resolved: Resolved, folder: Path) -> int:
    from rich.console import Console

    from swarm_mj.campaigns.runner import run_campaign
    from swarm_mj.io.progress import progress_bars

    console = Console()

    def say(words: str) -> None:
        console.print(words, soft_wrap=True, highlight=False, markup=False)

    with progress_bars(console, arguments.quiet) as bars:
        flown = run_campaign(
            resolved,
            folder,
            workers=arguments.workers,
            scheduler=arguments.scheduler,
            resume=arguments.resume,
            bars=bars,
            say=say,
            figures=not arguments.no_figures,
            going_on=_going_on(arguments),
        )
    from swarm_mj.campaigns.summary import group_table, sobol_findings, summary_table

    console.print(summary_table(flown.summary))
    designs = group_table(flown.summary)
    if designs is not None:
        console.print(designs)
    failed = [row for row in flown.results.to_pylist() if row["status"] == "failed"]
    for words in [*sobol_findings(flown.summary), *map(_failure, failed[:5])]:
        say(words)
    if failed:
        say(f"{len(failed)} failed; replay one with --replay {failed[0]['row']}")
    say(f"{resolved.campaign.name}: files in {folder}")
    return 0


def _failure(row: dict[str, Any]) -> str:
    return f"row {row['row']} ({row['scenario']}, seed {row['seed']}) failed: {row['error']}"


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
    if not arguments.quiet:
        print("\n".join(told))
    return 1 if again.differs else 0


def _loaded(arguments: argparse.Namespace) -> tuple[Resolved, Path]:
    """The campaign and its folder; what goes on or is replayed has as many runs as when it began, unless --runs says else."""
    from swarm_mj.campaigns.loading import load_campaign
    from swarm_mj.campaigns.manifest import load_campaign_of

    overrides = overrides_of(arguments)
    resolved = load_campaign(arguments.file, overrides, runs=arguments.runs)
    name, runs = resolved.campaign.name, resolved.campaign.runs
    folder = arguments.out or DEFAULT_OUT / name
    if arguments.resume or arguments.replay is not None:
        resolved = load_campaign_of(folder, arguments.file, overrides, runs=arguments.runs)
        if resolved.campaign.runs != runs:
            print(f"{name}: runs = {resolved.campaign.runs}, with which it began in {folder}; the file says {runs}")
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
