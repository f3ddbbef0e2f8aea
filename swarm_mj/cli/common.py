"""What several commands share."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

DEFAULT_OUT = Path("results")
DEFAULT_SCENARIOS = ("eros-config1", "eros-config2")


def add_overrides(command: argparse.ArgumentParser, example: str = "camera.half_angle_deg=3") -> None:
    """The argument `--set` of every command that works on a scenario."""
    command.add_argument(
        "--set",
        action="append",
        default=[],
        dest="overrides",
        metavar="KEY=VALUE",
        help=f"change one value, e.g. {example}; may be repeated",
    )


def add_common(command: argparse.ArgumentParser, *, seed_of: str) -> None:
    """Arguments of every command that works on a scenario and writes a folder."""
    command.add_argument("--seed", type=int, metavar="N", help=f"seed of {seed_of}")
    add_overrides(command)
    command.add_argument("--no-figures", action="store_true", help="write no pictures")
    command.add_argument("--pdf", action="store_true", help="write every figure as PDF too")
    command.add_argument("--quiet", action="store_true", help="no progress bar")


def overrides_of(arguments: argparse.Namespace) -> dict[str, Any]:
    """What `--set` and `--seed` ask for, by dotted key."""
    from swarm_mj.scenarios.loading import parse_overrides

    seed = getattr(arguments, "seed", None)
    return parse_overrides(arguments.overrides) | ({} if seed is None else {"seed": seed})
