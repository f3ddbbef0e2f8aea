"""What the attitude filter works on: sensors as they are and as it believes them to be, and what it carries on."""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple

import numpy as np

from swarm_mj.typing import Array, Mask


class Noise(IntEnum):
    """Rows of the standard normal numbers of one measurement, each with x, y, z."""

    GYRO = 0
    BIAS_WALK = 1
    STAR_TRACKER = 2


class Sensors(NamedTuple):
    """True properties of the sensors of n spacecraft, which faults may change.

    Attributes:
        gyro_noise: Angular random walk, shape (n,) [rad/sqrt(s)].
        bias_walk: Random walk of the gyro's bias, shape (n,) [rad/s/sqrt(s)].
        star_tracker_noise: One sigma about each axis, shape (n,) [rad].
        gyro_offset: Added to the gyro's bias, shape (n, 3) [rad/s].
        star_tracker_offset: Mounting error as a rotation vector in B, shape (n, 3) [rad].
        gyro_works: Shape (n,).
        star_tracker_works: Shape (n,).
    """

    gyro_noise: Array
    bias_walk: Array
    star_tracker_noise: Array
    gyro_offset: Array
    star_tracker_offset: Array
    gyro_works: Mask
    star_tracker_works: Mask


def sensors_of(n: int, gyro_noise: float, bias_walk: float, star_tracker_noise: float) -> Sensors:
    """Sensors of n spacecraft that are all alike, work, and have no offsets; see `Sensors`."""
    return Sensors(
        np.full(n, gyro_noise),
        np.full(n, bias_walk),
        np.full(n, star_tracker_noise),
        np.zeros((n, 3)),
        np.zeros((n, 3)),
        np.ones(n, np.bool_),
        np.ones(n, np.bool_),
    )


class Assumed(NamedTuple):
    """What the filter believes of the sensors.

    Attributes:
        gyro_noise: Angular random walk [rad/sqrt(s)].
        bias_walk: [rad/s/sqrt(s)].
        star_tracker_noise: One sigma about each axis [rad].
        initial_bias: One sigma of the bias at the start [rad/s].
    """

    gyro_noise: float
    bias_walk: float
    star_tracker_noise: float
    initial_bias: float


class FilterState(NamedTuple):
    """What is carried from one period to the next.

    Attributes:
        q_BN: Estimated attitudes, shape (n, 4).
        omega_BN_B: Estimated rates, shape (n, 3) [rad/s].
        bias: Estimated gyro biases, shape (n, 3) [rad/s].
        covariance: Of attitude error [rad] and bias error [rad/s], shape (n, 6, 6).
        true_bias: The gyro's walking bias, without `Sensors.gyro_offset`, shape (n, 3) [rad/s].
        q_before: True attitudes at the previous call, shape (n, 4).
        q_tracked: The star tracker's previous attitude, shape (n, 4).
        tracked: Whether there is one of the previous period, shape (n,).
        started: Whether the filter runs, shape (1,).
    """

    q_BN: Array
    omega_BN_B: Array
    bias: Array
    covariance: Array
    true_bias: Array
    q_before: Array
    q_tracked: Array
    tracked: Mask
    started: Mask


def first_state(true_bias: Array) -> FilterState:
    """The state before the first measurement.

    Args:
        true_bias: Of the gyros at the start, shape (n, 3) [rad/s].
    """
    n = len(true_bias)
    return FilterState(
        q_BN=np.tile([1.0, 0.0, 0.0, 0.0], (n, 1)),
        omega_BN_B=np.zeros((n, 3)),
        bias=np.zeros((n, 3)),
        covariance=np.zeros((n, 6, 6)),
        true_bias=true_bias.copy(),
        q_before=np.zeros((n, 4)),
        q_tracked=np.zeros((n, 4)),
        tracked=np.zeros(n, np.bool_),
        started=np.zeros(1, np.bool_),
    )
