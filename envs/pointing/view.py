"""What a step of `SwarmPointing-v0` comes to: errors, rewards, holds achieved; and the observation that is made of it."""

from __future__ import annotations

from math import pi, sqrt
from typing import NamedTuple

import numpy as np
from gymnasium import spaces

from swarm_mj.simulator.slots import Slot
from swarm_mj.spacecraft.attitude.algebra import dot, vector
from swarm_mj.typing import Array, Array32, Ints, Mask, kernel

#: Number of reward terms.
TERM_COUNT = 4
#: Scales of the observation: fine attitude error [1], rates and fine rates [rad/s], reference rates [rad/s].
FINE_SIGMA, RATE, FINE_RATE, REFERENCE_RATE = 0.05, 0.1, 0.01, 0.01
#: Names, numbers and bounds of what is observed, in order.
STATE = (
    ("sigma_BR", 3, 1.0),
    ("fine_sigma_BR", 3, 1.0),
    ("omega_BR", 3, 10.0),
    ("fine_omega_BR", 3, 1.0),
    ("wheel_speed", 3, 1.0),
    ("omega_RN", 3, 10.0),
    ("hold_left", 1, 1.0),
    ("time_left", 1, 1.0),
)
#: The same where pixels say where the body is: nothing tells the reference.
CAMERA = (
    ("omega_BN", 3, 10.0),
    ("fine_omega_BN", 3, 1.0),
    ("wheel_speed", 3, 1.0),
    ("hold_left", 1, 1.0),
    ("time_left", 1, 1.0),
)


class PointingLayout:
    """Which numbers stand where in an observation.

    Args:
        observation: `state` or `camera`.

    Attributes:
        camera: Whether the reference is left to the pixels.
        columns: Columns by name.
        space: Of the numbers.
    """

    def __init__(self, observation: str) -> None:
        self.camera = observation == "camera"
        parts = CAMERA if self.camera else STATE
        stops = np.cumsum([size for _, size, _ in parts]).tolist()
        self.columns = {name: slice(stop - size, stop) for (name, size, _), stop in zip(parts, stops, strict=True)}
        high = np.concatenate([np.full(size, bound, np.float32) for _, size, bound in parts])
        low = np.where(np.arange(len(high)) >= stops[-3], np.float32(0.0), -high)
        self.space = spaces.Box(low, high, dtype=np.float32)

    def split(self, observation: Array32) -> dict[str, Array32]:
        """The parts of observations, shape (..., F), by name, shape (..., size)."""
        return {name: observation[..., part] for name, part in self.columns.items()}


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


@kernel
def assess(
    constants: PointingConstants, error: Array, work: Array, effort: Array, live: Mask, state: PointingState
) -> None:
    """Enter what a step has come to.

    Args:
        constants: See there.
        error: Angle between +z and the target now [rad], shape (E,).
        work: Of the decision at the end of the step, see `Slot`, shape (E, slots, 1, 3).
        effort: Sum of the squares of the motor torques of the step, shape (E,) [N^2 m^2].
        live: Which flew, shape (E,).
        state: Brought up to date.
    """
    scales = constants.scales
    for e in range(live.shape[0]):
        state.reward[e] = 0.0
        for k in range(TERM_COUNT):
            state.terms[e, k] = 0.0
        if not live[e]:
            continue
        hold = min(state.step[e] // constants.hold_steps, state.held.shape[1] - 1)
        state.step[e] += 1
        state.error[e] = error[e]
        within = error[e] <= constants.tolerance
        state.steady[e] = state.steady[e] + 1 if within else 0
        state.on_target[e] += within
        state.held[e, hold] |= state.steady[e] >= constants.steady_steps
        omega = vector(work[e, Slot.OMEGA_BR], 0)
        share = error[e] / constants.tolerance
        state.terms[e, 0] = scales[0] * constants.step_share / (1.0 + share)
        state.terms[e, 1] = scales[1] * constants.step_share * error[e] / pi
        state.terms[e, 2] = scales[2] * constants.step_share * min(1.0, sqrt(dot(omega, omega)) / RATE)
        state.terms[e, 3] = scales[3] * constants.step_share * effort[e] / constants.max_effort
        state.reward[e] = state.terms[e, 0] + state.terms[e, 1] + state.terms[e, 2] + state.terms[e, 3]


@kernel
def write_views(
    constants: PointingConstants, work: Array, live: Mask, state: PointingState, camera: bool, out: Array32
) -> None:
    """Write observations, see `STATE` and `CAMERA`.

    Args:
        constants: See there.
        work: Of the decision now, see `Slot`, shape (E, slots, 1, 3).
        live: Which episodes, shape (E,).
        state: How far they are.
        camera: Whether the reference is left out.
        out: Receives the observations, shape (E, F).
    """
    for e in range(live.shape[0]):
        if not live[e]:
            continue
        at = 0
        if camera:
            at = _put(out[e], at, work[e, Slot.OMEGA, 0], RATE, 10.0)
            at = _put(out[e], at, work[e, Slot.OMEGA, 0], FINE_RATE, 1.0)
        else:
            at = _put(out[e], at, work[e, Slot.SIGMA_BR, 0], 1.0, 1.0)
            at = _put(out[e], at, work[e, Slot.SIGMA_BR, 0], FINE_SIGMA, 1.0)
            at = _put(out[e], at, work[e, Slot.OMEGA_BR, 0], RATE, 10.0)
            at = _put(out[e], at, work[e, Slot.OMEGA_BR, 0], FINE_RATE, 1.0)
        at = _put(out[e], at, work[e, Slot.WHEEL, 0], constants.max_wheel_speed, 1.0)
        if not camera:
            at = _put(out[e], at, work[e, Slot.OMEGA_R_B, 0], REFERENCE_RATE, 10.0)
        left = constants.steps - state.step[e]
        hold = left % constants.hold_steps
        out[e, at] = (hold if hold > 0 or left == 0 else constants.hold_steps) / constants.hold_steps
        out[e, at + 1] = left / constants.steps


@kernel
def _put(row: Array32, at: int, values: Array, scale: float, bound: float) -> int:
    for k in range(3):
        row[at + k] = min(bound, max(-bound, values[k] / scale))
    return at + 3
