"""What the attitude filter works on: sensors as they are and as it believes them to be, and what it carries on."""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple

import numpy as np

from swarm_mj.spacecraft.attitude.lanes import room
from swarm_mj.typing import Array, Mask


class Noise(IntEnum):
    """Rows of the standard normal numbers of one measurement, each with x, y, z."""

    GYRO = 0
    BIAS_WALK = 1
    STAR_TRACKER = 2


class Sensors(NamedTuple):
    """True properties of the sensors of n spacecraft, which faults may change; m = `room(n)` places, the first n theirs.

    Attributes:
        gyro_noise: Angular random walk, shape (m,) [rad/sqrt(s)].
        bias_walk: Random walk of the gyro's bias, shape (m,) [rad/s/sqrt(s)].
        star_tracker_noise: One sigma about each axis, shape (m,) [rad].
        gyro_offset: Added to the gyro's bias, shape (3, m) [rad/s].
        star_tracker_offset: Mounting error as a rotation vector in B, shape (3, m) [rad].
        gyro_works: Shape (m,).
        star_tracker_works: Shape (m,).
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
    m = room(n)
    return Sensors(
        np.full(m, gyro_noise),
        np.full(m, bias_walk),
        np.full(m, star_tracker_noise),
        np.zeros((3, m)),
        np.zeros((3, m)),
        np.ones(m, np.bool_),
        np.ones(m, np.bool_),
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
    """What is carried from one period to the next; m = `room(n)` places, of which the first n are spacecraft's.

    Attributes:
        q_BN: Estimated attitudes, shape (n, 4).
        omega_BN_B: Estimated rates, shape (n, 3) [rad/s].
        bias: Estimated gyro biases, shape (3, m) [rad/s].
        covariance: Of attitude error and bias error, see `covariances`, shape (21, m).
        true_bias: The gyro's walking bias, without `Sensors.gyro_offset`, shape (3, m) [rad/s].
        q_before: True attitudes at the previous call, shape (4, m).
        q_tracked: The star tracker's previous attitude, shape (4, m).
        tracked: Whether there is one of the previous period, shape (m,).
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


#: Where the blocks of a covariance begin: that of the attitude, of attitude and bias, of the bias. Of the first and the last
#: there is the upper triangle.
ATTITUDE, MIXED, BIAS = 0, 6, 15


def first_state(true_bias: Array) -> FilterState:
    """The state before the first measurement.

    Args:
        true_bias: Of the gyros at the start, shape (n, 3) [rad/s].
    """
    n = len(true_bias)
    m = room(n)
    walking = np.zeros((3, m))
    walking[:, :n] = true_bias.T
    return FilterState(
        q_BN=np.tile([1.0, 0.0, 0.0, 0.0], (n, 1)),
        omega_BN_B=np.zeros((n, 3)),
        bias=np.zeros((3, m)),
        covariance=np.zeros((21, m)),
        true_bias=walking,
        q_before=np.zeros((4, m)),
        q_tracked=np.zeros((4, m)),
        tracked=np.zeros(m, np.bool_),
        started=np.zeros(1, np.bool_),
    )


def biases(state: FilterState) -> tuple[Array, Array]:
    """Estimated biases, and the true ones without `Sensors.gyro_offset`, two of shape (n, 3) [rad/s]."""
    n = len(state.q_BN)
    return state.bias[:, :n].T, state.true_bias[:, :n].T


def covariances(state: FilterState) -> Array:
    """Of attitude error [rad] and bias error [rad/s], shape (n, 6, 6)."""
    n, upper = len(state.q_BN), np.triu_indices(3)
    P, rows = np.empty((n, 6, 6)), state.covariance[:, :n].T
    for first, block in ((ATTITUDE, P[:, :3, :3]), (BIAS, P[:, 3:, 3:])):
        block[:, upper[0], upper[1]] = block[:, upper[1], upper[0]] = rows[:, first : first + 6]
    P[:, :3, 3:] = rows[:, MIXED:BIAS].reshape(n, 3, 3)
    P[:, 3:, :3] = P[:, :3, 3:].swapaxes(1, 2)
    return P
