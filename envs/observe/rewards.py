"""The reward, term by term, and how an episode ends; `SwarmObserveEnv` has the table of terms.

The reward of a step is the sum of its terms, and each term its weight times its measure of the step. Measures that are sums
over time are shares of the whole flight, so that an episode's return does not depend on the length of a step.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from swarm_mj.compilation import allocation_free, kernel
from swarm_mj.smallbody.occultation import Occluder, way_blocked
from swarm_mj.typing import Array, Ints, Mask

from .kinematics import Kinematics, PerMission, Tracking
from .radio import RadioConstants, transmit
from .totals import EpisodeTotals

#: Wheel speed over its limit from which on saturation costs.
SATURATION_FROM = 0.9


class RewardWeights(NamedTuple):
    """Weight of each term's measure; the first two terms reach 1 each where all that is possible is seen and delivered.

    Attributes:
        seen: Of newly seen area over what is possible in the episode.
        delivered: Of data that Earth received over the volume of what is possible.
        effort: Of the mean square of motor torques over their limit, times step over duration.
        saturation: Of the mean share by which wheels are in the last tenth below their top speed, times step over duration.
        approach: Of the share of pairs of spacecraft that come too close, times step over duration.
        loss: Of the spacecraft that hit the body, or of divergence.
    """

    seen: float = 1.0
    delivered: float = 1.0
    effort: float = -0.02
    saturation: float = -0.1
    approach: float = -0.1
    loss: float = -1.0


#: Names of the terms in their order.
TERMS = RewardWeights._fields
_SEEN, _DELIVERED, _EFFORT, _SATURATION, _APPROACH, _LOSS = range(len(TERMS))

#: How an episode can end by itself; 0 goes on.
ENDS = ("", "complete", "lost", "diverged", "horizon")
_GOES_ON, _COMPLETE, _LOST, _DIVERGED, _HORIZON = range(len(ENDS))


class StepFacts(NamedTuple):
    """What the simulation tells of a step of E flights.

    Attributes:
        tick: Control periods flown since the start, shape (E,).
        live: Flights that began the step, shape (E,).
        finite: Those that ended it with a finite state, shape (E,).
        area: Newly seen, shape (E,) [m^2].
        effort: Sum of squared motor torques, shape (E,) [N^2 m^2].
        possible: Area that can be seen in the episode, shape (E,) [m^2].
    """

    tick: Ints
    live: Mask
    finite: Mask
    area: Array
    effort: Array
    possible: Array


class Measures(NamedTuple):
    """What is measured of a step.

    Attributes:
        received: By Earth, shape (E,) [bit].
        saturation: Mean share by which wheels are in the last tenth below their top speed, shape (E,).
        close_pairs: Share of the pairs of spacecraft that came too close, shape (E,).
        hit: Spacecraft that hit the body, shape (E, n).
    """

    received: Array
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


@allocation_free
def measure_hazards(
    limits: HazardLimits,
    body: Occluder,
    before: Kinematics,
    now: Kinematics,
    lost: Mask,
    live: Mask,
    measures: Measures,
) -> None:
    """How near the wheels are to saturation, the spacecraft to each other, and which hit the body.

    Args:
        limits: See `HazardLimits`.
        body: The asteroid.
        before: At the beginning of the step.
        now: At its end.
        lost: Spacecraft that are no more, shape (E, n).
        live: Which flights, shape (E,); nothing is written of the others.
        measures: Receives the answer.
    """
    for e in range(lost.shape[0]):
        if live[e]:
            measures.close_pairs[e] = 0.0
            measures.saturation[e] = _saturation(now.wheel[e], limits.max_wheel_speed)
            if before.t[e] >= limits.separation_grace_s:
                measures.close_pairs[e] = _close_pairs(before.r[e], now.r[e], lost[e], limits.min_separation_m)
            for j in range(lost.shape[1]):
                flies = not lost[e, j]
                measures.hit[e, j] = flies and way_blocked(before.r_A[e, j], now.r_A[e, j], body)


@allocation_free
def _saturation(wheel: Array, top_speed: float) -> float:
    total, n, wheels = 0.0, wheel.shape[0], wheel.shape[1]
    for j in range(n):
        for w in range(wheels):
            share = abs(wheel[j, w]) / top_speed
            total += min(1.0, max(0.0, (share - SATURATION_FROM) / (1.0 - SATURATION_FROM)))
    return total / (n * wheels)


@allocation_free
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
        weights: Of the terms, in the order of `TERMS`.
        cell_area: Of the target, shape (C,) [m^2].
        nominal_bit: Volume of the whole target seen straight down from the imaging altitude [bit].
        step_share: Length of a step over that of the flight.
        max_effort: Sum of squared motor torques of a step at the limit [N^2 m^2].
        complete_percent: Seen share that counts as complete [%].
        empty_bit: Data aboard that count as none [bit].
        last_tick: Control periods in the flight.
    """

    weights: Array
    cell_area: Array
    nominal_bit: float
    step_share: float
    max_effort: float
    complete_percent: float
    empty_bit: float
    last_tick: int


class ScoreConstants(NamedTuple):
    """What the score of every step of a mission shares.

    Attributes:
        body: As what hides and is hit.
        radio: See `transmit`.
        limits: See `measure_hazards`.
        reward: Weights, and what measures are taken over.
    """

    body: Occluder
    radio: RadioConstants
    limits: HazardLimits
    reward: RewardConstants


