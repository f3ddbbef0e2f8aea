"""The fewest spacecraft where each flies one of many paths and one of more sweeps along it than can be listed.

A column is a path with a sweep: pictures in slots of time that the slews allow (`coordination.allocation`). Its spacecraft sees
the patches that they show. With x_s = 1 where column s is flown,

    minimise sum_s x_s   subject to   sum_{s shows q} x_s + m_q >= 1,   sum_q weight_q m_q <= tolerance,   one sweep a path

Columns are generated (Gilmore and Gomory 1961): the linear program over the columns so far prices patches with its duals pi,
and for each path the planner finds the sweep of largest price (`optimum` of one agent). Let v be the largest price of any
sweep by the planner's own bound. Then pi / max(v, 1) prices no column above 1, and its sum less the fractional knapsack of
what may be missed is a lower bound (Farley 1990), however the planner's time ended. Where no sweep has a price above 1 the
linear program is solved; the whole numbers are then those of the columns so far, and the gap is told.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.optimize import LinearConstraint, linprog
from scipy.sparse import csr_array, eye_array, hstack, vstack

from swarm_mj.coordination.allocation.greedy import greedy
from swarm_mj.coordination.allocation.optimum import LEAST_S, optimum
from swarm_mj.coordination.allocation.problem import Allocation, AllocationProblem, Schedule
from swarm_mj.coordination.replanning import problem_of
from swarm_mj.designer.candidates.flights import fly_candidates
from swarm_mj.designer.exact import solve_program
from swarm_mj.errors import MissionError, ScenarioError
from swarm_mj.flight.encounter_table import encounter_of
from swarm_mj.io import highs
from swarm_mj.scenarios.schema import Scenario
from swarm_mj.typing import Array, Mask

#: Keys of `designer` that a design with sweeps knows nothing of.
WITHOUT_SWEEPS = (
    "fold", "probability", "quality_class", "deliver_within_h",
    "extra_targets", "altitudes_m", "times_of_flight_s", "releases_s", "aims",
)  # fmt: skip
#: A price above 1 by less than this is none: HiGHS works to such an accuracy.
SAME = 1e-6


class Column(NamedTuple):
    """A path with a sweep: the agent of the allocation problem, its pictures, and the patches they show, shape (p,)."""

    path: int
    sweep: Schedule
    shows: Mask


@dataclass(frozen=True, kw_only=True, eq=False)
class SweepDesign:
    """Paths and sweeps to fly.

    Attributes:
        columns: What each spacecraft flies.
        bound: No design has fewer spacecraft.
        covered_percent: Share of the weight that is shown.
        generated: Columns that were made in all.
    """

    columns: tuple[Column, ...]
    bound: int
    covered_percent: float
    generated: int

    @property
    def proven(self) -> bool:
        """Whether no design is smaller."""
        return self.bound == len(self.columns)


def fewest_sweeps(problem: AllocationProblem, tolerance_percent: float, time_limit_s: float = 60.0) -> SweepDesign:
    """The fewest spacecraft that show all patches but a share of the weight, each on a path of its own.

    Args:
        problem: Each agent is a path; its budget and slews are those of who flies it.
        tolerance_percent: Share of all weight that may be missed [%].
        time_limit_s: When to stop without proof [s].

    Raises:
        MissionError: Not even one spacecraft on every path, planned greedily, shows enough.
    """
    until = time.perf_counter() + time_limit_s
    slack = tolerance_percent / 100.0 * float(problem.weight.sum()) * (1.0 + 1e-9)
    best = _greedy_design(problem, slack)
    columns, bound = list(best), 1
    while bound < len(best) and time.perf_counter() < until:
        price = _prices(problem, columns, slack)
        new, dearest = _priced(problem, price, until)
        bound = max(bound, math.ceil(_farley(price / max(dearest, 1.0), problem.weight, slack) - SAME))
        fresh = [column for column in new if price[column.shows].sum() > 1.0 + SAME]
        columns += fresh
        if not fresh:
            break
    best = min(best, _whole(problem, columns, slack, until) or best, key=len)
    shown = np.logical_or.reduce([column.shows for column in best])
    percent = 100.0 * float(problem.weight[shown].sum() / problem.weight.sum())
    return SweepDesign(
        columns=tuple(best), bound=min(bound, len(best)), covered_percent=percent, generated=len(columns)
    )


def sweeps_for(scenario: Scenario) -> tuple[tuple[int, ...], SweepDesign]:
    """The fewest spacecraft that a scenario needs with planned sweeps: the visiting points they fly to, rising, and the design.

    Paths are those to the visiting points of its target, pictures those of the encounter's table; nothing fails.

    Raises:
        ScenarioError: It asks for what is designed without sweeps alone.
        MissionError: No design shows all but `designer.tolerance_percent`.
    """
    designer = scenario.designer
    for key in WITHOUT_SWEEPS:
        if getattr(designer, key) != type(designer).model_fields[key].default:
            raise ScenarioError(
                f"designer.{key}: must be left out of a design with sweeps; design without it or without them"
            )
    flights = fly_candidates(scenario.model_copy(update={"swarm": None}))
    found = fewest_sweeps(problem_of(encounter_of(flights.plan)), designer.tolerance_percent, designer.time_limit_s)
    return tuple(sorted(flights.points[column.path] for column in found.columns)), found


def _alone(problem: AllocationProblem, path: int, weight: Array) -> AllocationProblem:
    own = slice(path, path + 1)
    return AllocationProblem(
        weight=weight,
        shows=problem.shows[own],
        slew=problem.slew[own],
        budget=problem.budget[own],
        available=problem.available[own],
    )


def _column(alone: AllocationProblem, path: int, found: Allocation) -> Column:
    return Column(path, found.pictures[0], alone.shown_by(found.pictures))


def _greedy_design(problem: AllocationProblem, slack: float) -> list[Column]:
    """Path after path, the one whose greedy sweep shows most of what is missing."""
    left, design = problem.weight.copy(), list[Column]()
    while left.sum() > slack:
        free = set(range(problem.n_agents)) - {column.path for column in design}
        tried = [(alone := _alone(problem, path, left), path, greedy(alone)) for path in sorted(free)]
        most = max(tried, key=lambda one: one[2].value, default=None)
        if most is None or most[2].value <= 0.0:
            missing = 100.0 * float(left.sum() / problem.weight.sum())
            raise MissionError(
                f"{missing:.3g} % of the target stays unseen with {len(design)} of {problem.n_agents} paths flown, planned "
                "greedily; allow a larger tolerance, or more paths or pictures"
            )
        design.append(_column(*most))
        left[design[-1].shows] = 0.0
    return design


def _master(problem: AllocationProblem, columns: list[Column], slack: float) -> tuple[Array, csr_array, Array]:
    """Costs, rows in <=, one for each patch and the tolerance, and their right sides."""
    cost = np.concatenate([np.ones(len(columns)), np.zeros(problem.n_patches)])
    shown = csr_array(np.array([column.shows for column in columns]).T.astype(np.float64))
    scale = float(problem.weight.max())
    missed = csr_array(np.concatenate([np.zeros(len(columns)), problem.weight / scale])[None, :])
    rows = vstack([-hstack([shown, eye_array(problem.n_patches)]), missed], format="csr")
    return cost, rows, np.append(-np.ones(problem.n_patches), slack / scale)


def _prices(problem: AllocationProblem, columns: list[Column], slack: float) -> Array:
    """Duals of the patches, not negative, shape (p,)."""
    cost, rows, right = _master(problem, columns, slack)
    program = {"c": cost, "A_ub": rows, "b_ub": right, "bounds": (0.0, None), "options": {}}
    answer = highs.solve(program, None, by=linprog)
    if answer.status != 0:
        raise MissionError(f"HiGHS could not solve the problem: {answer.message}")
    return np.maximum(-answer.ineqlin.marginals[:-1], 0.0)


def _priced(problem: AllocationProblem, price: Array, until: float) -> tuple[list[Column], float]:
    """The sweep of largest price along every path, and a bound on the price of any."""
    found, dearest = [], 0.0
    for path in range(problem.n_agents):
        alone = _alone(problem, path, price)
        best = optimum(alone, max(until - time.perf_counter(), LEAST_S))
        found.append(_column(alone, path, best))
        dearest = max(dearest, best.bound)
    return found, dearest


def _farley(price: Array, weight: Array, slack: float) -> float:
    """Sum of prices that no column has more than 1 of, less the largest sum that may be missed."""
    order = np.argsort(-price / np.maximum(weight, 1e-300))
    before = np.concatenate([[0.0], np.cumsum(weight[order])[:-1]])
    missed = np.clip((slack - before) / np.maximum(weight[order], 1e-300), 0.0, 1.0)
    return float((price[order] * (1.0 - missed)).sum())


def _whole(problem: AllocationProblem, columns: list[Column], slack: float, until: float) -> list[Column] | None:
    """The fewest of the columns so far, one a path; None where none was found in time."""
    cost, rows, right = _master(problem, columns, slack)
    paths = np.array([column.path for column in columns])
    once = np.hstack([np.arange(problem.n_agents)[:, None] == paths, np.zeros((problem.n_agents, problem.n_patches))])
    constraints = [LinearConstraint(rows, -np.inf, right), LinearConstraint(once, -np.inf, 1.0)]
    answer = solve_program(cost, constraints, max(until - time.perf_counter(), LEAST_S))
    if answer.x is None:
        return None
    chosen = [columns[i] for i in np.flatnonzero(answer.x[: len(columns)] > 0.5)]
    missed = ~np.logical_or.reduce([column.shows for column in chosen])
    return chosen if problem.weight[missed].sum() <= slack else None
