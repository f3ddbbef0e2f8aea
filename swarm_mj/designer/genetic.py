"""The paper's genetic algorithm on gene maps, run by pymoo, with two sets of operators.

`plain`: gene maps drawn uniformly; simulated binary crossover and polynomial mutation rounded to integers (Deb and Agrawal
1995; Deb and Goyal 1996), which is what integer genetic algorithms commonly use and knows nothing of the problem.

`repair`: uniform crossover, replacement of points, and then every child is completed greedily and pruned (`repair`), so that
each one covers the target and carries no spacecraft that it does not need.

Both keep the fittest of parents and children, select by binary tournament, hold no design twice, and count every evaluated
child as a design explored. Fitness is N_obs, with Deb's penalty for designs that do not cover (`problem.Evaluation`).

pymoo (J. Blank and K. Deb, IEEE Access 8, 2020) calls its tournament comparison and its distance-based duplicate check once per
individual or pair, in Python, which takes longer than evaluating the designs. `FitnessTournament` compares whole arrays,
`UniqueDesigns` hashes gene maps.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np
from pymoo.algorithms.soo.nonconvex.ga import GA
from pymoo.core.callback import Callback
from pymoo.core.duplicate import DuplicateElimination
from pymoo.core.mating import Mating
from pymoo.core.mutation import Mutation
from pymoo.core.population import Population
from pymoo.core.problem import Problem
from pymoo.core.repair import Repair
from pymoo.core.sampling import Sampling
from pymoo.core.selection import Selection
from pymoo.core.termination import Termination
from pymoo.operators.crossover.sbx import SBX
from pymoo.operators.crossover.ux import UX
from pymoo.operators.mutation.pm import PM
from pymoo.operators.repair.rounding import RoundingRepair

from swarm_mj.designer.problem import DesignProblem, gene_map
from swarm_mj.designer.repair import repair_designs
from swarm_mj.io import interruption
from swarm_mj.typing import Array, Ints, Mask

Operators = Literal["plain", "repair"]
#: How often mating is repeated to replace children that already exist before a generation stays smaller.
MATING_ATTEMPTS = 5
#: Probability that a visiting point is replaced.
FORGET_RATE = 0.1


@dataclass(frozen=True, kw_only=True)
class GeneticSettings:
    """How the genetic algorithm runs.

    Attributes:
        operators: 'plain' or 'repair', see the module.
        population: Designs per generation.
        max_generations: Generations bred after the first, random one.
        patience: Generations without a fitter best design after which the run stops.
        seed: Seed of all random choices.
        blur: Randomness of repair, 0 to 1; unused by 'plain'.
    """

    operators: Operators = "repair"
    population: int = 100
    max_generations: int = 200
    patience: int = 50
    seed: int = 0
    blur: float = 0.5


class History(NamedTuple):
    """The run by generation, the first, random one included; shapes (generations + 1,).

    Attributes:
        best: Fitness of the best design (Figure 7).
        mean: Mean fitness of the population (Figure 7).
        explored: Designs evaluated so far.
    """

    best: Array
    mean: Array
    explored: Ints


class GeneticResult(NamedTuple):
    """What the genetic algorithm found.

    Attributes:
        genes: Selected gene map without the genes that are not read, [N_obs, p_1 ... p_Nobs] (Figure 8).
        points: Its visiting points, numbered from 1, ascending, shape (N_obs,).
        n_observers: Its N_obs.
        covered_percent: Its P_TO.
        feasible: Whether it covers the target within the tolerance.
        generations: Generations bred after the first.
        explored: Designs evaluated.
        history: The run by generation.
        stopped_by: 'patience', 'max_generations', or 'no new designs' where breeding gave only designs already there.
        seconds: Wall-clock time, compilation included where it was needed.
    """

    genes: Ints
    points: Ints
    n_observers: int
    covered_percent: float
    feasible: bool
    generations: int
    explored: int
    history: History
    stopped_by: str
    seconds: float


def evolve(
    problem: DesignProblem, settings: GeneticSettings | None = None, progress: Callable[[float], None] | None = None
) -> GeneticResult:
    """Search for the fewest spacecraft that cover the target.

    Args:
        problem: What to cover.
        settings: How to run; the defaults where None.
        progress: Called after every generation with the share done, 0 to 1, if no better design comes.

    Returns:
        The best design of all; `feasible` is False where none covered the target with `max_observers` spacecraft.

    Raises:
        MissionError: Not even visiting every point covers the target.
    """
    start = time.perf_counter()
    settings = settings or GeneticSettings()
    problem.require_coverable()
    stop = _Stop(settings.max_generations, settings.patience)
    record = _Recorder(stop, progress)
    algorithm = _algorithm(problem, settings)
    algorithm.setup(GeneMapProblem(problem), termination=stop, callback=record, seed=settings.seed)
    best = algorithm.run().X.astype(np.int64)
    value = problem.evaluate(best[None, :])
    points = np.sort(best[1 : 1 + best[0]])
    return GeneticResult(
        genes=gene_map(points, len(points)),
        points=points,
        n_observers=int(best[0]),
        covered_percent=float(value.covered_percent[0]),
        feasible=bool(value.feasible[0]),
        generations=len(record.best) - 1,
        explored=record.explored[-1],
        history=History(np.array(record.best), np.array(record.mean), np.array(record.explored)),
        stopped_by=stop.reason,
        seconds=time.perf_counter() - start,
    )


def _algorithm(problem: DesignProblem, settings: GeneticSettings) -> GA:
    if settings.operators == "plain":
        crossover, mutation, repair = SBX(prob=0.9, eta=3, vtype=float), PM(prob=1.0, eta=3), RoundingRepair()
    else:
        crossover, mutation, repair = UX(prob=0.9), ForgetMutation(), CoverRepair(problem, settings.blur)
    return breeding(GA, settings.population, RandomGeneMaps(), FitnessTournament(), crossover, mutation, repair)


def breeding(
    algorithm: Any, population: int, sampling: Any, selection: Any, crossover: Any, mutation: Any, repair: Any
) -> Any:
    """An algorithm of pymoo, by its class, with these operators; no design is in it twice."""
    how = {"repair": repair, "eliminate_duplicates": UniqueDesigns()}
    mating = Mating(selection, crossover, mutation, n_max_iterations=MATING_ATTEMPTS, **how)
    return algorithm(pop_size=population, sampling=sampling, mating=mating, output=None, **how)


class _Recorder(Callback):
    """Fitness and count of designs of every generation."""

    def __init__(self, stop: _Stop, progress: Callable[[float], None] | None) -> None:
        super().__init__()
        self._stop, self._progress = stop, progress
        self.best: list[float] = []
        self.mean: list[float] = []
        self.explored: list[int] = []

    def notify(self, algorithm: Any) -> None:
        fitness = algorithm.pop.get("F")[:, 0]
        self.best.append(float(fitness.min()))
        self.mean.append(float(fitness.mean()))
        self.explored.append(int(algorithm.evaluator.n_eval))
        interruption.check()
        if self._progress is not None:
            self._progress(self._stop.share(algorithm.n_gen - 1))


class _Stop(Termination):
    """Enough generations, or enough of them without a fitter best design."""

    def __init__(self, max_generations: int, patience: int) -> None:
        super().__init__()
        self.max_generations, self.patience = max_generations, patience
        self.best, self.best_generation, self.reason = np.inf, 0, "no new designs"

    def share(self, generation: int) -> float:
        """How much of the run is done, if no fitter design comes."""
        return max(generation / self.max_generations, (generation - self.best_generation) / self.patience)

    def _update(self, algorithm: Any) -> float:
        generation = algorithm.n_gen - 1
        fitness = float(algorithm.pop.get("F").min())
        if fitness < self.best:
            self.best, self.best_generation = fitness, generation
        if generation - self.best_generation >= self.patience:
            self.reason = "patience"
            return 1.0
        if generation >= self.max_generations:
            self.reason = "max_generations"
            return 1.0
        return 0.0


class GeneMapProblem(Problem):
    """The domains of the paper's Figure 5 and the fitness of `DesignProblem.evaluate`, many designs at a time."""

    def __init__(self, cover: DesignProblem) -> None:
        n_max = cover.max_observers
        super().__init__(
            n_var=1 + n_max,
            n_obj=1,
            xl=np.ones(1 + n_max),
            xu=np.concatenate([[n_max], np.full(n_max, cover.n_points)]),
            vtype=int,
        )
        self.cover = cover

    def _evaluate(self, x: Ints, out: dict[str, Any], *args: Any, **kwargs: Any) -> None:
        out["F"] = self.cover.evaluate(x).fitness[:, None]


