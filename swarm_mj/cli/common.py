"""What several commands share."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from io import StringIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rich.console import Console
    from rich.progress import Progress
    from rich.table import Table

#: No table is wider than this.
MOST_COLUMNS = 10_000
DEFAULT_OUT = Path("results")
DEFAULT_SCENARIOS = ("eros-config1", "eros-config2")


def add_command(
    commands: argparse._SubParsersAction,
    name: str,
    run: Callable[[argparse.Namespace], int],
    words: str,
    description: str | None = None,
) -> argparse.ArgumentParser:
    """A command whose `run` returns the exit status; the list of commands says its words, its own help the description."""
    command = commands.add_parser(name, help=words, description=description or f"{words[0].upper()}{words[1:]}.")
    assert isinstance(command, argparse.ArgumentParser)
    command.set_defaults(command=run)
    return command


def add_scenario(command: argparse.ArgumentParser) -> None:
    """The argument of a command that works on one scenario, by default the first of the paper."""
    default = DEFAULT_SCENARIOS[0]
    words = f"packaged name or YAML file (default: {default})"
    command.add_argument("scenario", nargs="?", default=default, metavar="NAME_OR_FILE", help=words)


def add_overrides(command: argparse.ArgumentParser, example: str = "camera.half_angle_deg=3") -> None:
    """The argument `--set` of every command that works on a scenario."""
    command.add_argument(
        "--set",
        action="append",
        default=[],
        dest="overrides",
        metavar="KEY=VALUE",
        help=f"change one value, e.g. {example}; may be repeated",
    )


def add_quiet(command: argparse.ArgumentParser) -> None:
    """The argument of every command that takes a while."""
    command.add_argument("--quiet", action="store_true", help="no progress bar")


def add_figures(command: argparse.ArgumentParser) -> None:
    """The argument of every command that draws."""
    command.add_argument("--no-figures", action="store_true", help="write no pictures")


def add_common(command: argparse.ArgumentParser, *, seed_of: str) -> None:
    """Arguments of every command that works on a scenario and writes a folder."""
    command.add_argument("--seed", type=int, metavar="N", help=f"seed of {seed_of}")
    add_overrides(command)
    add_figures(command)
    command.add_argument("--pdf", action="store_true", help="write every figure as PDF too")
    add_quiet(command)


def overrides_of(arguments: argparse.Namespace) -> dict[str, Any]:
    """What `--set` and `--seed` ask for, by dotted key."""
    from swarm_mj.scenarios.loading import parse_overrides

    seed = getattr(arguments, "seed", None)
    return parse_overrides(arguments.overrides) | ({} if seed is None else {"seed": seed})


def bars_for(arguments: argparse.Namespace) -> Progress:
    """Progress bars on the screen, none with `--quiet`."""
    from rich.console import Console

    from swarm_mj.io.progress import progress_bars

    return progress_bars(Console(), arguments.quiet)


def narrowest(console: Console, table: Table) -> tuple[int, int]:
    """Widths of a table whose cells are broken between all their words, and between none."""
    from rich.measure import Measurement

    return Measurement.get(console, console.options.update(max_width=MOST_COLUMNS), table)


def show_table(console: Console, table: Table) -> None:
    """Print a table whole: no cell is cut off, and where nobody looks at a terminal none is broken."""
    from rich.console import Console
    from rich.text import Text

    least, natural = narrowest(console, table)
    width = max(console.width, least) if console.is_terminal else natural
    drawn = StringIO()
    Console(file=drawn, width=width, force_terminal=console.is_terminal).print(table)
    console.print(Text.from_ansi(drawn.getvalue()), soft_wrap=True)


def tell(console: Console, *lines: str) -> None:
    """Print lines as they are, however long, without marks and colours."""
    for line in lines:
        console.print(line, soft_wrap=True, highlight=False, markup=False)
