"""Proven answers to the design problem, as mixed-integer programs solved by HiGHS (`scipy.optimize.milp`).

With x_p visits to point p and m_c = 1 where cell c of the target is missed,

    minimise sum_p x_p   subject to   sum_{p sees c} x_p + k m_c >= k,   sum_c area_c m_c <= tolerance,   0 <= x_p <= visits

which is set cover with a knapsack of permitted gaps. The matrix is reduced first (`reduction`), so that only cells smaller
than the tolerance have an m_c. HiGHS works to a relative accuracy of about 1e-6 and may let a gap pass that is larger than
the tolerance by that much: every answer is checked in whole units of area, and where it misses too much, that set of missed
cells is forbidden and the program solved again. Each program allows at least what the problem allows, so its bound is a bound.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import Bounds, LinearConstraint
from scipy.sparse import coo_array, csr_array, hstack, vstack

from swarm_mj.designer.problem import CoverProblem, check_cost
from swarm_mj.designer.reduction import ReducedProblem, merge_cells, reduce_problem
from swarm_mj.designer.repair import repair_designs
from swarm_mj.errors import MissionError
from swarm_mj.io import highs
from swarm_mj.typing import Array, Ints

#: HiGHS accepts constraints violated by this much; the tolerance is loosened by it so that no true design is lost.
FEASIBILITY_TOLERANCE = 1e-6

Waiting = Callable[[float], None] | None


class Cut(NamedTuple):
    """A condition on a design beyond what it sees: factor . x >= least, with x the numbers of visits.

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
        bound: What no design can beat: N_obs from below for `solve_exact`, the cost from below for `solve_cheapest`, P_TO
            from above for `solve_budget`.
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
    points, bound, proven = _cover(problem, np.ones(problem.n_points), None, time_limit_s, waiting)
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
    problem: CoverProblem,
    reduced: ReducedProblem,
    cuts: Sequence[Cut],
    time_limit_s: float | None = None,
    waiting: Waiting = None,
) -> ExactResult | None:
    """The fewest spacecraft that cover the target and keep some cuts, with proof; None where that is proven impossible.

    Args:
        problem: What to cover.
        reduced: The same, reduced to fewer cells with `all_points`.
        cuts: Conditions.
        time_limit_s: When to stop without proof [s]; the design may then break the cuts.
        waiting: Called now and then with the seconds that have passed.
    """
    start = time.perf_counter()
    asked = _Asked(reduced, np.ones(problem.n_points), problem.max_observers, cuts)
    try:
        points, bound, proven = _covered(problem, asked, time_limit_s, waiting)
    except NoDesignError:
        return None
    least = float(max(math.ceil(bound - FEASIBILITY_TOLERANCE), 1))
    return _result(problem, points, least, proven or len(points) == least, start)


def without_proof(problem: CoverProblem, points: Ints | None = None) -> ExactResult:
    """What is known when the proof was interrupted: a design, and the least number that the areas allow.

    Args:
        problem: What to cover.
        points: The best design known, numbered from 1; None: a greedy one.

    Raises:
        MissionError: The greedy design does not cover the target within its tolerance.
    """
    start = time.perf_counter()
    if points is None:
        points = _fallback(problem, problem.max_observers, 0.0)
    largest = int((problem.sees @ problem.weights).max())
    least = math.ceil(problem.fold * (problem.total_weight - problem.slack) / max(largest, 1))
    return _result(problem, points, float(max(least, 1)), False, start)._replace(status="interrupted")


def solve_cheapest(
    problem: CoverProblem, cost: Array, n_observers: int, time_limit_s: float | None = None
) -> ExactResult:
    """The cheapest design of at most `n_observers` spacecraft that covers the target, with proof.

    Args:
        problem: What to cover; set its tolerance to what may be missed.
        cost: Cost of a visit to each point, such as its delta-v [m/s], not negative, shape (n_points,).
        n_observers: Largest N_obs; it takes the place of `max_observers`.
        time_limit_s: When to stop without proof [s].

    Raises:
        MissionError: No such design exists or none was found in time, or cost does not fit.
    """
    start = time.perf_counter()
    cost = check_cost(problem, cost)
    problem.require_coverable()
    points, bound, proven = _cover(problem, cost, n_observers, time_limit_s)
    return _result(problem, points, bound, proven, start)


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
        LinearConstraint(hstack([seen, -problem.fold * _identity(n_cells)], format="csr"), 0.0, np.inf),
        LinearConstraint(np.concatenate([np.ones(n_points), np.zeros(n_cells)])[None, :], 1.0, n_observers),
    ]
    answer = _milp(
        np.concatenate([np.zeros(n_points), -percent]),
        constraints,
        np.concatenate([np.full(n_points, problem.max_visits), np.ones(n_cells)]),
        time_limit_s,
    )
    if answer.x is None:
        raise MissionError(f"nothing was found in {time_limit_s} s: allow more time")
    points = _without_idle(problem, _visits(answer.x[:n_points], np.arange(n_points)))
    bound = max(min(100.0, -float(answer.mip_dual_bound)), problem.covered_percent(points))
    return _result(problem, points, bound, answer.status == 0, start)


class _Asked(NamedTuple):
    """What is asked beyond covering: the cost of visits to all points, at most how many of them, and cuts."""

    reduced: ReducedProblem
    cost: Array
    n_observers: int | None
    cuts: Sequence[Cut] = ()


