"""The reward, term by term; `SwarmObserveEnv` says what each one means."""

from __future__ import annotations

from collections.abc import Mapping

from swarm_mj.errors import ScenarioError
from swarm_mj.typing import Array, Ints, Mask, kernel

from .arguments import is_number

#: Weight of each term. The first two reach 1 each when the whole target is seen and delivered at nominal volume.
DEFAULT_WEIGHTS = {"seen": 1.0, "delivered": 1.0, "effort": -0.02, "saturation": -0.1, "approach": -0.1, "loss": -1.0}

#: Names of the terms in their order.
TERMS = tuple(DEFAULT_WEIGHTS)


def checked_weights(given: Mapping[str, float] | None) -> dict[str, float]:
    """All weights, with those given in place of the defaults.

    Raises:
        ScenarioError: It is no mapping, a name is unknown or a weight is not a finite number.
    """
    weights = dict(DEFAULT_WEIGHTS)
    if given is not None and not isinstance(given, Mapping):
        raise ScenarioError(
            f"reward_weights = {given!r}: must be a mapping from terms to numbers; terms are {', '.join(weights)}"
        )
    for name, value in (given or {}).items():
        if name not in weights:
            raise ScenarioError(f"reward_weights: unknown term {name!r}; there are {', '.join(weights)}")
        if not is_number(value):
            raise ScenarioError(f"reward_weights[{name!r}] = {value!r}: must be a finite number")
        weights[name] = float(value)
    return weights


#: How an episode can end by itself; 0 goes on.
ENDS = ("", "complete", "impact", "lost", "diverged")
_COMPLETE, _IMPACT, _LOST, _DIVERGED = 1, 2, 3, 4


@kernel
def _end(impact: bool, complete: bool, lost: bool) -> int:
    """The number in `ENDS` of how a flight with a finite state ends, 0 if it goes on."""
    if impact:
        return _IMPACT
    if complete:
        return _COMPLETE
    return _LOST if lost else 0


@kernel
def settle(
    prices: Array,
    tick: Ints,
    live: Mask,
    flying: Mask,
    area: Array,
    effort: Array,
    measures: Array,
    hit: Mask,
    gone: Mask,
    lost: Mask,
    stored: Array,
    percent: Array,
    terms: Array,
    reward: Array,
    end: Ints,
    truncated: Mask,
) -> None:
    """Rewards and ends of a step, flight by flight.

    Args:
        prices: Area of the target [m^2], nominal volume [bit], the step's share of the flight, what the sum of squared torques
            is divided by [N^2 m^2], share that counts as complete [%], volume that counts as nothing [bit], last tick, whether
            flights go on without a spacecraft that is lost (1 or 0), and the six weights, shape (14,).
        tick: Control periods flown, shape (E,).
        live: Flights that began this step, shape (E,).
        flying: Those that ended it with a finite state, shape (E,).
        area: Newly seen, shape (E,) [m^2].
        effort: Sum of squared motor torques, shape (E,) [N^2 m^2].
        measures: Delivered bits, saturation, share of close pairs, shape (E, 3).
        hit: Spacecraft that hit the body, shape (E, n).
        gone: Spacecraft newly lost to faults, shape (E, n).
        lost: All that are lost, shape (E, n); those that hit are added where flights go on.
        stored: Data aboard, shape (E, n) [bit].
        percent: Seen share, shape (E,) [%].
        terms: Receives the weighted terms in the order of `TERMS`, shape (E, 6).
        reward: Receives their sum, shape (E,).
        end: Receives the number in `ENDS`, shape (E,).
        truncated: Receives whether the duration is over, shape (E,).
    """
    n, share, go_on = hit.shape[1], prices[2], prices[7] == 1.0
    for e in range(live.shape[0]):
        if not live[e]:
            continue
        if not flying[e]:
            terms[e, 5] = prices[13]
            reward[e], end[e] = terms[e, 5], _DIVERGED
            continue
        hits = losses = alive = 0
        aboard = 0.0
        for j in range(n):
            hits += hit[e, j]
            losses += hit[e, j] or gone[e, j]
            if go_on and hit[e, j]:
                lost[e, j] = True
            if not lost[e, j]:
                alive += 1
                aboard += stored[e, j]
        terms[e, 0] = prices[8] * (area[e] / prices[0])
        terms[e, 1] = prices[9] * (measures[e, 0] / prices[1])
        terms[e, 2] = prices[10] * (share * (effort[e] / prices[3]))
        terms[e, 3] = prices[11] * (share * measures[e, 1])
        terms[e, 4] = prices[12] * (share * measures[e, 2])
        terms[e, 5] = prices[13] * (losses if go_on else min(1, hits))
        for k in range(6):
            reward[e] += terms[e, k]
        complete = percent[e] >= prices[4] and aboard <= prices[5]
        end[e] = _end(hits > 0 and not go_on, complete, alive == 0)
        truncated[e] = end[e] == 0 and tick[e] >= prices[6]
