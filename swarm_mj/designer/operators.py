"""What a genetic algorithm on gene maps is made of, as components for pymoo (J. Blank and K. Deb, IEEE Access 8, 2020).

pymoo calls its tournament comparison and its distance-based duplicate check once per individual or pair, in Python, which
takes longer than evaluating the designs. `FitnessTournament` compares whole arrays, `UniqueDesigns` hashes gene maps.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from pymoo.core.duplicate import DuplicateElimination
from pymoo.core.mutation import Mutation
from pymoo.core.population import Population
from pymoo.core.problem import Problem
from pymoo.core.repair import Repair
from pymoo.core.sampling import Sampling
from pymoo.core.selection import Selection

from swarm_mj.designer.problem import CoverProblem
from swarm_mj.designer.repair import repair_designs
from swarm_mj.typing import Ints, Mask

#: How often mating is repeated to replace children that already exist before a generation stays smaller.
MATING_ATTEMPTS = 5


class GeneMapProblem(Problem):
    """The domains of the paper's Figure 5 and the fitness of `CoverProblem.evaluate`, many designs at a time."""

    def __init__(self, cover: CoverProblem) -> None:
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
    """Forget some visiting points and name random ones instead.

    Attributes:
        rate: Probability that a point is replaced.
    """

    def __init__(self, rate: float = 0.1) -> None:
        super().__init__(prob=1.0)
        self.rate = rate

    def _do(self, problem: Problem, X: Ints, *args: Any, random_state: Any, **kwargs: Any) -> Ints:  # noqa: N803
        genes = X.copy()
        replaced = random_state.random(genes[:, 1:].shape) < self.rate
        genes[:, 1:][replaced] = random_state.integers(1, int(problem.xu[1]) + 1, size=int(replaced.sum()))
        return genes


class CoverRepair(Repair):
    """Greedy completion and pruning of every child (`repair.repair_designs`).

    Attributes:
        blur: Upper end of the uniform blur of each point's gain: 0 is greedy, towards 1 random.
    """

    def __init__(self, cover: CoverProblem, blur: float) -> None:
        super().__init__()
        self.cover = cover
        self.blur = blur

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