def _cover(
    problem: CoverProblem,
    cost: Array,
    n_observers: int | None,
    time_limit_s: float | None,
    waiting: Waiting = None,
) -> tuple[Ints, float, bool]:
    """Cheapest cover as (points from 1, lower bound of the cost, whether the points attain it)."""
    return _covered(problem, _Asked(reduce_problem(problem, cost), cost, n_observers), time_limit_s, waiting)


def _covered(
    problem: CoverProblem, asked: _Asked, time_limit_s: float | None, waiting: Waiting
) -> tuple[Ints, float, bool]:
    reduced, n_observers = asked.reduced, asked.n_observers
    start = time.perf_counter()
    forbidden: list[Ints] = []
    while True:
        left = None if time_limit_s is None else max(time_limit_s - (time.perf_counter() - start), 0.0)
        answer = _solve_cover(problem, asked, forbidden, left, waiting)
        if answer.status == 2:
            raise NoDesignError(f"no design of at most {n_observers} spacecraft covers the target: allow more of them")
        if answer.status not in (0, 1):
            raise MissionError(f"HiGHS could not solve the problem: {answer.message}")
        bound = 0.0 if answer.mip_dual_bound is None else max(float(answer.mip_dual_bound), 0.0)
        if answer.x is None:
            return _fallback(problem, n_observers, time_limit_s), bound, False
        points = _visits(answer.x[: len(reduced.points)], reduced.points)
        if problem.is_enough(problem.covered_weight(points)):
            return points, bound, answer.status == 0
        forbidden.append(_missed(problem, reduced, points))


def _solve_cover(
    problem: CoverProblem, asked: _Asked, forbidden: list[Ints], time_limit_s: float | None, waiting: Waiting
) -> Any:
    """One program; `forbidden` holds sets of optional cells that together exceed the tolerance."""
    reduced = asked.reduced
    n_points, optional = len(reduced.points), np.flatnonzero(~reduced.mandatory)
    n_gaps, k = len(optional), problem.fold
    pick = coo_array((np.full(n_gaps, float(k)), (optional, np.arange(n_gaps))), shape=(len(reduced.weights), n_gaps))
    covers = hstack([csr_array(reduced.sees.T.astype(np.float64)), pick], format="csr")
    constraints = [LinearConstraint(covers, k, np.inf)]
    if n_gaps:
        shares = np.concatenate([np.zeros(n_points), reduced.weights[optional] / max(reduced.slack, 1)])
        constraints.append(LinearConstraint(shares[None, :], -np.inf, 1.0 + FEASIBILITY_TOLERANCE))
    if forbidden:
        cuts = np.zeros((len(forbidden), n_points + n_gaps))
        for cut, cells in zip(cuts, forbidden, strict=True):
            cut[n_points + cells] = 1.0
        constraints.append(LinearConstraint(cuts, -np.inf, [len(cells) - 1.0 for cells in forbidden]))
    visits = [*asked.cuts]
    if asked.n_observers is not None:
        visits.append(Cut(-np.ones(problem.n_points), -float(asked.n_observers)))
    if visits:
        rows = np.hstack([np.stack([cut.factor for cut in visits])[:, reduced.points], np.zeros((len(visits), n_gaps))])
        constraints.append(LinearConstraint(rows, [cut.least for cut in visits], np.inf))
    upper = np.concatenate([np.full(n_points, problem.max_visits), np.ones(n_gaps)])
    objective = np.concatenate([asked.cost[reduced.points], np.zeros(n_gaps)])
    return _milp(objective, constraints, upper, time_limit_s, waiting)


def _milp(
    objective: Array, constraints: list[Any], upper: Array, time_limit_s: float | None, waiting: Waiting = None
) -> Any:
    """HiGHS on whole numbers from 0 to `upper`, run until proven or as far as the time allows."""
    joined = LinearConstraint(
        vstack([csr_array(c.A) for c in constraints], format="csr"),
        np.concatenate([np.broadcast_to(c.lb, c.A.shape[0]) for c in constraints]),
        np.concatenate([np.broadcast_to(c.ub, c.A.shape[0]) for c in constraints]),
    )
    program = {
        "c": objective,
        "constraints": joined,
        "bounds": Bounds(0.0, upper),
        "integrality": np.ones(len(upper)),
        "options": {"mip_rel_gap": 0.0},
    }
    return highs.solve(program, time_limit_s, waiting)


def _identity(n: int) -> Any:
    return coo_array((np.ones(n), (np.arange(n), np.arange(n))), shape=(n, n))


def _visits(x: Array, points: Ints) -> Ints:
    """List of points, numbered from 1, of the numbers of visits."""
    return np.repeat(points + 1, np.rint(x).astype(np.int64))


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


def _fallback(problem: CoverProblem, n_observers: int | None, time_limit_s: float | None) -> Ints:
    """A greedy design for when the time is up before HiGHS has any."""
    most = problem.n_points * problem.max_visits if n_observers is None else n_observers
    roomy = CoverProblem(
        sees=problem.sees,
        area=problem.area,
        tolerance_percent=problem.tolerance_percent,
        max_observers=most,
        fold=problem.fold,
        max_visits=problem.max_visits,
    )
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
        f"max_observers = {problem.max_observers} is too small: so many spacecraft see at most {most.bound:.2f} % of the "
        f"target's area{times}; {least} are needed for {100.0 - problem.tolerance_percent:g} %"
    )
