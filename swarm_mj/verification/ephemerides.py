"""Ephemerides: Earth, Eros and its rotation against published facts, closed forms and astropy."""

from __future__ import annotations

from importlib import import_module

import numpy as np
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

from swarm_mj.scenarios.constants import AU, DAY, JD_J2000
from swarm_mj.smallbody.ephemeris import EARTH_ORBIT, EROS_ORBIT, Ephemeris, julian_date, position_velocity
from swarm_mj.verification.experiment import Bench, experiment
from swarm_mj.verification.reference import EPOCH_JD, ecliptic, eros_attitude

#: Equinoxes and solstices of the year 2000 (UTC; US Naval Observatory) and the Sun's apparent longitude then [deg].
SEASONS_2000 = {
    "2000-03-20T07:35": 0.0,
    "2000-06-21T01:48": 90.0,
    "2000-09-22T17:28": 180.0,
    "2000-12-21T13:37": 270.0,
}
#: TDB less UTC in 2000 [s].
TDB_LESS_UTC_S = 64.2
#: Constant of aberration and general precession in longitude per year [deg] (IAU 1976).
ABERRATION_DEG, PRECESSION_DEG = 20.49552 / 3600.0, 50.290966 / 3600.0
#: Earth's perihelion of 2020: 0.9832436 au on January 5 (US Naval Observatory).
EARTH_PERIHELION_AU, EARTH_PERIHELION_DATE = 0.9832436, "2020-01-05T07:48"
#: Sidereal period of Eros [d] (JPL Small-Body Database); osculating elements of other dates change it by tenths.
EROS_PERIOD_D = 643.2
#: Osculating elements of Eros on 2004-10-22 (JPL Small-Body Database, as printed at the time): semi-major axis [au],
#: eccentricity, inclination, node, argument of perihelion, mean anomaly [deg].
EROS_ELEMENTS_JD, EROS_ELEMENTS = 2453300.5, (1.458, 0.223, 10.829, 304.401, 178.664, 320.215)
#: Distance of Eros from Earth [Gm]: NEAR's pictures of 12 January 2000 and landing (NASA, PIA03142), the approach of 2012 and
#: the opposition of 2018 (BBC Sky at Night Magazine, November 2018).
EROS_FROM_EARTH_GM = {
    "2000-01-12T12:00": 274.0,
    "2001-02-12T20:01": 316.0,
    "2012-01-31T11:00": 26.7,
    "2018-12-07T00:00": 40.5,
}
#: One comparison with astropy in each, wandering through the seasons.
ASTROPY_YEARS = range(2005, 2045)


@experiment("ephemeris-seasons", "published times of the equinoxes and solstices of 2000", 0.02, "deg")
def seasons_error(bench: Bench) -> float:
    """Earth's heliocentric longitude."""
    errors = []
    for date, longitude in SEASONS_2000.items():
        jd = julian_date(date) + TDB_LESS_UTC_S / DAY
        x, y, _ = -position_velocity(EARTH_ORBIT, jd)[0]
        precession = PRECESSION_DEG * (jd - JD_J2000) / 365.25
        apparent = np.degrees(np.arctan2(y, x)) + precession - ABERRATION_DEG
        errors.append(abs((apparent - longitude + 180.0) % 360.0 - 180.0))
    return float(max(errors))


@experiment("ephemeris-perihelion", "published perihelion: 0.9832436 au", 1e-4, "au")
def perihelion_error(bench: Bench) -> float:
    """Earth's distance from the Sun on 2020-01-05."""
    r = position_velocity(EARTH_ORBIT, julian_date(EARTH_PERIHELION_DATE))[0]
    return abs(float(np.linalg.norm(r)) / AU - EARTH_PERIHELION_AU)


@experiment("ephemeris-eros-period", "published period: 643.2 d", 0.5, "d")
def period_error(bench: Bench) -> float:
    """Time from one passage of a place of Eros's orbit to the next."""
    days = np.arange(600.0, 700.0)
    start = position_velocity(EROS_ORBIT, EPOCH_JD)[0]
    distance = [float(np.linalg.norm(position_velocity(EROS_ORBIT, EPOCH_JD + d)[0] - start)) for d in days]
    nearest = days[int(np.argmin(distance))]
    r, v = position_velocity(EROS_ORBIT, EPOCH_JD + nearest)
    return abs(float(nearest + (start - r) @ v / (v @ v) / DAY) - EROS_PERIOD_D)


