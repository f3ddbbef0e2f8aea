"""The end of a step of E flights, compiled: data are sent, dangers measured, observations written, rewards worked out.

One call does all of it, because every array that Python hands to compiled code costs half a microsecond. Nothing depends on how
many flights are handled together, so that each comes out bit for bit as if it were alone.
"""

from __future__ import annotations

from typing import NamedTuple

from swarm_mj.smallbody.occultation import Occluder
from swarm_mj.typing import lean

from .kinematics import AttitudeEstimate, Kinematics, Tracking
from .observations import ObservationConstants, write_observations
from .radio import RadioConstants, transmit
from .rewards import Flown, HazardLimits, Outcome, RewardConstants, compute_rewards, measure_hazards
from .totals import EpisodeTotals


class StepConstants(NamedTuple):
    """What all steps of a task share.

    Attributes:
        body: The asteroid as what hides and is hit.
        radio: Antennas and rates.
        limits: Beyond which a flight becomes dangerous.
        observation: Scales and patches.
        reward: Weights of the terms and ends of an episode.
    """

    body: Occluder
    radio: RadioConstants
    limits: HazardLimits
    observation: ObservationConstants
    reward: RewardConstants


@lean
def finish_step(
    constants: StepConstants,
    before: Kinematics,
    now: Kinematics,
    estimate: AttitudeEstimate,
    tracking: Tracking,
    totals: EpisodeTotals,
    flown: Flown,
    outcome: Outcome,
) -> None:
    """Work out everything that a step brings.

    Args:
        constants: See `StepConstants`.
        before: At the beginning of the step.
        now: At its end.
        estimate: At its end, as the flight software has it.
        tracking: What the spacecraft track.
        totals: Brought up to date.
        flown: What the simulation tells of the step.
        outcome: Receives rewards and ends, and the observations of the flights with a finite state.
    """
    _measure(constants, before, now, tracking, totals, flown, outcome)
    write_observations(constants.observation, now, estimate, tracking, totals, flown.finite, outcome.observation)
    compute_rewards(constants.reward, flown, outcome.received, outcome.hazards, totals, outcome.result)


@lean
def score_step(
    constants: StepConstants,
    before: Kinematics,
    now: Kinematics,
    tracking: Tracking,
    totals: EpisodeTotals,
    flown: Flown,
    outcome: Outcome,
) -> None:
    """The same without observations, for environments that show their agents something else."""
    _measure(constants, before, now, tracking, totals, flown, outcome)
    compute_rewards(constants.reward, flown, outcome.received, outcome.hazards, totals, outcome.result)


@lean
def _measure(
    constants: StepConstants,
    before: Kinematics,
    now: Kinematics,
    tracking: Tracking,
    totals: EpisodeTotals,
    flown: Flown,
    outcome: Outcome,
) -> None:
    finite = flown.finite
    transmit(constants.radio, constants.body, now, tracking, totals, finite, outcome.received)
    measure_hazards(constants.limits, constants.body, before, now, totals.lost, finite, outcome.hazards)
