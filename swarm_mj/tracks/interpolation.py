"""Interpolation between the lines of a file: Hermite, Lagrange and linear, on a window of samples about each time asked for.

Divided differences in Newton's form; nodes of Hermite's polynomial count twice (Stoer and Bulirsch, section 2.1.5). A time that
is a sample's gives that sample itself.
"""

from __future__ import annotations

import numpy as np

from swarm_mj.typing import Array, Ints

#: Higher degrees swing between samples.
MAX_DEGREE = 27


def windows(t: Array, times: Array, size: int) -> Ints:
    """First of `size` consecutive samples, of k rising ones, about each time within them, shape (q,)."""
    after = np.searchsorted(t, times, side="right")
    return np.clip(after - (size + 1) // 2, 0, len(t) - size).astype(np.int64)


def interpolate(t: Array, values: Array, times: Array, *, degree: int, rates: Array | None = None) -> Array:
    """Values at times between samples.

    Args:
        t: Samples [s], rising, shape (k,).
        values: At the samples, shape (k, m).
        times: Within the samples [s], shape (q,).
        degree: Of the polynomial; lower where there are too few samples.
        rates: Derivatives of the values by time, shape (k, m): Hermite's polynomial; None: Lagrange's.

    Returns:
        Shape (q, m).
    """
    out, _ = _interpolated(t, values, times, degree, rates)
    # What is asked for at a sample is the sample, to the last bit.
    at = np.clip(np.searchsorted(t, times), 0, len(t) - 1)
    there = t[at] == times
    out[there] = values[at[there]]
    return out


def slopes(t: Array, values: Array, times: Array, *, degree: int, rates: Array | None = None) -> Array:
    """Derivatives by time of what `interpolate` gives, with the same arguments, shape (q, m)."""
    return _interpolated(t, values, times, degree, rates)[1]


def _interpolated(t: Array, values: Array, times: Array, degree: int, rates: Array | None) -> tuple[Array, Array]:
    size = min(len(t), max(1, (degree + 1) // 2) if rates is not None else degree + 1)
    first = windows(t, times, size)
    near = first[:, None] + np.arange(size)
    width = t[near[:, -1]] - t[near[:, 0]]
    scale = np.where(width > 1e-300, width, 1.0)  # a window of one sample has no width, but a slope
    x = (t[near] - times[:, None]) / scale[:, None]
    y = values[near]
    if rates is None:
        out, slope = _newton(x, y, None)
    else:
        out, slope = _newton(np.repeat(x, 2, axis=1), np.repeat(y, 2, axis=1), rates[near] * scale[:, None, None])
    return out, slope / scale[:, None]


def _newton(x: Array, y: Array, rates: Array | None) -> tuple[Array, Array]:
    """Value and slope at 0 of the polynomials through nodes x, shape (q, s), with values y, shape (q, s, m)."""
    table = y.copy()
    out, slope = np.zeros(y[:, 0].shape), np.zeros(y[:, 0].shape)
    coefficients = [table[:, 0].copy()]
    for order in range(1, x.shape[1]):
        gap = (x[:, order:] - x[:, :-order])[..., None]
        difference = table[:, 1:] - table[:, :-1]
        if order == 1 and rates is not None:
            table = np.empty_like(difference)
            table[:, 0::2] = rates
            table[:, 1::2] = difference[:, 1::2] / gap[:, 1::2]
        else:
            table = difference / gap
        coefficients.append(table[:, 0].copy())
    for k in range(len(coefficients) - 1, -1, -1):
        slope = out - x[:, k, None] * slope
        out = coefficients[k] - x[:, k, None] * out
    return out, slope


def slerp(t: Array, q: Array, times: Array) -> Array:
    """Unit quaternions at times between samples, turned at a constant rate from one to the next, shape (k, 4) to (q, 4)."""
    if len(t) == 1:
        return np.repeat(q, len(times), axis=0)
    k = windows(t, times, 2)
    a, b = q[k], q[k + 1]
    share = ((times - t[k]) / (t[k + 1] - t[k]))[:, None]
    cosine = np.sum(a * b, axis=1, keepdims=True)
    b, cosine = np.where(cosine < 0.0, -b, b), np.abs(cosine)
    # By the chord: the arc cosine of nearly 1 has no digits.
    angle = 2.0 * np.arcsin(np.minimum(0.5 * np.linalg.norm(b - a, axis=1, keepdims=True), 1.0))
    small = angle < 1e-12
    sine = np.where(small, 1.0, np.sin(angle))
    arc = (np.sin((1.0 - share) * angle) * a + np.sin(share * angle) * b) / sine
    out = np.where(small, (1.0 - share) * a + share * b, arc)
    turned: Array = out / np.linalg.norm(out, axis=1, keepdims=True)
    return turned
