"""Gyro, star tracker and a multiplicative extended Kalman filter of attitude and gyro bias, compiled, for n spacecraft.

The gyro integrates: over a period T it gives the rotation of the body plus bias and noise (Farrenkopf 1978; discrete form of
Crassidis and Junkins, Optimal Estimation of Dynamic Systems, 2nd ed., section 4.7). The star tracker gives the attitude, turned
by its mounting error and noise. The filter estimates the attitude and the bias (Lefferts, Markley and Shuster, J. Guidance 5,
1982): with q_true = q_est * dq(theta) and the bias error b - b_est its state is (theta, b - b_est), six numbers in B,

    theta' = exp(-[phi x]) theta - J_r(phi) T (b - b_est) + noise,      phi = measured rotation less b_est T,

J_r the right Jacobian of the rotation group. Quaternions (w, x, y, z), v_N = R(q_BN) v_B; radians, seconds.
"""

from __future__ import annotations

from enum import IntEnum
from math import atan2, cos, sin, sqrt
from typing import NamedTuple

import numpy as np

from swarm_mj.spacecraft.attitude.algebra import (
    Quaternion,
    Vector,
    combine,
    conjugate,
    normalised,
    product,
    put_quaternion,
    put_vector,
    quaternion,
    scaled,
    vector,
)
from swarm_mj.typing import Array, Mask, kernel

