"""The command `view`."""

from __future__ import annotations

import argparse

from swarm_mj.cli.common import DEFAULT_SCENARIOS, add_overrides, overrides_of


def add(commands: argparse._SubParsersAction) -> None:
    """Add the command to the parser."""
    view = commands.add_parser(
        "view",
        help="watch a scenario fly in MuJoCo's viewer",
        description="Fly a scenario in MuJoCo's viewer; needs a display.",
    )
    view.add_argument(
        "scenario",
        nargs="?",
        default=DEFAULT_SCENARIOS[0],
        metavar="NAME_OR_FILE",
        help=f"packaged name or YAML file (default: {DEFAULT_SCENARIOS[0]})",
    )
    view.add_argument(
        "--speed", type=float, default=10.0, metavar="X", help="seconds of flight per second at the start (default 10)"
    )
    add_overrides(view)
    view.set_defaults(command=_view)


def _view(arguments: argparse.Namespace) -> int:
    from swarm_mj.api.simulation import view

    view(arguments.scenario, overrides_of(arguments), speed=arguments.speed)
    return 0
