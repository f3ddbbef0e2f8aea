"""Trade-off between the number of spacecraft, their delta-v in all, and the area left uncovered, by NSGA-II.

NSGA-II (Deb, Pratap, Agarwal and Meyarivan 2002) as pymoo has it, on the gene maps of the paper's Figure 5. Children are
made by uniform crossover and by forgetting points; what was forgotten is replaced at random or by points of high gain per
delta-v, and spacecraft that add no area are taken away (`repair.refill_designs`). Every design that is evaluated and not
dominated is kept, not only those for which the population has room.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from pymoo.algorithms.moo.nsga2 import NSGA2, binary_tournament
from pymoo.core.callback import Callback
from pymoo.core.mutation import Mutation
from pymoo.core.problem import Problem
from pymoo.core.repair import Repair
from pymoo.operators.crossover.ux import UX
from pymoo.operators.selection.tournament import TournamentSelection
from pymoo.termination.max_gen import MaximumGenerationTermination

from swarm_mj.compilation import kernel
from swarm_mj.designer.genetic import GeneMapProblem, RandomGeneMaps, breeding
from swarm_mj.designer.problem import DesignProblem, gene_map
from swarm_mj.designer.repair import refill_designs
from swarm_mj.typing import Array, Ints, Mask

#: Probability that a child forgets a visiting point.
FORGET_RATE = 0.15


class ParetoFront(NamedTuple):
    """Designs of which none is at least as good as another in all three respects, by N_obs, then delta-v.

    Attributes:
        n_observers: N_obs, shape (m,).
        delta_v: Sum over the spacecraft, in the unit given, shape (m,).
        uncovered_percent: 100 - P_TO, shape (m,).
        points: Visiting points of each design, numbered from 1.
        explored: Designs evaluated.
        seconds: Wall-clock time.
    """

    n_observers: Ints
    delta_v: Array
    uncovered_percent: Array
    points: list[Ints]
    explored: int
    seconds: float


def pareto_front(
    problem: DesignProblem,
    delta_v: Array,
    known: Sequence[Ints] = (),
    *,
    population: int = 200,
    generations: int = 300,
    seed: int = 0,
) -> ParetoFront:
    """Search for the designs that trade spacecraft, delta-v and area.

    Args:
        problem: What to cover; its tolerance plays no part, `max_observers` limits N_obs.
        delta_v: Delta-v of a visit to each point [m/s or any unit], not negative, shape (n_points,).
        known: Designs to start from besides random ones, each a list of points from 1; the proven answers of `exact` for
            each N_obs make the extremes of the front exact.
        population: Designs per generation.
        generations: Generations bred after the first.
        seed: Seed of all random choices.

    Raises:
        MissionError: A known design has too many points.
    """
    start = time.perf_counter()
    archive = _Archive(problem.max_observers)
    sampling = _KnownAndRandom([gene_map(points, problem.max_observers) for points in known])
    selection, repair = TournamentSelection(func_comp=binary_tournament), _CheapRefill(problem, delta_v)
    algorithm = breeding(NSGA2, population, sampling, selection, UX(prob=0.9), _ForgetOrResize(prob=1.0), repair)
    stop = MaximumGenerationTermination(generations + 1)
    algorithm.setup(_TradeProblem(problem, delta_v), termination=stop, callback=archive, seed=seed)
    algorithm.run()
    order = np.lexsort((archive.values[:, 2], archive.values[:, 1], archive.values[:, 0]))
    genes, values = archive.genes[order], archive.values[order]
    return ParetoFront(
        n_observers=genes[:, 0],
        delta_v=values[:, 1],
        uncovered_percent=values[:, 2],
        points=[design[1 : 1 + design[0]] for design in genes],
        explored=int(algorithm.evaluator.n_eval),
        seconds=time.perf_counter() - start,
    )


@kernel
def dominated(values: Array, others: Array) -> Mask:
    """Which designs are no better than some other in any respect and worse in one.

    Args:
        values: Objectives to minimise, shape (m, n_objectives).
        others: Objectives of the designs to compare with, shape (k, n_objectives).
    """
    result = np.zeros(values.shape[0], dtype=np.bool_)
    for i in range(values.shape[0]):
        for j in range(others.shape[0]):
            no_worse, better = True, False
            for c in range(values.shape[1]):
                no_worse = no_worse and others[j, c] <= values[i, c]
                better = better or others[j, c] < values[i, c]
            if no_worse and better:
                result[i] = True
                break
    return result


class _TradeProblem(GeneMapProblem):
    """N_obs, delta-v in all, percentage uncovered."""

    def __init__(self, cover: DesignProblem, delta_v: Array) -> None:
        super().__init__(cover)
        self.n_obj = 3
        self.delta_v = delta_v

    def _evaluate(self, x: Ints, out: dict[str, Any], *args: Any, **kwargs: Any) -> None:
        read = np.arange(1, x.shape[1]) <= x[:, :1]
        spent = np.where(read, self.delta_v[x[:, 1:] - 1], 0.0).sum(axis=1)
        out["F"] = np.column_stack([x[:, 0], spent, 100.0 - self.cover.evaluate(x).covered_percent])


class _KnownAndRandom(RandomGeneMaps):
    def __init__(self, known: list[Ints]) -> None:
        super().__init__()
        self.known = known

    def _do(self, problem: Problem, n_samples: int, *args: Any, random_state: Any, **kwargs: Any) -> Ints:
        genes = super()._do(problem, n_samples, random_state=random_state)
        for i, design in enumerate(self.known[:n_samples]):
            genes[i] = design
        return genes


class _ForgetOrResize(Mutation):
    """Forget points, to be named anew at random or, by repeating a point, left to the refill; fly one more or fewer."""

    def _do(self, problem: Problem, X: Ints, *args: Any, random_state: Any, **kwargs: Any) -> Ints:  # noqa: N803
        genes = X.copy()
        forgotten = random_state.random(genes[:, 1:].shape) < FORGET_RATE
        anew = random_state.integers(1, int(problem.xu[1]) + 1, size=forgotten.shape)
        refill = random_state.random(len(genes)) < 0.5
        genes[:, 1:] = np.where(forgotten, np.where(refill[:, None], genes[:, 1:2], anew), genes[:, 1:])
        step = random_state.integers(-1, 2, size=len(genes))
        genes[:, 0] = np.clip(genes[:, 0] + step, 1, int(problem.xu[0]))
        return genes


class _CheapRefill(Repair):
    """Refill by area per delta-v to a power that differs from child to child, from 0 (area alone) to 3, blurred."""

    def __init__(self, cover: DesignProblem, delta_v: Array) -> None:
        super().__init__()
        self.cover, least = cover, 1e-9 * (1.0 + delta_v.max())
        self.cheapness = np.log((delta_v.min() + least) / (delta_v + least))

    def _do(self, problem: Problem, X: Ints, *args: Any, random_state: Any, **kwargs: Any) -> Ints:  # noqa: N803
        power = 3.0 * random_state.random((len(X), 1))
        blur = 1.0 - 0.5 * random_state.random((len(X), self.cover.n_points))
        return refill_designs(self.cover, X, 1.0 - blur * np.exp(power * self.cheapness))


class _Archive(Callback):
    """All designs met so far that none met so far dominates."""

    def __init__(self, max_observers: int) -> None:
        super().__init__()
        self.genes = np.empty((0, 1 + max_observers), dtype=np.int64)
        self.values = np.empty((0, 3))

    def notify(self, algorithm: Any) -> None:
        if algorithm.off is None:
            return
        genes, values = algorithm.off.get("X").astype(np.int64), algorithm.off.get("F")
        new = _first_of_equals(values, self.values)
        new[new] = ~dominated(values[new], values[new]) & ~dominated(values[new], self.values)
        kept = ~dominated(self.values, values[new])
        self.genes = np.concatenate([self.genes[kept], genes[new]])
        self.values = np.concatenate([self.values[kept], values[new]])


def _first_of_equals(values: Array, known: Array) -> Mask:
    """Which rows stand neither among the known nor earlier among themselves."""
    met, first = {row.tobytes() for row in known}, np.ones(len(values), dtype=np.bool_)
    for i, row in enumerate(values):
        first[i] = row.tobytes() not in met
        met.add(row.tobytes())
    return first
