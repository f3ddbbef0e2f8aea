"""Orbits against conservation laws, finite differences, astropy's Earth and known facts about Eros."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarm_mj.scenarios.constants import AU, DAY, GM_SUN, JD_J2000
from swarm_mj.smallbody.ephemeris import EARTH_ORBIT, EROS_ORBIT, eccentric_anomaly, position_velocity


@given(M=st.floats(-np.pi, np.pi), e=st.floats(0.0, 1.0, exclude_max=True))
def test_kepler_equation_is_solved_for_every_ellipse(M, e):
    E = eccentric_anomaly(M, e)
    assert abs(E) <= np.pi
    assert E - e * np.sin(E) == pytest.approx(M, abs=4.0 * np.pi * np.finfo(float).eps)


def test_kepler_equation_is_solved_near_the_parabola():
    # For e -> 1 and small E, M = (1 - e) E + E^3 / 6.
    e, E = 1.0 - 1e-9, 1e-3
    M = (1.0 - e) * E + e * (E**3 / 6 - E**5 / 120)
    assert eccentric_anomaly(M, e) == pytest.approx(E, rel=1e-6)


def test_anomaly_of_not_a_number_is_not_a_number():
    assert np.isnan(eccentric_anomaly(np.nan, 0.5))


def test_vis_viva_and_angular_momentum_hold_along_the_orbit():
    a, e = EROS_ORBIT.semi_major_axis_au * AU, EROS_ORBIT.eccentricity
    for jd in EROS_ORBIT.perihelion_jd + np.linspace(-400.0, 400.0, 17):
        r, v = position_velocity(EROS_ORBIT, jd)
        assert v @ v == pytest.approx(GM_SUN * (2.0 / np.linalg.norm(r) - 1.0 / a), rel=1e-13)
        momentum = np.cross(r, v)
        assert np.linalg.norm(momentum) == pytest.approx(np.sqrt(GM_SUN * a * (1 - e**2)), rel=1e-13)
        assert momentum[2] / np.linalg.norm(momentum) == pytest.approx(np.cos(np.radians(EROS_ORBIT.inclination_deg)))


@pytest.mark.parametrize("orbit", [EROS_ORBIT, EARTH_ORBIT])
def test_velocity_is_the_derivative_of_position(orbit):
    jd, step = 2458119.5, 0.05
    ahead, behind = (position_velocity(orbit, jd + h)[0] for h in (step, -step))
    velocity = position_velocity(orbit, jd)[1]
    assert np.linalg.norm((ahead - behind) / (2 * step * DAY) - velocity) < 3e-5 * np.linalg.norm(velocity)


def test_eros_passes_perihelion_at_1_133_au_and_returns_after_643_days():
    r, _ = position_velocity(EROS_ORBIT, EROS_ORBIT.perihelion_jd)
    assert np.linalg.norm(r) / AU == pytest.approx(1.1333, abs=1e-4)
    assert EROS_ORBIT.period_s / DAY == pytest.approx(643.1, abs=0.1)
    after = position_velocity(EROS_ORBIT, EROS_ORBIT.perihelion_jd + EROS_ORBIT.period_s / DAY)[0]
    np.testing.assert_allclose(after, r, rtol=1e-6)


@pytest.mark.parametrize(
    ("date", "distance_au", "days", "au"),
    [(2458498.5, 0.2088, 1.0, 0.002), (2455957.5, 0.1787, 2.0, 0.01)],
    ids=["15 January 2019, at the epoch of the elements", "31 January 2012, seven years before it"],
)
def test_known_close_approaches_of_eros_to_earth_are_reproduced(date, distance_au, days, au):
    dates = date + np.arange(-40.0, 40.0, 0.1)
    distances = [
        np.linalg.norm(position_velocity(EROS_ORBIT, jd)[0] - position_velocity(EARTH_ORBIT, jd)[0]) / AU
        for jd in dates
    ]
    nearest = int(np.argmin(distances))
    assert abs(dates[nearest] - date) <= days
    assert distances[nearest] == pytest.approx(distance_au, abs=au)


def test_earth_stands_within_a_hundredth_of_a_degree_of_astropys():
    coordinates = pytest.importorskip("astropy.coordinates")
    from astropy.time import Time
    from astropy.utils import iers

    obliquity = np.radians(84381.448 / 3600.0)
    to_ecliptic = np.array(
        [[1, 0, 0], [0, np.cos(obliquity), np.sin(obliquity)], [0, -np.sin(obliquity), np.cos(obliquity)]]
    )
    # Standish states 20 arcsec in longitude; the Earth circles its barycentre with the Moon by another 7 arcsec.
    with iers.conf.set_temp("auto_download", False), coordinates.solar_system_ephemeris.set("builtin"):
        for jd in JD_J2000 + np.linspace(0.0, 49.0, 99) * 365.25:
            time = Time(jd, format="jd", scale="tdb")
            earth, sun = (coordinates.get_body_barycentric(name, time).xyz.to_value("m") for name in ("earth", "sun"))
            expected = to_ecliptic @ (earth - sun)
            r, _ = position_velocity(EARTH_ORBIT, jd)
            sine = np.linalg.norm(np.cross(r, expected)) / np.linalg.norm(r) / np.linalg.norm(expected)
            assert r @ expected > 0.0 and np.degrees(np.arcsin(sine)) < 0.01
            assert np.linalg.norm(r) == pytest.approx(np.linalg.norm(expected), rel=1e-4)
