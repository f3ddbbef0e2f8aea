"""Checks: of the installed program's physics against independent references, and of policies on episodes that never change."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd
from rich.progress import Progress

from swarm_mj.io.progress import Shown, using_bars

if TYPE_CHECKING:
    from swarm_mj.envs.policies.leaderboard import Score


def validate(only: Sequence[str] = (), *, progress: Shown = None) -> pd.DataFrame:
    """Run the physics checks on the installed program.

    Args:
        only: Names of checks or groups; empty: all.
        progress: Whether to show a progress bar, or the bars to use; None: on a terminal and in notebooks, after 2 s.

    Returns:
        One row a check: what was measured, against which reference, the tolerance, and whether it passed (None: not run).

    Raises:
        SwarmError: A name is unknown.
    """
    from swarm_mj.verification.runner import choose, run_experiments

    with using_bars(progress) as bars:
        checks = run_experiments(choose(only), bars)
    return pd.DataFrame([asdict(check) for check in checks]).set_index("name")


def score(
    policies: str | Path | Sequence[str | Path],
    *,
    episodes: int | None = None,
    key: int | None = None,
    progress: Shown = None,
) -> list[Score]:
    """Fly policies of SwarmObserve-v0 through the frozen test episodes of its leaderboard.

    Args:
        policies: One or more: scripted ones by name, or files: `.npz` of swarm_mj, `.onnx`, or `.zip` of stable-baselines3.
        episodes: Only the first so many, at least 2; None: all.
        key: Of hidden episodes in the place of those of the leaderboard, a whole number; whoever keeps it can test what was
            not chosen by them.
        progress: Whether to show bars, or bars to move.

    Returns:
        One for each policy, in their order.

    Raises:
        ScenarioError: There are not so many episodes, or a policy cannot fly there; the message names why.
    """
    from swarm_mj.envs.policies.leaderboard import FrozenEpisodes

    given = [policies] if isinstance(policies, (str, Path)) else list(policies)
    with FrozenEpisodes.of(episodes, key) as test, using_bars(progress) as asked:
        bars = asked or Progress(disable=True)
        test.check(given)  # what is refused is so before another one is flown
        if test.preparations:
            _with_bar(bars, "test episodes", test.preparations, test.prepare)
        return [_with_bar(bars, Path(one).name, test.decisions, partial(test.score, one)) for one in given]


def _with_bar(bars: Progress, name: str, total: int, work: Callable[[Callable[[int], None]], Any]) -> Any:
    """What work comes to that calls a function with how far it is."""
    task = bars.add_task(name, total=total)
    return work(lambda done: bars.update(task, completed=done))
