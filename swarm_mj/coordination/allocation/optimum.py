"""The best allocation with proof: a mixed-integer linear program, solved by HiGHS.

With x_j in {0, 1} for picture j, and y_q in [0, 1] for how far patch q counts,

    maximise    sum_q weight_q y_q
    subject to  y_q <= sum of x_j over the pictures that show q,     sum of an agent's x_j <= its budget,
                sum of all x_j <= the most pictures of all agents together,
                sum of x_j over C <= 1 for sets C of an agent's pictures of which no two can be taken.

The sets C hold every pair that is in conflict. Those of one slot, or of as many slots in a row as the shortest slew takes, are
such a set. For later pairs, d slots apart, let N(p) be the aims that cannot follow aim p after d slots: then all aims whose N
contains N(p) in the first slot, and N(p) in the second, form one as well, which makes the relaxation tight.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from scipy.optimize import Bounds, LinearConstraint
from scipy.sparse import csr_array, eye_array, hstack

from swarm_mj.coordination.allocation.greedy import greedy, pictures_of
from swarm_mj.coordination.allocation.problem import Allocation, AllocationProblem
from swarm_mj.errors import MissionError
from swarm_mj.io import highs
from swarm_mj.typing import Ints, Mask

#: Relative difference below which value and bound are taken for the same: HiGHS works to such an accuracy.
SAME = 1e-7
#: Least time that HiGHS is given, where writing down the program took longer than there was [s].
LEAST_S = 0.1


def optimum(problem: AllocationProblem, time_limit_s: float | None = None) -> Allocation:
    """The allocation that shows most weight, with the bound that proves it, or as good a one as the time allows.

    Args:
        problem: Which.
        time_limit_s: When to stop [s]; None: never. Then the status is 'time limit', the bound still holds, and the
            allocation is at least as good as the greedy one.

    Raises:
        MissionError: The time limit is not positive, or HiGHS fails.
    """
    if time_limit_s is not None and not time_limit_s > 0.0:
        raise MissionError(f"time_limit_s = {time_limit_s}: must be positive, or None for no limit")
    begun = time.perf_counter()
    start = greedy(problem)
    if start.value >= problem.coverable:
        return replace(start, status="optimal")
    program = _program(problem)
    left = None if time_limit_s is None else max(time_limit_s - (time.perf_counter() - begun), LEAST_S)
    answer = highs.solve(program, left)
    if answer.status not in (0, 1):
        raise MissionError(f"HiGHS could not solve the problem: {answer.message}")
    best = start.pictures
    if answer.x is not None:
        chosen = np.flatnonzero(answer.x[: len(problem.pictures.agent)] > 0.5)
        best = max(best, pictures_of(problem, chosen), key=problem.value_of)
    unit = float(problem.weight.max())
    known = answer.mip_dual_bound is not None and np.isfinite(answer.mip_dual_bound)
    bound = min(problem.coverable, -answer.mip_dual_bound * unit) if known else problem.coverable
    value = problem.value_of(best)
    proven = bound - value <= SAME * bound
    return Allocation(pictures=best, value=value, bound=max(bound, value), status="optimal" if proven else "time limit")


def _rows(columns: Sequence[Ints], n_columns: int) -> csr_array:
    """A sparse matrix of ones from the columns of each row."""
    start = np.cumsum([0, *map(len, columns)])
    columns_of_all = np.concatenate([*columns, np.empty(0, np.int64)])
    return csr_array((np.ones(len(columns_of_all)), columns_of_all, start), shape=(len(columns), n_columns))


def _program(problem: AllocationProblem) -> dict[str, object]:
    """Arguments of `scipy.optimize.milp`; weights are relative to the largest."""
    pictures, n = problem.pictures, len(problem.pictures.agent)
    n_columns = n + problem.n_patches
    shown = csr_array((np.ones(len(pictures.patch)), pictures.patch, pictures.first), shape=(n, problem.n_patches))
    covered = hstack([-shown.T, eye_array(problem.n_patches)], format="csr")
    budgets = _rows([np.arange(*pictures.start[a : a + 2]) for a in range(problem.n_agents)], n_columns)
    apart = _rows(list(_exclusive(problem)), n_columns)
    cost = np.zeros(n_columns)
    cost[n:] = -problem.weight / problem.weight.max()
    return {
        "c": cost,
        "constraints": [
            LinearConstraint(covered, -np.inf, 0.0),
            LinearConstraint(budgets, -np.inf, problem.budget.astype(np.float64)),
            LinearConstraint(_rows([np.arange(n)], n_columns), -np.inf, n if problem.most is None else problem.most),
            LinearConstraint(apart, -np.inf, 1.0),
        ],
        "bounds": Bounds(0.0, 1.0),
        "integrality": (np.arange(n_columns) < n).astype(np.int64),
        "options": {"mip_rel_gap": 0.0},
    }


def _exclusive(problem: AllocationProblem) -> Iterator[Ints]:
    """Sets of pictures of which at most one can be taken, by their numbers; every pair in conflict is in one."""
    pictures = problem.pictures
    for agent in range(problem.n_agents):
        number = np.full((problem.n_slots, problem.n_aims), -1, np.int64)
        own = slice(*pictures.start[agent : agent + 2])
        number[pictures.slot[own], pictures.aim[own]] = np.arange(own.start, own.stop)
        if own.start == own.stop:
            continue
        used = np.flatnonzero((number >= 0).any(axis=0))
        slew = problem.slew[agent][np.ix_(used, used)]
        number, shortest = number[:, used], int(slew.min())
        for slot in range(max(problem.n_slots - shortest + 1, 1)):
            yield from _set(number[slot : slot + shortest])
        for d in range(shortest, min(int(slew.max()), problem.n_slots)):
            for before, after in _bicliques(slew > d):
                for slot in range(problem.n_slots - d):
                    if (number[slot, before] >= 0).any() and (number[slot + d, after] >= 0).any():
                        yield from _set(np.concatenate([number[slot, before], number[slot + d, after]]))


def _set(number: Ints) -> Iterator[Ints]:
    found = number[number >= 0]
    if len(found) > 1:
        yield np.sort(found)


def _bicliques(late: Mask) -> Iterator[tuple[Mask, Mask]]:
    """Aims of an earlier and of a later picture of which no two can be taken; `late[p, q]`: q comes too early after p."""
    for after in np.unique(late[late.any(axis=1)], axis=0):
        yield ~(after & ~late).any(axis=1), after
