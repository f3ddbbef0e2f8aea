"""Normally distributed vectors: mean, quantiles and chances of their lengths, and whether samples belong to them.

With x = C^(1/2) z and z standard normal, |x|^2 = |z|^2 u^T C u: the length of z and its direction u are independent, the
square of the length is chi-squared distributed and directions are uniform; quadrature goes over these.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import brentq
from scipy.special import gammainc, gammaincc, gammaincinv, gammaln

from swarm_mj.typing import Array

#: Nodes and weights of the quadrature in each angle.
NODES, WEIGHTS = np.polynomial.legendre.leggauss(64)


def length_within(covariance: Array, length: float) -> float:
    """Chance that a vector of 2 or 3 components with this covariance, and mean zero, is no longer than `length` [-]."""
    variance, weight = _variances(covariance)
    chi2 = np.divide(length**2, variance, out=np.full_like(variance, np.inf), where=variance > 0.0)
    return float(weight @ gammainc(0.5 * len(covariance), 0.5 * chi2))


def length_quantile(covariance: Array, chance: float) -> float:
    """Length that a vector of 2 or 3 components exceeds with 1 - `chance`, in the unit of its components."""
    largest = float(np.sqrt(np.linalg.eigvalsh(covariance)[-1].clip(0.0)))
    if largest == 0.0:
        return 0.0
    most = largest * float(np.sqrt(2.0 * gammaincinv(0.5 * len(covariance), chance)))
    return float(brentq(lambda length: length_within(covariance, length) - chance, 0.0, 1.001 * most, xtol=1e-9 * most))


def length_mean(covariance: Array) -> float:
    """Mean length of a vector of 2 or 3 components."""
    variance, weight = _variances(covariance)
    half = 0.5 * len(covariance)
    return float(np.sqrt(2.0) * np.exp(gammaln(half + 0.5) - gammaln(half)) * (weight @ np.sqrt(variance)))


def sample_chance(samples: Array, covariance: Array) -> float:
    """Chance that draws of a normal vector with mean zero and this covariance differ from it more than `samples` do [-].

    Nagao's test of a covariance matrix (1973, Annals of Statistics 1, 700) with the known mean, for many samples: with W the
    second moments, whitened, N/2 |W - I|^2 is chi-squared distributed with p (p + 1) / 2 degrees of freedom, and N |mean|^2
    with p; the smaller of both chances counts, twice. With 1,000 samples of three components, sigmas that are wrong by 6 %
    fail at 0.001.

    Args:
        samples: Shape (N, p).
        covariance: Shape (p, p), not singular.
    """
    n, p = samples.shape
    size = np.sqrt(np.diag(covariance))
    white = np.linalg.solve(np.linalg.cholesky(covariance / np.outer(size, size)), (samples / size).T)
    moments, mean = white @ white.T / n, white.mean(axis=1)
    spread = gammaincc(0.25 * p * (p + 1), 0.25 * n * float(((moments - np.eye(p)) ** 2).sum()))
    centre = gammaincc(0.5 * p, 0.5 * n * float(mean @ mean))
    return float(min(1.0, 2.0 * min(spread, centre)))


def _variances(covariance: Array) -> tuple[Array, Array]:
    """u^T C u for directions u all around, and weights that sum to 1."""
    principal = np.linalg.eigvalsh(covariance).clip(0.0)
    # All is even in each principal component: a quarter of the circle, an eighth of the sphere.
    angle, weight = 0.25 * np.pi * (NODES + 1.0), 0.5 * WEIGHTS
    around = principal[0] * np.cos(angle) ** 2 + principal[1] * np.sin(angle) ** 2
    if len(principal) == 2:
        return around, weight
    height2 = (0.5 * (NODES + 1.0))[:, None] ** 2
    variance = principal[2] * height2 + around * (1.0 - height2)
    return variance.ravel(), np.outer(weight, weight).ravel()
