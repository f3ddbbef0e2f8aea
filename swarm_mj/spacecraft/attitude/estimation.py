"""What flight software knows of attitudes, compiled, for n spacecraft: gyro, star tracker, filter and delay.

The gyro integrates: over a period T it gives the rotation of the body plus bias and noise (Farrenkopf 1978; discrete form of
Crassidis and Junkins, Optimal Estimation of Dynamic Systems, 2nd ed., section 4.7). The star tracker gives the attitude, turned
by its mounting error and noise. A multiplicative extended Kalman filter estimates the attitude and the bias (Lefferts, Markley
and Shuster, J. Guidance 5, 1982): with q_true = q_est * dq(theta) and the bias error b - b_est its state is
(theta, b - b_est), six numbers in B,

    theta' = exp(-[phi x]) theta - J_r(phi) T (b - b_est) + noise,      phi = measured rotation less b_est T,

J_r the right Jacobian of the rotation group. Quaternions (w, x, y, z), v_N = R(q_BN) v_B; radians, seconds.
"""

from __future__ import annotations

from enum import IntEnum
from math import sqrt
from typing import NamedTuple, TypeAlias

import numpy as np

from swarm_mj.compilation import allocation_free, inlined, jittable, kernel
from swarm_mj.spacecraft.attitude.algebra import (
    SMALL,
    Matrix,
    Quaternion,
    Vector,
    combine,
    conjugate,
    dot,
    half_angle_terms,
    normalised,
    product,
    product_transposed,
    put_quaternion,
    put_vector,
    quaternion,
    rotation_vector,
    scaled,
    symmetric_inverse,
    transformed,
    transposed,
    turn,
    vector,
)
from swarm_mj.typing import Array, Ints, Mask

#: Blocks of a covariance: of the attitude error, of attitude and bias error, of the bias error.
Covariance: TypeAlias = tuple[Matrix, Matrix, Matrix]
#: Angular acceleration that the filter allows for where it has no gyro [rad/s^2]: a slewing CubeSat with 4 mN m wheels.
_UNMEASURED_ACCELERATION = 0.03


class Noise(IntEnum):
    """Rows of the standard normal numbers of one measurement, each with x, y, z."""

    GYRO = 0
    BIAS_WALK = 1
    STAR_TRACKER = 2


class Count(IntEnum):
    """Places of `AttitudeKnowledge.counts`."""

    NOISE = 0  #: rows of the noise that have been used
    READINGS = 1  #: readings so far
    TICK = 2  #: control period of the last one; -1: none yet
    FILTERS = 3  #: 1 where sensors err, so that a filter runs


class Sensors(NamedTuple):
    """True properties of the sensors of n spacecraft, which faults may change."""

    gyro_noise: Array  #: angular random walk, shape (n,) [rad/sqrt(s)]
    bias_walk: Array  #: random walk of the gyro's bias, shape (n,) [rad/s/sqrt(s)]
    star_tracker_noise: Array  #: one sigma about each axis, shape (n,) [rad]
    gyro_offset: Array  #: added to the gyro's bias, shape (n, 3) [rad/s]
    star_tracker_offset: Array  #: mounting error as a rotation vector in B, shape (n, 3) [rad]
    gyro_works: Mask  #: shape (n,)
    star_tracker_works: Mask  #: shape (n,)


class Assumed(NamedTuple):
    """What the filter believes of the sensors, one sigma each."""

    gyro_noise: float  #: angular random walk [rad/sqrt(s)]
    bias_walk: float  #: [rad/s/sqrt(s)]
    star_tracker_noise: float  #: about each axis [rad]
    initial_bias: float  #: of the gyro at the start [rad/s]


class FilterState(NamedTuple):
    """What is carried from one period to the next."""

    q_BN: Array  #: estimated attitudes, shape (n, 4)
    omega_BN_B: Array  #: estimated rates, shape (n, 3) [rad/s]
    bias: Array  #: estimated gyro biases, shape (n, 3) [rad/s]
    covariance: Array  #: of attitude error [rad] and bias error [rad/s], shape (n, 6, 6)
    true_bias: Array  #: the gyro's walking bias, without `Sensors.gyro_offset`, shape (n, 3) [rad/s]
    q_before: Array  #: true attitudes at the previous call, shape (n, 4)
    q_tracked: Array  #: the star tracker's previous attitude, shape (n, 4)
    tracked: Mask  #: whether there is one of the previous period, shape (n,)
    started: Mask  #: whether the filter runs, shape (1,)


