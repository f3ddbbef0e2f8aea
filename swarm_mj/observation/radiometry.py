"""Signal to noise of a pixel by shot noise and read noise; without dark current, stray light, digitisation and saturation.

A surface of reflectance I/F sends the radiance (I/F) F / pi, F the Sun's irradiance there: that of a black body of the Sun's
size and effective temperature, 1.75 W m^-2 nm^-1 at 550 nm and 1 au, where some 1.86 are measured. With the lens' area, the
solid angle of a pixel, the band and the exposure, that is an energy, and over h c / wavelength a number of photons.
"""

from __future__ import annotations

from math import exp, pi

import numpy as np

from swarm_mj.scenarios.constants import AU, BOLTZMANN, PLANCK, SPEED_OF_LIGHT, SUN_RADIUS, SUN_TEMPERATURE
from swarm_mj.scenarios.schema_imaging import Camera
from swarm_mj.typing import Array


def solar_irradiance(wavelength_m: float, distance_m: float = AU) -> float:
    """Irradiance by the Sun, per metre of wavelength [W/m^3]."""
    quantum = PLANCK * SPEED_OF_LIGHT / wavelength_m
    radiance = 2.0 * quantum * SPEED_OF_LIGHT / wavelength_m**4 / (exp(quantum / (BOLTZMANN * SUN_TEMPERATURE)) - 1.0)
    return pi * radiance * (SUN_RADIUS / distance_m) ** 2


def electrons(camera: Camera, pixel_angle: float, reflectance: Array, sun_distance_m: float) -> Array:
    """Electrons of a pixel in one picture, where the surface has a reflectance I/F; same shape as that.

    Args:
        camera: Lens, band, quantum efficiency and exposure.
        pixel_angle: Width of a pixel at unit distance [rad].
        reflectance: I/F [-].
        sun_distance_m: Of the body from the Sun [m].
    """
    irradiance = solar_irradiance(camera.wavelength_m, sun_distance_m) * camera.bandwidth_m
    through_lens = irradiance / pi * (pi / 4.0 * camera.aperture_m**2) * pixel_angle**2 * (camera.exposure_s or 0.0)
    photons = through_lens * camera.wavelength_m / (PLANCK * SPEED_OF_LIGHT)
    return camera.quantum_efficiency * photons * np.maximum(reflectance, 0.0)


def signal_to_noise(camera: Camera, signal: Array) -> Array:
    """Signal to noise of a pixel with a signal [electrons], same shape."""
    return signal / np.sqrt(np.maximum(signal + camera.read_noise**2, np.finfo(np.float64).tiny))
