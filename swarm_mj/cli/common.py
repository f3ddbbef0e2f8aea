"""What several commands share."""

from __future__ import annotations

import argparse
from pathlib import Path

DEFAULT_OUT = Path("results")
DEFAULT_SCENARIOS = ("eros-config1", "eros-config2")


def add_common(command: argparse.ArgumentParser, *, seed_of: str) -> None:
    """Arguments of every command that works on a scenario and writes a folder."""
    command.add_argument("--seed", type=int, metavar="N", help=f"seed of {seed_of}")
    command.add_argument(
        "--set",
        action="append",
        default=[],
        dest="overrides",
        metavar="KEY=VALUE",
        help="change one value, e.g. camera.half_angle_deg=3; may be repeated",
    )
    command.add_argument("--no-figures", action="store_true", help="write no pictures")
    command.add_argument("--pdf", action="store_true", help="write every figure as PDF too")
    command.add_argument("--quiet", action="store_true", help="no progress bar")


def overrides_of(arguments: argparse.Namespace) -> list[str]:
    """What `--set` and `--seed` ask for."""
    seed = [] if arguments.seed is None else [f"seed={arguments.seed}"]
    return [*arguments.overrides, *seed]
