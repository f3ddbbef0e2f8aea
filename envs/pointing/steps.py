"""What a step of `SwarmPointing-v0` comes to: errors, weighted reward terms, references held, and what an agent is told."""

from __future__ import annotations

from math import pi
from typing import NamedTuple

import numpy as np
from gymnasium import spaces

from swarm_mj.simulator.slots import Slot
from swarm_mj.typing import Array, Array32, Ints, Mask

from .flights import PointingFlights

#: Rate that costs in full [rad/s], and the observation's scale of rates.
RATE = 0.1
#: Scales beside that of rates: fine attitude error [1], fine rates and reference rates [rad/s].
FINE_SIGMA, FINE_RATE, REFERENCE_RATE = 0.05, 0.01, 0.01
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


class PointingWeights(NamedTuple):
    """Weight of each reward term, in the order of their arrays."""

    precise: float = 80.0
    coarse: float = -40.0
    rate: float = -10.0
    effort: float = -5.0


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
        scales: Weight of each reward term, shape (terms,).
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
        terms: Weighted reward terms of the last step, shape (E, terms).
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
        terms=np.zeros((count, len(PointingWeights._fields))),
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


class PointingLayout:
    """Which numbers stand where in an observation, `state` or `camera`.

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


def observe(constants: PointingConstants, flights: PointingFlights, state: PointingState, *, camera: bool) -> Array32:
    """Observations, see `STATE`, or `CAMERA`, where the reference is left out, shape (E, F)."""
    omega = flights.reading(Slot.OMEGA if camera else Slot.OMEGA_BR)
    sigma, wheel = flights.reading(Slot.SIGMA_BR), flights.reading(Slot.WHEEL) / constants.max_wheel_speed
    left = (constants.steps - state.step)[:, None]
    hold = np.where((left % constants.hold_steps == 0) & (left > 0), constants.hold_steps, left % constants.hold_steps)
    rates, ends = [omega / RATE, omega / FINE_RATE, wheel], [hold / constants.hold_steps, left / constants.steps]
    errors, reference = [sigma, sigma / FINE_SIGMA], [flights.reading(Slot.OMEGA_R_B) / REFERENCE_RATE]
    parts = [*rates, *ends] if camera else [*errors, *rates, *reference, *ends]
    bounds = [bound for _, _, bound in (CAMERA if camera else STATE)]
    clipped = [np.clip(part, -bound, bound) for part, bound in zip(parts, bounds, strict=True)]
    return np.concatenate(clipped, axis=1, dtype=np.float32, casting="same_kind")
