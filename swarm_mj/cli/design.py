"""The command `design`."""

from __future__ import annotations

import argparse
import shlex
from pathlib import Path

from swarm_mj.cli.common import (
    DEFAULT_OUT,
    add_command,
    add_common,
    add_scenario,
    bars_for,
    overrides_of,
    show_table,
    tell,
)


def add(commands: argparse._SubParsersAction) -> None:
    """Add the command to the parser."""
    design = add_command(
        commands,
        "design",
        _design,
        "find the fewest spacecraft that see the whole target",
        "Design a swarm: the fewest observers that see the whole target, by genetic algorithm and with proof.",
    )
    add_scenario(design)
    design.add_argument("--out", type=Path, metavar="DIR", help=f"result folder (default: {DEFAULT_OUT}/NAME-design)")
    design.add_argument("--fold", type=int, metavar="K", help="every face must be seen by at least K spacecraft")
    design.add_argument(
        "--deliver-within",
        type=float,
        metavar="HOURS",
        help="the whole map must be on Earth HOURS past the epoch, with proof",
    )
    design.add_argument("--pareto", action="store_true", help="trade spacecraft against delta-v and area too (NSGA-II)")
    design.add_argument(
        "--compare", action="store_true", help="print how the minimum grows with demands beyond the paper"
    )
    design.add_argument("--workers", type=int, metavar="N", help="processes for the pictures (default: one per core)")
    add_common(design, seed_of="the genetic algorithm")


def _design(arguments: argparse.Namespace) -> int:
    from swarm_mj.api.design import design
    from swarm_mj.api.scenario import load
    from swarm_mj.cli.tables import design_table, growth_table

    overrides = overrides_of(arguments)
    if arguments.fold is not None:
        overrides["designer.fold"] = arguments.fold
    if arguments.deliver_within is not None:
        overrides["designer.deliver_within_h"] = arguments.deliver_within
    scenario = load(arguments.scenario, overrides)
    folder = arguments.out or DEFAULT_OUT / f"{scenario.name}-design"
    with bars_for(arguments) as bars:
        found = design(
            scenario,
            out=folder,
            pareto=arguments.pareto,
            compare=arguments.compare,
            workers=arguments.workers,
            figures=not arguments.no_figures,
            pdf=arguments.pdf,
            progress=bars,
        )
    show_table(bars.console, design_table(found.record))
    if arguments.compare:
        show_table(bars.console, growth_table(found.compared))
    tell(bars.console, f"{scenario.name}: files in {folder}", _hint(arguments, folder))
    return 0


def _hint(arguments: argparse.Namespace, folder: Path) -> str:
    """How to fly the design."""
    asked = shlex.join([arguments.scenario, *(word for text in arguments.overrides for word in ("--set", text))])
    return f"To fly it: swarm-mj fly {asked} --design {shlex.quote(str(folder / 'design.json'))}"
