"""The command `scenarios`."""

from __future__ import annotations

import argparse
import json


def add(commands: argparse._SubParsersAction) -> None:
    """Add the command to the parser."""
    scenarios = commands.add_parser(
        "scenarios",
        help="list the packaged scenarios, print one, or print the schema",
        description="List the packaged scenarios; with a NAME print that file, a start for your own.",
    )
    scenarios.add_argument("name", nargs="?", metavar="NAME", help="print this packaged scenario")
    scenarios.add_argument("--json-schema", action="store_true", help="print the JSON schema of scenario files")
    scenarios.set_defaults(command=_scenarios)


def _scenarios(arguments: argparse.Namespace) -> int:
    from swarm_mj.scenarios.loading import load_scenario, packaged_names, packaged_text
    from swarm_mj.scenarios.schema import Scenario

    if arguments.json_schema:
        print(json.dumps(Scenario.model_json_schema(), indent=2))
    elif arguments.name:
        print(packaged_text(arguments.name), end="")
    else:
        width = max(map(len, packaged_names()))
        for name in packaged_names():
            print(f"{name:{width}}  {' '.join(load_scenario(name).description.split())}")
    return 0
