"""What the training programs share: their command line, and the learning curve on episodes that training never flies."""

from __future__ import annotations

import argparse
import csv
import json
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from swarm_mj.envs.policies.baselines import Policy
from swarm_mj.envs.policies.leaderboard import VALIDATION_SEEDS, FrozenEpisodes

#: What all of them train in; the rest are defaults.
TRAINING: dict[str, Any] = {"split": "train", "missions": "all"}


@dataclass(frozen=True)
class Options:
    """What to train and for how long.

    Attributes:
        out: Folder of `curve.csv`, of the policy, and of `done.json` once training is over.
        steps: Decisions of all episodes together.
        seed: Of network, choices and episodes.
        every: Steps between two points of the curve.
    """

    out: Path
    steps: int
    seed: int
    every: int


def options(description: str | None, name: str) -> Options:
    """Those of the command line."""
    parser = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    add, shown = parser.add_argument, "(default: %(default)s)"
    add("--out", type=Path, default=Path("runs") / name, metavar="DIR", help=f"folder of curve and policy {shown}")
    add("--steps", type=int, default=300_000, help=f"decisions of all episodes together {shown}")
    add("--seed", type=int, default=1, help=f"of network, choices and episodes {shown}")
    add("--every", type=int, default=25_000, help=f"steps between points of the curve {shown}")
    given = Options(**vars(parser.parse_args()))
    print(
        "Compiling and working out the missions: about a minute the first time; both are kept in the cache.", flush=True
    )
    return given


class Curve:
    """The score of the likeliest choices on validation episodes, every so many steps, written as it comes.

    Args:
        given: Of the run.
    """

    def __init__(self, given: Options) -> None:
        self._given, self._test, self._start = given, FrozenEpisodes(VALIDATION_SEEDS), time.monotonic()
        self._next, self._testing = 0, 0.0
        given.out.mkdir(parents=True, exist_ok=True)
        self._row("w", "steps", "seconds", "score", "seen", "delivered", "sampled_score")

    def update(self, steps: int, policy: Policy, sampled: float = float("nan")) -> None:
        """Add a point where one is due; `sampled` is the mean score of training's own episodes."""
        if steps < self._next:
            return
        self._next = (steps // self._given.every + 1) * self._given.every
        begun = time.monotonic()
        flown = self._test.fly(policy)
        self._testing += time.monotonic() - begun
        means = [round(float(values.mean()), 4) for values in flown]
        self._row("a", steps, self.seconds, *means, round(sampled, 4))
        print(f"{steps:9,d} steps {self.seconds:7.0f} s  score {means[0]:.3f}, sampled {sampled:.3f}", flush=True)

    @property
    def seconds(self) -> float:
        """Of training, without the tests."""
        return round(time.monotonic() - self._start - self._testing, 1)

    def end(self, steps: int, policy: Policy) -> None:
        """The last point, and that training is over."""
        self._next = 0
        self.update(steps, policy)
        told = {"steps": steps, "seed": self._given.seed, "seconds": self.seconds}
        (self._given.out / "done.json").write_text(json.dumps(told) + "\n")
        self._test.__exit__()

    def _row(self, mode: str, *cells: Any) -> None:
        with (self._given.out / "curve.csv").open(mode, newline="") as file:
            csv.writer(file).writerow(cells)


def mean_of(returns: list[float], count: int = 200) -> float:
    """Of the latest episodes."""
    return float(np.mean(returns[-count:])) if returns else float("nan")