@experiment("ephemeris-eros-place", "published elements of that date, by SciPy", 0.5, "deg")
def place_error(bench: Bench) -> float:
    """Direction from the Sun to Eros on 2004-10-22."""
    axis_au, e, inclination, node, argument, mean = EROS_ELEMENTS
    anomaly = brentq(lambda x: x - e * np.sin(x) - np.radians(mean), 0.0, 2.0 * np.pi)
    in_plane = axis_au * np.array([np.cos(anomaly) - e, np.sqrt(1.0 - e * e) * np.sin(anomaly), 0.0])
    turn = Rotation.from_euler("ZXZ", [node, inclination, argument], degrees=True)
    expected, ours = turn.apply(in_plane), position_velocity(EROS_ORBIT, EROS_ELEMENTS_JD)[0]
    return float(np.degrees(np.arctan2(np.linalg.norm(np.cross(ours, expected)), ours @ expected)))


@experiment("ephemeris-eros-distance", "published distances: 274, 316, 26.7 and 40.5 Gm", 1.0, "Gm")
def distance_error(bench: Bench) -> float:
    """Distance from Earth to Eros, worst of 4 dates, 2000 to 2018."""
    errors = []
    for date, expected in EROS_FROM_EARTH_GM.items():
        jd = julian_date(date)
        between = position_velocity(EROS_ORBIT, jd)[0] - position_velocity(EARTH_ORBIT, jd)[0]
        errors.append(abs(1e-9 * float(np.linalg.norm(between)) - expected))
    return max(errors)


@experiment("ephemeris-velocity", "central differences of the positions", 2e-5)
def velocity_error(bench: Bench) -> float:
    """Velocities of Earth and Eros, relative.

    The drift of Earth's elements, 9e-6 of its motion, is no part of its velocity.
    """
    step, worst = 0.05, 0.0
    for orbit in (EARTH_ORBIT, EROS_ORBIT):
        for jd in EPOCH_JD + np.linspace(0.0, 600.0, 13):
            r = {k: position_velocity(orbit, jd + k * step)[0] for k in (-2, -1, 1, 2)}
            expected = (r[-2] - 8.0 * r[-1] + 8.0 * r[1] - r[2]) / (12.0 * step * DAY)
            v = position_velocity(orbit, jd)[1]
            worst = max(worst, float(np.linalg.norm(v - expected) / np.linalg.norm(expected)))
    return worst


@experiment("ephemeris-astropy", "astropy's built-in ephemeris", 0.02, "deg", package="astropy")
def astropy_error(bench: Bench) -> float:
    """Direction from the Sun to Earth and Moon, 2005 to 2044."""
    coordinates, time = import_module("astropy.coordinates"), import_module("astropy.time")
    worst = 0.0
    for year in ASTROPY_YEARS:
        moment = time.Time(JD_J2000 + 365.25 * (year - 2000) + 9.13 * (year - 2005), format="jd", scale="tdb")
        # The barycentre of Earth and Moon, which the elements describe, is (M r + m r_m) / (M + m), M / m = 81.3006.
        earth, moon, sun = (
            coordinates.get_body_barycentric(body, moment, ephemeris="builtin").xyz.to_value("m")
            for body in ("earth", "moon", "sun")
        )
        expected = ecliptic((81.3006 * earth + moon) / 82.3006 - sun)
        ours = position_velocity(EARTH_ORBIT, float(moment.jd))[0]
        worst = max(worst, float(np.arctan2(np.linalg.norm(np.cross(ours, expected)), ours @ expected)))
    return float(np.degrees(worst))


@experiment("ephemeris-rotation", "closed form from the vectors of pole, node and prime meridian", 1e-9)
def rotation_error(bench: Bench) -> float:
    """Elements of C_AN over a day."""
    ephemeris = Ephemeris()
    times = np.linspace(0.0, DAY, 97)
    return max(float(np.abs(ephemeris.rotation.C_AN(EPOCH_JD, t) - eros_attitude(t)).max()) for t in times)
