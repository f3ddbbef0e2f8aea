"""The command `scenarios`."""

from __future__ import annotations

import argparse
import json


def add(commands: argparse._SubParsersAction) -> None:
    """Add the command to the parser."""
    scenarios = commands.add_parser(
        "scenarios",
        help="list the packaged scenarios, print one, or explain the keys",
        description="List the packaged scenarios; with a NAME print that file, a start for your own.",
    )
    scenarios.add_argument("name", nargs="?", metavar="NAME", help="print this packaged scenario")
    scenarios.add_argument(
        "--keys",
        nargs="?",
        const="",
        metavar="KEY",
        help="explain the keys of a section (camera), one key (camera.half_angle_deg), or all",
    )
    scenarios.add_argument("--json-schema", action="store_true", help="print the JSON schema of scenario files")
    scenarios.set_defaults(command=_scenarios)


def _scenarios(arguments: argparse.Namespace) -> int:
    from swarm_mj.scenarios.loading import packaged_text

    if arguments.json_schema:
        from swarm_mj.scenarios.json_schema import json_schema

        print(json.dumps(json_schema(), indent=2))
    elif arguments.keys is not None:
        from swarm_mj.cli.listing import print_keys
        from swarm_mj.scenarios.catalogue import explained

        print_keys(*explained(arguments.keys))
    elif arguments.name:
        print(packaged_text(arguments.name), end="")
    else:
        from swarm_mj.cli.listing import print_names
        from swarm_mj.scenarios.catalogue import packaged_scenarios

        print_names(packaged_scenarios())
    return 0
