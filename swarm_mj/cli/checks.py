"""The commands `score` and `validate`."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from swarm_mj.cli.common import add_command, add_quiet, bars_for, show_table, tell

if TYPE_CHECKING:
    from rich.table import Table

    from swarm_mj.envs.policies.leaderboard import Score


def add(commands: argparse._SubParsersAction) -> None:
    """Add the commands to the parser."""
    score = add_command(
        commands,
        "score",
        _score,
        "fly policies of SwarmObserve-v0 through its test episodes",
        "Fly policies through the frozen episodes of the leaderboard, which no training sees; the score is a share "
        "of what was possible (docs/results/leaderboard.md).",
    )
    score.add_argument(
        "policy",
        nargs="+",
        metavar="POLICY",
        help="random, open_loop, sweep, greedy, greedy_ahead, planner, trained, or a file: .npz, .onnx, .zip of "
        "stable-baselines3 (which executes what is pickled in it)",
    )
    score.add_argument("--episodes", type=int, metavar="N", help="only the first so many, at least 2 (default: all)")
    score.add_argument("--key", type=int, metavar="K", help="fly hidden episodes that follow from this number instead")
    score.add_argument(
        "--out", type=Path, metavar="FILE", help="write all numbers there as JSON, a list of the policies"
    )
    add_quiet(score)
    validate = add_command(
        commands,
        "validate",
        _validate,
        "run the physics checks on the installed program",
        "Compare the installed program with independent references; exit status 1 if a check fails. Those that are "
        "other programs come with the extra dev; without it their checks are not run.",
    )
    validate.add_argument(
        "--only", action="append", default=[], metavar="NAME", help="run this check or group; may be repeated"
    )
    validate.add_argument("--json", type=Path, metavar="FILE", help="write the results as JSON")
    validate.add_argument("--markdown", type=Path, metavar="FILE", help="write the results as a Markdown page")
    add_quiet(validate)


def _score(arguments: argparse.Namespace) -> int:
    import json
    from contextlib import nullcontext

    from swarm_mj.api.checks import score
    from swarm_mj.io.atomic import atomic_file

    out = arguments.out
    # What cannot be written is refused before anybody flies for it.
    with nullcontext() if out is None else atomic_file(out) as partial:
        with bars_for(arguments) as bars:
            scores = score(arguments.policy, episodes=arguments.episodes, key=arguments.key, progress=bars)
        if partial is not None:
            partial.write_text(json.dumps([one.record() for one in scores], indent=1) + "\n", encoding="utf-8")
    show_table(bars.console, _table(scores))
    if out is not None:
        tell(bars.console, f"numbers in {out}")
    return 0


def _table(scores: Sequence[Score]) -> Table:
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    first = scores[0]
    table = Table(title=f"{first.environment}, {len(first.seeds)} test episodes", box=SIMPLE_HEAD, pad_edge=False)
    table.add_column("policy", overflow="fold")
    for name in first.headings:
        table.add_column(name, justify="right", no_wrap=True)
    for name, one in zip(_told_apart([str(one.policy) for one in scores]), scores, strict=True):
        table.add_row(name, *one.cells)
    return table


def _told_apart(policies: Sequence[str]) -> list[str]:
    """Names and ends of paths, as long as it takes to tell them apart: training programs call every file `policy.npz`."""
    paths, short = [Path(one).parts for one in policies], list(policies)
    for length in range(max(map(len, paths)), 0, -1):
        shorter = [str(Path(*parts[-length:])) for parts in paths]
        if len(set(shorter)) < len(set(policies)):
            break
        short = shorter
    return short


def _validate(arguments: argparse.Namespace) -> int:
    from swarm_mj.verification.runner import run_validation

    return run_validation(arguments.only, arguments.json, arguments.markdown, arguments.quiet)
