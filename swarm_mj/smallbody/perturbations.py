"""Small accelerations and torques beside the body's gravity: solar tide, solar radiation pressure, gravity gradient.

Each function takes all spacecraft at once and is compiled, so that the simulation loop can call it every step; it stands on one
for a single spacecraft, which kernels call that must not allocate.
"""

from __future__ import annotations

from typing import Any, NamedTuple, TypeAlias

import numpy as np

from swarm_mj.compilation import jittable, kernel
from swarm_mj.scenarios.constants import AU, GM_SUN, SOLAR_IRRADIANCE, SPEED_OF_LIGHT
from swarm_mj.typing import Array

_Vector: TypeAlias = tuple[float, float, float]

#: Pressure of sunlight on a black surface that faces the Sun at 1 au [N/m^2].
SOLAR_PRESSURE_1AU = SOLAR_IRRADIANCE / SPEED_OF_LIGHT


@kernel
def solar_tide(r_N: Array, r_sun_N: Array, gm_sun: float = GM_SUN) -> Array:
    """Attraction of the Sun relative to that on the asteroid, gm ((s - r)/|s - r|^3 - s/|s|^3) with s the Sun.

    Evaluated as -gm/|s - r|^3 (r + f(q) s), q = r.(r - 2 s)/s.s, f = q (3 + 3 q + q^2)/(1 + (1 + q)^(3/2)), which does
    not subtract two nearly equal vectors (Battin 1999, Mathematics and Methods of Astrodynamics, section 8.4).

    Args:
        r_N: spacecraft relative to the asteroid, in N [m], shape (n, 3).
        r_sun_N: Sun relative to the asteroid, in N [m], shape (3,).
        gm_sun: gravitational parameter of the Sun [m^3/s^2].

    Returns:
        Accelerations in N [m/s^2], shape (n, 3).
    """
    out = np.empty_like(r_N)
    for i in range(r_N.shape[0]):
        out[i, 0], out[i, 1], out[i, 2] = _tide(r_N[i], r_sun_N, gm_sun)
    return out


@jittable
def _tide(r: Any, sun: Array, gm: float) -> _Vector:
    square = sun[0] ** 2 + sun[1] ** 2 + sun[2] ** 2
    q = 0.0
    for k in range(3):
        q += r[k] * (r[k] - 2.0 * sun[k])
    q /= square
    cube = (1.0 + q) * np.sqrt(1.0 + q)
    f = q * (3.0 + q * (3.0 + q)) / (1.0 + cube)
    factor = -gm / (square * np.sqrt(square) * cube)
    return factor * (r[0] + f * sun[0]), factor * (r[1] + f * sun[1]), factor * (r[2] + f * sun[2])


@kernel
def solar_radiation_pressure(r_N: Array, r_sun_N: Array, area_m2: float, mass_kg: float, reflectivity: float) -> Array:
    """Push of sunlight on a sphere-like spacecraft (cannonball model), away from the Sun, without eclipses.

    a = C_R (A/m) (irradiance at 1 au / c) (1 au / d)^2, Montenbruck and Gill (2000), eq. 3.75.

    Args:
        r_N: spacecraft relative to the asteroid, in N [m], shape (n, 3).
        r_sun_N: Sun relative to the asteroid, in N [m], shape (3,).
        area_m2: area that faces the Sun [m^2].
        mass_kg: mass [kg].
        reflectivity: radiation pressure coefficient C_R: 1 absorbs all light, 2 is a mirror that faces the Sun.

    Returns:
        Accelerations in N [m/s^2], shape (n, 3).
    """
    out = np.empty_like(r_N)
    strength = reflectivity * area_m2 / mass_kg * SOLAR_PRESSURE_1AU * AU * AU
    for i in range(r_N.shape[0]):
        out[i, 0], out[i, 1], out[i, 2] = _push(r_N[i], r_sun_N, strength)
    return out


