"""How long Python takes to import the package and to print the help, each in a new process."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator

from benchmarks.measure import Row, in_turn, row


def rows(quick: bool) -> Iterator[Row]:
    """All of it; the bare start of Python is told beside."""
    commands = {
        "start of Python": ["-c", ""],
        "import swarm_mj": ["-c", "import swarm_mj"],
        "swarm-mj --help": ["-m", "swarm_mj.cli.main", "--help"],
    }
    works = {name: (lambda c=command: _run(c)) for name, command in commands.items()}
    targets = {"import swarm_mj": "<= 0.5", "swarm-mj --help": "<= 0.7"}
    for name, seconds in in_turn(works, 5 if quick else 11).items():
        yield row("start", name, seconds, "s", targets.get(name, ""))


def _run(arguments: list[str]) -> None:
    subprocess.run([sys.executable, *arguments], check=True, stdout=subprocess.DEVNULL)
