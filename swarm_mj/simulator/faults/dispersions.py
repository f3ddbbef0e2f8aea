"""Drawing how far one flight lies from its plan: mass, inertia, wheels, deployment, attitude, gravity, target, sensors.

Every quantity has a stream of random numbers of its own, spawned from the scenario's seed: switching one dispersion on, or
adding a fault to the end of the list, changes no other draw.
Means are zero, distributions normal unless the scenario says otherwise; what must stay positive is cut at three sigma.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import IntEnum
from math import radians

import numpy as np
from numpy.random import Generator

from swarm_mj.errors import ScenarioError
from swarm_mj.mission.target import local_axes, place_of
from swarm_mj.scenarios.schema_faults import Dispersions
from swarm_mj.scenarios.schema_sensors import Sensors
from swarm_mj.smallbody.environment import Environment
from swarm_mj.smallbody.gravity.base import Gravity
from swarm_mj.smallbody.gravity.spherical_harmonics import SphericalHarmonics
from swarm_mj.typing import Array, Ints

DEG_PER_HOUR = radians(1.0) / 3600.0  #: [rad/s]
DEG_PER_SQRT_HOUR = radians(1.0) / 60.0  #: [rad/sqrt(s)]
ARCSEC = radians(1.0 / 3600.0)  #: [rad]
#: Sets these streams apart from others that may be spawned from the same seed.
_FAMILY = 7


class Stream(IntEnum):
    """What a stream is for; part of its spawn key, so that a number must never be given to something else."""

    FAULT = 0
    ATTITUDE = 1
    RATE = 2
    DEPLOYMENT = 3
    MASS = 4
    INERTIA = 5
    COULOMB = 6
    VISCOUS = 7
    GRAVITY = 8
    HARMONICS = 9
    TARGET = 10
    GYRO_BIAS = 11
    STAR_TRACKER_BIAS = 12
    DELAY = 13
    SENSOR_NOISE = 14
    NAVIGATION = 15
    BURN = 16
    MOTHERSHIP = 17
    FIRST_KNOWLEDGE = 18
    BODY_KNOWLEDGE = 19
    PICTURE = 20
    RANGE = 21


def stream(seed: int, what: Stream, *numbers: int) -> np.random.Generator:
    """The generator of one quantity.

    Args:
        seed: Of the scenario.
        what: Which quantity.
        numbers: Further keys, for instance the number of the fault and of the spacecraft.
    """
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(_FAMILY, int(what), *numbers)))


@dataclass(frozen=True, kw_only=True)
class Dispersed:
    """What one seed gives the spacecraft."""

    mass_ratio: Array  #: true over planned mass, shape (n,)
    second_moment_ratio: Array  #: the same of the mass's second moments about x, y, z of B, shape (n, 3)
    coulomb: Array  #: friction of each wheel, shape (n, w) [N m]
    viscous: Array  #: shape (n, w) [N m s/rad]
    gyro_bias: Array  #: at the start, shape (n, 3) [rad/s]
    star_tracker_bias: Array  #: rotation of the mounting, shape (n, 3) [rad]
    delay_ticks: Ints  #: control periods by which sensors are late, shape (n,)


def draw_spacecraft(
    given: Dispersions, sensors: Sensors, seed: int, *, n: int, n_wheels: int, period_s: float
) -> Dispersed:
    """Draw the spacecraft of one flight.

    Args:
        given: The scenario's dispersions.
        sensors: Of each spacecraft.
        seed: Of the scenario.
        n: Number of spacecraft.
        n_wheels: Of each spacecraft.
        period_s: Control period [s].
    """
    wheels = (n, n_wheels)
    most = int(sensors.delay_s / period_s + 1e-9)
    delays = stream(seed, Stream.DELAY).integers(0, most, n, endpoint=True) if most else np.zeros(n, np.int64)
    return Dispersed(
        mass_ratio=1.0 + _scaled(0.01 * given.mass_percent, _cut, seed, Stream.MASS, (n,)),
        second_moment_ratio=1.0 + _scaled(0.01 * given.inertia_percent, _cut, seed, Stream.INERTIA, (n, 3)),
        coulomb=_scaled(given.wheel_coulomb_n_m, Generator.random, seed, Stream.COULOMB, wheels),
        viscous=_scaled(given.wheel_viscous_n_m_s, Generator.random, seed, Stream.VISCOUS, wheels),
        gyro_bias=_normal(sensors.gyro_bias_deg_h * DEG_PER_HOUR, seed, Stream.GYRO_BIAS, (n, 3)),
        star_tracker_bias=_normal(sensors.star_tracker_bias_arcsec * ARCSEC, seed, Stream.STAR_TRACKER_BIAS, (n, 3)),
        delay_ticks=delays,
    )


def attitude_turns(given: Dispersions, seed: int, n: int) -> Array:
    """Extra initial rotations as rotation vectors in B, shape (n, 3) [rad]."""
    return _normal(radians(given.attitude_deg), seed, Stream.ATTITUDE, (n, 3))


def extra_rates(given: Dispersions, seed: int, n: int) -> Array:
    """Extra initial body rates in B, shape (n, 3) [rad/s]."""
    return _normal(radians(given.rate_deg_s), seed, Stream.RATE, (n, 3))


def velocity_errors(given: Dispersions, seed: int, n: int) -> Array:
    """Errors of the deployment velocity in N, shape (n, 3) [m/s]."""
    return _normal(given.deployment_velocity_m_s, seed, Stream.DEPLOYMENT, (n, 3))


def mothership_error(given: Dispersions, seed: int) -> tuple[Array, Array]:
    """Errors of the mothership's position [m] and velocity [m/s] in N at the epoch, two of shape (3,)."""
    if not (given.mothership_position_m or given.mothership_velocity_m_s):
        return np.zeros(3), np.zeros(3)
    drawn = stream(seed, Stream.MOTHERSHIP).standard_normal((2, 3))
    return given.mothership_position_m * drawn[0], given.mothership_velocity_m_s * drawn[1]


