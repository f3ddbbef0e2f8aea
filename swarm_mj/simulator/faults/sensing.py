"""What the flight software knows of its attitude: sensors with dispersions and faults, the filter, and the delay of it all."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from swarm_mj.scenarios.schema_faults import (
    Dispersions,
    GyroBias,
    GyroDropout,
    GyroNoise,
    SensorDelay,
    StarTrackerBias,
    StarTrackerDropout,
    StarTrackerNoise,
)
from swarm_mj.simulator.faults.dispersions import ARCSEC, DEG_PER_HOUR, DEG_PER_SQRT_HOUR, Dispersed
from swarm_mj.simulator.faults.filter_state import Assumed, Noise, Sensors, biases, first_state, sensors_of
from swarm_mj.simulator.faults.random_streams import Stream, stream
from swarm_mj.simulator.faults.schedule import ScheduledFault
from swarm_mj.simulator.faults.sensing_kernels import Count, Knowledge, sense
from swarm_mj.typing import Array

#: Below these the filter believes no sensor, lest it trust one alone: noise of a good gyro and star tracker.
LEAST_GYRO_NOISE = 0.01 * DEG_PER_SQRT_HOUR
LEAST_STAR_TRACKER_NOISE = 1.0 * ARCSEC
LEAST_BIAS = 1.0 * DEG_PER_HOUR
#: Bias walk that lets the filter follow a jump of the gyro's bias within minutes [rad/s/sqrt(s)].
LEAST_BIAS_WALK = 0.05 * DEG_PER_HOUR

#: Readings for which noise is drawn at once.
NOISE_ROWS = 64

SENSOR_FAULTS = (GyroNoise, GyroBias, GyroDropout, StarTrackerNoise, StarTrackerBias, StarTrackerDropout)


class Sensing:
    """Attitude sensors and filters of one flight.

    Args:
        given: The scenario's dispersions.
        drawn: What the seed made of them.
        schedule: What will happen.
        seed: Of the noise.
        period: Control period [s]; sensors are read once in each.

    Attributes:
        estimating: Whether sensors are imperfect, so that a filter runs.
        active: Whether the controller knows anything else than the truth.
        state: Of the filter.
        knowledge: All of it for kernels.
    """

    def __init__(
        self, given: Dispersions, drawn: Dispersed, schedule: Sequence[ScheduledFault], seed: int, period: float
    ) -> None:
        n = len(drawn.mass_ratio)
        walk = given.gyro_rate_random_walk_deg_h_sqrt_h * DEG_PER_HOUR / 60.0
        noise = given.gyro_angular_random_walk_deg_sqrt_h * DEG_PER_SQRT_HOUR
        tracker = given.star_tracker_noise_arcsec * ARCSEC
        faulty = [isinstance(entry.fault, SENSOR_FAULTS) for entry in schedule]
        dispersed = max(noise, walk, tracker, given.gyro_bias_deg_h, given.star_tracker_bias_arcsec) > 0.0
        self.estimating = dispersed or any(faulty)
        self._normal = (noise, tracker)
        self._walk, self._drawn = walk, drawn
        self._sensors = self._at_start()
        self._assumed = Assumed(
            max(noise, LEAST_GYRO_NOISE),
            max(walk, LEAST_BIAS_WALK) if any(faulty) else walk,
            max(tracker, LEAST_STAR_TRACKER_NOISE),
            max(given.gyro_bias_deg_h * DEG_PER_HOUR, LEAST_BIAS),
        )
        self.state = first_state(drawn.gyro_bias)
        self._seed, self._period, self._blocks = seed, period, 0
        self._rng = stream(seed, Stream.SENSOR_NOISE) if self.estimating else None
        size = self._readings_kept(schedule, drawn)
        self.active = self.estimating or size > 1
        self.knowledge = self._begin(n, size, drawn)

    def _readings_kept(self, schedule: Sequence[ScheduledFault], drawn: Dispersed) -> int:
        later = [self._ticks(entry.fault.delay_s) for entry in schedule if isinstance(entry.fault, SensorDelay)]
        return 1 + max([int(drawn.delay_ticks.max(initial=0)), *later])

    def _begin(self, n: int, size: int, drawn: Dispersed) -> Knowledge:
        rows = NOISE_ROWS if self.estimating else 0
        return Knowledge(
            estimating=int(self.estimating),
            sensors=self._sensors,
            assumed=self._assumed,
            state=self.state,
            noise=np.zeros((rows, n, len(Noise), 3)),
            counts=np.array([rows, 0, -1], np.int64),
            delay=drawn.delay_ticks.astype(np.int64),
            q_past=np.zeros((size, n, 4)),
            omega_past=np.zeros((size, n, 3)),
            q_BN=np.zeros((n, 4)),
            omega_BN_B=np.zeros((n, 3)),
        )

    def restart(self) -> None:
        """Begin the same flight again, in the same arrays."""
        known = self.knowledge
        old = (*known.sensors, *known.state, known.delay, known.q_past, known.omega_past, known.q_BN, known.omega_BN_B)
        begun = (*self._at_start(), *first_state(self._drawn.gyro_bias), self._drawn.delay_ticks)
        new: tuple[Any, ...] = (*begun, 0.0, 0.0, 0.0, 0.0)
        for array, start in zip(old, new, strict=True):
            array[...] = start
        if self._blocks > 1:
            self._rng, self._blocks = stream(self._seed, Stream.SENSOR_NOISE), 0
        # The first numbers may still be there.
        known.counts[:] = 0 if self._blocks == 1 else len(known.noise), 0, -1

    def _at_start(self) -> Sensors:
        n = len(self._drawn.mass_ratio)
        sensors = sensors_of(n, self._normal[0], self._walk, self._normal[1])
        sensors.star_tracker_offset[:, :n] = self._drawn.star_tracker_bias.T
        return sensors

    def _ticks(self, delay_s: float) -> int:
        return round(delay_s / self._period)

    @property
    def gyro_bias(self) -> Array:
        """True biases with what faults add, shape (n, 3) [rad/s]."""
        return biases(self.state)[1] + self._sensors.gyro_offset[:, : len(self.state.q_BN)].T

    @property
    def gyro_bias_estimate(self) -> Array:
        """The filter's, shape (n, 3) [rad/s]."""
        return biases(self.state)[0]

    def know(self, tick: int, q_BN: Array, omega_BN_B: Array) -> tuple[Array, Array]:
        """Attitudes (n, 4) and rates (n, 3) [rad/s] that the controller is given; asked twice at a tick, the same again.

        Args:
            tick: Control periods flown.
            q_BN: True attitudes, shape (n, 4).
            omega_BN_B: True rates, shape (n, 3) [rad/s].
        """
        self.provide_noise()
        # Contiguous, so that one compiled function serves all who ask.
        sense(tick, np.ascontiguousarray(q_BN), np.ascontiguousarray(omega_BN_B), self._period, self.knowledge)
        return self.knowledge.q_BN, self.knowledge.omega_BN_B

    def provide_noise(self) -> int:
        """See that there is noise for the next reading; returns for how many there is."""
        if self._rng is None:
            return NOISE_ROWS
        noise, counts = self.knowledge.noise, self.knowledge.counts
        if counts[Count.NOISE] == len(noise):
            # The numbers that one reading after the other would draw.
            self._rng.standard_normal(out=noise)
            counts[Count.NOISE] = 0
            self._blocks += 1
        return len(noise) - int(counts[Count.NOISE])

    def knowledge_error(self, q_BN: Array) -> Array:
        """Angle between the true attitude and what the controller was given last, shape (n,) [rad]."""
        if self.knowledge.counts[Count.READINGS] == 0:
            return np.zeros(len(q_BN))
        along = np.abs(np.einsum("nk,nk->n", q_BN, self.knowledge.q_BN))
        return 2.0 * np.arccos(np.minimum(1.0, along))

    def fail(self, j: int, fault: object) -> str:
        """Let a fault of a sensor happen; returns it in words."""
        sensors = self._sensors
        if isinstance(fault, GyroNoise):
            sensors.gyro_noise[j] = fault.angular_random_walk_deg_sqrt_h * DEG_PER_SQRT_HOUR
            return f"{fault.angular_random_walk_deg_sqrt_h:g} deg/sqrt(h)"
        if isinstance(fault, GyroBias):
            sensors.gyro_offset[:, j] += DEG_PER_HOUR * np.array(fault.bias_deg_h)
            return f"{list(fault.bias_deg_h)} deg/h added"
        if isinstance(fault, GyroDropout):
            sensors.gyro_works[j] = False
            return "no rates"
        if isinstance(fault, StarTrackerNoise):
            sensors.star_tracker_noise[j] = fault.sigma_arcsec * ARCSEC
            return f"{fault.sigma_arcsec:g} arcsec"
        if isinstance(fault, StarTrackerBias):
            sensors.star_tracker_offset[:, j] += ARCSEC * np.array(fault.bias_arcsec)
            return f"{list(fault.bias_arcsec)} arcsec added"
        if isinstance(fault, StarTrackerDropout):
            sensors.star_tracker_works[j] = False
            return "no attitudes"
        assert isinstance(fault, SensorDelay)
        self.knowledge.delay[j] = self._ticks(fault.delay_s)
        return f"{self.knowledge.delay[j] * self._period:g} s"

    def recover(self, j: int, fault: object) -> None:
        """End a fault of a sensor."""
        sensors = self._sensors
        if isinstance(fault, GyroNoise):
            sensors.gyro_noise[j] = self._normal[0]
        elif isinstance(fault, GyroBias):
            sensors.gyro_offset[:, j] -= DEG_PER_HOUR * np.array(fault.bias_deg_h)
        elif isinstance(fault, GyroDropout):
            sensors.gyro_works[j] = True
        elif isinstance(fault, StarTrackerNoise):
            sensors.star_tracker_noise[j] = self._normal[1]
        elif isinstance(fault, StarTrackerBias):
            sensors.star_tracker_offset[:, j] -= ARCSEC * np.array(fault.bias_arcsec)
        elif isinstance(fault, StarTrackerDropout):
            sensors.star_tracker_works[j] = True
        elif isinstance(fault, SensorDelay):
            self.knowledge.delay[j] = self._drawn.delay_ticks[j]
