"""Relations by which a spacecraft follows from what it must do; each stands alone, in SI units, with its source.

Wertz, Everett and Puschell, Space Mission Engineering: The New SMAD (2011), is meant by SMAD.
"""

from __future__ import annotations

from math import ceil, exp, log1p, sqrt

from swarm_mj.scenarios.constants import AU, SOLAR_IRRADIANCE, STANDARD_GRAVITY
from swarm_mj.scenarios.coverage_relations import RAYLEIGH

#: Of a black body [W/m^2/K^4] (CODATA 2018).
STEFAN_BOLTZMANN = 5.670374419e-8
#: Largest angular acceleration of a line of sight to a point that is passed on a straight line, over (v / h)^2: 3 sqrt(3) / 8.
PASSING = 3.0 * sqrt(3.0) / 8.0


def pixel_angle(resolution_m: float, altitude_m: float, relief: float) -> float:
    """Angle of a pixel [rad] that samples ground at a resolution from an altitude, with a reserve for slants and slopes."""
    return resolution_m / (relief * altitude_m)


def aperture(pixel_rad: float, wavelength_m: float) -> float:
    """Diameter of a lens [m] whose Rayleigh angle is that of a pixel."""
    return RAYLEIGH * wavelength_m / pixel_rad


def focal_length(pixel_rad: float, pitch_m: float) -> float:
    """Of a lens that puts an angle on a pixel [m]."""
    return pitch_m / pixel_rad


def optics_mass(aperture_m: float) -> float:
    """Of a lens with its barrel [kg]: 0.15 kg + 110 kg/m^2 D^2.

    Through a lens of 35 mm (GomSpace NanoCam C1U, 0.28 of some 0.3 kg) and a mirror lens of 95 mm (Simera xScape100, 1.14 of
    1.1 kg), both as commonly quoted.
    """
    return 0.15 + 110.0 * aperture_m**2


def optics_length(focal_m: float, aperture_m: float) -> float:
    """Of folded optics [m]: the focal length over 3.3 (xScape100: 580 mm in 176 mm), and not below 1.2 apertures."""
    return max(focal_m / 3.3, 1.2 * aperture_m)


def smear_exposure(pixel_m: float, blur_px: float, ground_speed: float) -> float:
    """Longest exposure [s] in which the ground moves by so many pixels under a camera that does not turn along."""
    return blur_px * pixel_m / ground_speed


def pictures_needed(area_m2: float, pixels: int, resolution_m: float) -> int:
    """Pictures without which an area cannot be sampled at a resolution: no pixel shows more than a square of it."""
    return max(1, ceil(area_m2 / (pixels * resolution_m) ** 2 - 1e-9))


def box_inertia(mass_kg: float, size_m: tuple[float, float, float]) -> float:
    """Largest moment of inertia of a uniform box [kg m^2]."""
    a, b, c = sorted(size_m)
    return mass_kg / 12.0 * (b * b + c * c)


def tracking(speed: float, altitude_m: float) -> tuple[float, float]:
    """Largest rate [rad/s] and acceleration [rad/s^2] of the line of sight to a point that is passed on a straight line."""
    return speed / altitude_m, PASSING * (speed / altitude_m) ** 2


def turning(inertia: float, angle_rad: float, time_s: float) -> tuple[float, float]:
    """Torque [N m] and momentum [N m s] of a turn from rest to rest: half the time forwards, half backwards (SMAD, 19.1)."""
    return 4.0 * inertia * angle_rad / time_s**2, 2.0 * inertia * angle_rad / time_s


def propellant(dry_kg: float, delta_v: float, specific_impulse_s: float) -> float:
    """Mass that a change of velocity uses up [kg], by the rocket equation."""
    return dry_kg * (exp(delta_v / (STANDARD_GRAVITY * specific_impulse_s)) - 1.0)


def velocity(full_kg: float, propellant_kg: float, specific_impulse_s: float) -> float:
    """Change of velocity that propellant gives a spacecraft of a mass with it [m/s], by the rocket equation."""
    return -STANDARD_GRAVITY * specific_impulse_s * log1p(-propellant_kg / full_kg)


def panel_power(area_m2: float, efficiency: float, sun_distance_m: float, kept: float) -> float:
    """Of solar cells that face the Sun [W]; `kept` is what age, heat and pointing leave of it [-]."""
    return SOLAR_IRRADIANCE * (AU / sun_distance_m) ** 2 * area_m2 * efficiency * kept


def radiated_power(size_m: tuple[float, float, float], temperature_k: float, emissivity: float) -> float:
    """Power that the sides of a box radiate at a temperature into space [W] (Stefan and Boltzmann)."""
    a, b, c = size_m
    return 2.0 * (a * b + b * c + a * c) * emissivity * STEFAN_BOLTZMANN * temperature_k**4
