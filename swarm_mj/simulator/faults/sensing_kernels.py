"""One reading of the attitude sensors of a swarm, compiled: measured, filtered, and late."""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple

from swarm_mj.simulator.faults.attitude_filter import estimate
from swarm_mj.simulator.faults.filter_state import Assumed, FilterState, Sensors
from swarm_mj.typing import Array, Ints, kernel


class Count(IntEnum):
    """Places of `Knowledge.counts`."""

    NOISE = 0  #: rows of the noise that have been used
    READINGS = 1  #: readings so far
    TICK = 2  #: control period of the last one; -1: none yet


class Knowledge(NamedTuple):
    """What the flight software of n spacecraft knows, and what it knows it by.

    Attributes:
        estimating: Whether sensors err, so that a filter runs.
        sensors: The sensors.
        assumed: What the filter believes of them.
        state: Of the filter.
        noise: Standard normal numbers of the readings to come, see `filter_state.Noise`, shape (rows, n, 3, 3).
        counts: See `Count`, shape (3,).
        delay: Readings by which each is late, shape (n,).
        q_past: The last readings, one after the other in turn, shape (size, n, 4).
        omega_past: Shape (size, n, 3) [rad/s].
        q_BN: Attitudes that the controller is given, shape (n, 4).
        omega_BN_B: Rates, shape (n, 3) [rad/s].
    """

    estimating: int
    sensors: Sensors
    assumed: Assumed
    state: FilterState
    noise: Array
    counts: Ints
    delay: Ints
    q_past: Array
    omega_past: Array
    q_BN: Array
    omega_BN_B: Array


@kernel
def sense(tick: int, q_BN: Array, omega_BN_B: Array, period: float, known: Knowledge) -> None:
    """Read the sensors; asked twice at a tick, they give the same again.

    Args:
        tick: Control periods flown.
        q_BN: True attitudes, shape (n, 4).
        omega_BN_B: True rates, shape (n, 3) [rad/s].
        period: Between two readings [s].
        known: Brought up to date; a row of its noise must be left.
    """
    counts, size = known.counts, known.q_past.shape[0]
    if counts[Count.TICK] == tick:
        return
    counts[Count.TICK] = tick
    q, omega = q_BN, omega_BN_B
    if known.estimating != 0:
        noise = known.noise[counts[Count.NOISE]]
        estimate(q_BN, omega_BN_B, period, noise, known.sensors, known.assumed, known.state)
        counts[Count.NOISE] += 1
        q, omega = known.state.q_BN, known.state.omega_BN_B
    count = counts[Count.READINGS]
    counts[Count.READINGS] += 1
    place = count % size
    for j in range(q.shape[0]):
        # Before anything has arrived, the first reading stands.
        which = place if known.delay[j] == 0 else (count - min(known.delay[j], count)) % size
        for k in range(4):
            known.q_past[place, j, k] = q[j, k]
            known.q_BN[j, k] = known.q_past[which, j, k]
        for k in range(3):
            known.omega_past[place, j, k] = omega[j, k]
            known.omega_BN_B[j, k] = known.omega_past[which, j, k]
