"""Visiting points from which the loss of a spacecraft hurts least, chosen together with the pictures.

Each candidate's pictures are planned as if it flew alone, by the table of the encounter. Chosen are the points of which the
plans show most area, what two of them show counted twice: greedy choice of a submodular value, which reaches 1 - 1/e of the
best at least (Nemhauser, Wolsey and Fisher 1978).
"""

from __future__ import annotations

import numpy as np

from swarm_mj.coordination.allocation.problem import Schedule
from swarm_mj.coordination.replanning import planned_alone, problem_of
from swarm_mj.designer.candidates.flights import fly_candidates
from swarm_mj.errors import ScenarioError
from swarm_mj.flight.encounter_table import encounter_of
from swarm_mj.scenarios.schema import Scenario
from swarm_mj.typing import Array, Mask

#: How many spacecraft should be able to show each part: with two, one may be lost.
FOLD = 2


def robust_points(scenario: Scenario) -> tuple[int, ...]:
    """As many visiting points as a scenario has observers, rising; it says how they are flown to, and with which camera.

    Raises:
        ScenarioError: There are fewer points that can be flown to.
        SwarmError: None of the points can.
    """
    wanted = len(scenario.design.visiting_points)
    flights = fly_candidates(scenario.model_copy(update={"swarm": None}))
    if wanted > len(flights.points):
        raise ScenarioError(
            f"observers = {wanted}: must be at most {len(flights.points)}, the visiting points that can be flown to"
        )
    encounter = encounter_of(flights.plan)
    problem, alone = problem_of(encounter), planned_alone(encounter).pictures
    nobody: tuple[Schedule, ...] = ((),) * len(alone)
    shown = np.array([problem.shown_by((*nobody[:j], taken, *nobody[j + 1 :])) for j, taken in enumerate(alone)])
    return tuple(sorted(flights.points[j] for j in most_shown(shown, encounter.area, wanted)))


def most_shown(shown: Mask, area: Array, count: int) -> list[int]:
    """Numbers of so many candidates chosen one by one, each the one that adds most; the lowest of equal ones.

    A cell counts `FOLD` times; what each candidate shows has shape (candidates, cells), the cells' areas (cells,) [m^2].
    """
    chosen: list[int] = []
    times = np.zeros(len(area), np.int64)
    for _ in range(count):
        gain = (shown & (times < FOLD)) @ area
        gain[chosen] = -1.0
        best = int(np.argmax(gain))
        chosen.append(best)
        times += shown[best]
    return chosen
