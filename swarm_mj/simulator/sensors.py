"""What the flight software knows of its attitude: sensors that err and fail, the filter, and the delay of it all."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from swarm_mj.scenarios.schema_faults import (
    Fault,
    GyroBias,
    GyroDropout,
    GyroNoise,
    SensorDelay,
    StarTrackerBias,
    StarTrackerDropout,
    StarTrackerNoise,
)
from swarm_mj.scenarios.schema_sensors import Sensors
from swarm_mj.simulator.faults.dispersions import ARCSEC, DEG_PER_HOUR, DEG_PER_SQRT_HOUR, Dispersed, Stream, stream
from swarm_mj.simulator.faults.schedule import ScheduledFault
from swarm_mj.simulator.flights import fill
from swarm_mj.spacecraft.attitude.estimation import Assumed, AttitudeKnowledge, Count, first_state, sensors_of
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


def can_err(given: Sensors, faults: Sequence[Fault]) -> bool:
    """Whether sensors can be imperfect in any flight with these faults, so that a filter runs."""
    return given.errs or any(isinstance(fault, SENSOR_FAULTS) for fault in faults)


def most_readings(given: Sensors, faults: Sequence[Fault], period: float) -> int:
    """How many readings must be kept, so that the latest of any flight are there."""
    delays = [fault.delay_s for fault in faults if isinstance(fault, SensorDelay)]
    return 1 + max(int(given.delay_s / period + 1e-9), *(round(delay / period) for delay in delays), 0)


class Sensing:
    """Attitude sensors and filters of one flight.

    Args:
        given: What they err by.
        drawn: What the seed made of them.
        schedule: What will happen.
        seed: Of the noise.
        period: Control period [s]; sensors are read once in each.
        knowledge: Sensors, filter and readings, for kernels; put at their start.

    Attributes:
        estimating: Whether sensors are imperfect, so that a filter runs.
        active: Whether the controller knows anything else than the truth.
        knowledge: As given.
        rng: Draws the noise; None: there is none.
    """

    def __init__(
        self,
        given: Sensors,
        drawn: Dispersed,
        schedule: Sequence[ScheduledFault],
        seed: int,
        period: float,
        knowledge: AttitudeKnowledge,
    ) -> None:
        walk = given.gyro_rate_random_walk_deg_h_sqrt_h * DEG_PER_HOUR / 60.0
        noise = given.gyro_angular_random_walk_deg_sqrt_h * DEG_PER_SQRT_HOUR
        tracker = given.star_tracker_noise_arcsec * ARCSEC
        faulty = any(isinstance(entry.fault, SENSOR_FAULTS) for entry in schedule)
        self.estimating = given.errs or faulty
        late = any(isinstance(entry.fault, SensorDelay) for entry in schedule) or bool(drawn.delay_ticks.any())
        self.active = self.estimating or late
        assumed = Assumed(
            max(noise, LEAST_GYRO_NOISE),
            max(walk, LEAST_BIAS_WALK) if faulty else walk,
            max(tracker, LEAST_STAR_TRACKER_NOISE),
            max(given.gyro_bias_deg_h * DEG_PER_HOUR, LEAST_BIAS),
        )
        self._normal, self._drawn, self._period = (noise, tracker), drawn, period
        self.rng = stream(seed, Stream.SENSOR_NOISE) if self.estimating else None
        self.knowledge = known = knowledge
        sensors = sensors_of(len(drawn.mass_ratio), noise, walk, tracker)
        fill(known.sensors, sensors._replace(star_tracker_offset=drawn.star_tracker_bias))
        fill(known.state, first_state(drawn.gyro_bias))
        known.assumed[:], known.delay[:] = assumed, drawn.delay_ticks
        known.counts[:] = len(known.noise), 0, -1, self.estimating
        for array in (known.q_past, known.omega_past, known.q_BN, known.omega_BN_B):
            array[:] = 0.0

    @property
    def gyro_bias(self) -> Array:
        """True biases with what faults add, shape (n, 3) [rad/s]."""
        return self.knowledge.state.true_bias + self.knowledge.sensors.gyro_offset

    @property
    def gyro_bias_estimate(self) -> Array:
        """The filter's, shape (n, 3) [rad/s]."""
        return self.knowledge.state.bias

    def provide_noise(self) -> None:
        """See that there is noise for the next reading: the numbers that one reading after the other would draw."""
        noise, counts = self.knowledge.noise, self.knowledge.counts
        if self.rng is not None and counts[Count.NOISE] == len(noise):
            self.rng.standard_normal(out=noise)
            counts[Count.NOISE] = 0

    def knowledge_error(self, q_BN: Array) -> Array:
        """Angle between the true attitude and what the controller was given last, shape (n,) [rad]."""
        if self.knowledge.counts[Count.READINGS] == 0:
            return np.zeros(len(q_BN))
        along = np.abs(np.einsum("nk,nk->n", q_BN, self.knowledge.q_BN))
        return 2.0 * np.arccos(np.minimum(1.0, along))

    def set_fault(self, j: int, fault: object, active: bool) -> str:
        """Let a fault of a sensor begin or end; returns it in words."""
        sensors, sign = self.knowledge.sensors, 1.0 if active else -1.0
        if isinstance(fault, GyroNoise):
            walk = fault.angular_random_walk_deg_sqrt_h
            sensors.gyro_noise[j] = walk * DEG_PER_SQRT_HOUR if active else self._normal[0]
            return f"{walk:g} deg/sqrt(h)"
        if isinstance(fault, GyroBias):
            sensors.gyro_offset[j] += sign * DEG_PER_HOUR * np.array(fault.bias_deg_h)
            return f"{list(fault.bias_deg_h)} deg/h added"
        if isinstance(fault, GyroDropout):
            sensors.gyro_works[j] = not active
            return "no rates"
        if isinstance(fault, StarTrackerNoise):
            sensors.star_tracker_noise[j] = fault.sigma_arcsec * ARCSEC if active else self._normal[1]
            return f"{fault.sigma_arcsec:g} arcsec"
        if isinstance(fault, StarTrackerBias):
            sensors.star_tracker_offset[j] += sign * ARCSEC * np.array(fault.bias_arcsec)
            return f"{list(fault.bias_arcsec)} arcsec added"
        if isinstance(fault, StarTrackerDropout):
            sensors.star_tracker_works[j] = not active
            return "no attitudes"
        assert isinstance(fault, SensorDelay)
        delay = self.knowledge.delay
        delay[j] = round(fault.delay_s / self._period) if active else self._drawn.delay_ticks[j]
        return f"{delay[j] * self._period:g} s"
