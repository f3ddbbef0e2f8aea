"""What an agent of `SwarmPointing-v0` is told of its episode, as numbers, see `STATE` and `CAMERA`."""

from __future__ import annotations

import numpy as np
from gymnasium import spaces

from swarm_mj.simulator.slots import Slot
from swarm_mj.typing import Array32

from .flights import PointingFlights
from .rewards import RATE, PointingConstants, PointingState

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


def observe(constants: PointingConstants, flights: PointingFlights, state: PointingState, *, camera: bool) -> Array32:
    """Observations, see `STATE` and `CAMERA`, shape (E, F).

    Args:
        constants: See there.
        flights: As they are.
        state: How far they are.
        camera: Whether the reference is left out.
    """
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
