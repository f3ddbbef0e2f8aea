"""The command `validate`."""

from __future__ import annotations

import argparse
from pathlib import Path

from swarm_mj.cli.common import add_command, add_quiet


def add(commands: argparse._SubParsersAction) -> None:
    """Add the command to the parser."""
    validate = add_command(
        commands,
        "validate",
        _validate,
        "run the physics checks on the installed program",
        "Compare the installed program with independent references; exit status 1 if a check fails. Those that are "
        "other programs come with the extra dev; without it their checks are not run.",
    )
    validate.add_argument(
        "--only", action="append", default=[], metavar="NAME", help="run this check or group; may be repeated"
    )
    validate.add_argument("--json", type=Path, metavar="FILE", help="write the results as JSON")
    validate.add_argument("--markdown", type=Path, metavar="FILE", help="write the results as a Markdown page")
    add_quiet(validate)


def _validate(arguments: argparse.Namespace) -> int:
    from swarm_mj.verification.runner import run_validation

    return run_validation(arguments.only, arguments.json, arguments.markdown, arguments.quiet)