#: Angular acceleration that the filter allows for where it has no gyro [rad/s^2]: a slewing CubeSat with 4 mN m wheels.
_UNMEASURED_ACCELERATION = 0.03


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
        bias: Estimated gyro biases, shape (n, 3) [rad/s].
        covariance: Of attitude error and bias error, shape (n, 6, 6).
        omega_BN_B: Estimated rates, shape (n, 3) [rad/s].
        true_bias: The gyro's walking bias, without `Sensors.gyro_offset`, shape (n, 3) [rad/s].
        q_before: True attitudes at the previous call, shape (n, 4).
        q_tracked: The star tracker's previous attitude, shape (n, 4).
        tracked: Whether there is one of the previous period, shape (n,).
        started: Whether the filter runs, shape (n,).
        work: Room for matrices of one reading, shape (n, 3, 3, 3).
    """

    q_BN: Array
    bias: Array
    covariance: Array
    omega_BN_B: Array
    true_bias: Array
    q_before: Array
    q_tracked: Array
    tracked: Mask
    started: Mask
    work: Array


def first_state(true_bias: Array) -> FilterState:
    """The state before the first measurement.

    Args:
        true_bias: Of the gyros at the start, shape (n, 3) [rad/s].
    """
    n = len(true_bias)
    flags = np.zeros((2, n), np.bool_)
    q = np.zeros((3, n, 4))
    q[..., 0] = 1.0
    return FilterState(
        q[0],
        np.zeros((n, 3)),
        np.zeros((n, 6, 6)),
        np.zeros((n, 3)),
        true_bias.copy(),
        q[1],
        q[2],
        flags[0],
        flags[1],
        np.zeros((n, 3, 3, 3)),
    )


@kernel
def estimate(
    q_BN: Array, omega_BN_B: Array, period: float, noise: Array, sensors: Sensors, assumed: Assumed, state: FilterState
) -> None:
    """Measure once and bring the estimates up to date.

    Args:
        q_BN: True attitudes, shape (n, 4).
        omega_BN_B: True rates, shape (n, 3) [rad/s].
        period: Since the previous call [s].
        noise: Standard normal numbers, see `Noise`, shape (n, 3, 3).
        sensors: See `Sensors`.
        assumed: See `Assumed`.
        state: See `FilterState`; replaced in place.
    """
    for j in range(q_BN.shape[0]):
        q = normalised(quaternion(q_BN, j))
        if state.started[j]:
            _propagate(j, q, vector(omega_BN_B, j), period, noise, sensors, assumed, state)
        seen = product(q, turn(vector(sensors.star_tracker_offset, j)))
        error = scaled(sensors.star_tracker_noise[j], vector(noise[j], Noise.STAR_TRACKER))
        seen = product(seen, turn(error))
        if not state.started[j]:
            _start(j, seen, vector(omega_BN_B, j), assumed, state)
        elif sensors.star_tracker_works[j]:
            if not sensors.gyro_works[j] and state.tracked[j]:
                moved = rotation_vector(product(conjugate(quaternion(state.q_tracked, j)), seen))
                put_vector(state.omega_BN_B, j, scaled(1.0 / period, moved))
            _update(j, seen, assumed.star_tracker_noise, state)
        put_quaternion(state.q_tracked, j, seen)
        state.tracked[j] = sensors.star_tracker_works[j]
        put_quaternion(state.q_before, j, q)


@kernel
def _start(j: int, seen: Quaternion, omega: Vector, assumed: Assumed, state: FilterState) -> None:
    put_quaternion(state.q_BN, j, seen)
    put_vector(state.omega_BN_B, j, omega)
    for k in range(3):
        state.covariance[j, k, k] = assumed.star_tracker_noise**2
        state.covariance[j, 3 + k, 3 + k] = assumed.initial_bias**2
    state.started[j] = True


@kernel
def _propagate(
    j: int,
    q: Quaternion,
    omega: Vector,
    period: float,
    noise: Array,
    sensors: Sensors,
    assumed: Assumed,
    state: FilterState,
) -> None:
    white = sqrt(sensors.gyro_noise[j] ** 2 / period + sensors.bias_walk[j] ** 2 * period / 12.0)
    turned = rotation_vector(product(conjugate(quaternion(state.q_before, j)), q))
    estimated = vector(state.bias, j)
    rate = [0.0, 0.0, 0.0]
    moved = [0.0, 0.0, 0.0]
    for k in range(3):
        before = state.true_bias[j, k]
        after = before + sensors.bias_walk[j] * sqrt(period) * noise[j, Noise.BIAS_WALK, k]
        state.true_bias[j, k] = after
        error = 0.5 * (before + after) + sensors.gyro_offset[j, k] + white * noise[j, Noise.GYRO, k] - estimated[k]
        moved[k] = turned[k] + period * error
        rate[k] = omega[k] + error
    if sensors.gyro_works[j]:
        phi = (moved[0], moved[1], moved[2])
        put_vector(state.omega_BN_B, j, (rate[0], rate[1], rate[2]))
        extra = 0.0
    else:
        phi = scaled(period, vector(state.omega_BN_B, j))
        extra = (0.5 * _UNMEASURED_ACCELERATION * period**2) ** 2
    put_quaternion(state.q_BN, j, normalised(product(quaternion(state.q_BN, j), turn(phi))))
    _grow(state.covariance[j], state.work[j], phi, period, assumed, extra, sensors.gyro_works[j])


@kernel
def _grow(P: Array, work: Array, phi: Vector, period: float, assumed: Assumed, extra: float, biased: bool) -> None:
    """Carry the covariance over one period in which the body turned by `phi`.

    With P in blocks A (attitude), B (attitude and bias), C (bias), and the transition R, G above: B' = R B + G C and
    A' = (R A + G B^T) R^T + B' G^T.
    """
    A, B, C = P[:3, :3], P[:3, 3:], P[3:, 3:]
    R, G, part = work[0], work[1], work[2]
    _transition(phi, -period if biased else 0.0, R, G)
    noise, walk = assumed.gyro_noise**2, assumed.bias_walk**2
    for i in range(3):
        for k in range(3):
            part[i, k] = _row(R, i, A, k) + G[i, 0] * B[k, 0] + G[i, 1] * B[k, 1] + G[i, 2] * B[k, 2]
    _replace_product(R, B, G, C)
    for i in range(3):
        for k in range(i + 1):
            grown = part[i, 0] * R[k, 0] + part[i, 1] * R[k, 1] + part[i, 2] * R[k, 2]
            grown += B[i, 0] * G[k, 0] + B[i, 1] * G[k, 1] + B[i, 2] * G[k, 2]
            A[i, k] = A[k, i] = grown
        A[i, i] += noise * period + walk * period**3 / 3.0 + extra
        C[i, i] += walk * period
        if biased:
            B[i, i] -= 0.5 * walk * period**2
    _mirror(P)


@kernel
def _mirror(P: Array) -> None:
    """Write the block of bias and attitude below that of attitude and bias."""
    for i in range(3):
        for k in range(3):
            P[3 + k, i] = P[i, 3 + k]


@kernel
def _row(a: Array, i: int, b: Array, k: int) -> float:
    """Element i, k of the product of two matrices of shape (3, 3)."""
    return a[i, 0] * b[0, k] + a[i, 1] * b[1, k] + a[i, 2] * b[2, k]


@kernel
def _replace_product(R: Array, B: Array, G: Array, C: Array) -> None:
    """Replace B by R B + G C."""
    for k in range(3):
        x, y, z = B[0, k], B[1, k], B[2, k]
        for i in range(3):
            B[i, k] = R[i, 0] * x + R[i, 1] * y + R[i, 2] * z + _row(G, i, C, k)


@kernel
def _update(j: int, seen: Quaternion, sigma: float, state: FilterState) -> None:
    """Take a star tracker attitude in.

    It measures theta itself with noise r = sigma^2 about each axis, so that with S = A + r I the gains are A S^-1 and
    B^T S^-1, and A becomes r S^-1 A, B becomes r S^-1 B, C becomes C - B^T S^-1 B.
    """
    P = state.covariance[j]
    A, B, C = P[:3, :3], P[:3, 3:], P[3:, 3:]
    z = rotation_vector(product(conjugate(quaternion(state.q_BN, j)), seen))
    r = sigma**2
    inverse, shrunk = state.work[j, 0], state.work[j, 1]
    _invert_sum(A, r, inverse)
    # S^-1 times the residual gives all corrections.
    w = (_dot_row(inverse, 0, z), _dot_row(inverse, 1, z), _dot_row(inverse, 2, z))
    theta = (_dot_row(A, 0, w), _dot_row(A, 1, w), _dot_row(A, 2, w))
    change = (_dot_column(B, 0, w), _dot_column(B, 1, w), _dot_column(B, 2, w))
    for i in range(3):
        for k in range(3):
            shrunk[i, k] = _row(inverse, i, B, k)
    for i in range(3):
        for k in range(i + 1):
            C[i, k] -= B[0, i] * shrunk[0, k] + B[1, i] * shrunk[1, k] + B[2, i] * shrunk[2, k]
            C[k, i] = C[i, k]
    for i in range(3):
        for k in range(3):
            B[i, k] = r * shrunk[i, k]
    for i in range(3):
        for k in range(3):
            shrunk[i, k] = r * _row(inverse, i, A, k)
    for i in range(3):
        for k in range(3):
            A[i, k] = 0.5 * (shrunk[i, k] + shrunk[k, i])
    _mirror(P)
    put_quaternion(state.q_BN, j, normalised(product(quaternion(state.q_BN, j), turn(theta))))
    put_vector(state.bias, j, combine(1.0, vector(state.bias, j), 1.0, change))


@kernel
def _dot_row(a: Array, i: int, v: Vector) -> float:
    return a[i, 0] * v[0] + a[i, 1] * v[1] + a[i, 2] * v[2]


@kernel
def _dot_column(a: Array, k: int, v: Vector) -> float:
    return a[0, k] * v[0] + a[1, k] * v[1] + a[2, k] * v[2]


@kernel
def _invert_sum(A: Array, r: float, inverse: Array) -> None:
    """Write (A + r I)^-1 of a symmetric A, by cofactors."""
    a, b, c = A[0, 0] + r, A[1, 1] + r, A[2, 2] + r
    d, e, f = A[0, 1], A[0, 2], A[1, 2]
    inverse[0, 0], inverse[1, 1], inverse[2, 2] = b * c - f * f, a * c - e * e, a * b - d * d
    inverse[0, 1], inverse[0, 2], inverse[1, 2] = e * f - c * d, d * f - b * e, d * e - a * f
    scale = 1.0 / (a * inverse[0, 0] + d * inverse[0, 1] + e * inverse[0, 2])
    for i in range(3):
        for k in range(i, 3):
            inverse[i, k] *= scale
            inverse[k, i] = inverse[i, k]


@kernel
def turn(phi: Vector) -> Quaternion:
    """The quaternion of a rotation vector [rad]."""
    angle = sqrt(phi[0] * phi[0] + phi[1] * phi[1] + phi[2] * phi[2])
    scale = 0.5 - angle * angle / 48.0 if angle < 1e-4 else sin(0.5 * angle) / angle
    return cos(0.5 * angle), scale * phi[0], scale * phi[1], scale * phi[2]


@kernel
def rotation_vector(q: Quaternion) -> Vector:
    """The rotation vector of a unit quaternion, taken the short way [rad]."""
    sign = -1.0 if q[0] < 0.0 else 1.0
    length = sqrt(q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    scale = 2.0 * sign if length < 1e-9 else 2.0 * sign * atan2(length, sign * q[0]) / length
    return scale * q[1], scale * q[2], scale * q[3]


@kernel
def _transition(phi: Vector, factor: float, R: Array, G: Array) -> None:
    """Write exp(-[phi x]) and `factor` times the right Jacobian, I - (1 - cos)/p^2 [phi x] + (p - sin)/p^3 [phi x]^2."""
    angle2 = phi[0] * phi[0] + phi[1] * phi[1] + phi[2] * phi[2]
    angle = sqrt(angle2)
    if angle < 1e-3:
        first, second, third = 1.0 - angle2 / 6.0, 0.5 - angle2 / 24.0, 1.0 / 6.0 - angle2 / 120.0
    else:
        first, second = sin(angle) / angle, (1.0 - cos(angle)) / angle2
        third = (angle - sin(angle)) / (angle2 * angle)
    for i in range(3):
        for k in range(3):
            square = phi[i] * phi[k]
            if i == k:
                R[i, i] = 1.0 + second * (square - angle2)
                G[i, i] = factor * (1.0 + third * (square - angle2))
            else:
                # [phi x] has +phi_m at the place of an odd permutation, -phi_m at that of an even one.
                m = 3 - i - k
                tilde = -phi[m] if (i + 1) % 3 == k else phi[m]
                R[i, k] = second * square - first * tilde
                G[i, k] = factor * (third * square - second * tilde)