@jittable
def _push(r: Any, sun: Array, strength: float) -> _Vector:
    x, y, z = r[0] - sun[0], r[1] - sun[1], r[2] - sun[2]
    square = x * x + y * y + z * z
    factor = strength / (square * np.sqrt(square))
    return factor * x, factor * y, factor * z


class Sunlight(NamedTuple):
    """What the Sun does to spacecraft near the body; zeros switch it off.

    Attributes:
        gm: Of the Sun, whose tide acts [m^3/s^2].
        area_per_mass: Sunlit area over mass [m^2/kg].
        reflectivity: Coefficient C_R.
    """

    gm: float
    area_per_mass: float
    reflectivity: float


@kernel
def add_perturbations(r_A: Array, C_AN: Array, sun_N: Array, sunlight: Sunlight, a_A: Array) -> None:
    """Add tide and radiation pressure to accelerations.

    Args:
        r_A: Positions in A, shape (n, 3) [m].
        C_AN: Rotation from N to A.
        sun_N: The Sun in N, shape (3,) [m].
        sunlight: What of it acts.
        a_A: Accelerations in A, to which is added, shape (n, 3) [m/s^2].
    """
    strength = sunlight.reflectivity * sunlight.area_per_mass / 1.0 * SOLAR_PRESSURE_1AU * AU * AU
    for j in range(r_A.shape[0]):
        x, y, z = r_A[j, 0], r_A[j, 1], r_A[j, 2]
        r_N = (
            C_AN[0, 0] * x + C_AN[1, 0] * y + C_AN[2, 0] * z,
            C_AN[0, 1] * x + C_AN[1, 1] * y + C_AN[2, 1] * z,
            C_AN[0, 2] * x + C_AN[1, 2] * y + C_AN[2, 2] * z,
        )
        if sunlight.gm > 0.0:
            _add_turned(_tide(r_N, sun_N, sunlight.gm), C_AN, a_A[j])
        if sunlight.area_per_mass > 0.0:
            _add_turned(_push(r_N, sun_N, strength), C_AN, a_A[j])


@jittable
def _add_turned(a_N: _Vector, C_AN: Array, a_A: Array) -> None:
    for k in range(3):
        a_A[k] += C_AN[k, 0] * a_N[0] + C_AN[k, 1] * a_N[1] + C_AN[k, 2] * a_N[2]


@kernel
def gravity_gradient_torque(r_BN_B: Array, inertia_B: Array, gm: float) -> Array:
    """Torque of the asteroid's central field about each centre of mass, 3 gm/r^5 r x (I r).

    Schaub and Junkins (2018), Analytical Mechanics of Space Systems, eq. 4.154.

    Args:
        r_BN_B: spacecraft relative to the asteroid, each in its own body frame B [m], shape (n, 3).
        inertia_B: inertia of each spacecraft about its centre of mass in B [kg m^2], shape (n, 3, 3).
        gm: gravitational parameter of the asteroid [m^3/s^2].

    Returns:
        Torques in B [N m], shape (n, 3).
    """
    out = np.empty_like(r_BN_B)
    for i in range(r_BN_B.shape[0]):
        out[i, 0], out[i, 1], out[i, 2] = gradient_torque_on(r_BN_B[i], inertia_B[i], gm)
    return out


@jittable
def gradient_torque_on(r_B: Any, inertia: Array, gm: float) -> _Vector:
    """The same of one spacecraft: its place in B [m], and its inertia, shape (3, 3)."""
    x, y, z = r_B[0], r_B[1], r_B[2]
    hx = inertia[0, 0] * x + inertia[0, 1] * y + inertia[0, 2] * z
    hy = inertia[1, 0] * x + inertia[1, 1] * y + inertia[1, 2] * z
    hz = inertia[2, 0] * x + inertia[2, 1] * y + inertia[2, 2] * z
    square = x * x + y * y + z * z
    factor = 3.0 * gm / (square * square * np.sqrt(square))
    return factor * (y * hz - z * hy), factor * (z * hx - x * hz), factor * (x * hy - y * hx)
