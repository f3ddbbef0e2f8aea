"""Elections: which spacecraft speak to Earth, by where all are and by what would be delivered."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from itertools import combinations
from math import comb, isfinite

import numpy as np

from swarm_mj.errors import MissionError
from swarm_mj.typing import Array, Ints

#: Distances that the search through all sets may hold at once; beyond, PAM.
MOST_HELD = 5_000_000
#: Of relays, numbers rising: something that follows from who they are.
OfRelays = Callable[[tuple[int, ...]], float]
#: Candidates up to which every set is tried for what it delivers; beyond, sets are built up and exchanged.
ALL_SETS = 8
#: Relative difference of two costs that rounding and solvers may make of equal ones.
SAME = 1e-9


def k_medoids(distance: Array, k: int) -> Ints:
    """The k spacecraft with the least sum of distances from everybody to the nearest of them.

    All sets are tried where that is few (`MOST_HELD`). Beyond, partitioning around medoids (PAM: Kaufman and Rousseeuw 1990,
    "Finding Groups in Data", chapter 2), which ends where no exchange of one is better. The lowest numbers win ties, so that
    all who know the distances elect alike.

    Args:
        distance: From each to each, symmetric, shape (n, n); infinite where one cannot be reached.
        k: How many.

    Returns:
        Numbers from 0, rising, shape (k,).

    Raises:
        MissionError: There are fewer than k, or none is asked for.
    """
    n = len(distance)
    check_relays(k, n)
    if comb(n, k) * n > MOST_HELD:
        return np.array(
            _exchanged(range(n), k, lambda relays: medoid_cost(distance, relays), lambda _: -np.inf), np.int64
        )
    sets = np.array(list(combinations(range(n), k)), np.int64)
    nearest = distance[sets[:, 0]]
    for column in sets.T[1:]:
        np.minimum(nearest, distance[column], out=nearest)
    found: Ints = sets[np.argmin(nearest.sum(axis=1))]
    return found


def medoid_cost(distance: Array, relays: Sequence[int] | Ints) -> float:
    """Sum of distances from everybody to the nearest relay; infinite where there is none."""
    return float(distance[np.asarray(relays, np.int64)].min(axis=0, initial=np.inf).sum())


def elect_by_delivery(
    value_of: OfRelays, candidates: Sequence[int] | Ints, k: int, *, bound_of: OfRelays = lambda relays: np.inf
) -> Ints:
    """The k spacecraft with which most is delivered.

    Up to `ALL_SETS` candidates every set is tried. Beyond, the set is built up one by one and then exchanged one by one, as by
    PAM: nothing proves that no other set is better. Sets whose values differ by rounding (`SAME`) count as equal; the lowest
    numbers win.

    Args:
        value_of: What is delivered with a set, numbers rising; asked once for each set, of up to k.
        candidates: Who can be elected, numbers from 0.
        k: How many.
        bound_of: What `value_of` a set cannot exceed, where that is found in less time: sets for which it is no more than the
            best value so far are not tried.

    Returns:
        Numbers, rising, shape (k,).

    Raises:
        MissionError: There are fewer than k candidates, or none is asked for.
    """
    who = sorted(int(j) for j in candidates)
    check_relays(k, len(who))
    cost_of, least_of = _negative(value_of), _negative(bound_of)
    if len(who) > ALL_SETS:
        return np.array(_exchanged(who, k, cost_of, least_of), np.int64)
    return np.array(_cheapest(list(combinations(who, k)), cost_of, least_of), np.int64)


def _negative(value_of: OfRelays) -> OfRelays:
    return lambda relays: -float(value_of(relays))


def check_relays(k: int, n: int) -> None:
    """Refuse, by a MissionError, more relays than the n that work, or none."""
    if not 1 <= k <= n:
        raise MissionError(f"data.relays = {k}: must be >= 1 and <= {n}, the spacecraft that can be elected")


def _exchanged(who: Sequence[int], k: int, cost_of: OfRelays, least_of: OfRelays) -> tuple[int, ...]:
    """A set of k of which no exchange of one costs less: built up, then exchanged; each time the first of equals is taken."""
    cost_of, least_of = cache(cost_of), cache(least_of)
    now: tuple[int, ...] = ()
    for _ in range(k):
        now = _cheapest([_rising(now, j) for j in who if j not in now], cost_of, least_of)
    while True:
        others = [_rising([i for i in now if i != out], j) for out in now for j in who if j not in now]
        best = _cheapest([now, *others], cost_of, least_of)
        if best == now:
            return now
        now = best


def _rising(relays: Sequence[int], one_more: int) -> tuple[int, ...]:
    return tuple(sorted((*relays, one_more)))


def _cheapest(sets: Sequence[tuple[int, ...]], cost_of: OfRelays, least_of: OfRelays) -> tuple[int, ...]:
    """The first that no later one undercuts by more than rounding; what cannot, by `least_of`, is not asked for its cost."""
    best, cost = sets[0], cost_of(sets[0])
    for relays in sets[1:]:
        if not _undercuts(least_of(relays), cost):
            continue
        trial = cost_of(relays)
        if _undercuts(trial, cost):
            best, cost = relays, trial
    return best


def _undercuts(cost: float, other: float) -> bool:
    return cost < (other - SAME * abs(other) if isfinite(other) else other)


def next_relays(current: Ints, candidate: Ints, cost_current: float, cost_candidate: float, hysteresis: float) -> Ints:
    """Who speaks to Earth from now on: others only where they are better by a part of what the present ones cost.

    Args:
        current: Those that do, numbers.
        candidate: Those that would be elected now.
        cost_current: Of the current ones now, not negative; infinite where they cannot go on.
        cost_candidate: Of the others now.
        hysteresis: The part, 0 to 1 [-]; with 0 any gain suffices, with 1 none does.
    """
    if not isfinite(cost_current):
        return candidate
    return candidate if cost_candidate < (1.0 - hysteresis) * cost_current else current
