"""What a sample of runs says, with intervals: probabilities, quantiles, means, sensitivities. All by scipy.stats.

Intervals hold for independent runs (monte_carlo). Latin hypercubes and Sobol' sequences cover the parameters more evenly, so
that theirs are, if anything, too wide.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from swarm_mj.typing import Array

#: Confidence level of all intervals.
LEVEL = 0.95
RESAMPLES = 999
#: Widest interval of a Sobol' index that still says something about a share of the variance.
WIDEST_INDEX = 0.5


@dataclass(frozen=True)
class Estimate:
    """A number and its confidence interval; an end is NaN where the sample is too small to tell."""

    value: float
    low: float
    high: float


def index_told(index: Estimate) -> bool:
    """Whether a sample allows a Sobol' index: its interval is known and no wider than `WIDEST_INDEX`."""
    return bool(index.high - index.low <= WIDEST_INDEX)  # False for NaN


def probability(successes: int, n: int, method: str = "wilson") -> Estimate:
    """A probability from n trials, with the interval of Wilson (1927, `wilson`) or of Clopper and Pearson (1934, `exact`)."""
    if n == 0:
        return Estimate(np.nan, 0.0, 1.0)
    interval = stats.binomtest(successes, n).proportion_ci(LEVEL, method=method)
    return Estimate(successes / n, float(interval.low), float(interval.high))


def quantile(values: Array, p: float) -> Estimate:
    """A quantile with the interval between two order statistics that holds for any continuous distribution.

    Conover, Practical Nonparametric Statistics, 1999, section 3.2; NaN where the sample is too small for an end.
    """
    interval = stats.quantile_test(values, q=float(np.median(values)), p=p).confidence_interval(LEVEL)
    return Estimate(float(np.quantile(values, p)), float(interval.low), float(interval.high))


def mean(values: Array, rng: np.random.Generator) -> Estimate:
    """The mean with a bootstrap interval (percentile method)."""
    middle = float(values.mean())
    if len(values) < 2 or np.ptp(values) == 0.0:
        return Estimate(middle, middle if len(values) > 1 else np.nan, middle if len(values) > 1 else np.nan)
    found = stats.bootstrap(
        (values,), np.mean, confidence_level=LEVEL, n_resamples=RESAMPLES, method="percentile", rng=rng, batch=100
    )
    return Estimate(middle, float(found.confidence_interval.low), float(found.confidence_interval.high))


def spearman(x: Array, y: Array) -> tuple[Estimate, float] | None:
    """Rank correlation, its interval, and the p-value of none; None where a sample is constant or below 5 pairs.

    The interval is Fisher's transform with the variance of Bonett and Wright (Psychometrika 65, 2000).
    """
    if len(x) < 5 or np.ptp(x) == 0.0 or np.ptp(y) == 0.0:
        return None
    found = stats.spearmanr(x, y)
    rho = float(found.statistic)
    if abs(rho) >= 1.0:
        return Estimate(rho, rho, rho), float(found.pvalue)
    half = stats.norm.ppf(0.5 + 0.5 * LEVEL) * np.sqrt((1.0 + 0.5 * rho**2) / (len(x) - 3))
    z = np.arctanh(rho)
    return Estimate(rho, float(np.tanh(z - half)), float(np.tanh(z + half))), float(found.pvalue)


def correlation_ratio(groups: NDArray[Any], y: Array, rng: np.random.Generator) -> tuple[Estimate, float] | None:
    """How strongly an outcome depends on a choice: the square root of the share of its variance between the choices.

    The share is Kelley's unbiased epsilon squared (PNAS 21, 1935), its interval a bootstrap over runs (percentile method), and
    the p-value of no dependence that of Kruskal and Wallis. None where a sample is constant, or has fewer than 5 runs or 2 for
    each choice.
    """
    _, of = np.unique(groups, return_inverse=True)
    k, n = int(of.max(initial=0)) + 1, len(y)
    if n < max(5, 2 * k) or k < 2 or np.ptp(y) == 0.0:
        return None
    draws = rng.integers(n, size=(RESAMPLES, n))
    low, high = np.quantile([_epsilon(of[d], y[d], k) for d in draws], (0.5 - 0.5 * LEVEL, 0.5 + 0.5 * LEVEL))
    value = _epsilon(of, y, k)
    p = float(stats.kruskal(*(y[of == g] for g in range(k))).pvalue)
    return Estimate(value, min(float(low), value), max(float(high), value)), p


def _epsilon(of: NDArray[np.int64], y: Array, k: int) -> float:
    counts = np.bincount(of, minlength=k)
    means = np.bincount(of, y, k) / np.maximum(counts, 1)
    total = float(((y - y.mean()) ** 2).sum())
    if total == 0.0:
        return 0.0
    within = float(((y - means[of]) ** 2).sum())
    there = int((counts > 0).sum())
    return float(np.sqrt(max(0.0, 1.0 - within / total * (len(y) - 1) / max(len(y) - there, 1))))


def sobol(members: Array, rng: np.random.Generator) -> tuple[list[Estimate], list[Estimate]] | None:
    """Sobol' indices with bootstrap intervals: shares of an outcome's variance by factor.

    Args:
        members: Outcomes of the groups of a saltelli sample, shape (n, d + 2), n a power of 2: the point of A, that of B, and A
            with each of the d factors from B.
        rng: For the bootstrap over groups.

    Returns:
        Of each factor alone, and with all its interactions; None where the outcome does not vary.
    """
    if np.ptp(members[:, :2]) == 0.0:
        return None
    n, width = members.shape
    found = _indices(members)
    draws = np.array([_indices(members[rng.integers(n, size=n)]) for _ in range(RESAMPLES)])
    low, high = np.quantile(draws, (0.5 - 0.5 * LEVEL, 0.5 + 0.5 * LEVEL), axis=0)
    first, total = (
        [Estimate(float(found[k, i]), float(low[k, i]), float(high[k, i])) for i in range(width - 2)] for k in (0, 1)
    )
    return first, total


def _indices(members: Array) -> Array:
    """First-order and total indices, shape (2, d)."""
    values = {"f_A": members[None, :, 0], "f_B": members[None, :, 1], "f_AB": members[:, 2:].T[:, None, :]}
    found = stats.sobol_indices(func=values, n=len(members))
    return np.array([np.ravel(found.first_order), np.ravel(found.total_order)])