class AttitudeKnowledge(NamedTuple):
    """What the flight software of n spacecraft knows, and what it knows it by."""

    sensors: Sensors
    assumed: Array  #: in the order of `Assumed`, shape (4,)
    state: FilterState
    noise: Array  #: standard normal numbers of the readings to come, see `Noise`, shape (rows, n, 3, 3)
    counts: Ints  #: see `Count`, shape (4,)
    delay: Ints  #: readings by which each is late, shape (n,)
    q_past: Array  #: the last readings, one after the other in turn, shape (size, n, 4)
    omega_past: Array  #: the same of the rates, shape (size, n, 3) [rad/s]
    q_BN: Array  #: attitudes that the control law is given, shape (n, 4)
    omega_BN_B: Array  #: rates, shape (n, 3) [rad/s]


def sensors_of(n: int, gyro_noise: float, bias_walk: float, star_tracker_noise: float) -> Sensors:
    """Sensors of n spacecraft that are all alike, work, and have no offsets; see `Sensors`."""
    noises = np.full(n, gyro_noise), np.full(n, bias_walk), np.full(n, star_tracker_noise)
    return Sensors(*noises, *np.zeros((2, n, 3)), *np.ones((2, n), np.bool_))


def first_state(true_bias: Array) -> FilterState:
    """The state before the first measurement, with the true biases of the gyros, shape (n, 3) [rad/s]."""
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


def first_knowledge(n: int, noise_rows: int, readings: int) -> AttitudeKnowledge:
    """Before the first reading, with sensors that do not err; `noise_rows` readings draw their noise at once."""
    return AttitudeKnowledge(
        sensors=sensors_of(n, 0.0, 0.0, 0.0),
        assumed=np.zeros(4),
        state=first_state(np.zeros((n, 3))),
        noise=np.zeros((noise_rows, n, 3, 3)),
        counts=np.array([noise_rows, 0, -1, 0]),
        delay=np.zeros(n, np.int64),
        q_past=np.zeros((readings, n, 4)),
        omega_past=np.zeros((readings, n, 3)),
        q_BN=np.zeros((n, 4)),
        omega_BN_B=np.zeros((n, 3)),
    )


@kernel
def sense(tick: int, q_BN: Array, omega_BN_B: Array, period: float, known: AttitudeKnowledge) -> None:
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
    if counts[Count.FILTERS] != 0:
        noise, a = known.noise[counts[Count.NOISE]], known.assumed
        assumed = Assumed(a[0], a[1], a[2], a[3])
        estimate(q_BN, omega_BN_B, period, noise, known.sensors, assumed, known.state)
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


@allocation_free
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
        q, omega = normalised(quaternion(q_BN, j)), vector(omega_BN_B, j)
        seen = _seen(j, q, noise, sensors)
        if state.started[0]:
            turned = rotation_vector(product(conjugate(quaternion(state.q_before, j)), q))
            phi, rate = _measured(j, turned, omega, period, noise, sensors, state)
            if not sensors.gyro_works[j]:
                phi, rate = _tracked(j, seen, period, sensors, state)
            put_vector(state.omega_BN_B, j, rate)
            _filter(j, phi, seen, period, sensors, assumed, state)
        else:
            put_quaternion(state.q_BN, j, seen)
            put_vector(state.omega_BN_B, j, omega)
            a, c = assumed.star_tracker_noise**2, assumed.initial_bias**2
            _put_covariance(state.covariance, j, (_diagonal(a), _diagonal(0.0), _diagonal(c)))
        put_quaternion(state.q_tracked, j, seen)
        put_quaternion(state.q_before, j, q)
        state.tracked[j] = sensors.star_tracker_works[j]
    state.started[0] = True


