"""The command `bench`."""

from __future__ import annotations

import argparse
from pathlib import Path


def add(commands: argparse._SubParsersAction) -> None:
    """Add the command to the parser."""
    bench = commands.add_parser(
        "bench",
        help="measure how fast the program is on this machine",
        description="Measure ratios side by side: loop against raw MuJoCo, observers, designer, environment, films, main job.",
    )
    bench.add_argument(
        "--only",
        action="append",
        default=[],
        metavar="NAME",
        help="start, loop, observers, designer, environment, gpu, pictures or job; may be repeated",
    )
    bench.add_argument(
        "--full", action="store_true", help="more rounds and large cases, as in docs/results/performance.md"
    )
    bench.add_argument("--json", type=Path, metavar="FILE", help="write the results as JSON")
    bench.add_argument("--markdown", type=Path, metavar="FILE", help="write the results as a Markdown page")
    bench.set_defaults(command=_bench)


def _bench(arguments: argparse.Namespace) -> int:
    from swarm_mj.verification.performance.runner import run_bench

    run_bench(arguments.only, quick=not arguments.full, as_json=arguments.json, markdown=arguments.markdown)
    return 0