class StepResult(NamedTuple):
    """Rewards and ends of a step of E flights.

    Attributes:
        terms: Weighted terms in the order of `TERMS`, shape (E, terms).
        reward: Their sum, shape (E,).
        end: Number in `ENDS`, shape (E,).
        truncated: Whether the flight is over by its duration, shape (E,).
        hit: Spacecraft that hit the body in the step, shape (E, n).
    """

    terms: Array
    reward: Array
    end: Ints
    truncated: Mask
    hit: Mask


def no_result(count: int, n: int) -> StepResult:
    """Of a step of that many flights of n spacecraft that nothing has come of."""
    return StepResult(
        terms=np.zeros((count, len(TERMS))),
        reward=np.zeros(count),
        end=np.zeros(count, np.int64),
        truncated=np.zeros(count, np.bool_),
        hit=np.zeros((count, n), np.bool_),
    )


def horizon_ended(result: StepResult) -> StepResult:
    """The same with flights that are over by their duration reported as ended, not as truncated."""
    end = np.where(result.truncated, _HORIZON, result.end)
    return result._replace(end=end, truncated=np.zeros_like(result.truncated))


def no_measures(result: StepResult) -> Measures:
    """Of the flights of a result, which has the same hits."""
    count = len(result.reward)
    return Measures(np.zeros(count), np.zeros(count), np.zeros(count), result.hit)


@kernel
def score_step(
    constants: PerMission[ScoreConstants],
    mission: Ints,
    before: Kinematics,
    now: Kinematics,
    tracking: Tracking,
    totals: EpisodeTotals,
    flown: StepFacts,
    measures: Measures,
    result: StepResult,
) -> None:
    """Send data, measure dangers, and work out rewards and ends of the live flights.

    Args:
        constants: By mission.
        mission: Of each flight, shape (E,).
        before: At the beginning of the step.
        now: At its end.
        tracking: What the spacecraft track.
        totals: Brought up to date; spacecraft that hit the body become lost.
        flown: What the simulation tells.
        measures: Receives what is measured of the flights with a finite state.
        result: Receives rewards and ends.
    """
    count = mission.shape[0]
    mine, received = np.empty(count, np.bool_), np.empty(count)
    for m in range(len(constants)):
        some = False
        for e in range(count):
            mine[e] = flown.finite[e] and mission[e] == m
            some = some or (flown.live[e] and mission[e] == m)
        if not some:
            continue
        of = constants[m]
        transmit(of.radio, of.body, now, tracking, totals, mine, received)
        measure_hazards(of.limits, of.body, before, now, totals.lost, mine, measures)
        for e in range(count):
            if mine[e]:
                measures.received[e] = received[e]
            if flown.live[e] and mission[e] == m:
                _reward(of.reward, flown, measures, totals, e, result)


@allocation_free
def _reward(
    constants: RewardConstants, flown: StepFacts, measures: Measures, totals: EpisodeTotals, e: int, result: StepResult
) -> None:
    """Terms, reward and end of a step of flight e."""
    terms, share = result.terms[e], constants.step_share
    for k in range(terms.shape[0]):
        terms[k] = 0.0
    if flown.finite[e]:
        hits = 0
        for j in range(measures.hit.shape[1]):
            hits += measures.hit[e, j]
            totals.lost[e, j] = totals.lost[e, j] or measures.hit[e, j]
        target, can_count, seen = 0.0, 0.0, 0.0
        for i in range(constants.cell_area.shape[0]):
            target += constants.cell_area[i]
            if totals.target[e, i]:
                can_count += constants.cell_area[i]
            if totals.seen[e, i]:
                seen += constants.cell_area[i]
        terms[_SEEN] = flown.area[e] / flown.possible[e]
        terms[_DELIVERED] = measures.received[e] / (constants.nominal_bit * flown.possible[e] / target)
        terms[_EFFORT] = share * (flown.effort[e] / constants.max_effort)
        terms[_SATURATION] = share * measures.saturation[e]
        terms[_APPROACH] = share * measures.close_pairs[e]
        terms[_LOSS] = hits
        percent = 100.0 * (1.0 - (can_count - seen) / target)
        result.end[e] = _end(constants, totals, percent, e)
        result.truncated[e] = result.end[e] == _GOES_ON and flown.tick[e] >= constants.last_tick
    else:
        terms[_LOSS], result.end[e], result.truncated[e] = 1.0, _DIVERGED, False
    result.reward[e] = 0.0
    for k in range(terms.shape[0]):
        terms[k] *= constants.weights[k]
        result.reward[e] += terms[k]


@allocation_free
def _end(constants: RewardConstants, totals: EpisodeTotals, percent: float, e: int) -> int:
    """The number in `ENDS` of how a flight with a finite state ends, 0 if it goes on."""
    alive, aboard = 0, 0.0
    for j in range(totals.lost.shape[1]):
        if not totals.lost[e, j]:
            alive += 1
            aboard += totals.stored[e, j]
    if percent >= constants.complete_percent and aboard <= constants.empty_bit:
        return _COMPLETE
    return _LOST if alive == 0 else _GOES_ON