class RandomGeneMaps(Sampling):
    """Gene maps uniform over their domains."""

    def _do(self, problem: Problem, n_samples: int, *args: Any, random_state: Any, **kwargs: Any) -> Ints:
        low, high = problem.xl.astype(np.int64), problem.xu.astype(np.int64)
        return random_state.integers(low, high + 1, size=(n_samples, problem.n_var))


class FitnessTournament(Selection):
    """Binary tournaments on the first objective; the fitter of two wins, ties fall to the first drawn."""

    def _do(
        self,
        problem: Problem,
        pop: Population,
        n_select: int,
        n_parents: int,
        *args: Any,
        random_state: Any,
        **kwargs: Any,
    ) -> Ints:
        fitness = pop.get("F")[:, 0]
        pairs = random_state.integers(len(pop), size=(2, n_select, n_parents))
        return np.where(fitness[pairs[1]] < fitness[pairs[0]], pairs[1], pairs[0])


class ForgetMutation(Mutation):
    """Forget some visiting points and name random ones instead."""

    def __init__(self) -> None:
        super().__init__(prob=1.0)

    def _do(self, problem: Problem, X: Ints, *args: Any, random_state: Any, **kwargs: Any) -> Ints:  # noqa: N803
        genes = X.copy()
        replaced = random_state.random(genes[:, 1:].shape) < FORGET_RATE
        genes[:, 1:][replaced] = random_state.integers(1, int(problem.xu[1]) + 1, size=int(replaced.sum()))
        return genes


