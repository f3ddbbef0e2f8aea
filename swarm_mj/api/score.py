"""How good policies of an environment are, on episodes that never change."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from rich.progress import Progress

from swarm_mj.envs.missions.leaderboard import TEST_SEEDS, Score, Test
from swarm_mj.errors import ScenarioError
from swarm_mj.io.progress import using_bars


def score(
    policies: str | Path | Sequence[str | Path], *, episodes: int | None = None, progress: bool | Progress = False
) -> list[Score]:
    """Fly policies of SwarmObserve-v1 through the frozen test episodes.

    Args:
        policies: One or more: scripted ones by name, or files: `.npz` of swarm_mj, `.onnx`, or `.zip` of stable-baselines3.
        episodes: Only the first so many, at least 2; None: all.
        progress: Whether to show bars, or bars to move.

    Returns:
        One for each policy, in their order.

    Raises:
        ScenarioError: There are not so many episodes, or a policy cannot fly there; the message names why.
    """
    count = len(TEST_SEEDS) if episodes is None else episodes
    if not 2 <= count <= len(TEST_SEEDS):
        raise ScenarioError(f"episodes = {episodes}: must be from 2 to {len(TEST_SEEDS)}")
    given = [policies] if isinstance(policies, (str, Path)) else list(policies)
    with Test(TEST_SEEDS[:count]) as test, using_bars(progress) as bars:
        test.check(given)  # what is refused is so before another one is flown
        return [_one(test, policy, bars) for policy in given]


def _one(test: Test, policy: str | Path, bars: Progress | None) -> Score:
    if bars is None:
        return test.score(policy)
    task = bars.add_task(Path(policy).name, total=test.decisions)
    return test.score(policy, lambda taken: bars.update(task, completed=taken))
