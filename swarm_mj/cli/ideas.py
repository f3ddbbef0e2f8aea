"""The command `ideas`."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from swarm_mj.cli.common import add_command, add_quiet, bars_for, show_table, tell
from swarm_mj.errors import SwarmError

if TYPE_CHECKING:
    import pandas as pd
    from rich.table import Table

#: What is done with kept studies, and how many of them it takes.
VERBS = {"list": 0, "show": 1, "compare": 2, "rerun": 1, "keys": 0}
#: Differences that are shown at once.
MOST_ROWS = 40


def add(commands: argparse._SubParsersAction) -> None:
    """Add the command to the parser."""
    ideas = add_command(
        commands,
        "ideas",
        _ideas,
        "size spacecraft and design a swarm from a requirement; look up kept studies",
        "Carry a requirement through spacecraft designer, swarm designer, flight and campaign, or prove what forbids it; every "
        "study is kept. Exit status 1 where the requirement is not met, or a rerun differs.",
    )
    ideas.add_argument(
        "what",
        metavar="WHAT",
        help="YAML file of a requirement; or keys of one, list, show STUDY, compare STUDY STUDY, rerun STUDY",
    )
    ideas.add_argument(
        "study", nargs="*", default=[], metavar="STUDY", help="id of a kept study, the beginning of it, or its name"
    )
    ideas.add_argument("--base", type=Path, metavar="FILE", help="the knowledge base (default: results/ideas.sqlite)")
    ideas.add_argument(
        "--out",
        type=Path,
        metavar="DIR",
        help="write report.html, study.json, scenario.yaml that flies the swarm, and its flight, design and campaign",
    )
    ideas.add_argument("--workers", type=int, metavar="N", help="processes (default: one per core)")
    add_quiet(ideas)


def _ideas(arguments: argparse.Namespace) -> int:
    from swarm_mj.api import ideas

    verb, names = arguments.what, arguments.study
    base = ideas.BASE if arguments.base is None else arguments.base
    if (count := VERBS.get(verb, 0)) != len(names):
        raise SwarmError(f"ideas {verb}: takes {count} studies, not {len(names)}")
    if arguments.out is not None and verb in ("keys", "list", "compare", "rerun"):
        raise SwarmError(f"ideas {verb}: writes nothing; leave --out out")
    with bars_for(arguments) as bars:
        if verb == "keys":
            return _show(bars.console, "Keys of a requirement", ideas.requirement_keys(), most=None)
        if verb == "list":
            return _show(bars.console, f"Studies in {base}", ideas.studies(base))
        if verb == "compare":
            found = ideas.compare_studies(names[0], names[1], base)
            return _show(bars.console, f"{names[0]} and {names[1]}", found)
        if verb == "rerun":
            found = ideas.rerun_study(names[0], base, workers=arguments.workers, progress=bars)
            if len(found):
                _show(bars.console, f"{names[0]}: what changed", found)
            else:
                tell(bars.console, f"{names[0]}: the same to the last bit")
            return int(len(found) > 0)
        if verb == "show":
            one = ideas.open_study(names[0], base)
        else:
            one = ideas.study(verb, base=base, out=arguments.out, workers=arguments.workers, progress=bars)
        if one.record["spacecraft"] is not None:
            parts = one.parts[["name", "number", "mass_kg", "volume_u", "power_w", "source"]]
            _show(bars.console, f"{one.kept.name}: {one.record['spacecraft']['kind']}, without margins", parts)
            _show(bars.console, "Requirement by requirement", one.checks.drop(columns="shown"))
        lines = [*one.sentences, f"{one.kept.name}: kept as {one.kept.id} in {base}"]
        if arguments.out is not None:
            place = one.save(arguments.out) if verb == "show" else arguments.out
            lines.append(f"{one.kept.name}: files in {place}; begin with {place / 'report.html'}")
        tell(bars.console, *lines)
        return int(not one.closed)


def _show(console: Any, title: str, rows: pd.DataFrame, most: int | None = MOST_ROWS) -> int:
    """Print a table of rows, the first of many; None: all."""
    show_table(console, _table(title, rows if most is None else rows.head(most)))
    if most is not None and len(rows) > most:
        tell(console, f"and {len(rows) - MOST_ROWS} more")
    return 0


def _table(title: str, rows: pd.DataFrame) -> Table:
    from rich.markup import escape
    from rich.table import Table

    table = Table(title=escape(title), title_justify="left")
    for name in rows.columns:
        table.add_column(escape(str(name)), overflow="fold")
    for _, row in rows.astype(object).iterrows():
        table.add_row(*(escape(_shown(value)) for value in row))
    return table


def _shown(value: Any) -> str:
    if value is None or value != value:
        return "-"
    return f"{value:.5g}" if isinstance(value, float) else str(value)