class CoverRepair(Repair):
    """Greedy completion and pruning of every child (`repair.repair_designs`).

    Attributes:
        blur: Upper end of the uniform blur of each point's gain: 0 is greedy, towards 1 random.
    """

    def __init__(self, cover: DesignProblem, blur: float) -> None:
        super().__init__()
        self.cover, self.blur = cover, blur

    def _do(self, problem: Problem, X: Ints, *args: Any, random_state: Any, **kwargs: Any) -> Ints:  # noqa: N803
        return repair_designs(self.cover, X, self.blur * random_state.random((len(X), self.cover.n_points)))


class UniqueDesigns(DuplicateElimination):
    """Drop designs whose spacecraft visit the same points as those of a design already there, in whatever order."""

    def _do(self, pop: Population, other: Population | None, is_duplicate: Mask) -> Mask:
        known = set() if other is None else set(_keys(other))
        for i, key in enumerate(_keys(pop)):
            is_duplicate[i] = key in known
            if other is None:
                known.add(key)
        return is_duplicate


def _keys(pop: Population) -> list[bytes]:
    genes = np.asarray(pop.get("X"), dtype=np.int64)
    read = np.arange(1, genes.shape[1]) <= genes[:, :1]
    points = np.sort(np.where(read, genes[:, 1:], 0), axis=1)
    return [row.tobytes() for row in points]
