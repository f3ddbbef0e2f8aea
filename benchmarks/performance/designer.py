"""The designer: 6,801 designs of the genetic algorithm and the proof with the matrix in hand, and the matrix itself."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np

from benchmarks.measure import Row, in_turn, row
from swarm_mj.designer.candidates.visibility import visibility
from swarm_mj.designer.exact import solve_exact
from swarm_mj.designer.genetic import GeneticSettings, evolve
from swarm_mj.designer.study import cover_problem
from swarm_mj.scenarios.loading import load_scenario

#: The paper explored 6,801 designs: 67 generations of 100, and the first.
GENERATIONS = 67


def rows(quick: bool) -> Iterator[Row]:
    """All of it; compilation is not counted."""
    scenario = load_scenario("eros-config1")
    problem = cover_problem(scenario, visibility(scenario))
    settings = partial(GeneticSettings, max_generations=GENERATIONS, patience=10 * GENERATIONS)
    seeds = iter(range(10_000))
    works = {
        "genetic algorithm, 6,800 designs": lambda: evolve(problem, settings(seed=next(seeds))),
        "proof": lambda: solve_exact(problem),
        "matrix, 51 points x 170 faces": lambda: cover_problem(scenario, visibility(scenario)),
    }
    times = in_turn(works, 3 if quick else 7)
    for name, seconds in times.items():
        yield row("designer", name, seconds, "s", "<= 1" if name.startswith("genetic") else "")
    found = evolve(problem, settings(seed=0)).n_observers
    proven = solve_exact(problem).n_observers
    yield row("designer", "spacecraft, genetic algorithm - proof", np.array([found - proven]), "spacecraft", "<= 0")
