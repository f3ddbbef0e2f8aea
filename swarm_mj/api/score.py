"""How good policies of an environment are, on episodes that never change."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from rich.progress import Progress

from swarm_mj.envs.missions.leaderboard import Score, Test
from swarm_mj.envs.policies.flyby_scores import FlybyScore, FlybyTest
from swarm_mj.envs.policies.frozen_episodes import FrozenEpisodes
from swarm_mj.errors import ScenarioError
from swarm_mj.io.progress import using_bars

#: How the test episodes of each environment are made.
TESTS: dict[str, Callable[[int | None], FrozenEpisodes]] = {"SwarmObserve-v1": Test.of, "SwarmObserve-v0": FlybyTest}


def score(
    policies: str | Path | Sequence[str | Path],
    *,
    env: str = "SwarmObserve-v1",
    episodes: int | None = None,
    progress: bool | Progress = False,
) -> list[Score] | list[FlybyScore]:
    """Fly policies of an environment through its frozen test episodes.

    Args:
        policies: One or more: scripted ones by name, or files: `.npz` of swarm_mj, and for SwarmObserve-v1 `.onnx`, or `.zip`
            of stable-baselines3.
        env: SwarmObserve-v1, or SwarmObserve-v0.
        episodes: Only the first so many, at least 2; None: all.
        progress: Whether to show bars, or bars to move.

    Returns:
        One for each policy, in their order.

    Raises:
        ScenarioError: There is no such environment or there are not so many episodes, or a policy cannot fly there; the message
            names why.
    """
    if env not in TESTS:
        raise ScenarioError(f"env = {env!r}: must be one of {', '.join(TESTS)}")
    given = [policies] if isinstance(policies, (str, Path)) else list(policies)
    with TESTS[env](episodes) as test, using_bars(progress) as bars:
        test.check(given)  # what is refused is so before another one is flown
        if test.preparations:
            _with_bar(bars, "test episodes", test.preparations, test.prepare)
        return [_with_bar(bars, Path(one).name, test.decisions, partial(test.score, one)) for one in given]


def _with_bar(bars: Progress | None, name: str, total: int, work: Callable[[Callable[[int], None] | None], Any]) -> Any:
    """What work comes to that calls a function with how far it is."""
    if bars is None:
        return work(None)
    task = bars.add_task(name, total=total)
    return work(lambda done: bars.update(task, completed=done))