@inlined
def _seen(j: int, q: Quaternion, noise: Array, sensors: Sensors) -> Quaternion:
    """The attitude as the star tracker gives it."""
    offset = vector(sensors.star_tracker_offset, j)
    if offset[0] != 0.0 or offset[1] != 0.0 or offset[2] != 0.0:
        q = product(q, turn(offset))
    return product(q, turn(scaled(sensors.star_tracker_noise[j], vector(noise[j], Noise.STAR_TRACKER))))


@inlined
def _measured(
    j: int, turned: Vector, omega: Vector, period: float, noise: Array, sensors: Sensors, state: FilterState
) -> tuple[Vector, Vector]:
    """Rotation over the period and rate as the gyro gives the true ones, less the estimated bias; the true bias walks on."""
    walk, gyro = sensors.bias_walk[j], sensors.gyro_noise[j]
    white = sqrt(gyro * gyro / period + walk * walk * period / 12.0)
    before = vector(state.true_bias, j)
    after = combine(1.0, before, walk * sqrt(period), vector(noise[j], Noise.BIAS_WALK))
    put_vector(state.true_bias, j, after)
    bias = combine(1.0, combine(0.5, before, 0.5, after), 1.0, vector(sensors.gyro_offset, j))
    error = combine(1.0, bias, white, vector(noise[j], Noise.GYRO))
    error = combine(1.0, error, -1.0, vector(state.bias, j))
    return combine(1.0, turned, period, error), combine(1.0, omega, 1.0, error)


@inlined
def _tracked(j: int, seen: Quaternion, period: float, sensors: Sensors, state: FilterState) -> tuple[Vector, Vector]:
    """Rotation over the period and rate without a gyro: the rotation as the rate before says, the rate by two star fixes."""
    before = vector(state.omega_BN_B, j)
    rate = before
    if state.tracked[j] and sensors.star_tracker_works[j]:
        rate = scaled(1.0 / period, rotation_vector(product(conjugate(quaternion(state.q_tracked, j)), seen)))
    return scaled(period, before), rate


@inlined
def _filter(
    j: int, phi: Vector, seen: Quaternion, period: float, sensors: Sensors, assumed: Assumed, state: FilterState
) -> None:
    """Carry the estimates over the period in which the body turned by `phi`, and take the star tracker's attitude in."""
    P = _grown(_covariance(state.covariance, j), phi, period, assumed, sensors.gyro_works[j])
    q = product(quaternion(state.q_BN, j), turn(phi))
    if sensors.star_tracker_works[j]:
        theta, change, P = _updated(P, rotation_vector(product(conjugate(q), seen)), assumed.star_tracker_noise)
        put_vector(state.bias, j, combine(1.0, vector(state.bias, j), 1.0, change))
        q = product(q, turn(theta))
    put_quaternion(state.q_BN, j, normalised(q))
    _put_covariance(state.covariance, j, P)


@inlined
def _grown(P: Covariance, phi: Vector, period: float, assumed: Assumed, biased: bool) -> Covariance:
    """The covariance after one period in which the body turned by `phi`, `biased`: it was a gyro that said so.

    With P in blocks A (attitude), B (attitude and bias), C (bias), and the transition R, G above: B' = R B + G C and
    A' = (R A + G B^T) R^T + B' G^T.
    """
    A, B, C = P
    R, G = _transition(phi, -period if biased else 0.0)
    part = _sum(product_transposed(R, A), product_transposed(G, B))
    B = _sum(product_transposed(R, transposed(B)), product_transposed(G, C))
    A = _sum(product_transposed(part, R), product_transposed(B, G))
    noise, walk = assumed.gyro_noise**2, assumed.bias_walk**2
    grown = noise * period + walk * period**3 / 3.0
    unmeasured = (0.5 * _UNMEASURED_ACCELERATION * period**2) ** 2
    A = _with_diagonal(A, grown if biased else grown + unmeasured)
    B = _with_diagonal(B, -0.5 * walk * period**2 if biased else 0.0)
    return A, B, _with_diagonal(C, walk * period)


