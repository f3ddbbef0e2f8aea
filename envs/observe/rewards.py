"""The reward, term by term, and how an episode ends; `SwarmObserveEnv` has the table of terms.

Each term is its scale times a measure of the step, and the measures that are sums over time are shares of the whole flight, so
that an episode's return does not depend on the length of a step.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from swarm_mj.errors import ScenarioError
from swarm_mj.smallbody.occultation import Occluder, way_blocked
from swarm_mj.typing import Array, Array32, Ints, Mask, lean

from ..arguments import is_number
from .kinematics import Kinematics
from .totals import EpisodeTotals

#: Wheel speed over its limit from which on saturation costs.
SATURATION_FROM = 0.9


class RewardScales(NamedTuple):
    """Weight of each term; the first two terms reach 1 each when the whole target is seen and delivered at nominal volume.

    Attributes:
        seen: Of newly seen area over the target's area.
        delivered: Of data that Earth received over the nominal volume.
        effort: Of the mean square of motor torques over their limit, times step over duration.
        saturation: Of the mean share by which wheels are in the last tenth below their top speed, times step over duration.
        approach: Of the share of pairs of spacecraft that come too close, times step over duration.
        loss: Of an impact on the body, or divergence.
    """

    seen: float = 1.0
    delivered: float = 1.0
    effort: float = -0.02
    saturation: float = -0.1
    approach: float = -0.1
    loss: float = -1.0


class RewardTerms(NamedTuple):
    """The terms of `RewardScales`, weighted, each of shape (E,)."""

    seen: Array
    delivered: Array
    effort: Array
    saturation: Array
    approach: Array
    loss: Array


#: Names of the terms in their order.
TERMS = RewardScales._fields

#: How an episode can end by itself; 0 goes on.
ENDS = ("", "complete", "impact", "lost", "diverged", "horizon")
_GOES_ON, _COMPLETE, _IMPACT, _LOST, _DIVERGED, _HORIZON = range(6)


def checked_scales(given: Mapping[str, float] | None) -> RewardScales:
    """All weights, with those given in place of the defaults.

    Raises:
        ScenarioError: It is no mapping, a name is unknown or a weight is not a finite number.
    """
    if given is not None and not isinstance(given, Mapping):
        raise ScenarioError(
            f"reward_weights = {given!r}: must be a mapping from terms to numbers; terms are {', '.join(TERMS)}"
        )
    for name, value in (given or {}).items():
        if name not in TERMS:
            raise ScenarioError(f"reward_weights: unknown term {name!r}; there are {', '.join(TERMS)}")
        if not is_number(value):
            raise ScenarioError(f"reward_weights[{name!r}] = {value!r}: must be a finite number")
    return RewardScales(**{name: float(value) for name, value in (given or {}).items()})


class Flown(NamedTuple):
    """What the simulation tells of a step of E flights of n spacecraft.

    Attributes:
        tick: Control periods flown since the start, shape (E,).
        live: Flights that began the step, shape (E,).
        finite: Those that ended it with a finite state, shape (E,).
        area: Newly seen, shape (E,) [m^2].
        effort: Sum of squared motor torques, shape (E,) [N^2 m^2].
        failed: Spacecraft newly lost to faults, shape (E, n).
    """

    tick: Ints
    live: Mask
    finite: Mask
    area: Array
    effort: Array
    failed: Mask


class Hazards(NamedTuple):
    """How dangerous a step was.

    Attributes:
        saturation: Mean share by which wheels are in the last tenth below their top speed, shape (E,).
        close_pairs: Share of the pairs of spacecraft that came too close, shape (E,).
        hit: Spacecraft that hit the body, shape (E, n).
    """

    saturation: Array
    close_pairs: Array
    hit: Mask


class HazardLimits(NamedTuple):
    """Beyond which a flight becomes dangerous.

    Attributes:
        max_wheel_speed: Top speed of the wheels [rad/s].
        min_separation_m: Of two spacecraft [m].
        separation_grace_s: Steps that begin earlier than this are excused: all come from one place [s].
    """

    max_wheel_speed: float
    min_separation_m: float
    separation_grace_s: float


@lean
def measure_hazards(
    limits: HazardLimits,
    body: Occluder,
    before: Kinematics,
    now: Kinematics,
    lost: Mask,
    live: Mask,
    hazards: Hazards,
) -> None:
    """How near the wheels are to saturation, the spacecraft to each other, and which hit the body.

    Args:
        limits: See `HazardLimits`.
        body: The asteroid.
        before: At the beginning of the step.
        now: At its end.
        lost: Spacecraft that are no more, shape (E, n).
        live: Which flights, shape (E,); the others are in no danger.
        hazards: Receives the answer.
    """
    for e in range(lost.shape[0]):
        hazards.saturation[e] = hazards.close_pairs[e] = 0.0
        for j in range(lost.shape[1]):
            hazards.hit[e, j] = False
        if live[e]:
            hazards.saturation[e] = _saturation(now.wheel[e], limits.max_wheel_speed)
            if before.t[e] >= limits.separation_grace_s:
                hazards.close_pairs[e] = _close_pairs(before.r[e], now.r[e], lost[e], limits.min_separation_m)
            for j in range(lost.shape[1]):
                flies = not lost[e, j]
                hazards.hit[e, j] = flies and way_blocked(before.r_A[e, j], now.r_A[e, j], body)


@lean
def _saturation(wheel: Array, top_speed: float) -> float:
    total, n, wheels = 0.0, wheel.shape[0], wheel.shape[1]
    for j in range(n):
        for w in range(wheels):
            share = abs(wheel[j, w]) / top_speed
            total += min(1.0, max(0.0, (share - SATURATION_FROM) / (1.0 - SATURATION_FROM)))
    return total / (n * wheels)


@lean
def _close_pairs(before_N: Array, now_N: Array, lost: Mask, least: float) -> float:
    """Share of the pairs that came closer than `least` [m]; the relative motion within the step is taken as straight."""
    n, near = now_N.shape[0], 0
    if n < 2:
        return 0.0
    for i in range(n):
        for j in range(i + 1, n):
            if lost[i] or lost[j]:
                continue
            along = square = first = 0.0
            for k in range(3):
                d = before_N[j, k] - before_N[i, k]
                s = (now_N[j, k] - now_N[i, k]) - d
                along, square, first = along + d * s, square + s * s, first + d * d
            share = min(1.0, max(0.0, -along / square)) if square > 0.0 else 0.0
            if first + share * (2.0 * along + share * square) < least * least:
                near += 1
    return near / (n * (n - 1) / 2)


class RewardConstants(NamedTuple):
    """What turns measures into rewards and ends.

    Attributes:
        scales: Weight of each term.
        target_area_m2: Of the target [m^2].
        nominal_bit: Volume of the whole target seen straight down from the imaging altitude [bit].
        step_share: Length of a step over that of the flight.
        max_effort: Sum of squared motor torques of a step at the limit [N^2 m^2].
        complete_percent: Seen share that counts as complete [%].
        empty_bit: Data aboard that count as none [bit].
        last_tick: Control periods in the flight.
        continues_after_impact: Whether flights go on without a spacecraft that hit the body.
    """

    scales: RewardScales
    target_area_m2: float
    nominal_bit: float
    step_share: float
    max_effort: float
    complete_percent: float
    empty_bit: float
    last_tick: int
    continues_after_impact: bool


class StepResult(NamedTuple):
    """Rewards and ends of a step of E flights.

    Attributes:
        terms: Weighted terms, each of shape (E,).
        reward: Their sum, shape (E,).
        end: Number in `ENDS`, shape (E,).
        truncated: Whether the flight is over by its duration, shape (E,).
        hit: Spacecraft that hit the body in the step, shape (E, n).
    """

    terms: RewardTerms
    reward: Array
    end: Ints
    truncated: Mask
    hit: Mask

    def terms_of(self, e: int) -> dict[str, float]:
        """The weighted terms of flight e by name."""
        return {name: float(values[e]) for name, values in zip(TERMS, self.terms, strict=True)}


def horizon_ended(result: StepResult) -> StepResult:
    """The same with flights that are over by their duration reported as ended, not as truncated."""
    end = np.where(result.truncated, _HORIZON, result.end)
    return result._replace(end=end, truncated=np.zeros_like(result.truncated))


def joined(results: Sequence[StepResult]) -> StepResult:
    """The results of several batches as those of one, copies."""
    terms = RewardTerms(*map(np.concatenate, zip(*(result.terms for result in results), strict=True)))
    rest = (np.concatenate(values) for values in zip(*(result[1:] for result in results), strict=True))
    return StepResult(terms, *rest)


class Outcome(NamedTuple):
    """What the end of a step writes.

    Attributes:
        observation: Of every flight, shape (E, F).
        received: By Earth in the step, shape (E,) [bit].
        hazards: How dangerous it was.
        result: Rewards and ends.
    """

    observation: Array32
    received: Array
    hazards: Hazards
    result: StepResult


def no_outcome(observation: Array32, n: int) -> Outcome:
    """Of flights of n spacecraft, before anything has happened; their observations go into an array of the caller."""
    count = len(observation)
    zero, hit = np.zeros((10, count)), np.zeros((count, n), np.bool_)
    terms = RewardTerms(*zero[:6])
    result = StepResult(terms, zero[6], np.zeros(count, np.int64), np.zeros(count, np.bool_), hit)
    return Outcome(observation, zero[7], Hazards(zero[8], zero[9], hit), result)


@lean
def compute_rewards(
    constants: RewardConstants,
    flown: Flown,
    delivered: Array,
    hazards: Hazards,
    totals: EpisodeTotals,
    result: StepResult,
) -> None:
    """Rewards and ends of a step, flight by flight; zero of the flights that did not begin it.

    Args:
        constants: See `RewardConstants`.
        flown: What the simulation tells.
        delivered: Received by Earth in the step, shape (E,) [bit].
        hazards: How dangerous it was.
        totals: What the flights have come to; spacecraft that hit the body become lost where flights go on.
        result: Receives them.
    """
    for e in range(flown.live.shape[0]):
        result.reward[e], result.end[e], result.truncated[e] = 0.0, _GOES_ON, False
        for term in result.terms:
            term[e] = 0.0
        if not flown.live[e]:
            continue
        if flown.finite[e]:
            if constants.continues_after_impact:
                for j in range(totals.lost.shape[1]):
                    totals.lost[e, j] = totals.lost[e, j] or hazards.hit[e, j]
            _write_terms(constants, flown, delivered[e], hazards, e, result.terms)
            result.end[e] = _end(constants, hazards.hit[e], totals, e)
            result.truncated[e] = result.end[e] == _GOES_ON and flown.tick[e] >= constants.last_tick
        else:
            result.terms.loss[e], result.end[e] = constants.scales.loss, _DIVERGED
        for term in result.terms:
            result.reward[e] += term[e]


@lean
def _write_terms(
    constants: RewardConstants, flown: Flown, delivered: float, hazards: Hazards, e: int, terms: RewardTerms
) -> None:
    scales, share = constants.scales, constants.step_share
    hits = losses = 0
    for j in range(hazards.hit.shape[1]):
        hits += hazards.hit[e, j]
        losses += hazards.hit[e, j] or flown.failed[e, j]
    terms.seen[e] = scales.seen * (flown.area[e] / constants.target_area_m2)
    terms.delivered[e] = scales.delivered * (delivered / constants.nominal_bit)
    terms.effort[e] = scales.effort * (share * (flown.effort[e] / constants.max_effort))
    terms.saturation[e] = scales.saturation * (share * hazards.saturation[e])
    terms.approach[e] = scales.approach * (share * hazards.close_pairs[e])
    terms.loss[e] = scales.loss * (losses if constants.continues_after_impact else min(1, hits))


@lean
def _end(constants: RewardConstants, hit: Mask, totals: EpisodeTotals, e: int) -> int:
    """The number in `ENDS` of how a flight with a finite state ends, 0 if it goes on."""
    any_hit, alive, aboard = False, 0, 0.0
    for j in range(totals.lost.shape[1]):
        any_hit = any_hit or hit[j]
        if not totals.lost[e, j]:
            alive += 1
            aboard += totals.stored[e, j]
    if any_hit and not constants.continues_after_impact:
        return _IMPACT
    if totals.percent[e] >= constants.complete_percent and aboard <= constants.empty_bit:
        return _COMPLETE
    return _LOST if alive == 0 else _GOES_ON
