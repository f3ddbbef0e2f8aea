"""Relative motion about a point mass in closed form.

Hill's equations x'' - 2 n y' - 3 n^2 x = 0, y'' + 2 n x' = 0, z'' + n^2 z = 0 hold for small offsets from a circular orbit of
rate n; x is radial, y along the velocity, z along the orbit's normal, and the axes turn. Their solution is Clohessy and
Wiltshire's (1960, J. Aerospace Sciences 27, 653); here in the form of Vallado, Fundamentals of Astrodynamics, section 6.8.
"""

from __future__ import annotations

import numpy as np

from swarm_mj.typing import Array


def clohessy_wiltshire(rate: float, t: float) -> Array:
    """Transition matrix of (x, y, z, x', y', z') over a time, shape (6, 6).

    Args:
        rate: Of the circular orbit [rad/s], more than 0.
        t: [s].
    """
    s, c, n = np.sin(rate * t), np.cos(rate * t), rate
    return np.array(
        [
            [4 - 3 * c, 0, 0, s / n, 2 * (1 - c) / n, 0],
            [6 * (s - n * t), 1, 0, -2 * (1 - c) / n, (4 * s - 3 * n * t) / n, 0],
            [0, 0, c, 0, 0, s / n],
            [3 * n * s, 0, 0, c, 2 * s, 0],
            [-6 * n * (1 - c), 0, 0, -2 * s, 4 * c - 3, 0],
            [0, 0, -n * s, 0, 0, c],
        ]
    )


def hill_axes(r_N: Array, v_N: Array) -> Array:
    """Rows: radial, along the path (completes), normal to the orbit, in N; shape (3, 3)."""
    radial, normal = r_N / np.linalg.norm(r_N), np.cross(r_N, v_N)
    normal = normal / np.linalg.norm(normal)
    return np.array([radial, np.cross(normal, radial), normal])