@inlined
def _updated(P: Covariance, z: Vector, sigma: float) -> tuple[Vector, Vector, Covariance]:
    """Corrections of attitude and bias, and the covariance, from a star tracker attitude that is off by z.

    It measures theta itself with noise r = sigma^2 about each axis, so that with S = A + r I the gains are A S^-1 and
    B^T S^-1, and A becomes r S^-1 A, B becomes r S^-1 B, C becomes C - B^T S^-1 B.
    """
    (A, B, C), r = P, sigma**2
    inverse, columns = symmetric_inverse(_with_diagonal(A, r)), transposed(B)
    w = transformed(inverse, z)
    shrunk = product_transposed(inverse, columns)
    taken = product_transposed(columns, transposed(shrunk))
    less = combine(1.0, C[0], -1.0, taken[0]), combine(1.0, C[1], -1.0, taken[1]), combine(1.0, C[2], -1.0, taken[2])
    kept = _scaled(r, product_transposed(inverse, A)), _scaled(r, shrunk), less
    return transformed(A, w), transformed(columns, w), kept


@inlined
def _transition(phi: Vector, factor: float) -> tuple[Matrix, Matrix]:
    """exp(-[phi x]) and `factor` times the right Jacobian, I - (1 - cos)/p^2 [phi x] + (p - sin)/p^3 [phi x]^2."""
    angle2 = dot(phi, phi)
    c, share = half_angle_terms(0.25 * angle2, 0.5)
    first, second = 2.0 * share * c, 2.0 * share * share  # sin / p and (1 - cos) / p^2
    if 0.25 * angle2 >= SMALL:
        third = (1.0 - first) / angle2
    else:
        third = 1.0 / 5_040.0 - angle2 * (1.0 / 362_880.0 - angle2 / 39_916_800.0)
        third = 1.0 / 6.0 - angle2 * (1.0 / 120.0 - angle2 * third)
    R = _about(phi, 1.0 - second * angle2, first, second)
    return R, _about(phi, factor * (1.0 - third * angle2), factor * second, factor * third)


@jittable
def _about(phi: Vector, one: float, tilde: float, square: float) -> Matrix:
    """The matrix `one` I - `tilde` [phi x] + `square` phi phi^T."""
    x, y, z = phi
    (u, v, w), (p, q, r) = scaled(square, phi), scaled(tilde, phi)
    return (one + u * x, u * y + r, u * z - q), (u * y - r, one + v * y, v * z + p), (u * z + q, v * z - p, one + w * z)


@inlined
def _covariance(P: Array, j: int) -> Covariance:
    return _block(P[j], 0, 0), _block(P[j], 0, 3), _block(P[j], 3, 3)


@inlined
def _put_covariance(P: Array, j: int, blocks: Covariance) -> None:
    """Write a covariance; of the blocks on the diagonal the upper triangle stands on both sides."""
    A, B, C = blocks
    for i in range(3):
        for k in range(3):
            P[j, i, 3 + k] = P[j, 3 + k, i] = B[i][k]
        for k in range(i, 3):
            P[j, i, k] = P[j, k, i] = A[i][k]
            P[j, 3 + i, 3 + k] = P[j, 3 + k, 3 + i] = C[i][k]


@jittable
def _block(P: Array, i: int, k: int) -> Matrix:
    return (
        (P[i, k], P[i, k + 1], P[i, k + 2]),
        (P[i + 1, k], P[i + 1, k + 1], P[i + 1, k + 2]),
        (P[i + 2, k], P[i + 2, k + 1], P[i + 2, k + 2]),
    )


@jittable
def _diagonal(a: float) -> Matrix:
    return (a, 0.0, 0.0), (0.0, a, 0.0), (0.0, 0.0, a)


@jittable
def _sum(a: Matrix, b: Matrix) -> Matrix:
    return combine(1.0, a[0], 1.0, b[0]), combine(1.0, a[1], 1.0, b[1]), combine(1.0, a[2], 1.0, b[2])


@jittable
def _scaled(p: float, a: Matrix) -> Matrix:
    return scaled(p, a[0]), scaled(p, a[1]), scaled(p, a[2])


@jittable
def _with_diagonal(a: Matrix, more: float) -> Matrix:
    """A matrix plus `more` I."""
    x, y, z = a
    return (x[0] + more, x[1], x[2]), (y[0], y[1] + more, y[2]), (z[0], z[1], z[2] + more)
