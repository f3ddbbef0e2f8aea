"""The command `view`."""

from __future__ import annotations

import argparse

from swarm_mj.cli.common import DEFAULT_SCENARIOS


def add(commands: argparse._SubParsersAction) -> None:
    """Add the command to the parser."""
    view = commands.add_parser(
        "view",
        help="watch a scenario fly in MuJoCo's viewer",
        description="Fly a scenario in MuJoCo's viewer, or in the browser where there is no display.",
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
    view.add_argument("--web", action="store_true", help="use the browser even where there is a display")
    view.add_argument(
        "--port",
        type=int,
        default=0,
        metavar="N",
        help="of the browser's page (default: the first free); implies --web",
    )
    view.add_argument(
        "--host",
        metavar="ADDRESS",
        help="that the browser's page is served on (default 127.0.0.1: this machine alone; 0.0.0.0: everybody, without "
        "password or encryption); implies --web",
    )
    view.add_argument(
        "--set", action="append", default=[], dest="overrides", metavar="KEY=VALUE", help="change one value"
    )
    view.set_defaults(command=_view)


def _view(arguments: argparse.Namespace) -> int:
    from swarm_mj.api.scenario import load
    from swarm_mj.api.simulation import view

    scenario = load(arguments.scenario, arguments.overrides)
    view(scenario, speed=arguments.speed, web=arguments.web, port=arguments.port, host=arguments.host)
    return 0
