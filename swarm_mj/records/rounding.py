"""Numbers of a summary, rounded to what they mean."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from swarm_mj.typing import Array


def rounded(value: Any, digits: int) -> float:
    """A number as a plain float of so many digits after the point."""
    return round(float(value), digits)


def by_name(names: Iterable[str], values: Any, digits: int) -> dict[str, float]:
    """A rounded number for each spacecraft, by its name."""
    return {name: rounded(value, digits) for name, value in zip(names, values, strict=True)}


def spread(values: Array) -> dict[str, float]:
    """The least, the median and the greatest of numbers, those that are NaN left out; empty where none is left."""
    known = values[~np.isnan(values)]
    names = ("min", "median", "max")
    return dict(zip(names, np.quantile(known, (0.0, 0.5, 1.0)).round(6).tolist(), strict=True)) if len(known) else {}
