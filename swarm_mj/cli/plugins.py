"""The command `plugins`."""

from __future__ import annotations

import argparse


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
    import swarm_mj as sm
    from swarm_mj.cli.tables import print_keys, print_names
    from swarm_mj.errors import PluginError

    there = sm.available().query("kind not in ('scenario', 'campaign')")
    if arguments.name is None:
        for kind, group in there.groupby("kind", sort=False):
            print(f"{kind}:")
            print_names(group, indent="  ")
        return 0
    if arguments.name not in there.index:
        raise PluginError(f"{arguments.name!r}: no such plug-in is installed; there are {', '.join(there.index)}")
    kind, description = there.loc[arguments.name, ["kind", "description"]]
    print(f"{arguments.name}, a {kind}: {description}")
    print_keys(sm.explain(arguments.name))
    return 0
