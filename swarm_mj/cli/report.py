"""The command `report`."""

from __future__ import annotations

import argparse
from pathlib import Path


def add(commands: argparse._SubParsersAction) -> None:
    """Add the command to the parser."""
    report = commands.add_parser(
        "report",
        help="write the report of a run, or of two side by side",
        description="Write one HTML file that opens in any browser without a network.",
    )
    report.add_argument(
        "runs", nargs="+", type=Path, metavar="RUN_DIR", help="one or two result folders of `swarm-mj fly`"
    )
    report.add_argument(
        "--out",
        type=Path,
        metavar="FILE",
        help="default: report.html in the folder, or comparison.html in the first of two",
    )
    report.set_defaults(command=_report)


def _report(arguments: argparse.Namespace) -> int:
    from swarm_mj.api.results import report

    print(f"wrote {report(arguments.runs, arguments.out)}")
    return 0
