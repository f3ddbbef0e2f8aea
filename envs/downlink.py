"""Where the pictures' data are: aboard, handed to a spacecraft that relays, or delivered to Earth."""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite

import numpy as np
from numpy.typing import NDArray

from swarm_mj.errors import ScenarioError
from swarm_mj.mission.behaviors import TargetKind, Targets
from swarm_mj.mission.links import links_closed
from swarm_mj.planning import Plan, antennas_from

from .state import SwarmState

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Radio:
    """Data rates.

    Attributes:
        bits_per_pixel: Of a picture, after compression.
        swarm_rate_bit_s: From a spacecraft to the one it tracks [bit/s].
        earth_rate_bit_s: To Earth, which hears one spacecraft at a time [bit/s].

    Raises:
        ScenarioError: A value is not positive.
    """

    bits_per_pixel: float
    swarm_rate_bit_s: float
    earth_rate_bit_s: float

    def __post_init__(self) -> None:
        """Refuse impossible rates."""
        for name, value in vars(self).items():
            if not (isfinite(value) and value > 0.0):
                raise ScenarioError(f"{name} = {value}: must be a positive number")


class Downlink:
    """Data aboard and delivered, in bits.

    The links are those of `swarm_mj.mission.links` at the end of a step, taken to be so for the whole of it.

    Attributes:
        stored: Aboard each spacecraft, shape (n,) [bit].
        delivered: Received by Earth [bit].
        closed: Whose link was closed at the end of the last step, shape (n,).
        nominal: Volume of the whole target seen straight down from the imaging altitude [bit].
    """

    def __init__(self, plan: Plan, radio: Radio, pixel_angle: float) -> None:
        self._plan, self._radio, self._antennas = plan, radio, antennas_from(plan.scenario)
        footprint = (plan.scenario.design.imaging_altitude_m * pixel_angle) ** 2
        self.nominal = plan.region.total_area / footprint * radio.bits_per_pixel
        self.reset()

    def reset(self) -> None:
        """Nothing aboard, nothing delivered."""
        n = self._plan.n
        self.stored, self.delivered, self.closed = np.zeros(n), 0.0, np.zeros(n, np.bool_)

    def add_pictures(self, pixels: Array) -> None:
        """Store the pixels that each spacecraft took, shape (n,)."""
        self.stored += self._radio.bits_per_pixel * pixels

    def transmit(self, state: SwarmState, targets: Targets, duration: float) -> float:
        """Send for `duration` [s] over the links that are closed now; returns the bits that Earth received."""
        talking = (targets.kind == TargetKind.SPACECRAFT) | (targets.kind == TargetKind.EARTH)
        self.closed = self._closed(state, targets) if talking.any() else np.zeros(self._plan.n, np.bool_)
        for j in np.flatnonzero(self.closed & (targets.kind == TargetKind.SPACECRAFT)):
            sent = min(self.stored[j], self._radio.swarm_rate_bit_s * duration)
            self.stored[j] -= sent
            self.stored[targets.spacecraft[j]] += sent
        return self._send_to_earth(self.closed & (targets.kind == TargetKind.EARTH), duration)

    def _closed(self, state: SwarmState, targets: Targets) -> NDArray[np.bool_]:
        closed = links_closed(
            antennas=self._antennas,
            shape=self._plan.shape,
            mode=targets.kind[None].astype(np.int8),
            tracked=targets.spacecraft[None].astype(np.int16),
            r_BN_N=state.r_BN_N[None],
            C_BN=state.C_BN[None],
            C_AN=state.C_AN[None],
            earth_N=self._plan.environment.earth.at(state.t)[None],
        )
        return np.asarray(closed[0])

    def _send_to_earth(self, talks: NDArray[np.bool_], duration: float) -> float:
        """Earth hears one spacecraft at a time, in gene order."""
        budget = self._radio.earth_rate_bit_s * duration
        received = 0.0
        for j in np.flatnonzero(talks):
            sent = min(float(self.stored[j]), budget - received)
            self.stored[j] -= sent
            received += sent
        self.delivered += received
        return received
