"""What else could be chosen, and which requirement drives the swarm.

Both by the spacecraft designer and the bound of the observers alone: the swarms are not designed and not flown.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from pymoo.util.nds.non_dominated_sorting import NonDominatedSorting

from swarm_mj.ideas.requirement import Requirement
from swarm_mj.ideas.spacecraft import Encounter, Spacecraft, least_observers, spacecraft_options
from swarm_mj.scenarios.schema import Scenario

#: Resolutions of the alternatives over the one that is asked for.
RESOLUTIONS = (0.5, 0.7, 1.0, 1.4, 2.0)
#: By what factor values are changed, one at a time.
CHANGE = 1.2
#: Values that are changed, by key.
DRIVERS = (
    *(
        "resolution_m",
        "share_percent",
        "min_snr",
        "max_blur_px",
        "deliver_within_h",
        "contact_h",
        "delta_v_m_s",
        "turn_s",
    ),
    *("margins.mass", "margins.power", "margins.relief", "margins.overlap", "margins.cells", "margins.battery"),
)


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


class Driver(NamedTuple):
    """What a value of the requirement does.

    Attributes:
        key: Which.
        value: That is asked for.
        lower: Value that is asked for less, over `CHANGE` times.
        lower_kg: Lower bound of the lightest swarm's mass with that; None: none can be built.
        higher: Value over that, `CHANGE` times as much.
        higher_kg: Likewise.
    """

    key: str
    value: float
    lower: float
    lower_kg: float | None
    higher: float
    higher_kg: float | None


def alternatives(asked: Requirement, scenario: Scenario, seen: Encounter) -> list[Alternative]:
    """Spacecraft of several resolutions, without those that another one beats in resolution, masses, power and time."""
    found = []
    for times in RESOLUTIONS:
        given = asked.model_copy(update={"resolution_m": times * asked.resolution_m})
        for *_, one in spacecraft_options(given, scenario, seen):
            if isinstance(one, Spacecraft):
                least = least_observers(given, seen, one.payload) * one.mass_kg
                found.append(Alternative(one.name, given.resolution_m, one.mass_kg, one.power_w, one.send_h, least))
    if not found:
        return []
    values = np.round(np.array([one[1:] for one in found]), 9)
    _, first = np.unique(values, axis=0, return_index=True)  # of those that are alike the first
    values, found = values[np.sort(first)], [found[k] for k in np.sort(first)]
    front = NonDominatedSorting().do(values, only_non_dominated_front=True)
    return [found[k] for k in sorted(front)]


def drivers(asked: Requirement, scenario: Scenario, seen: Encounter) -> list[Driver]:
    """What each value alone does to the lightest swarm, the strongest first."""
    found = []
    for key in DRIVERS:
        value = value_of(asked, key)
        if value == 0.0:
            continue
        ends = [value / CHANGE, value * CHANGE]
        if key == "share_percent":
            ends[1] = min(ends[1], 100.0)
        if key in ("margins.cells", "margins.battery"):
            ends[1] = min(ends[1], 1.0)
        if key == "margins.relief":
            ends[0] = max(ends[0], 1.0)
        lower, higher = (_lightest(changed(asked, key, end), scenario, seen) for end in ends)
        found.append(Driver(key, value, ends[0], lower, ends[1], higher))
    now = _lightest(asked, scenario, seen)
    return sorted(found, key=lambda one: -_swing(one, now))


def _swing(one: Driver, now: float | None) -> float:
    """By how much a value moves the mass; what makes a swarm impossible, or possible, the most."""
    ends = [one.lower_kg, one.higher_kg, now]
    known = [mass for mass in ends if mass is not None]
    return np.inf if 0 < len(known) < len(ends) else max(known, default=0.0) - min(known, default=0.0)


def _lightest(asked: Requirement, scenario: Scenario, seen: Encounter) -> float | None:
    masses = [
        least_observers(asked, seen, one.payload) * one.mass_kg
        for *_, one in spacecraft_options(asked, scenario, seen)
        if isinstance(one, Spacecraft)
    ]
    return min(masses, default=None)


def value_of(asked: Requirement, key: str) -> float:
    """A number of a requirement by its dotted key."""
    section, _, name = key.rpartition(".")
    return float(getattr(getattr(asked, section) if section else asked, name))


def changed(asked: Requirement, key: str, value: float) -> Requirement:
    """A requirement with another number at a dotted key."""
    section, _, name = key.rpartition(".")
    if not section:
        return asked.model_copy(update={name: value})
    return asked.model_copy(update={section: getattr(asked, section).model_copy(update={name: value})})
