"""Who speaks to Earth after a flight: elected at its end, and again where the scenario asks for it (section `data`).

The flight itself is not touched: in it the behaviour elects.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import xarray as xr

from swarm_mj.dataflow.relays import OfRelays, elect_by_delivery, k_medoids, medoid_cost, next_relays
from swarm_mj.flight.afterwards import Course, earthward
from swarm_mj.scenarios.schema import Scenario
from swarm_mj.simulator.telemetry import working
from swarm_mj.typing import Array, Ints, Mask


class Elections(NamedTuple):
    """Elections that changed who speaks to Earth, the first at the end of the flight.

    Attributes:
        time_s: When, past the epoch [s], rising, shape (e,).
        elected: Who speaks to Earth from then on, shape (e, n).
    """

    time_s: Array
    elected: Mask

    def relays_at(self, times: Array) -> Ints:
        """Numbers of those who speak to Earth at times after the flight [s], shape (m,): shape (m, k), some more than once."""
        counts = self.elected.sum(axis=1)
        relays = np.zeros((len(counts), int(counts.max())), np.int64)
        for row, who in zip(relays, self.elected, strict=True):
            row[:] = np.resize(np.flatnonzero(who), len(row))
        found: Ints = relays[np.maximum(np.searchsorted(self.time_s, times, side="right") - 1, 0)]
        return found


def elect_relays(
    scenario: Scenario, telemetry: xr.Dataset, course: Course, edges_s: Array, value_of: OfRelays, bound_of: OfRelays
) -> Elections:
    """Hold the elections that a scenario asks for.

    Where fewer spacecraft work than are to be elected, all that do speak to Earth. Relays that are lost later are replaced at
    the next election, if there is one.

    Args:
        scenario: What was flown.
        telemetry: The flight.
        course: Where the swarm is afterwards.
        edges_s: Edges of the slots [s]; who speaks to Earth changes at these, at the earliest after the time of election.
        value_of: What can be delivered with some relays.
        bound_of: What no schedule with them exceeds, in less time.
    """
    data, end_s = scenario.data, float(telemetry["time"].values[-1])
    r_N, works = telemetry["r_BN_N"].values[-1], working(telemetry)[-1]
    left = np.flatnonzero(works)
    if data.election == "delivery" and len(left):
        now = elect_by_delivery(value_of, left, min(data.relays, len(left)), bound_of=bound_of)
    else:
        now = candidates(scenario, r_N, works, earthward(telemetry))
    times_s, elected = [end_s], [now]
    for slot in election_slots(edges_s, end_s, data.election_interval_s):
        k = int(np.searchsorted(course.t, edges_s[slot]))
        r_N, works = course.r_BN_N[k], course.works[k]
        if not works.any():
            break
        candidate = candidates(scenario, r_N, works, now)
        costs = (_cost(r_N, works, now), _cost(r_N, works, candidate))
        following = next_relays(now, candidate, *costs, data.hysteresis)
        if set(following) != set(now):
            now = following
            times_s.append(float(edges_s[slot]))
            elected.append(now)
    return Elections(np.array(times_s), np.array([np.isin(np.arange(len(works)), who) for who in elected]))


def candidates(scenario: Scenario, r_N: Array, works: Mask, current: Ints) -> Ints:
    """Whom an election by positions or numbers comes to at one instant.

    Args:
        scenario: Says how many are elected, and by what rule.
        r_N: Positions, shape (n, 3) [m].
        works: Who works, shape (n,).
        current: Who speaks to Earth now, numbers from 0.

    Returns:
        Numbers, rising; none where nobody works.
    """
    left, data = np.flatnonzero(works), scenario.data
    k = min(data.relays, len(left))
    if not k:
        return left
    if data.election == "first":
        return left[:k]
    stay = np.intersect1d(current, left)
    if data.election == "flight" and len(stay):
        return stay
    return left[k_medoids(_distances(r_N[left]), k)]


def election_slots(edges_s: Array, end_s: float, interval_s: float | None) -> Ints:
    """Slots at whose start an election is held: the first that starts when an interval after the flight has passed.

    Args:
        edges_s: Edges of the slots [s], shape (T + 1,).
        end_s: End of the flight [s].
        interval_s: Between two elections [s]; None: none is held.
    """
    if interval_s is None:
        return np.empty(0, np.int64)
    passed = np.maximum(np.floor((edges_s[:-1] - end_s) / interval_s + 1e-9), 0.0)
    return np.flatnonzero(np.diff(passed, prepend=0.0) > 0.0)


def _cost(r_N: Array, works: Mask, relays: Ints) -> float:
    """Sum of distances from all that work to the nearest relay [m]; infinite where one of those does not."""
    if not len(relays) or not works[relays].all():
        return float("inf")
    return medoid_cost(_distances(r_N)[:, works], relays)


def _distances(r_N: Array) -> Array:
    return np.linalg.norm(r_N[:, None] - r_N[None], axis=2)
