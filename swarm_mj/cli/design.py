"""The command `design`."""

from __future__ import annotations

import argparse
import shlex
from pathlib import Path

from swarm_mj.cli.common import DEFAULT_OUT, DEFAULT_SCENARIOS, add_common, overrides_of


def add(commands: argparse._SubParsersAction) -> None:
    """Add the command to the parser."""
    design = commands.add_parser(
        "design",
        help="find the fewest spacecraft that see the whole target",
        description="Design a swarm: the fewest observers that see the whole target, by genetic algorithm and with proof.",
    )
    design.add_argument(
        "scenario",
        nargs="?",
        default=DEFAULT_SCENARIOS[0],
        metavar="NAME_OR_FILE",
        help=f"packaged name or YAML file (default: {DEFAULT_SCENARIOS[0]})",
    )
    design.add_argument("--out", type=Path, metavar="DIR", help=f"result folder (default: {DEFAULT_OUT}/NAME-design)")
    design.add_argument("--fold", type=int, metavar="K", help="every face must be seen by at least K spacecraft")
    design.add_argument("--pareto", action="store_true", help="trade spacecraft against delta-v and area too (NSGA-II)")
    design.add_argument(
        "--compare", action="store_true", help="print how the minimum grows with demands beyond the paper"
    )
    design.add_argument("--workers", type=int, metavar="N", help="processes for the pictures (default: one per core)")
    add_common(design, seed_of="the genetic algorithm")
    design.set_defaults(command=_design)


def _design(arguments: argparse.Namespace) -> int:
    from swarm_mj.cli.design_runner import run_design
    from swarm_mj.errors import OutputError
    from swarm_mj.scenarios.loading import load_scenario

    if arguments.workers is not None and arguments.workers < 1:
        raise OutputError(f"--workers {arguments.workers}: must be at least 1")
    overrides = overrides_of(arguments)
    if arguments.fold is not None:
        overrides.append(f"designer.fold={arguments.fold}")
    scenario = load_scenario(arguments.scenario, overrides)
    run_design(
        scenario,
        arguments.out or DEFAULT_OUT / f"{scenario.name}-design",
        pareto=arguments.pareto,
        compare=arguments.compare,
        figures=not arguments.no_figures,
        pdf=arguments.pdf,
        quiet=arguments.quiet,
        workers=arguments.workers,
        asked_as=shlex.join([arguments.scenario, *(word for text in arguments.overrides for word in ("--set", text))]),
    )
    return 0
