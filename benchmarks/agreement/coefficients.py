"""Coefficients of a gravity field as other programs want them.

Ours are fully normalised, C_nm = N_nm^-1 C'_nm with N_nm = sqrt((2 - delta_m0) (2n + 1) (n - m)! / (n + m)!), C' without
normalisation; U = GM/r sum (R/r)^n P_nm (C cos m lambda + S sin m lambda), C_00 = 1.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import factorial, sqrt

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
#: (n, m, C, S)
Terms = Sequence[tuple[int, int, float, float]]


def terms(c: Array, s: Array) -> list[tuple[int, int, float, float]]:
    """Of coefficients C[n, m] and S[n, m], shape (N + 1, N + 1): the list, degree by degree."""
    return [(n, m, float(c[n, m]), float(s[n, m])) for n in range(len(c)) for m in range(n + 1)]


def factor(n: int, m: int) -> float:
    """N_nm: a coefficient without normalisation over the fully normalised one."""
    return sqrt((1 if m == 0 else 2) * (2 * n + 1) * factorial(n - m) / factorial(n + m))


def unnormalised(normalised: Terms) -> list[tuple[int, int, float, float]]:
    """The same field by coefficients without normalisation."""
    return [(n, m, factor(n, m) * c, factor(n, m) * s) for n, m, c, s in normalised]


def rows(normalised: Terms) -> tuple[list[list[float]], list[list[float]]]:
    """C and S as Basilisk wants them: a row of n + 1 numbers for every degree n."""
    degree = max(n for n, _, _, _ in normalised)
    c, s = ([[0.0] * (n + 1) for n in range(degree + 1)] for _ in range(2))
    for n, m, c_nm, s_nm in normalised:
        c[n][m], s[n][m] = c_nm, s_nm
    return c, s


def icgem(name: str, gm: float, radius: float, normalised: Terms) -> str:
    """The field as a file of the International Centre for Global Earth Models, which Orekit and brahe read."""
    head = {
        "product_type": "gravity_field",
        "modelname": name,
        "earth_gravity_constant": repr(gm),
        "radius": repr(radius),
        "max_degree": max(n for n, _, _, _ in normalised),
        "norm": "fully_normalized",
        "tide_system": "tide_free",
        "errors": "no",
    }
    lines = [f"{key:<28}{value}" for key, value in head.items()]
    lines += ["end_of_head " + "=" * 14, *(f"gfc {n} {m} {c!r} {s!r}" for n, m, c, s in normalised)]
    return "\n".join(lines) + "\n"
