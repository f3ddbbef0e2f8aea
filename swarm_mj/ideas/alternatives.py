"""What else could be chosen, by the spacecraft designer and the bound of the observers: nothing is designed or flown for it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from pymoo.util.nds.non_dominated_sorting import NonDominatedSorting

from swarm_mj.ideas.requirement import Requirement
from swarm_mj.ideas.spacecraft import Encounter, Spacecraft, least_swarm_kg, spacecraft_options
from swarm_mj.scenarios.schema import Scenario

#: Resolutions of the alternatives over the one that is asked for.
RESOLUTIONS = (0.5, 0.7, 1.0, 1.4, 2.0)


class Alternative(NamedTuple):
    """A spacecraft that no other one beats in everything.

    Attributes:
        kind: Size, altitude and detector.
        resolution_m: That it samples [m].
        mass_kg: Of one [kg].
        power_w: In the mean of a day [W].
        send_h: Until its pictures are on Earth [h].
        least_kg: Lower bound of the swarm's mass [kg].
    """

    kind: str
    resolution_m: float
    mass_kg: float
    power_w: float
    send_h: float
    least_kg: float


def alternatives(asked: Requirement, scenario: Scenario, seen: Encounter) -> list[Alternative]:
    """Spacecraft of several resolutions, without those that another one beats in resolution, masses, power and time."""
    found = []
    for times in RESOLUTIONS:
        given = asked.with_value("resolution_m", times * asked.resolution_m)
        for *_, one in spacecraft_options(given, scenario, seen):
            if isinstance(one, Spacecraft):
                least = least_swarm_kg(given, seen, one)
                found.append(Alternative(one.name, given.resolution_m, one.mass_kg, one.power_w, one.send_h, least))
    if not found:
        return []
    values = np.round(np.array([one[1:] for one in found]), 9)
    _, first = np.unique(values, axis=0, return_index=True)  # of those that are alike the first
    values, found = values[np.sort(first)], [found[k] for k in np.sort(first)]
    front = NonDominatedSorting().do(values, only_non_dominated_front=True)
    return [found[k] for k in sorted(front)]
