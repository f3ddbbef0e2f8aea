"""What a step of `SwarmPointing-v0` comes to: errors, weighted reward terms, references held."""

from __future__ import annotations

from math import pi
from typing import NamedTuple

import numpy as np

from swarm_mj.typing import Array, Ints, Mask

#: Number of reward terms.
TERM_COUNT = 4
#: Rate that costs in full [rad/s], and the observation's scale of rates.
RATE = 0.1


class PointingConstants(NamedTuple):
    """What `assess` needs to know of a task.

    Attributes:
        step_share: Length of a step over that of an episode.
        tolerance: Largest error that counts as pointing [rad].
        steady_steps: For so many steps in a row a reference must be held.
        hold_steps: Steps of a hold.
        steps: Steps of an episode.
        max_wheel_speed: [rad/s].
        max_effort: Sum of the squares of all motor torques of a step at their limit [N^2 m^2].
        scales: Weight of each reward term, shape (TERM_COUNT,).
    """

    step_share: float
    tolerance: float
    steady_steps: int
    hold_steps: int
    steps: int
    max_wheel_speed: float
    max_effort: float
    scales: Array


class PointingState(NamedTuple):
    """What E episodes remember.

    Attributes:
        step: Steps flown, shape (E,).
        steady: Steps in a row in which the present reference has been held, shape (E,).
        held: Which references have been held for long enough, shape (E, H).
        error: Angle between +z and the target at the end of the last step [rad], shape (E,).
        on_target: Steps so far at whose end that was within the tolerance, shape (E,).
        terms: Weighted reward terms of the last step, shape (E, TERM_COUNT).
        reward: Their sum, shape (E,).
    """

    step: Ints
    steady: Ints
    held: Mask
    error: Array
    on_target: Ints
    terms: Array
    reward: Array


def no_state(count: int, holds: int) -> PointingState:
    """E episodes that have not begun."""
    return PointingState(
        step=np.zeros(count, np.int64),
        steady=np.zeros(count, np.int64),
        held=np.zeros((count, holds), np.bool_),
        error=np.zeros(count),
        on_target=np.zeros(count, np.int64),
        terms=np.zeros((count, TERM_COUNT)),
        reward=np.zeros(count),
    )


def assess(
    constants: PointingConstants, error: Array, rate: Array, effort: Array, live: Mask, state: PointingState
) -> None:
    """Enter what a step has come to.

    Args:
        constants: See there.
        error: Angle between +z and the target now [rad], shape (E,).
        rate: Of the body relative to the reference now [rad/s], shape (E,).
        effort: Sum of the squares of the motor torques of the step, shape (E,) [N^2 m^2].
        live: Which flew, shape (E,).
        state: Brought up to date.
    """
    within = error <= constants.tolerance
    hold = np.minimum(state.step // constants.hold_steps, state.held.shape[1] - 1)
    state.step[live] += 1
    state.error[live] = error[live]
    state.steady[live] = np.where(within, state.steady + 1, 0)[live]
    state.on_target[live] += within[live]
    state.held[live, hold[live]] |= (state.steady >= constants.steady_steps)[live]
    measures = (
        1.0 / (1.0 + error / constants.tolerance),
        error / pi,
        np.minimum(1.0, rate / RATE),
        effort / constants.max_effort,
    )
    state.terms[:] = constants.scales * constants.step_share * np.stack(measures, axis=1) * live[:, None]
    state.reward[:] = state.terms.sum(axis=1)
