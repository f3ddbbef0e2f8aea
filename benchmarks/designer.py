"""The designer with the matrix in hand: 6,801 designs of the genetic algorithm, and the proof: python -m benchmarks.designer.

The paper explored 6,801 designs in 67 generations of 100. Compilation and the computation of the matrix are not counted; both
sets of operators and the proof are timed in turn in every round.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from swarm_mj.candidates.sightings import sightings
from swarm_mj.design.exact import solve_exact
from swarm_mj.design.genetic import GeneticSettings, Operators, evolve
from swarm_mj.designer import cover_problem
from swarm_mj.scenarios.loading import load_scenario

ROUNDS, GENERATIONS = 7, 67


def seconds(work: Callable[[], object]) -> float:
    """Wall-clock seconds of one call."""
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


def main() -> None:
    """Print medians and largest times."""
    scenario = load_scenario("eros-config1")
    problem = cover_problem(scenario, sightings(scenario))

    def run(operators: Operators, seed: int) -> object:
        return evolve(
            problem,
            GeneticSettings(operators=operators, max_generations=GENERATIONS, patience=10 * GENERATIONS, seed=seed),
        )

    cases: dict[str, Callable[[int], object]] = {
        "genetic algorithm, repair": lambda seed: run("repair", seed),
        "genetic algorithm, plain": lambda seed: run("plain", seed),
        "exact solver": lambda seed: solve_exact(problem),
    }
    for work in cases.values():
        work(0)
    times = np.array([[seconds(lambda w=work, k=k: w(k)) for work in cases.values()] for k in range(ROUNDS)])  # type: ignore[misc]
    print(f"{problem.n_points} points, {problem.n_faces} faces, {GENERATIONS} generations of 100")
    for name, column in zip(cases, times.T, strict=True):
        print(f"{name:28s} median {np.median(column):6.3f} s   largest {column.max():6.3f} s")


if __name__ == "__main__":
    main()
