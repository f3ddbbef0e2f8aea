"""Heliocentric orbits from their elements: where Sun and Earth stand, and how the asteroid is turned, at any epoch.

Orbits are Keplerian, in axes parallel to ecliptic J2000, and positions geometric: light-time and aberration (up to 0.01 deg
each) are neglected. Dates are TDB; no leap seconds are involved (UTC is 69 s behind in 2018, 1.3 deg of Eros's rotation).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from datetime import datetime

import numpy as np

from swarm_mj.errors import ScenarioError
from swarm_mj.scenarios.constants import AU, DAY, GM_SUN, JD_J2000
from swarm_mj.scenarios.schema_body import HeliocentricOrbit
from swarm_mj.smallbody.rotation import Rotation
from swarm_mj.typing import Array

DAYS_PER_CENTURY = 36_525.0
#: Newton steps on Kepler's equation end below this change of the eccentric anomaly, relative above 1 rad.
ANOMALY_TOLERANCE = 1e-15
#: More steps than bisection alone would need to reach the tolerance.
MAX_STEPS = 100


@dataclass(frozen=True, kw_only=True)
class SecularRates:
    """Linear drift of elements per Julian century since J2000; angles in degrees, the semi-major axis in au."""

    semi_major_axis_au: float = 0.0
    eccentricity: float = 0.0
    inclination_deg: float = 0.0
    node_deg: float = 0.0
    argument_of_perihelion_deg: float = 0.0
    mean_anomaly_deg: float


@dataclass(frozen=True, kw_only=True)
class OrbitalElements:
    """An elliptic orbit about the Sun, angles relative to the ecliptic and equinox J2000.

    Attributes:
        semi_major_axis_au: semi-major axis [au], above 0.
        eccentricity: 0 <= e < 1.
        inclination_deg: inclination [deg].
        node_deg: longitude of the ascending node [deg].
        argument_of_perihelion_deg: argument of perihelion [deg].
        perihelion_jd: Julian date (TDB) of a perihelion passage.
        rates: drift of the elements since J2000; None: fixed elements with the mean motion of Kepler's third law.
    """

    semi_major_axis_au: float
    eccentricity: float
    inclination_deg: float
    node_deg: float
    argument_of_perihelion_deg: float
    perihelion_jd: float
    rates: SecularRates | None = None

    @property
    def mean_motion(self) -> float:
        """Mean motion [rad/s]."""
        if self.rates is not None:
            return math.radians(self.rates.mean_anomaly_deg) / (DAYS_PER_CENTURY * DAY)
        return math.sqrt(GM_SUN / (self.semi_major_axis_au * AU) ** 3)

    @property
    def period_s(self) -> float:
        """Anomalistic period [s]."""
        return 2.0 * math.pi / self.mean_motion


#: 433 Eros, osculating on 2019-05-02 (JPL Horizons).
EROS_ORBIT = OrbitalElements(**HeliocentricOrbit().model_dump())
#: Barycentre of Earth and Moon, 1800 to 2050 (Standish, JPL, Keplerian elements for approximate positions, table 1).
#: Its mean longitude 100.46457166 deg less its longitude of perihelion 102.93768193 deg at J2000 gives the perihelion
#: date. The rates are kept: with them the direction from the Sun is within 0.01 deg of the true one from 2000 to 2049.
EARTH_ORBIT = OrbitalElements(
    semi_major_axis_au=1.00000261,
    eccentricity=0.01671123,
    inclination_deg=-0.00001531,
    node_deg=0.0,
    argument_of_perihelion_deg=102.93768193,
    perihelion_jd=JD_J2000 - (100.46457166 - 102.93768193) / (35999.37244981 - 0.32327364) * DAYS_PER_CENTURY,
    rates=SecularRates(
        semi_major_axis_au=0.00000562,
        eccentricity=-0.00004392,
        inclination_deg=-0.01294668,
        argument_of_perihelion_deg=0.32327364,
        mean_anomaly_deg=35999.37244981 - 0.32327364,
    ),
)


def position_velocity(elements: OrbitalElements, jd: float) -> tuple[Array, Array]:
    """Position [m] and velocity [m/s] relative to the Sun at a Julian date (TDB), along the axes of N, each of shape (3,)."""
    a_au, e, inclination, node, argument = _elements_at(elements, jd)
    a, n = a_au * AU, elements.mean_motion
    anomaly = eccentric_anomaly(n * (jd - elements.perihelion_jd) * DAY, e)
    sine, cosine, minor = math.sin(anomaly), math.cos(anomaly), math.sqrt((1.0 - e) * (1.0 + e))
    rate = n / (1.0 - e * cosine)
    P, Q = perifocal_axes(inclination, node, argument)
    return a * ((cosine - e) * P + minor * sine * Q), a * rate * (-sine * P + minor * cosine * Q)


def eccentric_anomaly(mean_anomaly: float, eccentricity: float) -> float:
    """Solve Kepler's equation M = E - e sin E by Newton's method kept inside a shrinking bracket.

    Args:
        mean_anomaly: M [rad], any size.
        eccentricity: 0 <= e < 1.

    Returns:
        E [rad] in [-pi, pi]; M is first reduced to that interval.
    """
    M = math.remainder(mean_anomaly, 2.0 * math.pi)
    # E - M = e sin E lies between 0 and e on the side of M's sign; Newton alone may leave that range when e is near 1.
    low, high = (M, min(M + eccentricity, math.pi)) if M >= 0.0 else (max(M - eccentricity, -math.pi), M)
    E = 0.5 * (low + high)
    for _ in range(MAX_STEPS):
        excess = E - eccentricity * math.sin(E) - M
        low, high = (low, E) if excess > 0.0 else (E, high)
        step = E - excess / (1.0 - eccentricity * math.cos(E))
        following = step if low <= step <= high else 0.5 * (low + high)
        if abs(following - E) <= ANOMALY_TOLERANCE * max(1.0, abs(E)):
            return following
        E = following
    return E


def _elements_at(elements: OrbitalElements, jd: float) -> tuple[float, float, float, float, float]:
    """Semi-major axis [au], eccentricity, inclination, node and argument of perihelion [rad] at a date."""
    centuries = (jd - JD_J2000) / DAYS_PER_CENTURY
    rates = elements.rates or SecularRates(mean_anomaly_deg=0.0)
    names = ("semi_major_axis_au", "eccentricity", "inclination_deg", "node_deg", "argument_of_perihelion_deg")
    a, e, *angles = (getattr(elements, name) + centuries * getattr(rates, name) for name in names)
    inclination, node, argument = map(math.radians, angles)
    return a, e, inclination, node, argument


def perifocal_axes(inclination: float, node: float, argument: float) -> tuple[Array, Array]:
    """Unit vectors towards perihelion and 90 deg ahead of it, Montenbruck and Gill (2000), eq. 2.58."""
    ci, si = math.cos(inclination), math.sin(inclination)
    cn, sn = math.cos(node), math.sin(node)
    ca, sa = math.cos(argument), math.sin(argument)
    P = np.array([ca * cn - sa * ci * sn, ca * sn + sa * ci * cn, sa * si])
    Q = np.array([-sa * cn - ca * ci * sn, -sa * sn + ca * ci * cn, ca * si])
    return P, Q


#: Start of the paper's two configurations with Eros as it really was. In January 2018 Sun and Earth stand near its
#: equator, at latitudes 12 and 10 deg and 3 deg apart. At this minute they stand over 62 and 61 deg east 600 s later,
#: when the swarm passes over 0 N, 90 E. From 0 to 1,030 s the Sun is within 38 deg of the target's axis and 48 deg of
#: the normal of each of its faces (the terrain there faces 46 deg east), and no shadow falls on it; the Earth is never
#: hidden on the way from (0, 0, -30 km) over the target until 1,200 s. At the elements' own epoch the Sun stands at
#: latitude 88 deg.
DEFAULT_EPOCH = "2018-01-01T03:15:00"


@dataclass(frozen=True, kw_only=True)
class Ephemeris:
    """The asteroid among Sun and Earth; the defaults are those of 433 Eros.

    Attributes:
        orbit: heliocentric orbit of the asteroid.
        earth_orbit: heliocentric orbit of the Earth (of its barycentre with the Moon, 4,700 km away at most).
        rotation: pole and rotation of the asteroid.
    """

    orbit: OrbitalElements = EROS_ORBIT
    earth_orbit: OrbitalElements = EARTH_ORBIT
    rotation: Rotation = field(default_factory=Rotation)

    def sun_state_N(self, jd: float) -> tuple[Array, Array]:
        """Position [m] and velocity [m/s] of the Sun relative to the asteroid, in N, at a Julian date (TDB)."""
        r, v = position_velocity(self.orbit, jd)
        return -r, -v

    def earth_state_N(self, jd: float) -> tuple[Array, Array]:
        """Position [m] and velocity [m/s] of the Earth relative to the asteroid, in N, at a Julian date (TDB)."""
        (r, v), (r_earth, v_earth) = (position_velocity(orbit, jd) for orbit in (self.orbit, self.earth_orbit))
        return r_earth - r, v_earth - v


def julian_date(epoch: str) -> float:
    """Julian date (TDB) of a date and time; double precision resolves 40 us.

    Args:
        epoch: ISO 8601 without time zone, read as TDB, e.g. `2018-01-15T00:00:00`.

    Raises:
        ScenarioError: not such a text.
    """
    moment = _moment(epoch)
    midnight = moment.replace(hour=0, minute=0, second=0, microsecond=0)
    return midnight.toordinal() + 1_721_424.5 + (moment - midnight).total_seconds() / DAY


def ephemeris_time(epoch: str) -> float:
    """SPICE's ephemeris time, seconds of TDB past J2000, of a date and time; args and errors as for `julian_date`."""
    return (_moment(epoch) - datetime(2000, 1, 1, 12)).total_seconds()


def _moment(epoch: str) -> datetime:
    try:
        moment = datetime.fromisoformat(epoch)
    except (TypeError, ValueError):
        raise ScenarioError(f"epoch {epoch!r}: not a date and time like {DEFAULT_EPOCH} (ISO 8601, TDB)") from None
    if moment.tzinfo is not None:
        raise ScenarioError(f"epoch {epoch!r}: times are TDB and take no time zone; write it like {DEFAULT_EPOCH}")
    return moment
