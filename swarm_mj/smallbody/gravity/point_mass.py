"""The field of a point mass at the origin of frame A: U = GM / r."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from swarm_mj.compilation import kernel
from swarm_mj.smallbody.gravity.base import positions, positive
from swarm_mj.typing import Array


@dataclass(frozen=True)
class PointMass:
    """Point mass.

    Attributes:
        gm: gravitational parameter [m^3/s^2], above 0.
    """

    gm: float

    def __post_init__(self) -> None:
        """Check the gravitational parameter."""
        object.__setattr__(self, "gm", positive(self.gm, "gravity.gm"))

    def acceleration(self, r_A: Array) -> Array:
        """Attraction in A [m/s^2], shape (n, 3), at positions in A [m], shape (n, 3)."""
        return _acceleration(positions(r_A), self.gm)

    def potential(self, r_A: Array) -> Array:
        """Potential [m^2/s^2], positive, shape (n,), at positions in A [m], shape (n, 3)."""
        return self.gm / np.linalg.norm(positions(r_A), axis=1)


@kernel
def _acceleration(r_A: Array, gm: float) -> Array:
    out = np.empty_like(r_A)
    write_point_mass(r_A, gm, out)
    return out


@kernel
def write_point_mass(r_A: Array, gm: float, out: Array) -> None:
    """Write the accelerations in A [m/s^2], shape (n, 3), at positions in A [m], shape (n, 3)."""
    for i in range(r_A.shape[0]):
        x, y, z = r_A[i, 0], r_A[i, 1], r_A[i, 2]
        square = x * x + y * y + z * z
        factor = -gm / (square * np.sqrt(square))
        out[i, 0] = factor * x
        out[i, 1] = factor * y
        out[i, 2] = factor * z
