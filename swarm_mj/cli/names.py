"""The commands `available`, `explain`, `packaged` and `json-schema`: what can be named; they load no heavy module."""

from __future__ import annotations

import argparse
import json
import sys
import textwrap
from itertools import groupby
from shutil import get_terminal_size

from swarm_mj.cli.common import add_command


def add(commands: argparse._SubParsersAction) -> None:
    """Add the commands to the parser."""
    words = "list packaged scenarios and campaigns, and installed control laws, gravity fields and behaviours"
    add_command(commands, "available", _available, words)
    words = "explain keys of a scenario, or the arguments of a plug-in"
    facts = f"{words[0].upper()}{words[1:]}: type, unit, default, what is allowed, meaning."
    explain = add_command(commands, "explain", _explain, words, facts)
    explain.add_argument(
        "name",
        nargs="?",
        default="",
        metavar="NAME",
        help="a section (camera), a key (camera.half_angle_deg) or a plug-in (mrp_sliding_mode); none: every key",
    )
    words = "print the file of a packaged scenario, a start for your own"
    packaged = add_command(commands, "packaged", _packaged, words)
    packaged.add_argument("name", metavar="NAME", help="of the scenario, see `swarm-mj available`")
    add_command(commands, "json-schema", _json_schema, "print the JSON schema of scenario files, for editors")


def _available(_: argparse.Namespace) -> int:
    from swarm_mj.scenarios.catalogue import available

    named = available()
    width = max(len(one.name) for one in named)
    for kind, group in groupby(named, lambda one: one.kind):
        print(f"{kind}:")
        for one in group:
            print(_wrapped(f"  {one.name:{width}}  {one.description}", width + 4))
    return 0


def _explain(arguments: argparse.Namespace) -> int:
    from swarm_mj.scenarios.catalogue import explained

    found = explained(arguments.name)
    if not found:
        print(f"{arguments.name} takes no arguments")
    for row in found:
        default = row.default if row.default == "required" else f"default {row.default}"
        facts = (row.type, row.unit and f"[{row.unit}]", default, row.allowed.replace("`", ""))
        print(f"{row.name}: {', '.join(filter(None, facts))}")
        print(_wrapped(f"    {row.meaning}", 4))
    return 0


def _wrapped(line: str, indent: int) -> str:
    """A line as a terminal has room for it; whole where nobody looks at one."""
    if not sys.stdout.isatty():
        return line
    return textwrap.fill(line, get_terminal_size().columns, subsequent_indent=" " * indent, break_on_hyphens=False)


def _packaged(arguments: argparse.Namespace) -> int:
    from swarm_mj.scenarios.loading import packaged

    print(packaged(arguments.name), end="")
    return 0


def _json_schema(_: argparse.Namespace) -> int:
    from swarm_mj.scenarios.catalogue import json_schema

    print(json.dumps(json_schema(), indent=2))
    return 0
