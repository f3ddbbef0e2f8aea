"""How bright a surface is: reflectance laws as radiance factors I/F, and the light of whole spheres.

The radiance factor is the radiance over that of a white Lambert surface under the Sun in its zenith: pi L / F, F the Sun's
irradiance across its rays. With mu0 and mu the cosines of incidence and emission and a the phase angle, which is none of
their sums but an angle of its own:

    Lambert              A mu0
    Lommel-Seeliger      A f(a) 2 mu0 / (mu0 + mu)
    lunar-Lambert        A f(a) [2 L(a) mu0 / (mu0 + mu) + (1 - L(a)) mu0]              McEwen 1991, Icarus 92, 298
    Akimov               A f(a) D(a, longitude, latitude)                               Shkuratov et al. 2011, PSS 59, 1326
    Hapke                K w / 4 mu0e / (mu0e + mue) [(1 + B) p + H(mu0e/K) H(mue/K) - 1] S   Hapke 2012, Theory of
                         Reflectance and Emittance Spectroscopy, 2nd edition, chapters 8 to 12

Surfaces are opaque and turn no light to the neighbours: what one face sends to another is left out.
"""

from __future__ import annotations

from enum import IntEnum
from math import acos, cos, exp, log, pi, radians, sin, sqrt, tan
from typing import Any, NamedTuple, get_args

import numpy as np

from swarm_mj.compilation import jittable, kernel
from swarm_mj.errors import ScenarioError
from swarm_mj.scenarios.schema_body import Body
from swarm_mj.scenarios.schema_photometry import LawName, Photometry
from swarm_mj.typing import Array

#: Below this sine or cosine an angle has no azimuth.
_LEAST = 1e-9


class Law(IntEnum):
    """Reflectance laws."""

    LAMBERT = 0
    LOMMEL_SEELIGER = 1
    LUNAR_LAMBERT = 2
    AKIMOV = 3
    HAPKE = 4


class Surface(NamedTuple):
    """A reflectance law in numbers; see `Photometry` for what they are."""

    law: int
    albedo: float
    phase: tuple[float, float, float]
    partition: tuple[float, float, float]
    asymmetry: float
    amplitude: float
    width: float
    tan_roughness: float
    porosity: float


def surface_of(given: Photometry) -> Surface:
    """A section `body.photometry` in numbers."""
    return Surface(
        Law(get_args(LawName).index(given.law)).value,
        given.albedo,
        given.phase_exponents,
        given.partition,
        given.asymmetry,
        given.opposition_amplitude,
        given.opposition_width,
        tan(radians(given.roughness_deg)),
        given.porosity_factor,
    )


def needed_surface(body: Body) -> Surface:
    """How the surface of a scenario's body reflects, for pictures.

    Raises:
        ScenarioError: Nobody says.
    """
    surface = body_surface(body)
    if surface is None:
        raise ScenarioError(
            "body.photometry = null: pictures need to know how the body reflects light; give a published set or a law, or "
            "body.albedo, 0.04 to 0.4 for most small bodies"
        )
    return surface


def body_surface(body: Body) -> Surface | None:
    """How the surface of a scenario's body reflects, see `Body.reflectance`; None: nobody says."""
    return None if body.reflectance is None else surface_of(body.reflectance)


@jittable
def radiance_factor(surface: Surface, mu0: float, mu: float, cos_phase: float) -> float:
    """I/F of a face; 0 where mu0 or mu is not above 0."""
    if mu0 <= 0.0 or mu <= 0.0:
        return 0.0
    phase = acos(min(max(cos_phase, -1.0), 1.0))
    if surface.law == 4:
        return _hapke(surface, mu0, mu, phase)
    if surface.law == 0:
        return surface.albedo * mu0
    degrees = phase * 180.0 / pi
    b, c, d = surface.phase
    bright = surface.albedo * exp(degrees * (b + degrees * (c + degrees * d)))
    if surface.law == 3:
        return bright * _akimov(mu0, mu, phase)
    share = 1.0
    if surface.law == 2:
        p, q, r = surface.partition
        share = min(max(1.0 + degrees * (p + degrees * (q + degrees * r)), 0.0), 1.0)
    return bright * (share * 2.0 * mu0 / (mu0 + mu) + (1.0 - share) * mu0)


@jittable
def _akimov(mu0: float, mu: float, phase: float) -> float:
    """Parameterless disk function: photometric longitude counts from the camera towards the Sun."""
    if phase < _LEAST:
        return 1.0
    if phase > pi - _LEAST:
        return 0.0
    longitude = np.arctan2(mu0 - mu * cos(phase), mu * sin(phase))
    cos_latitude = min(mu / max(cos(longitude), _LEAST), 1.0)
    along = cos(pi / (pi - phase) * (longitude - 0.5 * phase))
    return cos(0.5 * phase) * max(along, 0.0) * cos_latitude ** (phase / (pi - phase)) / max(cos(longitude), _LEAST)


