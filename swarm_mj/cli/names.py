"""The commands `available`, `explain`, `packaged` and `json-schema`: what can be named; they load no heavy module."""

from __future__ import annotations

import argparse
import json
import textwrap
from itertools import groupby


def add(commands: argparse._SubParsersAction) -> None:
    """Add the commands to the parser."""
    available = commands.add_parser(
        "available",
        help="list packaged scenarios and campaigns, and installed plug-ins",
        description="List packaged scenarios and campaigns, control laws, gravity fields and behaviours, with what they are.",
    )
    available.set_defaults(command=_available)
    explain = commands.add_parser(
        "explain",
        help="explain keys of a scenario, or the arguments of a plug-in",
        description="Explain keys of a scenario, or the arguments of a plug-in: type, unit, default, what is allowed, meaning.",
    )
    explain.add_argument(
        "name",
        nargs="?",
        default="",
        metavar="NAME",
        help="a section (camera), a key (camera.half_angle_deg) or a plug-in (mrp_sliding_mode); none: every key",
    )
    explain.set_defaults(command=_explain)
    packaged = commands.add_parser(
        "packaged",
        help="print the file of a packaged scenario, a start for your own",
        description="Print the file of a packaged scenario, a start for your own.",
    )
    packaged.add_argument("name", metavar="NAME", help="of the scenario, see `swarm-mj available`")
    packaged.set_defaults(command=_packaged)
    schema = commands.add_parser(
        "json-schema",
        help="print the JSON schema of scenario files, for editors",
        description="Print the JSON schema of scenario files, for editors.",
    )
    schema.set_defaults(command=_json_schema)


def _available(_: argparse.Namespace) -> int:
    from swarm_mj.scenarios.catalogue import available

    named = available()
    width = max(len(one.name) for one in named)
    for kind, group in groupby(named, lambda one: one.kind):
        print(f"{kind}:")
        for one in group:
            print(f"  {one.name:{width}}  {one.description}")
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
        print(textwrap.indent(textwrap.fill(row.meaning, 100), "    "))
    return 0


def _packaged(arguments: argparse.Namespace) -> int:
    from swarm_mj.scenarios.loading import packaged_text

    print(packaged_text(arguments.name), end="")
    return 0


def _json_schema(_: argparse.Namespace) -> int:
    from swarm_mj.scenarios.json_schema import json_schema

    print(json.dumps(json_schema(), indent=2))
    return 0
