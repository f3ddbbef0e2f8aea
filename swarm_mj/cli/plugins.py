"""The command `plugins`."""

from __future__ import annotations

import argparse
from itertools import groupby


def add(commands: argparse._SubParsersAction) -> None:
    """Add the command to the parser."""
    plugins = commands.add_parser(
        "plugins",
        help="list control laws, gravity fields and behaviours, or explain one",
        description="List the installed plug-ins: control laws, gravity fields, behaviours; with a NAME explain its arguments.",
    )
    plugins.add_argument("name", nargs="?", metavar="NAME", help="explain this plug-in")
    plugins.set_defaults(command=_plugins)


def _plugins(arguments: argparse.Namespace) -> int:
    from swarm_mj.cli.listing import print_keys, print_names
    from swarm_mj.errors import PluginError
    from swarm_mj.scenarios.catalogue import explained, installed_plugins

    there = installed_plugins()
    if arguments.name is None:
        for kind, group in groupby(there, lambda one: one.kind):
            print(f"{kind}:")
            print_names(list(group), indent="  ")
        return 0
    found = [one for one in there if one.name == arguments.name]
    if not found:
        names = ", ".join(one.name for one in there)
        raise PluginError(f"{arguments.name!r}: no such plug-in is installed; there are {names}")
    print(f"{arguments.name}, a {found[0].kind}: {found[0].description}")
    print_keys(*explained(arguments.name))
    return 0
