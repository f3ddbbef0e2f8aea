"""Make a cover problem smaller without changing its minimum, before it is proven.

Four steps, each sound on its own:

1. Faces that no choice of points can cover are given up: their area comes off the tolerance.
2. Faces seen by exactly the same points are one cell with the summed area.
3. A cell larger than what may be missed is mandatory. A cell is implied, and dropped, where it is seen by all the points that
   see some mandatory cell: covering that one covers it.
4. A point is dropped where at least `fold` visits are possible to other points that see all that it sees and cost no more.
   In a cheapest design that uses it, either one of those visits is free and does as well, or all are taken and the point was
   not needed.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from swarm_mj.designer.bitset import Words, pack
from swarm_mj.designer.problem import CoverProblem
from swarm_mj.typing import Array, Ints, Mask, kernel


class ReducedProblem(NamedTuple):
    """What is left to decide.

    Attributes:
        points: The points kept, numbered from 0, shape (n,).
        sees: Who sees which cell, shape (n, n_cells).
        weights: Area of each cell in units of `AREA_UNITS`, shape (n_cells,).
        mandatory: Whether a cell must be covered, shape (n_cells,).
        slack: Weight of the cells that may be missed.
    """

    points: Ints
    sees: Mask
    weights: Ints
    mandatory: Mask
    slack: int


def merge_cells(problem: CoverProblem) -> tuple[Mask, Ints]:
    """Steps 1 and 2: coverable cells as (sees, shape (n_points, n_cells); weights, shape (n_cells,))."""
    coverable = problem.coverable
    seers = pack(problem.sees.T[coverable])
    _, first, cell = np.unique(seers, axis=0, return_index=True, return_inverse=True)
    weights = np.zeros(len(first), dtype=np.int64)
    np.add.at(weights, cell.ravel(), problem.weights[coverable])
    return problem.sees[:, coverable][:, first], weights


def reduce_problem(problem: CoverProblem, cost: Array, *, all_points: bool = False) -> ReducedProblem:
    """All four steps, repeated until nothing more falls away.

    Args:
        problem: What to cover; it must be coverable.
        cost: Cost of a visit to each point, not negative, shape (n_points,).
        all_points: Leave step 4 out: more is asked of a point than what it sees.
    """
    sees, weights = merge_cells(problem)
    slack = problem.slack - (problem.total_weight - int(weights.sum()))
    mandatory = weights > slack
    points = np.arange(problem.n_points)
    while True:
        shape = sees.shape
        cells = ~implied(pack(sees.T), mandatory)
        sees, weights, mandatory = sees[:, cells], weights[cells], mandatory[cells]
        if not all_points:
            kept = ~replaceable(pack(sees), cost[points], problem.fold, problem.max_visits)
            sees, points = sees[kept], points[kept]
        if all_points or sees.shape == shape:
            return ReducedProblem(points, sees, weights, mandatory, slack)


@kernel
def implied(seers: Words, mandatory: Mask) -> Mask:
    """Which cells are covered by covering a mandatory one; of cells with equal seers the first stays."""
    n = seers.shape[0]
    dropped = np.zeros(n, dtype=np.bool_)
    for c in range(n):
        for other in range(n):
            if other == c or not mandatory[other] or dropped[other] or not _within(seers[other], seers[c]):
                continue
            if not _within(seers[c], seers[other]) or other < c or not mandatory[c]:
                dropped[c] = True
                break
    return dropped


@kernel
def replaceable(rows: Words, cost: Array, fold: int, max_visits: int) -> Mask:
    """Which points can be dropped by step 4; equal points at equal cost stand in for each other in their order."""
    n = rows.shape[0]
    dropped = np.zeros(n, dtype=np.bool_)
    for p in range(n):
        stand_ins = 0
        for other in range(n):
            if other == p or cost[other] > cost[p] or not _within(rows[p], rows[other]):
                continue
            if other < p or cost[other] < cost[p] or not _within(rows[other], rows[p]):
                stand_ins += max_visits
                if stand_ins >= fold:
                    dropped[p] = True
                    break
    return dropped


@kernel
def _within(small: Words, large: Words) -> bool:
    for w in range(small.shape[0]):
        if small[w] & ~large[w] != np.uint64(0):
            return False
    return True
