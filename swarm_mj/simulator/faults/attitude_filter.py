"""Gyro, star tracker and a multiplicative extended Kalman filter of attitude and gyro bias, compiled, for n spacecraft.

The gyro integrates: over a period T it gives the rotation of the body plus bias and noise (Farrenkopf 1978; discrete form of
Crassidis and Junkins, Optimal Estimation of Dynamic Systems, 2nd ed., section 4.7). The star tracker gives the attitude, turned
by its mounting error and noise. The filter estimates the attitude and the bias (Lefferts, Markley and Shuster, J. Guidance 5,
1982): with q_true = q_est * dq(theta) and the bias error b - b_est its state is (theta, b - b_est), six numbers in B,

    theta' = exp(-[phi x]) theta - J_r(phi) T (b - b_est) + noise,      phi = measured rotation less b_est T,

J_r the right Jacobian of the rotation group. Quaternions (w, x, y, z), v_N = R(q_BN) v_B; radians, seconds.

Spacecraft are taken side by side, see `lanes`; matrices are tuples of rows, and what is carried on lies as `abreast` reads it.
"""

from __future__ import annotations

from math import sqrt
from typing import Any

from swarm_mj.simulator.faults.filter_state import ATTITUDE, BIAS, MIXED, Assumed, FilterState, Noise, Sensors
from swarm_mj.spacecraft.attitude.algebra import (
    SMALL,
    combine,
    conjugate,
    dot,
    half_angle_terms,
    normalised,
    product,
    product_transposed,
    quaternions,
    rotation_vector,
    scaled,
    select_each,
    transformed,
    transposed,
    turn,
    vectors,
)
from swarm_mj.spacecraft.attitude.lanes import (
    abreast,
    every,
    put_abreast,
    put_columns,
    select,
    some,
    width,
)
from swarm_mj.typing import Array, lean, woven

#: Angular acceleration that the filter allows for where it has no gyro [rad/s^2]: a slewing CubeSat with 4 mN m wheels.
_UNMEASURED_ACCELERATION = 0.03


@lean
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
    for j in range(0, q_BN.shape[0], width()):
        q, omega = normalised(quaternions(q_BN, j)), vectors(omega_BN_B, j)
        seen = _seen(j, q, noise, sensors)
        if state.started[0]:
            turned = rotation_vector(product(conjugate(_four(state.q_before, j)), q))
            measured = _measured(j, turned, omega, period, noise, sensors, state)
            phi, rate = _believed(j, measured, seen, period, sensors, state)
            put_columns(state.omega_BN_B, j, 1, rate)
            _filter(j, phi, seen, period, sensors, assumed, state)
        else:
            put_columns(state.q_BN, j, 1, seen)
            put_columns(state.omega_BN_B, j, 1, omega)
            _start(j, assumed, state)
        put_abreast(state.q_tracked, j, seen)
        put_abreast(state.q_before, j, q)
    state.started[0] = True
    for j in range(state.tracked.shape[0]):
        state.tracked[j] = sensors.star_tracker_works[j]


@woven
def _seen(j: int, q: Any, noise: Array, sensors: Sensors) -> Any:
    """The attitude as the star tracker gives it."""
    offset = _three(sensors.star_tracker_offset, j)
    if some((offset[0] != 0.0) | (offset[1] != 0.0) | (offset[2] != 0.0)):
        q = product(q, turn(offset))
    sigma = abreast(sensors.star_tracker_noise, j)
    return product(q, turn(scaled(sigma, vectors(noise[:, Noise.STAR_TRACKER], j))))


@woven
def _measured(
    j: int, turned: Any, omega: Any, period: float, noise: Array, sensors: Sensors, state: FilterState
) -> Any:
    """Rotation over the period and rate as the gyro gives them, less the estimated bias; the true bias walks on.

    Args:
        j: First of the spacecraft.
        turned: True rotation over the period [rad].
        omega: True rate [rad/s].
        period: [s].
        noise: See `estimate`.
        sensors: The same.
        state: The same.
    """
    walk, gyro = abreast(sensors.bias_walk, j), abreast(sensors.gyro_noise, j)
    white = sqrt(gyro * gyro / period + walk * walk * period / 12.0)
    before = _three(state.true_bias, j)
    after = combine(1.0, before, walk * sqrt(period), vectors(noise[:, Noise.BIAS_WALK], j))
    put_abreast(state.true_bias, j, after)
    bias = combine(1.0, combine(0.5, before, 0.5, after), 1.0, _three(sensors.gyro_offset, j))
    error = combine(1.0, bias, white, vectors(noise[:, Noise.GYRO], j))
    error = combine(1.0, error, -1.0, _three(state.bias, j))
    return combine(1.0, turned, period, error), combine(1.0, omega, 1.0, error)


