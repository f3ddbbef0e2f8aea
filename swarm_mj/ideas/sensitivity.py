"""Which requirement drives: each value alone, and all of them at once by Sobol' indices.

Both by the spacecraft designer and the bound of the observers: no swarm is designed or flown for it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.stats import qmc

from swarm_mj.campaigns.statistics import sobol
from swarm_mj.ideas.requirement import Requirement
from swarm_mj.ideas.spacecraft import Encounter, Spacecraft, least_observers, least_swarm_kg, spacecraft_options
from swarm_mj.io.machine import usable_cores
from swarm_mj.io.workers import run_jobs
from swarm_mj.scenarios.schema import Scenario
from swarm_mj.typing import Array

#: By what factor values are changed.
CHANGE = 1.2
#: Values that are changed, by key, and the least and the most that they may become.
DRIVERS = {
    **dict.fromkeys(
        ("resolution_m", "min_snr", "max_blur_px", "deliver_within_h", "delta_v_m_s", "turn_s"),
        (0.0, np.inf),
    ),
    "share_percent": (0.0, 100.0),
    "contact_h": (0.0, 24.0),
    "listen_share": (0.0, 1.0),
    **dict.fromkeys(("margins.mass", "margins.power"), (0.0, np.inf)),
    **dict.fromkeys(("margins.relief", "margins.overlap"), (1.0, np.inf)),
    **dict.fromkeys(("margins.cells", "margins.battery"), (0.0, 1.0)),
}
#: What Sobol' indices are of: of the lightest swarm by its bound, and whether any can be built.
OUTCOMES = ("can_be_built", "observers", "swarm_kg", "send_h")


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


class Index(NamedTuple):
    """A Sobol' index pair: the share of an outcome's variance by a value alone, and with its interactions.

    Attributes:
        outcome: Of `OUTCOMES`.
        key: Which value is changed.
        first: By the value alone, and its 95 % interval by bootstrap.
        first_low: Likewise.
        first_high: Likewise.
        total: With interactions, likewise.
        total_low: Likewise.
        total_high: Likewise.
    """

    outcome: str
    key: str
    first: float
    first_low: float
    first_high: float
    total: float
    total_low: float
    total_high: float


def _ends(asked: Requirement) -> dict[str, tuple[float, float]]:
    """Least and largest of each value that is not 0."""
    found = {}
    for key, (least, most) in DRIVERS.items():
        if (value := asked.value(key)) != 0.0:
            found[key] = max(value / CHANGE, least), min(value * CHANGE, most)
    return found


def drivers(asked: Requirement, scenario: Scenario, seen: Encounter) -> list[Driver]:
    """What each value alone does to the lightest swarm, the strongest first."""
    found = []
    for key, ends in _ends(asked).items():
        lower, higher = (_lightest(asked.with_value(key, end), scenario, seen)[1] for end in ends)
        found.append(Driver(key, asked.value(key), ends[0], lower, ends[1], higher))
    now = _lightest(asked, scenario, seen)[1]
    return sorted(found, key=lambda one: -_swing(one, now))


def _swing(one: Driver, now: float | None) -> float:
    """By how much a value moves the mass; what makes a swarm impossible, or possible, the most."""
    ends = [one.lower_kg, one.higher_kg, now]
    known = [mass for mass in ends if mass is not None]
    return np.inf if 0 < len(known) < len(ends) else max(known, default=0.0) - min(known, default=0.0)


def _lightest(asked: Requirement, scenario: Scenario, seen: Encounter) -> tuple[int | None, float | None, float | None]:
    """Observers, mass [kg] and time until all is on Earth [h] of the swarm with the least bound; None: none can be built."""
    built = [one for *_, one in spacecraft_options(asked, scenario, seen) if isinstance(one, Spacecraft)]
    best = min(built, key=lambda one: least_swarm_kg(asked, seen, one), default=None)
    if best is None:
        return None, None, None
    return least_observers(asked, seen, best.payload), least_swarm_kg(asked, seen, best), best.send_h


def sobol_indices(
    asked: Requirement,
    scenario: Scenario,
    seen: Encounter,
    *,
    workers: int | None = None,
    tell: Callable[[float], None],
) -> tuple[list[Index], float]:
    """Sobol' indices of the lightest swarm over all values at once, each evenly between its ends.

    Args:
        asked: The requirement; its `sobol` says how many points each of the two base samples has.
        scenario: As of `chain.encounter_of`.
        seen: Likewise.
        workers: Processes; None: one per core.
        tell: Told the share that is done.

    Returns:
        The indices of each outcome that varies and that every point of the sample has; and the share of points of which no
        spacecraft can be built.
    """
    ends = _ends(asked)
    low, high = np.array(list(ends.values())).T
    base = qmc.Sobol(2 * len(ends), rng=np.random.default_rng(0)).random(asked.sobol).reshape(asked.sobol, 2, -1)
    points = np.repeat(base[:, :1], len(ends) + 2, axis=1)
    points[:, 1] = base[:, 1]
    for k in range(len(ends)):
        points[:, 2 + k, k] = base[:, 1, k]
    values = (low + (high - low) * points).reshape(-1, len(ends))
    found = np.full((len(values), len(OUTCOMES)), np.nan)
    jobs = ((row, (dict(zip(ends, map(float, point), strict=True)),)) for row, point in enumerate(values))
    arguments = (asked.model_dump_json(), scenario, seen)
    count = workers or usable_cores()
    for done, (row, outcome) in enumerate(run_jobs(jobs, _outcome, workers=count, setup=_opened, arguments=arguments)):
        found[row] = outcome
        tell((done + 1) / len(values))
    unbuilt = 1.0 - float(found[:, 0].mean())
    return _indices(list(ends), found.reshape(asked.sobol, len(ends) + 2, len(OUTCOMES))), unbuilt


def _opened(asked: str, scenario: Scenario, seen: Encounter) -> tuple[Requirement, Scenario, Encounter]:
    return Requirement.model_validate_json(asked), scenario, seen


def _outcome(state: tuple[Requirement, Scenario, Encounter], values: dict[str, float]) -> tuple[float, ...]:
    """The outcomes of a point, NaN where no spacecraft can be built."""
    asked, scenario, seen = state
    for key, value in values.items():
        asked = asked.with_value(key, value)
    found = _lightest(asked, scenario, seen)
    return (float(found[0] is not None), *(np.nan if value is None else float(value) for value in found))


def _indices(keys: list[str], found: Array) -> list[Index]:
    rows = []
    for k, outcome in enumerate(OUTCOMES):
        if not np.isfinite(found[..., k]).all():
            continue
        indices = sobol(found[..., k], np.random.default_rng(0))
        if indices is not None:
            for key, alone, whole in zip(keys, *indices, strict=True):
                ends = (alone.value, alone.low, alone.high, whole.value, whole.low, whole.high)
                rows.append(Index(outcome, key, *map(float, ends)))
    return rows
