"""How good policies of an environment are, on episodes that never change."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from rich.progress import Progress

from swarm_mj.envs.flyby_scores import FlybyScore, FlybyTest
from swarm_mj.envs.frozen_episodes import FrozenEpisodes
from swarm_mj.envs.missions.leaderboard import Score, Test
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
        return [_one(test, policy, bars) for policy in given]


def _one(test: FrozenEpisodes, policy: str | Path, bars: Progress | None) -> Any:
    if bars is None:
        return test.score(policy)
    task = bars.add_task(Path(policy).name, total=test.decisions)
    return test.score(policy, lambda taken: bars.update(task, completed=taken))
