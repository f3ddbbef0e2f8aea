"""The command line `swarm-mj`. Heavy modules are imported by the commands that need them, so that help is quick."""

from __future__ import annotations

import argparse
import signal
import sys
import threading
from collections.abc import Sequence

from swarm_mj import __version__
from swarm_mj.commands import bench, campaign, design, report, run, scenarios, shape, validate, video, view
from swarm_mj.errors import SwarmError


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit status.

    0: done; 1: a check failed; 2: bad input or another named error; 130: interrupted.
    """
    arguments = _parser().parse_args(argv)
    if threading.current_thread() is threading.main_thread():
        # Whoever ends the program politely gets the same tidy end as Ctrl-C.
        signal.signal(signal.SIGTERM, _interrupt)
    try:
        return int(arguments.command(arguments) or 0)
    except SwarmError as error:
        print(f"swarm-mj: error: {error}", file=sys.stderr)
        return 2
    except MemoryError:
        print("swarm-mj: error: not enough memory for this; ask for less", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("\nswarm-mj: interrupted; nothing half-written was left behind", file=sys.stderr)
        return 130
    except BrokenPipeError:
        return 0


def _interrupt(number: int, frame: object) -> None:
    raise KeyboardInterrupt


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="swarm-mj", description="Fly CubeSat swarms past small bodies and measure what their cameras see."
    )
    parser.add_argument("--version", action="version", version=f"swarm-mj {__version__}")
    commands = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)
    for module in (run, design, campaign, video, report, view, scenarios, shape, validate, bench):
        module.add(commands)
    return parser


if __name__ == "__main__":
    sys.exit(main())
