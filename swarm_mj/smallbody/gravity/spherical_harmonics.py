r"""Gravity as a series of fully normalised spherical harmonics of any degree, free of singularities at the poles.

The series is written in the solid harmonics of Cunningham (1970), here fully normalised,

    V_nm + i W_nm = (R/r)^(n+1) P_nm(sin phi) exp(i m lambda),      U = GM/R sum_nm (C_nm V_nm + S_nm W_nm),

with the recursions of Montenbruck and Gill, Satellite Orbits (2000), eqs. 3.29 to 3.31, multiplied by the normalisation
factors N_nm = sqrt((2 - delta_m0) (2n + 1) (n - m)! / (n + m)!). The derivative of a solid harmonic is a sum of solid
harmonics one degree higher (ibid., eq. 3.33), so each component of the acceleration is itself such a series. Its
coefficients are formed once, by `differentiate`, and the compiled kernel only ever sums series.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from swarm_mj.compilation import kernel
from swarm_mj.errors import ScenarioError
from swarm_mj.scenarios import constants
from swarm_mj.smallbody.gravity.base import positions, positive
from swarm_mj.smallbody.shape import frozen
from swarm_mj.typing import Array

#: Highest degree accepted; far beyond what any small body's field was measured to.
MAX_DEGREE = 360
#: Share of the attraction below which terms of a `bounded` series are lost in rounding.
LOST = 1e-16


@dataclass(frozen=True, eq=False)
class SphericalHarmonics:
    """A field given by fully normalised coefficients. It converges outside the sphere that encloses the body.

    Attributes:
        gm: gravitational parameter [m^3/s^2].
        reference_radius: radius R to which the coefficients refer [m].
        c: cosine coefficients C[n, m], shape (N + 1, N + 1); C[0, 0] = 1 gives the central field.
        s: sine coefficients S[n, m], same shape.
        bounded: whether all mass lies within the reference radius R, so that at r terms of degree n make at most
            (n + 1) (R / r)^n of the attraction; those that are lost in rounding are then left out.
        acceleration_series: coefficients of the acceleration's three components, for `sum_series`; follows from the above.
        recursion: the factors of its recursion, see `recursion_table`; the same.
    """

    gm: float
    reference_radius: float
    c: Array = field(repr=False)
    s: Array = field(repr=False)
    bounded: bool = False
    acceleration_series: Array = field(init=False, repr=False)
    recursion: Array = field(init=False, repr=False)

    def __post_init__(self) -> None:
        """Check and freeze the coefficients, and prepare the series of the acceleration."""
        c, s = (frozen(np.array(values, dtype=np.float64)) for values in (self.c, self.s))
        _check_coefficients(c, s)
        object.__setattr__(self, "gm", positive(self.gm, "gravity.gm"))
        object.__setattr__(self, "reference_radius", positive(self.reference_radius, "gravity.reference_radius"))
        object.__setattr__(self, "c", c)
        object.__setattr__(self, "s", s)
        scale = self.gm / self.reference_radius**2
        object.__setattr__(self, "acceleration_series", scale * differentiate(np.stack([c, s], axis=-1)[:, :, None]))
        object.__setattr__(self, "recursion", recursion_table(self.degree + 1))

    @classmethod
    def from_coefficients(
        cls, gm: float, reference_radius: float, coefficients: Mapping[tuple[int, int], tuple[float, float]]
    ) -> SphericalHarmonics:
        """Build from {(n, m): (C, S)}, fully normalised; C_00 is 1 unless given, all others are 0.

        Raises:
            ScenarioError: an order outside 0 <= m <= n, or a number that is not finite.
        """
        for n, m in coefficients:
            if not 0 <= m <= n <= MAX_DEGREE:
                raise ScenarioError(f"gravity coefficient (n, m) = ({n}, {m}): needs 0 <= m <= n <= {MAX_DEGREE}")
            if n == 0 and coefficients[n, m][0] == 0.0:
                raise ScenarioError(
                    "gravity coefficient (0, 0) = 0 switches gravity off: leave it out, or set a tiny gm"
                )
        degree = max((n for n, _ in coefficients), default=0)
        c, s = np.zeros((2, degree + 1, degree + 1))
        c[0, 0] = 1.0
        for (n, m), (c_nm, s_nm) in coefficients.items():
            c[n, m], s[n, m] = c_nm, s_nm
        return cls(gm, reference_radius, c, s)

    @classmethod
    def eros_degree_2(cls) -> SphericalHarmonics:
        """The measured field of 433 Eros up to degree and order 2 (NEAR15A)."""
        return cls.from_coefficients(constants.EROS_GM, constants.EROS_REFERENCE_RADIUS, constants.EROS_DEGREE_2)

    @property
    def degree(self) -> int:
        """Highest degree N."""
        return len(self.c) - 1

    def acceleration(self, r_A: Array) -> Array:
        """Attraction in A [m/s^2], shape (n, 3), at positions in A [m], shape (n, 3)."""
        return self._sum(r_A, self.recursion, self.acceleration_series)

    def potential(self, r_A: Array) -> Array:
        """Potential [m^2/s^2], positive, shape (n,), at positions in A [m], shape (n, 3)."""
        series = self.gm / self.reference_radius * np.stack([self.c, self.s], axis=-1)[:, :, None]
        return self._sum(r_A, self.recursion, series)[:, 0]

    def gradient(self, r_A: Array) -> Array:
        """Gradient of the acceleration [1/s^2], shape (n, 3, 3), at positions in A [m], shape (n, 3)."""
        series, table = self._gradient_series
        return self._sum(r_A, table, series).reshape(-1, 3, 3)

    def _sum(self, r_A: Array, table: Array, series: Array) -> Array:
        return np.asarray(sum_series(positions(r_A), self.reference_radius, table, series, self.bounded))

    @cached_property
    def _gradient_series(self) -> tuple[Array, Array]:
        series = differentiate(self.acceleration_series) / self.reference_radius
        return series, recursion_table(self.degree + 2)


def fit_harmonics(
    gravity_potential: Callable[[Array], Array],
    gm: float,
    reference_radius: float,
    degree: int,
    radius: float,
    *,
    margin: int = 10,
) -> SphericalHarmonics:
    """Expand a potential in spherical harmonics by quadrature over a sphere.

    Gauss-Legendre in the sine of latitude times even steps in longitude, exact for fields up to `degree + margin`;
    higher degrees of the true field alias, weakened by (body radius / radius)^(degree + 2 margin).

    Args:
        gravity_potential: potential [m^2/s^2] of positions in A [m], (n, 3) -> (n,), e.g. `Polyhedron.potential`.
        gm: gravitational parameter [m^3/s^2] to which the coefficients refer.
        reference_radius: radius to which the coefficients refer [m].
        degree: highest degree and order wanted.
        radius: radius of the sphere [m]; the sphere must enclose the body.
        margin: extra degrees that the quadrature resolves.

    Returns:
        The fitted field.
    """
    sines, weights = np.polynomial.legendre.leggauss(degree + margin + 1)
    longitudes = 2.0 * np.pi * np.arange(2 * (degree + margin + 1)) / (2 * (degree + margin + 1))
    cosines = np.sqrt(1.0 - sines**2)
    x, y = np.outer(cosines, np.cos(longitudes)), np.outer(cosines, np.sin(longitudes))
    sphere = np.stack(np.broadcast_arrays(x, y, sines[:, None]), axis=-1)
    values = gravity_potential(radius * sphere.reshape(-1, 3)).reshape(len(sines), -1) * radius / gm
    waves = np.fft.rfft(values, axis=1)[:, : degree + 1] / len(longitudes)
    legendre = _normalised_legendre(degree, sines)
    moments = 0.5 * np.einsum("j,nmj,jm->nm", weights, legendre, waves)
    moments *= (radius / reference_radius) ** np.arange(degree + 1)[:, None]
    return SphericalHarmonics(gm, reference_radius, moments.real, 0.0 - moments.imag)


def _normalised_legendre(degree: int, sines: Array) -> Array:
    """Fully normalised associated Legendre functions P[n, m] at sines of latitude, shape (N + 1, N + 1, k)."""
    table, cosines = recursion_table(degree), np.sqrt(1.0 - sines**2)
    legendre = np.zeros((degree + 1, degree + 1, len(sines)))
    legendre[0, 0] = 1.0
    for m in range(degree + 1):
        if m > 0:
            legendre[m, m] = table[m, m, 0] * cosines * legendre[m - 1, m - 1]
        for n in range(m + 1, degree + 1):  # at n = m + 1 the second factor is zero
            legendre[n, m] = table[n, m, 0] * sines * legendre[n - 1, m] - table[n, m, 1] * legendre[n - 2, m]
    return legendre


def recursion_table(degree: int) -> Array:
    """Factors of the normalised recursions up to a degree, shape (N + 1, N + 1, 2), indexed [n, m].

    Off the diagonal a and b of V_nm = a (z R / r^2) V_(n-1)m - b (R/r)^2 V_(n-2)m; on it, first, the factor that takes
    V_(m-1)(m-1) to V_mm.
    """
    n, m = np.meshgrid(np.arange(degree + 1.0), np.arange(degree + 1.0), indexing="ij")
    table = np.zeros((degree + 1, degree + 1, 2))
    below = n > m
    n, m = n[below], m[below]
    table[below, 0] = np.sqrt((2 * n + 1) * (2 * n - 1) / ((n - m) * (n + m)))
    # At n = m + 1 the factor vanishes with (n - m - 1); n = 1 alone would make its denominator negative.
    table[below, 1] = np.sqrt((2 * n + 1) * (n + m - 1) * (n - m - 1) / (np.maximum(2 * n - 3, 1) * (n + m) * (n - m)))
    order = np.arange(1, degree + 1)
    table[order, order, 0] = np.sqrt((2 * order + 1) / (2 * order))
    if degree >= 1:
        table[1, 1, 0] = np.sqrt(3.0)
    return table


def differentiate(series: Array) -> Array:
    """Coefficients of R times the gradient of series of normalised solid harmonics.

    Args:
        series: coefficients (C, S) of k series, shape (N + 1, N + 1, k, 2), indexed [n, m].

    Returns:
        Coefficients of the 3 k series d/dx, d/dy, d/dz of each, shape (N + 2, N + 2, 3 k, 2); the three derivatives of
        one series stand side by side.
    """
    size, _, count, _ = series.shape
    out = np.zeros((size + 1, size + 1, count, 3, 2))
    for n in range(size):
        shrink = (2.0 * n + 1.0) / (2.0 * n + 3.0)
        for m in range(n + 1):
            c, s = series[n, m, :, 0], series[n, m, :, 1]
            # N_nm / N_(n+1)(m+1), N_nm / N_(n+1)m and N_nm / N_(n+1)(m-1) times the factorials of eq. 3.33.
            raised = np.sqrt(shrink * (n + m + 1) * (n + m + 2) * (0.5 if m == 0 else 1.0))
            kept = np.sqrt(shrink * (n + m + 1) * (n - m + 1))
            lowered = np.sqrt(shrink * (n - m + 1) * (n - m + 2) * (2.0 if m == 1 else 1.0))
            half = 1.0 if m == 0 else 0.5
            _add(out[n + 1, m], 2, -kept * c, -kept * s)
            _add(out[n + 1, m + 1], 0, -half * raised * c, -half * raised * s)
            _add(out[n + 1, m + 1], 1, half * raised * s, -half * raised * c)
            if m > 0:
                _add(out[n + 1, m - 1], 0, half * lowered * c, half * lowered * s)
                _add(out[n + 1, m - 1], 1, half * lowered * s, -half * lowered * c)
    # W_n0 is zero: its coefficients would multiply nothing.
    out[:, 0, ..., 1] = 0.0
    return out.reshape(size + 1, size + 1, 3 * count, 2)


def _add(target: Array, axis: int, c: Array, s: Array) -> None:
    target[:, axis, 0] += c
    target[:, axis, 1] += s


@kernel
def sum_series(r_A: Array, radius: float, table: Array, series: Array, bounded: bool = False) -> Array:
    """Sum k series of solid harmonics at n positions, shape (n, k); `bounded` as in `SphericalHarmonics`."""
    out = np.empty((r_A.shape[0], series.shape[2]))
    write_series(r_A, radius, table, series, bounded, out)
    return out


@kernel
def write_series(r_A: Array, radius: float, table: Array, series: Array, bounded: bool, out: Array) -> None:
    """The same into an array of the caller, order by order so that no scratch is needed."""
    count = series.shape[2]
    for i in range(r_A.shape[0]):
        size = series.shape[0]
        for k in range(count):
            out[i, k] = 0.0
        x, y, z = r_A[i, 0], r_A[i, 1], r_A[i, 2]
        inverse = radius / (x * x + y * y + z * z)
        x, y, z = x * inverse, y * inverse, z * inverse
        shrink = radius * inverse
        if bounded and shrink < 1.0:
            size = min(size, int(2.0 * np.log(LOST / size) / np.log(shrink)) + 2)
        v_sector, w_sector = np.sqrt(shrink), 0.0
        for m in range(size):
            if m > 0:
                factor = table[m, m, 0]
                v_sector, w_sector = factor * (x * v_sector - y * w_sector), factor * (x * w_sector + y * v_sector)
            v, w, v_before, w_before = v_sector, w_sector, 0.0, 0.0
            for n in range(m, size):
                if n > m:
                    a, b = table[n, m, 0] * z, table[n, m, 1] * shrink
                    v, v_before = a * v - b * v_before, v
                    w, w_before = a * w - b * w_before, w
                for k in range(count):
                    out[i, k] += series[n, m, k, 0] * v + series[n, m, k, 1] * w


def _check_coefficients(c: Array, s: Array) -> None:
    if c.ndim != 2 or c.shape[0] != c.shape[1] or c.shape != s.shape or c.size == 0:
        raise ScenarioError(f"gravity coefficients C {c.shape} and S {s.shape}: need two square tables of one size")
    bad = np.argwhere(~np.isfinite(c) | ~np.isfinite(s))
    if len(bad):
        n, m = bad[0]
        raise ScenarioError(f"gravity coefficient (n, m) = ({n}, {m}): C = {c[n, m]}, S = {s[n, m]} must be finite")
