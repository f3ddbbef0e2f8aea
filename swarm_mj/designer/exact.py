"""Proven answers to the design problem, as mixed-integer programs solved by HiGHS (`scipy.optimize.milp`).

With x_p = 1 where point p is visited and m_c = 1 where cell c of the target is missed,

    minimise sum_p x_p   subject to   sum_{p sees c} x_p + k m_c >= k,   sum_c area_c m_c <= tolerance

which is set cover with a knapsack of permitted gaps; points that are avoided count a little more than 1. The matrix is reduced
first (`reduce_problem`), so that only cells smaller than the tolerance have an m_c. HiGHS works to a relative accuracy of about
1e-6 and may let a gap pass that is larger than the tolerance by that much: every answer is checked in whole units of area, and
where it misses too much, that set of missed cells is forbidden and the program solved again. Each program allows at least what
the problem allows, so its bound is a bound.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import Bounds, LinearConstraint
from scipy.sparse import coo_array, csr_array, eye_array, hstack, vstack

from swarm_mj.compilation import kernel
from swarm_mj.designer.problem import CoverProblem, Words, is_subset, pack
from swarm_mj.designer.repair import repair_designs
from swarm_mj.errors import MissionError
from swarm_mj.io import highs
from swarm_mj.observation.coverage import rounded_up_digits
from swarm_mj.typing import Array, Ints, Mask

#: HiGHS accepts constraints violated by this much; the tolerance is loosened by it so that no true design is lost.
FEASIBILITY_TOLERANCE = 1e-6

Waiting = Callable[[float], None] | None


class Cut(NamedTuple):
    """A condition on a design beyond what it sees: factor . x >= least, with x what is visited.

    Attributes:
        factor: Shape (n_points,).
        least: The right side.
    """

    factor: Array
    least: float


class NoDesignError(MissionError):
    """It is proven that no design of the spacecraft that are allowed covers the target."""


class ExactResult(NamedTuple):
    """A design and what is proven about it.

    Attributes:
        n_observers: N_obs of the design.
        points: Visited points, numbered from 1, ascending, shape (n_observers,).
        covered_percent: P_TO of the design.
        bound: What no design can beat: N_obs from below for `solve_exact`, P_TO from above for `solve_budget`.
        status: 'optimal' where the design attains the bound, 'time limit' where that is not known, and 'interrupted' where
            nobody waited for the proof: then the bound is the area of the target over that of the best view.
        seconds: Wall-clock time.
    """

    n_observers: int
    points: Ints
    covered_percent: float
    bound: float
    status: str
    seconds: float


def solve_exact(problem: CoverProblem, time_limit_s: float | None = None, waiting: Waiting = None) -> ExactResult:
    """The fewest spacecraft that cover the target, with proof.

    Args:
        problem: What to cover.
        time_limit_s: When to stop without proof [s]; the design is then the best known.
        waiting: Called now and then with the seconds that have passed.

    Raises:
        MissionError: No design covers the target, or none of at most `max_observers`; the message says how much can be seen
            and what would make it feasible.
    """
    start = time.perf_counter()
    problem.require_coverable()
    points, bound, proven = _covered(problem, reduce_problem(problem), (), time_limit_s, waiting)
    least = max(math.ceil(bound - FEASIBILITY_TOLERANCE), 1)
    if least > problem.max_observers or (proven and len(points) > problem.max_observers):
        raise MissionError(_too_few(problem, str(least) if proven else f"at least {least}", time_limit_s))
    if len(points) > problem.max_observers:
        raise MissionError(
            f"no design of at most max_observers = {problem.max_observers} was found in {time_limit_s:g} s, nor excluded "
            f"(at least {least}; {len(points)} are enough): allow more time or more spacecraft"
        )
    return _result(problem, points, float(least), proven or len(points) == least, start)


def solve_cut(
    problem: CoverProblem, reduced: ReducedProblem, cuts: Sequence[Cut], time_limit_s: float, waiting: Waiting
) -> ExactResult | None:
    """The fewest spacecraft that cover the target and keep some cuts, with proof; None where that is proven impossible.

    Args:
        problem: What to cover.
        reduced: The same, reduced to fewer cells with `all_points`.
        cuts: Conditions, beside that of at most `max_observers`.
        time_limit_s: When to stop without proof [s]; the design may then break the cuts.
        waiting: Called now and then with the seconds that have passed.
    """
    start = time.perf_counter()
    few = Cut(-np.ones(problem.n_points), -float(problem.max_observers))
    try:
        points, bound, proven = _covered(problem, reduced, [*cuts, few], time_limit_s, waiting)
    except NoDesignError:
        return None
    least = float(max(math.ceil(bound - FEASIBILITY_TOLERANCE), 1))
    return _result(problem, points, least, proven or len(points) == least, start)


def without_proof(problem: CoverProblem, points: Ints | None) -> ExactResult:
    """What is known when the proof was interrupted: a design, and the least number that the areas allow.

    Args:
        problem: What to cover.
        points: The best design known, numbered from 1; None: a greedy one.

    Raises:
        MissionError: The greedy design does not cover the target within its tolerance.
    """
    start = time.perf_counter()
    if points is None:
        points = _fallback(problem, 0.0, problem.max_observers)
    largest = int((problem.sees @ problem.weights).max())
    least = math.ceil(problem.fold * (problem.total_weight - problem.slack) / max(largest, 1))
    return _result(problem, points, float(max(least, 1)), False, start)._replace(status="interrupted")


def solve_budget(problem: CoverProblem, n_observers: int, time_limit_s: float | None = None) -> ExactResult:
    """The largest area that `n_observers` spacecraft can cover, with proof; the tolerance plays no part.

    Args:
        problem: What to cover; its tolerance and `max_observers` are not used.
        n_observers: Largest N_obs; fewer are returned where more would add nothing, but at least one.
        time_limit_s: When to stop without proof [s].

    Raises:
        MissionError: n_observers is below 1, or nothing was found in time.
    """
    start = time.perf_counter()
    if n_observers < 1:
        raise MissionError(f"n_observers = {n_observers}: must be at least 1")
    sees, weights = merge_cells(problem)
    n_points, n_cells = sees.shape
    percent = 100.0 * weights / problem.total_weight
    seen = csr_array(sees.T.astype(np.float64))
    constraints = [
        LinearConstraint(hstack([seen, -problem.fold * eye_array(n_cells)], format="csr"), 0.0, np.inf),
        LinearConstraint(np.concatenate([np.ones(n_points), np.zeros(n_cells)])[None, :], 1.0, n_observers),
    ]
    answer = _milp(np.concatenate([np.zeros(n_points), -percent]), constraints, time_limit_s)
    if answer.x is None:
        raise MissionError(f"nothing was found in {time_limit_s} s: allow more time")
    points = _without_idle(problem, _visits(answer.x[:n_points], np.arange(n_points)))
    bound = max(min(100.0, -float(answer.mip_dual_bound)), problem.covered_percent(points))
    return _result(problem, points, bound, answer.status == 0, start)


def _covered(
    problem: CoverProblem, reduced: ReducedProblem, cuts: Sequence[Cut], time_limit_s: float | None, waiting: Waiting
) -> tuple[Ints, float, bool]:
    """Smallest cover as (points from 1, lower bound of their number, whether the points attain it)."""
    start = time.perf_counter()
    forbidden: list[Ints] = []
    while True:
        left = None if time_limit_s is None else max(time_limit_s - (time.perf_counter() - start), 0.0)
        answer = _solve_cover(problem, reduced, cuts, forbidden, left, waiting)
        if answer.status == 2:
            raise NoDesignError("no design that is allowed covers the target")
        if answer.status not in (0, 1):
            raise MissionError(f"HiGHS could not solve the problem: {answer.message}")
        # Each spacecraft counts at most 1 + `_price`.
        bound = max(float(answer.mip_dual_bound or 0.0), 0.0) / (1.0 + _price(problem) * problem.avoided.any())
        if answer.x is None:
            return _fallback(problem, time_limit_s, problem.max_observers if cuts else problem.n_points), bound, False
        points, proven = _visits(answer.x[: len(reduced.points)], reduced.points), answer.status == 0
        if problem.is_enough(problem.covered_weight(points)):
            return points, float(len(points)) if proven else bound, proven
        forbidden.append(_missed(problem, reduced, points))


def _solve_cover(
    problem: CoverProblem,
    reduced: ReducedProblem,
    cuts: Sequence[Cut],
    forbidden: list[Ints],
    time_limit_s: float | None,
    waiting: Waiting,
) -> Any:
    """One program; `forbidden` holds sets of optional cells that together exceed the tolerance."""
    n_points, optional = len(reduced.points), np.flatnonzero(~reduced.mandatory)
    n_gaps, k = len(optional), problem.fold
    pick = coo_array((np.full(n_gaps, float(k)), (optional, np.arange(n_gaps))), shape=(len(reduced.weights), n_gaps))
    covers = hstack([csr_array(reduced.sees.T.astype(np.float64)), pick], format="csr")
    constraints = [LinearConstraint(covers, k, np.inf)]
    if n_gaps:
        shares = np.concatenate([np.zeros(n_points), reduced.weights[optional] / max(reduced.slack, 1)])
        constraints.append(LinearConstraint(shares[None, :], -np.inf, 1.0 + FEASIBILITY_TOLERANCE))
    if forbidden:
        missed = np.zeros((len(forbidden), n_points + n_gaps))
        for row, cells in zip(missed, forbidden, strict=True):
            row[n_points + cells] = 1.0
        constraints.append(LinearConstraint(missed, -np.inf, [len(cells) - 1.0 for cells in forbidden]))
    if cuts:
        rows = np.hstack([np.stack([cut.factor for cut in cuts])[:, reduced.points], np.zeros((len(cuts), n_gaps))])
        constraints.append(LinearConstraint(rows, [cut.least for cut in cuts], np.inf))
    objective = np.concatenate([1.0 + _price(problem) * problem.avoided[reduced.points], np.zeros(n_gaps)])
    return _milp(objective, constraints, time_limit_s, waiting)


def _price(problem: CoverProblem) -> float:
    """What an avoided point costs beside 1: all of them together less than one more spacecraft."""
    return 1.0 / (problem.n_points + 1.0)


def _milp(objective: Array, constraints: list[Any], time_limit_s: float | None, waiting: Waiting = None) -> Any:
    """HiGHS on numbers that are 0 or 1, run until proven or as far as the time allows."""
    joined = LinearConstraint(
        vstack([csr_array(c.A) for c in constraints], format="csr"),
        np.concatenate([np.broadcast_to(c.lb, c.A.shape[0]) for c in constraints]),
        np.concatenate([np.broadcast_to(c.ub, c.A.shape[0]) for c in constraints]),
    )
    program = {
        "c": objective,
        "constraints": joined,
        "bounds": Bounds(0.0, 1.0),
        "integrality": np.ones(len(objective)),
        "options": {"mip_rel_gap": 0.0},
    }
    return highs.solve(program, time_limit_s, waiting)


def _visits(x: Array, points: Ints) -> Ints:
    """List of points, numbered from 1, of those that are visited."""
    return points[np.rint(x) > 0.0] + 1


def _missed(problem: CoverProblem, reduced: ReducedProblem, points: Ints) -> Ints:
    """Places, among the optional cells, of those that a design misses."""
    visits = np.bincount(points - 1, minlength=problem.n_points)[reduced.points]
    return np.flatnonzero((visits @ reduced.sees < problem.fold)[~reduced.mandatory])


def _without_idle(problem: CoverProblem, points: Ints) -> Ints:
    """The same cover without visits that add nothing; one is kept."""
    whole = problem.covered_weight(points)
    for point in points.tolist():
        fewer = np.delete(points, np.flatnonzero(points == point)[0])
        if len(fewer) and problem.covered_weight(fewer) == whole:
            points = fewer
    return points


def _fallback(problem: CoverProblem, time_limit_s: float | None, most: int) -> Ints:
    """A greedy design of at most so many, for when the time is up before HiGHS has any."""
    roomy = replace(problem, max_observers=most)
    design = repair_designs(roomy, np.ones((1, 1 + most), dtype=np.int64), np.zeros((1, problem.n_points)))[0]
    points = design[1 : 1 + design[0]]
    if not problem.is_enough(problem.covered_weight(points)):
        raise MissionError(f"no design was found in {time_limit_s} s: allow more time")
    return points


def _result(problem: CoverProblem, points: Ints, bound: float, proven: bool, start: float) -> ExactResult:
    status, seconds = "optimal" if proven else "time limit", time.perf_counter() - start
    return ExactResult(len(points), np.sort(points), problem.covered_percent(points), bound, status, seconds)


def _too_few(problem: CoverProblem, least: str, time_limit_s: float | None) -> str:
    most = solve_budget(problem, problem.max_observers, time_limit_s)
    times = "" if problem.fold == 1 else f" {problem.fold} times"
    return (
        f"max_observers = {problem.max_observers} is too small: so many spacecraft see at most "
        f"{rounded_up_digits(most.bound)} % of the target's area{times}; {least} are needed for "
        f"{100.0 - problem.tolerance_percent:g} %"
    )


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


def reduce_problem(problem: CoverProblem, *, all_points: bool = False) -> ReducedProblem:
    """Make a problem smaller without changing its minimum, before it is proven.

    Four steps, each sound on its own, are repeated until nothing more falls away:

    1. Faces that no choice of points can cover are given up: their area comes off the tolerance.
    2. Faces seen by exactly the same points are one cell with the summed area.
    3. A cell larger than what may be missed is mandatory. A cell is implied, and dropped, where it is seen by all the points
       that see some mandatory cell: covering that one covers it.
    4. A point is dropped where at least `fold` others see all that it sees, and are not avoided unless it is. In a smallest
       design that uses it, either one of those is free and does as well, or all are visited and the point was not needed.

    Args:
        problem: What to cover; it must be coverable.
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
            kept = ~replaceable(pack(np.column_stack((sees, ~problem.avoided[points]))), problem.fold)
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
            if other == c or not mandatory[other] or dropped[other] or not is_subset(seers[other], seers[c]):
                continue
            if not is_subset(seers[c], seers[other]) or other < c or not mandatory[c]:
                dropped[c] = True
                break
    return dropped


@kernel
def replaceable(rows: Words, fold: int) -> Mask:
    """Which points can be dropped by step 4; equal points stand in for each other in their order."""
    n = rows.shape[0]
    dropped = np.zeros(n, dtype=np.bool_)
    for p in range(n):
        stand_ins = 0
        for other in range(n):
            if other == p or not is_subset(rows[p], rows[other]):
                continue
            if other < p or not is_subset(rows[other], rows[p]):
                stand_ins += 1
                if stand_ins >= fold:
                    dropped[p] = True
                    break
    return dropped
