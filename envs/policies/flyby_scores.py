"""How good a policy of SwarmObserve-v0 is: frozen flight seeds that neither training nor the choice of a policy looked at."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from swarm_mj import __version__
from swarm_mj.errors import ScenarioError
from swarm_mj.io.resources import asset_path
from swarm_mj.typing import Array32, Ints

from ..arguments import checked_episodes
from ..observe.task import Task, make_task
from .evaluation import Interval, Progress, Returns, VectorPolicy, fly_seeds, interval
from .frozen_episodes import FrozenEpisodes, policy_file
from .policy import ENVIRONMENT, load_policy
from .policy_behavior import PACKAGED, SCRIPTED
from .provenance import refuse_other_environment

#: Seeds of the episodes; they stay as they are for good.
TEST_SEEDS = tuple(range(5_000, 5_100))
TRAINED = "trained"


@dataclass(frozen=True)
class FlybyScore:
    """Of a policy on some episodes.

    Attributes:
        policy: Its name or file.
        seeds: Of the episodes.
        flown: What the policy came to.
    """

    headings: ClassVar[tuple[str, ...]] = ("return", "seen [%]", "delivered [Mbit]")
    environment: ClassVar[str] = ENVIRONMENT
    policy: str
    seeds: tuple[int, ...]
    flown: Returns

    @property
    def total(self) -> Interval:
        """Mean return and the half-width of its 95 % interval."""
        return interval(self.flown.total)

    @property
    def cells(self) -> list[str]:
        """Under `headings`."""
        mean, half = self.total
        delivered = 1e-6 * self.flown.delivered_bit.mean()
        return [f"{mean:.3f} +- {half:.3f}", f"{self.flown.coverage_percent.mean():.1f}", f"{delivered:.2f}"]

    def record(self) -> dict[str, Any]:
        """As JSON has it; returns by episode, rounded."""
        return {
            "environment": ENVIRONMENT,
            "package": __version__,
            "policy": self.policy,
            "episodes": len(self.seeds),
            "score": self.total.mean,
            "score_half_width": self.total.half_width,
            "coverage_percent": float(self.flown.coverage_percent.mean()),
            "delivered_bit": float(self.flown.delivered_bit.mean()),
            "seeds": list(self.seeds),
            "scores": np.round(self.flown.total, 4).tolist(),
        }


class FlybyTest(FrozenEpisodes):
    """The test episodes, ready to be flown by one policy after another; a context manager.

    Args:
        episodes: Only the first so many, at least 2; None: all.
    """

    def __init__(self, episodes: int | None = None) -> None:
        self.seeds = TEST_SEEDS[: checked_episodes(episodes, len(TEST_SEEDS))]
        self._task = make_task()

    def close(self) -> None:
        """Release the observer."""
        self._task.close()

    @property
    def decisions(self) -> int:
        """How far `progress` of `score` counts: episodes."""
        return len(self.seeds)

    def policy(self, name_or_file: str | Path) -> VectorPolicy:
        """A scripted policy by name, `trained` for the packaged one, or that of a file, see `score`."""
        task, name = self._task, str(name_or_file)
        if name in SCRIPTED:
            return _each(name, task)
        path = policy_file(str(asset_path(PACKAGED)) if name == TRAINED else name_or_file, (TRAINED, *SCRIPTED))
        if path.suffix != ".npz":
            raise ScenarioError(f"policy {path}: must be an .npz of examples/train_sb3.py to be flown in {ENVIRONMENT}")
        refuse_other_environment(path, ENVIRONMENT)
        return load_policy(path).for_task(task).act

    def score(self, name_or_file: str | Path, progress: Progress | None = None) -> FlybyScore:
        """See `FrozenEpisodes`."""
        return FlybyScore(str(name_or_file), self.seeds, fly_seeds(self.policy(name_or_file), self.seeds, progress))


def _each(name: str, task: Task) -> VectorPolicy:
    def act(rows: Array32) -> Ints:
        return np.array([SCRIPTED[name](task, row) for row in rows])

    return act
