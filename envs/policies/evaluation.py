"""Means with intervals, and how far a long evaluation is."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.stats import t as student

from swarm_mj.typing import Array

Progress = Callable[[int], None]


class Interval(NamedTuple):
    """A mean and the half width of its 95 % confidence interval."""

    mean: float
    half_width: float


def interval(values: Array) -> Interval:
    """Of independent values, by Student's t; shape (m,), m at least 2."""
    m = len(values)
    spread = float(np.std(values, ddof=1)) / m**0.5
    return Interval(float(np.mean(values)), float(student.ppf(0.975, m - 1)) * spread)
