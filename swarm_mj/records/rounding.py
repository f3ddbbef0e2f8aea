"""Numbers of a summary, rounded to what they mean."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any


def rounded(value: Any, digits: int) -> float:
    """A number as a plain float of so many digits after the point."""
    return round(float(value), digits)


def by_name(names: Iterable[str], values: Any, digits: int) -> dict[str, float]:
    """A rounded number for each spacecraft, by its name."""
    return {name: rounded(value, digits) for name, value in zip(names, values, strict=True)}