def dispersed_inertia(inertia_B: Array, ratio: Array) -> Array:
    """Inertia with dispersed second moments of the mass, shape (n, 3, 3) [kg m^2].

    Any positive second moments belong to some body, whereas freely scaled moments of inertia may break the triangle
    inequality; a long CubeSat is close to it.

    Args:
        inertia_B: Planned, about the centre of mass, shape (3, 3) [kg m^2]; products of inertia stay as planned.
        ratio: Of the second moments int x^2 dm, int y^2 dm, int z^2 dm, shape (n, 3).
    """
    principal = np.diag(inertia_B)
    moments = (0.5 * principal.sum() - principal) * ratio
    products = inertia_B - np.diag(principal)
    return (moments.sum(axis=1, keepdims=True) - moments)[:, :, None] * np.eye(3) + products


def disperse_environment(environment: Environment, given: Dispersions, seed: int) -> Environment:
    """The surroundings in truth; the same object where gravity is not dispersed.

    Raises:
        ScenarioError: Coefficients are to be dispersed of a field that has none.
    """
    gravity = environment.gravity
    if given.harmonics_percent > 0.0:
        if not isinstance(gravity, SphericalHarmonics):
            raise ScenarioError(
                f"dispersions.harmonics_percent = {given.harmonics_percent:g}: needs body.gravity.model: spherical_harmonics"
            )
        gravity = _with_dispersed_coefficients(gravity, given.harmonics_percent, stream(seed, Stream.HARMONICS))
    if given.gravity_percent > 0.0:
        factor = 1.0 + 0.01 * given.gravity_percent * float(_cut(stream(seed, Stream.GRAVITY), (1,))[0])
        gravity = ScaledGravity(gravity, factor)
    return environment if gravity is environment.gravity else replace(environment, gravity=gravity)


@dataclass(frozen=True)
class ScaledGravity:
    """A field times a factor: the same shape of field of a heavier or lighter body."""

    field: Gravity
    factor: float

    @property
    def gm(self) -> float:
        """Gravitational parameter [m^3/s^2], where the field has one."""
        return self.factor * float(self.field.gm)  # type: ignore[attr-defined]

    def acceleration(self, r_A: Array) -> Array:
        """Attraction in A [m/s^2], shape (n, 3), at positions in A [m], shape (n, 3)."""
        return self.factor * self.field.acceleration(r_A)


def unscaled(gravity: Gravity) -> tuple[Gravity, float]:
    """A field without its factor, and the factor."""
    return (gravity.field, gravity.factor) if isinstance(gravity, ScaledGravity) else (gravity, 1.0)


def target_shift(given: Dispersions, seed: int) -> tuple[float, float]:
    """How far east and north of its planned place the target lies [m]."""
    east, north = given.target_m * stream(seed, Stream.TARGET).standard_normal(2)
    return float(east), float(north)


def shifted_target(
    latitude_deg: float, longitude_deg: float, east: float, north: float, radius: float
) -> tuple[float, float]:
    """Latitude and longitude [deg] of a place that lies `east` and `north` [m] of another, on a sphere of `radius` [m].

    The way is taken along the great circle, so that it is right at the poles too.
    """
    distance = float(np.hypot(east, north))
    if distance == 0.0:
        return latitude_deg, longitude_deg
    to_east, to_north, up = local_axes(latitude_deg, longitude_deg)
    way = (east * to_east + north * to_north) / distance
    latitude, longitude = place_of(np.cos(distance / radius) * up + np.sin(distance / radius) * way)
    return float(latitude), float(longitude)


def _with_dispersed_coefficients(
    field: SphericalHarmonics, percent: float, rng: np.random.Generator
) -> SphericalHarmonics:
    errors = 1.0 + 0.01 * percent * rng.standard_normal((2, *field.c.shape))
    errors[:, 0] = 1.0
    return SphericalHarmonics(field.gm, field.reference_radius, field.c * errors[0], field.s * errors[1])


def _scaled(scale: float, draw: Callable[..., Array], seed: int, what: Stream, shape: tuple[int, ...]) -> Array:
    """Drawn numbers times a scale; where that is zero nothing is drawn, for every stream costs as much as its numbers."""
    return scale * draw(stream(seed, what), shape) if scale else np.zeros(shape)


def _normal(scale: float, seed: int, what: Stream, shape: tuple[int, ...]) -> Array:
    return _scaled(scale, Generator.standard_normal, seed, what, shape)


def _cut(rng: Generator, shape: tuple[int, ...]) -> Array:
    """Normal numbers, those beyond three sigma drawn anew."""
    values = rng.standard_normal(shape)
    while (beyond := np.abs(values) > 3.0).any():
        values[beyond] = rng.standard_normal(int(beyond.sum()))
    return values
