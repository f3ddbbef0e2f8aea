"""What a replanned swarm can do at most after a loss: the best plan of those that are left, made knowing all at once."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from swarm_mj.coordination.allocation.optimum import optimum
from swarm_mj.coordination.replanning import problem_of
from swarm_mj.flight.encounter_table import encounter_of
from swarm_mj.flight.plan import as_planned, make_plan
from swarm_mj.scenarios.schema import Scenario


class LossBound(NamedTuple):
    """The table's problem without one observer, lost before its first picture.

    Attributes:
        spacecraft: Who is lost; empty: nobody.
        in_view: Area that the others could show with all pictures of the table, turns left out [%].
        best: Area of the best plan found for them [%].
        bound: No plan has more [%].
    """

    spacecraft: str
    in_view: float
    best: float
    bound: float


def loss_bounds(scenario: Scenario, time_limit_s: float = 6.0) -> list[LossBound]:
    """For nobody and for each observer lost: what those that are left can still show, by an omniscient plan.

    Args:
        scenario: Faults and dispersions are left out.
        time_limit_s: For each plan and its proof [s].

    Raises:
        SwarmError: The scenario cannot be planned.
    """
    plan = make_plan(as_planned(scenario))
    encounter = encounter_of(plan)
    problem, percent = problem_of(encounter), 100.0 / float(encounter.area.sum())
    found = []
    for lost in range(-1, plan.n_observers):
        left = np.arange(problem.n_agents) != lost
        rest = replace(problem, available=np.tile(left[:, None], (1, problem.n_slots)))
        best = optimum(rest, time_limit_s)
        name = plan.names[lost] if lost >= 0 else ""
        found.append(LossBound(name, percent * rest.coverable, percent * best.value, percent * best.bound))
    return found
