"""The command `campaign`."""

from __future__ import annotations

import argparse
from pathlib import Path

from swarm_mj.commands.common import DEFAULT_OUT


def add(commands: argparse._SubParsersAction) -> None:
    """Add the command to the parser."""
    campaign = commands.add_parser(
        "campaign",
        help="fly many runs with drawn parameters, on all cores or a Dask cluster",
        description="Fly a campaign: scenarios with drawn parameters, one row of results a run, and what they say in sum. "
        "An interrupted campaign goes on with --resume.",
    )
    campaign.add_argument("file", metavar="FILE", help="YAML file of the campaign, or the name of a packaged one")
    campaign.add_argument("--out", type=Path, metavar="DIR", help=f"result folder (default: {DEFAULT_OUT}/NAME)")
    campaign.add_argument("--runs", type=int, metavar="N", help="instead of the file's number of runs")
    campaign.add_argument("--workers", type=int, metavar="N", help="processes (default: one per core)")
    campaign.add_argument("--scheduler", metavar="ADDRESS", help="fly on the Dask cluster there, e.g. tcp://host:8786")
    campaign.add_argument("--resume", action="store_true", help="go on with the campaign in the result folder")
    campaign.add_argument("--replay", type=int, metavar="ROW", help="fly this row again, alone, and compare")
    campaign.add_argument("--no-figures", action="store_true", help="write no pictures")
    campaign.add_argument("--quiet", action="store_true", help="no progress bar")
    campaign.set_defaults(command=_campaign)


def _campaign(arguments: argparse.Namespace) -> int:
    from swarm_mj.campaign.loading import load_campaign
    from swarm_mj.campaign.runner import replay, run_campaign
    from swarm_mj.errors import OutputError

    if arguments.workers is not None and arguments.workers < 1:
        raise OutputError(f"--workers {arguments.workers}: must be at least 1")
    resolved = load_campaign(arguments.file, runs=arguments.runs)
    folder = arguments.out or DEFAULT_OUT / resolved.campaign.name
    if arguments.replay is not None:
        return 0 if replay(resolved, arguments.replay, folder, quiet=arguments.quiet) else 1
    run_campaign(
        resolved,
        folder,
        workers=arguments.workers,
        scheduler=arguments.scheduler,
        resume=arguments.resume,
        quiet=arguments.quiet,
        figures=not arguments.no_figures,
    )
    return 0
