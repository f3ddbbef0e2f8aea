"""What every gravity field can do, and the checks that their constructors share."""

from __future__ import annotations

import math
from typing import Protocol, runtime_checkable

import numpy as np

from swarm_mj.errors import ScenarioError
from swarm_mj.typing import Array


@runtime_checkable
class Gravity(Protocol):
    """A gravity field fixed to the body; the extension point `swarm_mj.gravity`."""

    def acceleration(self, r_A: Array) -> Array:
        """Attraction of the body alone, without centrifugal or Coriolis terms.

        Args:
            r_A: positions relative to the origin of A, in A [m], shape (n, 3).

        Returns:
            Accelerations in A [m/s^2], shape (n, 3).
        """
        ...


def positive(value: float, what: str) -> float:
    """Return a finite number above zero.

    Raises:
        ScenarioError: it is not one.
    """
    number = float(value)
    if not (math.isfinite(number) and number > 0.0):
        raise ScenarioError(f"{what} = {value!r}: must be a finite number above 0")
    return number


def positions(r_A: Array) -> Array:
    """View positions as the C-contiguous float64 (n, 3) array that the compiled kernels take.

    Raises:
        ValueError: the array has another shape.
    """
    rows = np.ascontiguousarray(r_A, dtype=np.float64)
    if rows.ndim != 2 or rows.shape[1] != 3:
        raise ValueError(f"positions must have shape (n, 3), got {rows.shape}")
    return rows