@woven
def _believed(j: int, measured: Any, seen: Any, period: float, sensors: Sensors, state: FilterState) -> Any:
    """Rotation over the period and rate that the filter goes by: the gyro's; without one, by the star tracker's attitudes."""
    (phi, rate), works = measured, abreast(sensors.gyro_works, j)
    if not every(works):
        before = vectors(state.omega_BN_B, j)
        moved = rotation_vector(product(conjugate(_four(state.q_tracked, j)), seen))
        again = abreast(state.tracked, j) & abreast(sensors.star_tracker_works, j)
        phi = select_each(works, phi, scaled(period, before))
        rate = select_each(works, rate, select_each(again, scaled(1.0 / period, moved), before))
    return phi, rate


@woven
def _start(j: int, assumed: Assumed, state: FilterState) -> None:
    rows, a, c = state.covariance, assumed.star_tracker_noise**2, assumed.initial_bias**2
    put_abreast(rows[ATTITUDE:], j, (a, 0.0, 0.0, a, 0.0, a))
    put_abreast(rows[MIXED:], j, (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    put_abreast(rows[BIAS:], j, (c, 0.0, 0.0, c, 0.0, c))


@woven
def _filter(j: int, phi: Any, seen: Any, period: float, sensors: Sensors, assumed: Assumed, state: FilterState) -> None:
    """Carry the estimates over the period in which the body turned by `phi`, and take the star tracker's attitude in."""
    P = _grown(_covariance(j, state), phi, period, assumed, abreast(sensors.gyro_works, j))
    q, tracks = product(quaternions(state.q_BN, j), turn(phi)), abreast(sensors.star_tracker_works, j)
    if some(tracks):
        theta, change, taken = _updated(P, rotation_vector(product(conjugate(q), seen)), assumed.star_tracker_noise)
        still, bias = (0.0, 0.0, 0.0), _three(state.bias, j)
        put_abreast(state.bias, j, combine(1.0, bias, 1.0, select_each(tracks, change, still)))
        q = product(q, turn(select_each(tracks, theta, still)))
        if every(tracks):
            P = taken
        else:
            P = _either(tracks, taken[0], P[0]), _either(tracks, taken[1], P[1]), _either(tracks, taken[2], P[2])
    rows = state.covariance
    put_columns(state.q_BN, j, 1, normalised(q))
    put_abreast(rows[ATTITUDE:], j, _upper(P[0]))
    put_abreast(rows[MIXED:], j, (*P[1][0], *P[1][1], *P[1][2]))
    put_abreast(rows[BIAS:], j, _upper(P[2]))


@woven
def _grown(P: Any, phi: Any, period: float, assumed: Assumed, biased: Any) -> Any:
    """The covariance after one period in which the body turned by `phi`, `biased` where it was a gyro that said so.

    With P in blocks A (attitude), B (attitude and bias), C (bias), and the transition R, G above: B' = R B + G C and
    A' = (R A + G B^T) R^T + B' G^T.
    """
    A, B, C = P
    R, G = _transition(phi, select(biased, -period, 0.0))
    part = _sum(product_transposed(R, A), product_transposed(G, B))
    B = _sum(product_transposed(R, transposed(B)), product_transposed(G, C))
    A = _sum(product_transposed(part, R), product_transposed(B, G))
    noise, walk = assumed.gyro_noise**2, assumed.bias_walk**2
    grown = noise * period + walk * period**3 / 3.0
    unmeasured = (0.5 * _UNMEASURED_ACCELERATION * period**2) ** 2
    A = _with_diagonal(A, select(biased, grown, grown + unmeasured))
    B = _with_diagonal(B, select(biased, -0.5 * walk * period**2, 0.0))
    return A, B, _with_diagonal(C, walk * period)


@woven
def _updated(P: Any, z: Any, sigma: float) -> Any:
    """Corrections of attitude and bias, and the covariance, from a star tracker attitude that is off by z.

    It measures theta itself with noise r = sigma^2 about each axis, so that with S = A + r I the gains are A S^-1 and
    B^T S^-1, and A becomes r S^-1 A, B becomes r S^-1 B, C becomes C - B^T S^-1 B.
    """
    (A, B, C), r = P, sigma**2
    inverse, columns = _inverse(_with_diagonal(A, r)), transposed(B)
    w = transformed(inverse, z)
    shrunk = product_transposed(inverse, columns)
    taken = product_transposed(columns, transposed(shrunk))
    less = combine(1.0, C[0], -1.0, taken[0]), combine(1.0, C[1], -1.0, taken[1]), combine(1.0, C[2], -1.0, taken[2])
    kept = _scaled(r, product_transposed(inverse, A)), _scaled(r, shrunk), less
    return transformed(A, w), transformed(columns, w), kept


@woven
def _inverse(S: Any) -> Any:
    """The inverse of a symmetric matrix, by cofactors."""
    a, b, c, d, e, f = S[0][0], S[1][1], S[2][2], S[0][1], S[0][2], S[1][2]
    x = (b * c - f * f, e * f - c * d, d * f - b * e)
    scale = 1.0 / dot((a, d, e), x)
    yy, yz, zz = scale * (a * c - e * e), scale * (d * e - a * f), scale * (a * b - d * d)
    x = scaled(scale, x)
    return x, (x[1], yy, yz), (x[2], yz, zz)


@woven
def _transition(phi: Any, factor: Any) -> Any:
    """exp(-[phi x]) and `factor` times the right Jacobian, I - (1 - cos)/p^2 [phi x] + (p - sin)/p^3 [phi x]^2."""
    angle2 = dot(phi, phi)
    c, share = half_angle_terms(0.25 * angle2, 0.5)
    first, second = 2.0 * share * c, 2.0 * share * share  # sin / p and (1 - cos) / p^2
    third = 1.0 / 5_040.0 - angle2 * (1.0 / 362_880.0 - angle2 / 39_916_800.0)
    third = 1.0 / 6.0 - angle2 * (1.0 / 120.0 - angle2 * third)
    large = 0.25 * angle2 >= SMALL
    if some(large):
        third = select(large, (1.0 - first) / angle2, third)
    R = _about(phi, 1.0 - second * angle2, first, second)
    return R, _about(phi, factor * (1.0 - third * angle2), factor * second, factor * third)


@woven
def _about(phi: Any, one: Any, tilde: Any, square: Any) -> Any:
    """The matrix `one` I - `tilde` [phi x] + `square` phi phi^T."""
    x, y, z = phi
    (u, v, w), (p, q, r) = scaled(square, phi), scaled(tilde, phi)
    return (one + u * x, u * y + r, u * z - q), (u * y - r, one + v * y, v * z + p), (u * z + q, v * z - p, one + w * z)


@woven
def _covariance(j: int, state: FilterState) -> Any:
    rows = state.covariance
    B = _three(rows[MIXED:], j), _three(rows[MIXED + 3 :], j), _three(rows[MIXED + 6 :], j)
    return _symmetric(rows[ATTITUDE:], j), B, _symmetric(rows[BIAS:], j)


@woven
def _symmetric(rows: Array, j: int) -> Any:
    """The matrix with this upper triangle."""
    (a, d, e), (b, f, c) = _three(rows, j), _three(rows[3:], j)
    return (a, d, e), (d, b, f), (e, f, c)


@woven
def _upper(a: Any) -> Any:
    return a[0][0], a[0][1], a[0][2], a[1][1], a[1][2], a[2][2]


@woven
def _sum(a: Any, b: Any) -> Any:
    return combine(1.0, a[0], 1.0, b[0]), combine(1.0, a[1], 1.0, b[1]), combine(1.0, a[2], 1.0, b[2])


@woven
def _scaled(p: float, a: Any) -> Any:
    return scaled(p, a[0]), scaled(p, a[1]), scaled(p, a[2])


@woven
def _with_diagonal(a: Any, more: Any) -> Any:
    """A matrix plus `more` I."""
    x, y, z = a
    return (x[0] + more, x[1], x[2]), (y[0], y[1] + more, y[2]), (z[0], z[1], z[2] + more)


@woven
def _either(flags: Any, a: Any, b: Any) -> Any:
    """The matrix a where a flag is set, otherwise b."""
    return select_each(flags, a[0], b[0]), select_each(flags, a[1], b[1]), select_each(flags, a[2], b[2])


@woven
def _three(rows: Array, j: int) -> Any:
    return abreast(rows[0], j), abreast(rows[1], j), abreast(rows[2], j)


@woven
def _four(rows: Array, j: int) -> Any:
    return abreast(rows[0], j), abreast(rows[1], j), abreast(rows[2], j), abreast(rows[3], j)
