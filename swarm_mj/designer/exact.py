"""Proven answers to the design problem, as mixed-integer programs solved by HiGHS (`scipy.optimize.milp`).

With x_p = 1 where point p is visited and m_c = 1 where cell c of the target is missed,

    minimise sum_p x_p   subject to   rows a . x + b m_c >= b,   sum_c area_c m_c <= tolerance

where the rows say what covers a cell (`relaxation`), sum_{p sees c} x_p + k m_c >= k where k must see it; points that are
avoided count a little more than 1. The problem is reduced first (`reduction`), so that only cells smaller than the tolerance
have an m_c. HiGHS works to a relative accuracy of about 1e-6 and may let a gap pass that is larger than the tolerance by that
much, and not all rows of a quality class, or of a large problem, are there from the start: every answer is checked in whole
units of area. Where it misses too much, rows that it breaks are added, or, where it breaks none, that set of missed cells is
forbidden, and the program is solved again. Each program allows at least what the problem allows, so its bound is a bound.

Large problems and quality classes start warm: a greedy design, the Lagrangian bound with whose reduced costs points are fixed
that no better design visits, and linear relaxations to which broken rows are added until none is left. The program then asks
for a better design than the best known: that there is none is its proof.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import Bounds, LinearConstraint
from scipy.sparse import coo_array, csr_array, hstack, vstack

from swarm_mj.designer.problem import DesignProblem
from swarm_mj.designer.reduction import ReducedProblem, cells_of, reduce_problem
from swarm_mj.designer.relaxation import BROKEN, LEAST_STEP, Rows, climb, reduced_costs, rows_of, violated
from swarm_mj.designer.repair import repair_designs
from swarm_mj.designer.requirements import COUNT, completed, first_gains, fulfilled, pruned
from swarm_mj.errors import MissionError, TooFewObserversError
from swarm_mj.io import highs
from swarm_mj.observation.coverage import rounded_up_digits
from swarm_mj.typing import Array, Ints, Mask

#: HiGHS accepts constraints violated by this much; the tolerance is loosened by it so that no true design is lost.
FEASIBILITY_TOLERANCE = 1e-6
#: Contributions of points to cells with which HiGHS is given all rows at once, without a warm start.
AT_ONCE_MOST = 30_000
#: Steps along subgradients between two greedy designs, and how often.
CLIMB, CLIMBS = 50, 40
#: Shares of the time limit after which the bound climbs no more, and linear relaxations end.
CLIMB_SHARE, SEARCH_SHARE, RELAX_SHARE = 0.25, 0.4, 0.7
#: How often a part of the best design is dropped and completed again.
SEARCHES = 1000
#: Rows of the start added at one go, the most broken ones.
ROWS_AT_ONCE = 2000
#: Rows of the start that a large problem's relaxation begins with, those of the largest multipliers.
ROWS_PER_POINT = 2
#: Relaxations in a row that may add rows without raising the bound.
PATIENCE = 3

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


def solve_exact(problem: DesignProblem, time_limit_s: float | None = None, waiting: Waiting = None) -> ExactResult:
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
    reduced = reduce_problem(problem)
    left = None if time_limit_s is None else max(time_limit_s - (time.perf_counter() - start), 0.0)
    points, bound, proven = _covered(problem, reduced, (), left, waiting)
    least = max(math.ceil(bound - FEASIBILITY_TOLERANCE), 1)
    if least > problem.max_observers or (proven and len(points) > problem.max_observers):
        words = _too_few(problem, str(least) if proven else f"at least {least}", time_limit_s)
        raise TooFewObserversError(words, least)
    if len(points) > problem.max_observers:
        raise MissionError(
            f"no design of at most max_observers = {problem.max_observers} was found in {time_limit_s:g} s, nor excluded "
            f"(at least {least}; {len(points)} are enough): allow more time or more spacecraft"
        )
    return _result(problem, points, float(least), proven or len(points) == least, start)


def solve_cut(
    problem: DesignProblem, reduced: ReducedProblem, cuts: Sequence[Cut], time_limit_s: float, waiting: Waiting
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


def without_proof(problem: DesignProblem, points: Ints | None) -> ExactResult:
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
    least = math.ceil((problem.total_weight - problem.slack) / max(problem.largest_view, 1.0))
    return _result(problem, points, float(max(least, 1)), False, start)._replace(status="interrupted")


def solve_budget(problem: DesignProblem, n_observers: int, time_limit_s: float | None = None) -> ExactResult:
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
    cells = cells_of(problem)
    n_points, n_cells = problem.n_points, len(cells.weights)
    percent, rows = 100.0 * cells.weights / problem.total_weight, rows_of(cells.asked)
    few = np.concatenate([np.ones(n_points), np.zeros(n_cells)])[None, :]
    while True:
        gaps = coo_array((rows.need, (np.arange(len(rows.need)), rows.cell)), shape=(len(rows.need), n_cells))
        constraints = [
            LinearConstraint(hstack([rows.matrix, gaps], format="csr"), rows.need, np.inf),
            LinearConstraint(few, 1.0, n_observers),
        ]
        left = None if time_limit_s is None else max(time_limit_s - (time.perf_counter() - start), 0.0)
        answer = solve_program(np.concatenate([np.zeros(n_points), percent]), constraints, left)
        if answer.x is None:
            raise MissionError(f"nothing was found in {time_limit_s} s: allow more time")
        x, missed = np.rint(answer.x[:n_points]), np.rint(answer.x[n_points:])
        new = violated(cells.asked, x, missed)
        if answer.status != 0 or not len(new.need):
            break
        rows = rows.joined(new)
    points = _without_idle(problem, np.flatnonzero(x) + 1)
    bound = max(min(100.0, problem.coverable_percent - float(answer.mip_dual_bound)), problem.covered_percent(points))
    return _result(problem, points, bound, answer.status == 0, start)


def _covered(
    problem: DesignProblem, reduced: ReducedProblem, cuts: Sequence[Cut], time_limit_s: float | None, waiting: Waiting
) -> tuple[Ints, float, bool]:
    """Smallest cover as (points from 1, lower bound of their number, whether the points attain it)."""
    program = _Program(problem, reduced, cuts, time_limit_s, waiting)
    if program.starts_warm:
        program.start()
    points, proven = program.prove()
    bound = program.bound / (1.0 + _price(problem) * problem.avoided.any())  # each spacecraft counts at most so much
    if points is None:
        return _fallback(problem, time_limit_s, problem.max_observers if cuts else problem.n_points), bound, False
    return points, float(len(points)) if proven else bound, proven


class _Program:
    """The program of a reduced problem, its rows so far and what is known of its answer.

    Attributes:
        bound: No design costs less.
        best: The cheapest design known, by places in `reduced.points`; None: none.
    """

    def __init__(
        self,
        problem: DesignProblem,
        reduced: ReducedProblem,
        cuts: Sequence[Cut],
        time_limit_s: float | None,
        waiting: Waiting,
    ) -> None:
        self.problem, self.reduced, self.cuts, self.waiting = problem, reduced, cuts, waiting
        self.begun, self.time_limit_s = time.perf_counter(), time_limit_s
        self.cost: Array = np.asarray(1.0 + _price(problem) * problem.avoided[reduced.points], np.float64)
        self.step = _price(problem) if problem.avoided.any() else 1.0  # least difference between two designs' costs
        self.rows, self.bound = rows_of(reduced.asked), 0.0
        self.active = np.ones(len(self.rows.need), np.bool_)
        self.found = self.rows.of(np.zeros(0, np.int64))
        self.forbidden: list[Ints] = []
        self.excluded = np.zeros(len(reduced.points), np.bool_)
        self.best: Ints | None = None

    @property
    def starts_warm(self) -> bool:
        """Whether HiGHS is not given everything at once."""
        simple = bool((self.reduced.asked.kind == COUNT).all()) and self.rows.matrix.nnz <= AT_ONCE_MOST
        return not (simple or self.cuts)

    def left(self, share: float = 1.0) -> float | None:
        """Time until so much of the limit is used up [s]; None: no limit."""
        if self.time_limit_s is None:
            return None
        return max(share * self.time_limit_s - (time.perf_counter() - self.begun), 0.0)

    @property
    def upper(self) -> float:
        """Cost of the best design known."""
        return math.inf if self.best is None else float(self.cost[self.best].sum())

    @property
    def is_closed(self) -> bool:
        """Whether no design costs less than the best known."""
        return self.bound > self.upper - self.step + FEASIBILITY_TOLERANCE * self.step

    def start(self) -> None:
        """Greedy designs, the Lagrangian bound, fixed points and the rows that matter, and linear relaxations."""
        self.gains = np.asarray(first_gains(self.reduced.asked))
        self.improve(np.empty(0, np.int64), np.zeros(len(self.cost)))
        self.climb()
        self.search()
        if not self.is_closed:
            self.relax()

    def improve(self, points: Ints, noise: Array) -> None:
        """Complete some points greedily, prune them, and keep what comes out where it costs less than the best known."""
        asked, weights = self.reduced.asked, self.reduced.weights
        enough = int(weights.sum()) - self.reduced.slack
        found, covered = completed(asked, weights, self.gains, points, len(self.cost), enough, noise)
        if covered < enough:
            return
        for order in (np.arange(len(found)), np.argsort(self.gains[found]), np.argsort(-noise[found])):
            design = pruned(asked, weights, found, enough, order)
            if self.cost[design].sum() < self.upper + 0.5 * self.step:
                self.best = design

    def search(self) -> None:
        """Drop a part of the best design at random and complete it again, many times."""
        rng, count = np.random.default_rng(0), 0
        while self.best is not None and not self.is_closed and count < SEARCHES and self.left(SEARCH_SHARE) != 0.0:
            kept = self.best[rng.random(len(self.best)) > rng.uniform(0.1, 0.5)]
            self.improve(kept, rng.uniform(0.0, 0.5) * rng.random(len(self.cost)))
            count += 1

    def climb(self) -> None:
        """Raise the bound along subgradients; exclude points; keep the rows that weigh in it."""
        rows, reduced = self.rows, self.reduced
        table = (rows.matrix.indptr.astype(np.int64), rows.matrix.indices.astype(np.int64), rows.matrix.data, rows.need)
        size = np.maximum(np.bincount(table[1], table[2], len(self.cost)), 1.0)
        price = np.minimum.reduceat(np.append((self.cost / size)[table[1]], np.inf), table[0][:-1])
        u: Array = np.where(np.diff(table[0]) > 0, price, 0.0)
        step, best = 1.0, np.zeros_like(u)
        for _ in range(CLIMBS):
            bound, now, step = climb(
                *table, rows.cell, reduced.weights, reduced.mandatory, reduced.slack, self.cost, self._goal, u, step, CLIMB
            )  # fmt: skip
            if bound > self.bound:
                self.bound, best = float(bound), now
            u = now.copy()
            dear = reduced_costs(rows, self.cost, now)
            self.exclude(dear, bound)
            self.improve(np.empty(0, np.int64), np.clip(dear, 0.0, 0.95))  # who is too dear is blurred
            if self.waiting is not None:
                self.waiting(time.perf_counter() - self.begun)
            if self.is_closed or step < LEAST_STEP or self.left(CLIMB_SHARE) == 0.0:
                break
        if rows.matrix.nnz > AT_ONCE_MOST:
            heaviest = np.argsort(-best, kind="stable")[: ROWS_PER_POINT * len(self.cost)]
            self.active = np.isin(np.arange(len(best)), heaviest[best[heaviest] > 0.0])

    @property
    def _goal(self) -> float:
        return self.upper if self.best is not None else float(len(self.cost))

    def exclude(self, reduced_cost: Array, bound: float) -> None:
        """Exclude the points that no design better than the best known visits."""
        self.excluded |= bound + np.maximum(reduced_cost, 0.0) > self.upper - self.step + FEASIBILITY_TOLERANCE

    def relax(self) -> None:
        """Solve linear relaxations, adding broken rows, until none is, the bound rises no more, or their time is up."""
        stale = 0
        while not self.is_closed and stale < PATIENCE:
            answer = self.solve(self.left(RELAX_SHARE), whole=False)
            if answer.x is None:
                if answer.status == 2:
                    self.bound = self.upper  # of what is not excluded nothing covers the target
                return
            stale = 0 if answer.fun > self.bound + 1e-4 else stale + 1
            self.bound = max(self.bound, float(answer.fun))
            x, missed = self.parts(answer.x)
            self.improve(np.empty(0, np.int64), 0.9 * (1.0 - x))
            if not self.broken(x, missed) or self.left(RELAX_SHARE) == 0.0:
                return

    def broken(self, x: Array, missed: Array) -> bool:
        """Add rows that points and missed cells break; whether there are any."""
        short = np.where(self.active, 0.0, self.rows.shortfall(x, missed))
        worst = np.argsort(-short)[:ROWS_AT_ONCE]
        worst = worst[short[worst] > BROKEN]
        self.active[worst] = True
        new = violated(self.reduced.asked, x, missed)
        self.found = self.found.joined(new)
        return bool(len(worst) or len(new.need))

    def prove(self) -> tuple[Ints | None, bool]:
        """Solve programs until the best design is proven or the time is up: its points from 1, and whether it is."""
        while not self.is_closed:
            answer = self.solve(self.left())
            if answer.status == 2:
                if self.best is None:
                    raise NoDesignError("no design that is allowed covers the target")
                break
            if answer.status not in (0, 1):
                raise MissionError(f"HiGHS could not solve the problem: {answer.message}")
            self.bound = max(self.bound, min(float(answer.mip_dual_bound or 0.0), self.upper))
            if answer.x is None:
                return self.best_points, False
            x, missed = self.parts(np.rint(answer.x))
            points = np.flatnonzero(x)
            if self.problem.is_enough(self.problem.covered_weight(self.reduced.points[points] + 1)):
                if self.cost[points].sum() < self.upper:
                    self.best = points
                return self.best_points, answer.status == 0
            if self.starts_warm:
                self.improve(points, np.zeros(len(x)))
            if answer.status == 1:
                return self.best_points, self.is_closed
            self.forbid(x, missed)
        return self.best_points, True

    @property
    def best_points(self) -> Ints | None:
        """The best design known, numbered from 1."""
        return None if self.best is None else self.reduced.points[self.best] + 1

    def forbid(self, x: Array, missed: Array) -> None:
        """Add what a whole design breaks: rows, or else the set of cells that it misses, which is larger than allowed."""
        asked, weights = self.reduced.asked, self.reduced.weights
        uncovered = fulfilled(asked, np.flatnonzero(x), len(weights)) > 0
        if not (uncovered & (missed < 0.5)).any() or not self.broken(x, missed):
            self.forbidden.append(np.flatnonzero(uncovered & ~self.reduced.mandatory))

    @property
    def model(self) -> Rows:
        """The rows so far."""
        return (self.rows if self.active.all() else self.rows.of(self.active)).joined(self.found)

    def parts(self, solution: Array) -> tuple[Array, Array]:
        """What is visited and how far each cell is missed, of all points and cells."""
        n, missed = len(self.cost), np.zeros(len(self.reduced.weights))
        missed[self.optional] = solution[n:]
        return solution[:n], missed

    def solve(self, time_limit_s: float | None, *, whole: bool = True) -> Any:
        """Solve the program with the rows so far, in whole numbers or not."""
        reduced, rows = self.reduced, self.model
        named = np.zeros(len(reduced.weights), np.bool_)
        named[rows.cell] = True
        for cells in self.forbidden:
            named[cells] = True
        self.optional = np.flatnonzero(named & ~reduced.mandatory)
        number = np.full(len(reduced.weights), -1)
        number[self.optional] = np.arange(len(self.optional))
        constraints = [*self._rows(rows, number), *self._limits(number)]
        most = np.concatenate([np.where(self.excluded, 0.0, 1.0), np.ones(len(self.optional))])
        return solve_program(self._objective(), constraints, time_limit_s, self.waiting, most=most, whole=whole)

    def _objective(self) -> Array:
        return np.concatenate([self.cost, np.zeros(len(self.optional))])

    def _rows(self, rows: Rows, number: Ints) -> list[LinearConstraint]:
        gaps = np.flatnonzero(number[rows.cell] >= 0)
        place = (gaps, number[rows.cell[gaps]])
        pick = coo_array((rows.need[gaps], place), shape=(len(rows.need), len(self.optional)))
        return [LinearConstraint(hstack([rows.matrix, pick], format="csr"), rows.need, np.inf)]

    def _limits(self, number: Ints) -> list[LinearConstraint]:
        """The tolerance, what is forbidden, cuts, and a lower cost than that of the best design known."""
        reduced, n_points, n_gaps = self.reduced, len(self.cost), len(self.optional)
        found = []
        if n_gaps:
            shares = np.concatenate([np.zeros(n_points), reduced.weights[self.optional] / max(reduced.slack, 1)])
            found.append(LinearConstraint(shares[None, :], -np.inf, 1.0 + FEASIBILITY_TOLERANCE))
        if self.forbidden:
            missed = np.zeros((len(self.forbidden), n_points + n_gaps))
            for row, cells in zip(missed, self.forbidden, strict=True):
                row[n_points + number[cells]] = 1.0
            found.append(LinearConstraint(missed, -np.inf, [len(cells) - 1.0 for cells in self.forbidden]))
        if self.cuts:
            factors = np.stack([cut.factor for cut in self.cuts])[:, reduced.points]
            rows = np.hstack([factors, np.zeros((len(self.cuts), n_gaps))])
            found.append(LinearConstraint(rows, [cut.least for cut in self.cuts], np.inf))
        if self.best is not None:
            cheaper = self.upper - self.step * (1.0 - FEASIBILITY_TOLERANCE)
            found.append(LinearConstraint(self._objective()[None, :], -np.inf, cheaper))
        return found


def _price(problem: DesignProblem) -> float:
    """What an avoided point costs beside 1: all of them together less than one more spacecraft."""
    return 1.0 / (problem.n_points + 1.0)


def solve_program(
    objective: Array,
    constraints: list[LinearConstraint],
    time_limit_s: float | None,
    waiting: Waiting = None,
    *,
    most: Array | float = 1.0,
    whole: Mask | bool = True,
) -> Any:
    """HiGHS on numbers from 0 to `most`, whole ones or not, run until proven or as far as the time allows."""
    joined = LinearConstraint(
        vstack([csr_array(c.A) for c in constraints], format="csr"),
        np.concatenate([np.broadcast_to(c.lb, c.A.shape[0]) for c in constraints]),
        np.concatenate([np.broadcast_to(c.ub, c.A.shape[0]) for c in constraints]),
    )
    program = {
        "c": objective,
        "constraints": joined,
        "bounds": Bounds(0.0, np.broadcast_to(most, objective.shape)),
        "integrality": np.broadcast_to(whole, objective.shape).astype(np.int64),
        "options": {"mip_rel_gap": 0.0},
    }
    return highs.solve(program, time_limit_s, waiting)


def _without_idle(problem: DesignProblem, points: Ints) -> Ints:
    """The same cover without visits that add nothing; one is kept."""
    whole = problem.covered_weight(points)
    for point in points.tolist():
        fewer = np.delete(points, np.flatnonzero(points == point)[0])
        if len(fewer) and problem.covered_weight(fewer) == whole:
            points = fewer
    return points


def _fallback(problem: DesignProblem, time_limit_s: float | None, most: int) -> Ints:
    """A greedy design of at most so many, for when the time is up before HiGHS has any."""
    roomy = replace(problem, max_observers=most)
    design = repair_designs(roomy, np.ones((1, 1 + most), dtype=np.int64), np.zeros((1, problem.n_points)))[0]
    points = design[1 : 1 + design[0]]
    if not problem.is_enough(problem.covered_weight(points)):
        raise MissionError(f"no design was found in {time_limit_s} s: allow more time")
    return points


def _result(problem: DesignProblem, points: Ints, bound: float, proven: bool, start: float) -> ExactResult:
    status, seconds = "optimal" if proven else "time limit", time.perf_counter() - start
    return ExactResult(len(points), np.sort(points), problem.covered_percent(points), bound, status, seconds)


def _too_few(problem: DesignProblem, least: str, time_limit_s: float | None) -> str:
    most = solve_budget(problem, problem.max_observers, time_limit_s)
    return (
        f"max_observers = {problem.max_observers} is too small: so many spacecraft see at most "
        f"{rounded_up_digits(most.bound)} % of the target's area{problem.times}; {least} are needed for "
        f"{100.0 - problem.tolerance_percent:g} %"
    )
