"""Search the best that single test episodes allow, by hill climbing that flies each again and again.

    python -m scripts.pages.hindsight --rounds 150     # goes on where an earlier call was interrupted

Its scores, in scripts/pages/hindsight.json, know all that will fail. They are what some choices come to, not the most that any
could.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from swarm_mj.envs.observe.episodes import Episodes
from swarm_mj.envs.observe.layout import Observed
from swarm_mj.envs.policies.baselines import Policy, greedy
from swarm_mj.envs.policies.leaderboard import PLANNER, TEST_SEEDS, WIDTH, FrozenEpisodes

from swarm_mj.io.atomic import write_text
from swarm_mj.io.progress import progress_bars
from swarm_mj.typing import Array, Ints

NUMBERS = Path(__file__).with_suffix(".json")


def main() -> None:
    """Search group by group, and keep what each has come to."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=150, help="changes that are tried in each (default: %(default)s)")
    rounds = parser.parse_args().rounds
    found = json.loads(NUMBERS.read_text()) if NUMBERS.exists() else {}
    if found.get("rounds") != rounds:
        found = {"rounds": rounds, "scores": {}}
    waiting = [seed for seed in TEST_SEEDS if str(seed) not in found["scores"]]
    with progress_bars(Console()) as bars, FrozenEpisodes() as test:
        bar = bars.add_task("episodes", total=len(TEST_SEEDS), completed=len(TEST_SEEDS) - len(waiting))
        for start in range(0, len(waiting), WIDTH):
            some = waiting[start : start + WIDTH]
            scores = climbed(test.episodes, some, (greedy, test.policy(PLANNER)), rounds)
            found["scores"] |= {str(seed): round(float(one), 4) for seed, one in zip(some, scores, strict=True)}
            write_text(NUMBERS, json.dumps(found) + "\n")
            bars.update(bar, advance=len(some))
    print(f"wrote {NUMBERS}")


def climbed(episodes: Episodes, seeds: Sequence[int], starts: Sequence[Policy], rounds: int) -> Array:
    """What the best choices that were found for each episode come to, shape (m,).

    Args:
        episodes: Where they fly, room for all of them.
        seeds: Flight seeds.
        starts: Policies; the search begins with the better one of each episode.
        rounds: How many changes are tried in each episode; one that does not lower its score is kept.
    """
    flown = [recorded(episodes, seeds, policy) for policy in starts]
    first = np.argmax([score for score, _ in flown], axis=0)
    rows = np.arange(len(seeds))
    best = np.array([choices for _, choices in flown])[first, :, rows].swapaxes(0, 1)
    score = np.array([one for one, _ in flown])[first, rows]
    rng = np.random.default_rng(int(seeds[0]))
    for _ in range(rounds):
        tried = changed(best, episodes, rng)
        found, _ = recorded(episodes, seeds, _Listed(tried))
        better = found >= score
        best[:, better], score = tried[:, better], np.maximum(found, score)
    return score


def changed(best: Ints, episodes: Episodes, rng: np.random.Generator) -> Ints:
    """The choices, shape (steps, m, n), each episode's with another patch, Earth, or the neighbour's choice for some steps."""
    steps, m, n = best.shape
    tried = best.copy()
    for e in range(m):
        j, first, length = rng.integers(n), rng.integers(steps), rng.integers(1, 5)
        kind = rng.random()
        part = tried[first : first + length, e, j]
        if kind < 0.5:
            part[:] = rng.integers(episodes.patches)
        elif kind < 0.7:
            part[:] = episodes.patches
        else:  # all that follows comes sooner or later
            later = best[first:, e, j]
            tried[first:, e, j] = np.append(later[1:], later[-1]) if kind < 0.85 else np.append(later[:1], later[:-1])
    return tried


class _Listed:
    """A policy that takes choices from a list, shape (steps, m, n)."""

    def __init__(self, choices: NDArray[Any]) -> None:
        self._choices, self._step = choices, 0

    def __call__(self, observed: Observed) -> Ints:
        """The next ones."""
        self._step += 1
        return np.asarray(self._choices[self._step - 1])


def recorded(episodes: Episodes, seeds: Sequence[int], policy: Policy) -> tuple[Array, Ints]:
    """What a policy comes to in each episode, shape (m,), and what it chose, shape (steps, m, n)."""
    episodes.reset(dict(enumerate(seeds)))
    m, live = len(seeds), np.arange(episodes.count) < len(seeds)
    score, choices = (
        np.zeros(episodes.count),
        np.zeros((episodes.config.decisions, episodes.count, episodes.n), np.int64),
    )
    for k in range(len(choices)):
        given = np.asarray(policy(episodes.entities()))
        choices[k, : len(given)] = given
        result = episodes.fly(choices[k], live)
        score += result.reward
        live = live & (result.end == 0) & ~result.truncated
        if not live.any():
            break
    return score[:m], choices[:, :m]


if __name__ == "__main__":
    main()
