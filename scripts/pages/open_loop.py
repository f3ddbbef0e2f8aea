"""Search a list of choices for `baselines.OPEN_LOOP`, the policy that looks at nothing but the clock.

python -m scripts.pages.open_loop --rounds 300
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from swarm_mj.envs.observe.config import EnvConfig
from swarm_mj.envs.observe.episodes import Episodes
from swarm_mj.envs.policies.baselines import OPEN_LOOP, fly, open_loop

from swarm_mj.io.machine import usable_cores
from swarm_mj.typing import Ints


def main() -> None:
    """Climb on from the list of the package, on flight seeds 0 to 127 of the default missions, and print what was found."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=300, help="changes that are tried (default: %(default)s)")
    rounds = parser.parse_args().rounds
    episodes = Episodes(EnvConfig(), 64, usable_cores())
    start = np.array([row.split() for row in OPEN_LOOP], np.int64).T
    best, score = climbed(episodes, start, range(128), rounds)
    episodes.close()
    print("\n".join(" ".join(map(str, row)) for row in best.T.tolist()))
    print(f"mean score {score:.3f}")


def climbed(
    episodes: Episodes, start: NDArray[Any], seeds: Sequence[int], rounds: int, seed: int = 0
) -> tuple[Ints, float]:
    """A list of choices that hill climbing finds on some flight seeds, and its mean score on them.

    Args:
        episodes: Where they fly.
        start: The list to begin with, shape (steps, n).
        seeds: Flight seeds.
        rounds: How many changes are tried; one that does not lower the mean is kept.
        seed: Of the changes.
    """
    rng, best = np.random.default_rng(seed), np.array(start, np.int64)
    steps, n = best.shape
    score = float(fly(episodes, open_loop(best), seeds).score.mean())
    for _ in range(rounds):
        tried, j, first = best.copy(), int(rng.integers(n)), int(rng.integers(steps))
        length = int(rng.integers(1, 7)) if rng.random() < 0.5 else 1
        part = tried[first : first + length, j]
        # Another patch each, or talk all the time.
        part[:] = rng.integers(0, episodes.patches, len(part)) if rng.random() < 0.7 else episodes.patches
        found = float(fly(episodes, open_loop(tried), seeds).score.mean())
        if found >= score:
            best, score = tried, found
    return best, score


if __name__ == "__main__":
    main()
