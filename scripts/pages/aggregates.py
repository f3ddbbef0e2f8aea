"""What a few training runs say together: interquartile means with bootstrap intervals, as rliable defines them.

Agarwal, Schwarzer, Castro, Courville and Bellemare 2021, "Deep Reinforcement Learning at the Edge of the Statistical
Precipice":
scores of several runs on several tasks are put together, a quarter of them is left out at either end, and the rest averaged.
The interval comes from runs drawn anew with replacement, task by task.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.stats import trim_mean

from swarm_mj.errors import OutputError
from swarm_mj.typing import Array

#: Samples of the bootstrap, and the share of them that an interval holds.
RESAMPLES, CONFIDENCE = 2_000, 0.95
#: Left out at either end.
QUARTER = 0.25


class Aggregate(NamedTuple):
    """An interquartile mean and its interval.

    Attributes:
        mean: Interquartile mean.
        low: Lower end of the interval.
        high: Upper end of the interval.
    """

    mean: float
    low: float
    high: float


def interquartile_mean(scores: Array) -> float:
    """Of all scores together, a quarter left out at either end; any shape."""
    return float(trim_mean(np.ravel(scores), QUARTER))


def aggregate(scores: Array, seed: int = 0) -> Aggregate:
    """Interquartile mean of runs on tasks and its stratified bootstrap interval.

    Args:
        scores: Shape (runs, tasks).
        seed: Of the bootstrap.

    Raises:
        OutputError: It has not two dimensions, or a score is no number.
    """
    given = np.asarray(scores, np.float64)
    if given.ndim != 2 or not given.size or not np.isfinite(given).all():
        raise OutputError(f"scores of shape {given.shape}: must be finite numbers of shape (runs, tasks)")
    runs, tasks = given.shape
    # Runs are drawn for each task by itself.
    drawn = np.random.default_rng(seed).integers(runs, size=(RESAMPLES, runs, tasks))
    means = trim_mean(given[drawn, np.arange(tasks)].reshape(RESAMPLES, -1), QUARTER, axis=1)
    edge = 50.0 * (1.0 - CONFIDENCE)
    low, high = np.percentile(means, [edge, 100.0 - edge])
    return Aggregate(interquartile_mean(given), float(low), float(high))