@jittable
def _hapke(surface: Surface, mu0: float, mu: float, phase: float) -> float:
    g, w, K = surface.asymmetry, surface.albedo, surface.porosity
    scattered = (1.0 - g * g) / (1.0 + 2.0 * g * cos(phase) + g * g) ** 1.5
    # At 180 deg, where the tangent grows beyond all numbers, nothing is left of the opposition effect.
    opposition = surface.amplitude / (1.0 + tan(min(0.5 * phase, 0.4999999 * pi)) / surface.width)
    mu0e, mue, shadowed = _rough(surface.tan_roughness, mu0, mu, phase)
    several = _h(mu0e / K, w) * _h(mue / K, w) - 1.0
    return K * 0.25 * w * mu0e / (mu0e + mue) * ((1.0 + opposition) * scattered + several) * shadowed


@jittable
def _h(x: float, w: float) -> float:
    """Chandrasekhar's H function of isotropic scatterers; Hapke 2002, Icarus 157, 523, equation 13: within 1 %."""
    gamma = sqrt(1.0 - w)
    r0 = (1.0 - gamma) / (1.0 + gamma)
    return 1.0 / (1.0 - w * x * (r0 + 0.5 * (1.0 - 2.0 * r0 * x) * log((1.0 + x) / x)))


@jittable
def _rough(t: float, mu0: float, mu: float, phase: float) -> tuple[float, float, float]:
    """Effective cosines and shadowing function of a surface with mean slope atan(t); Hapke 1984, Icarus 59, 41."""
    if t <= 0.0:
        return mu0, mu, 1.0
    sin_i, sin_e = sqrt(max(1.0 - mu0 * mu0, 0.0)), sqrt(max(1.0 - mu * mu, 0.0))
    across = sin_i * sin_e
    cos_psi = min(max((cos(phase) - mu0 * mu) / across, -1.0), 1.0) if across > _LEAST else 1.0
    psi = acos(cos_psi)
    half2 = 0.5 * (1.0 - cos_psi)
    chi = 1.0 / sqrt(1.0 + pi * t * t)
    e1_i, e2_i = _tilts(t, mu0, sin_i)
    e1_e, e2_e = _tilts(t, mu, sin_e)
    eta_i = chi * (mu0 + sin_i * t * e2_i / (2.0 - e1_i))
    eta_e = chi * (mu + sin_e * t * e2_e / (2.0 - e1_e))
    if mu0 >= mu:
        below = 2.0 - e1_e - psi / pi * e1_i
        mu0e = chi * (mu0 + sin_i * t * (cos_psi * e2_e + half2 * e2_i) / below)
        mue = chi * (mu + sin_e * t * (e2_e - half2 * e2_i) / below)
        seen = mu0 / eta_i
    else:
        below = 2.0 - e1_i - psi / pi * e1_e
        mu0e = chi * (mu0 + sin_i * t * (e2_i - half2 * e2_e) / below)
        mue = chi * (mu + sin_e * t * (cos_psi * e2_i + half2 * e2_e) / below)
        seen = mu / eta_e
    f = exp(-2.0 * tan(min(0.5 * psi, 0.4999999 * pi)))
    shadowed = mue / eta_e * mu0 / eta_i * chi / (1.0 - f + f * chi * seen)
    return mu0e, mue, shadowed


@jittable
def _tilts(t: float, cosine: float, sine: float) -> tuple[float, float]:
    """E1 and E2 of an angle; cot^2 in the exponent, 0 in the zenith."""
    if sine < _LEAST:
        return 0.0, 0.0
    cot = cosine / sine / t
    return exp(-2.0 / pi * cot), exp(-cot * cot / pi)


@kernel
def radiance_factors(surface: Surface, mu0: Array, mu: Array, cos_phase: Array) -> Array:
    """I/F of many faces, each shape (n,)."""
    out = np.empty(len(mu0))
    for i in range(len(mu0)):
        out[i] = radiance_factor(surface, mu0[i], mu[i], cos_phase[i])
    return out


def sphere_phase_curve(surface: Surface, phase: Any, nodes: int = 96) -> Array:
    """Light of a sphere over that of a white disc of its size under the Sun in its zenith, by quadrature, as `phase` [rad].

    At zero phase that is the geometric albedo. Gauss's rule in photometric longitude and in the sine of the latitude.
    """
    x, weight = np.polynomial.legendre.leggauss(nodes)
    out = []
    for a in np.atleast_1d(np.asarray(phase, np.float64)):
        # Longitude from the camera towards the Sun, over the part of the near side that the Sun reaches.
        low, high = a - 0.5 * pi, 0.5 * pi
        longitude = 0.5 * (high - low) * x + 0.5 * (high + low)
        cos_latitude = np.sqrt(1.0 - x**2)
        mu = np.outer(np.cos(longitude), cos_latitude)
        mu0 = np.outer(np.cos(longitude - a), cos_latitude)
        light = radiance_factors(surface, mu0.ravel(), mu.ravel(), np.full(mu.size, np.cos(a))).reshape(mu.shape)
        out.append(0.5 * (high - low) * float(np.einsum("i,j,ij->", weight, weight, light * mu)) / pi)
    return np.array(out).reshape(np.shape(phase))
