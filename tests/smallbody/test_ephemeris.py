"""Rotation and directions against closed forms, published facts and astropy's frames."""

import numpy as np
import pytest
import trimesh

from swarm_mj.errors import ScenarioError
from swarm_mj.scenarios.constants import AU, JD_J2000
from swarm_mj.smallbody.ephemeris import DEFAULT_EPOCH, EROS_ORBIT, Ephemeris, julian_date, position_velocity
from swarm_mj.smallbody.rotation import Rotation, spin_dcm, sub_point
from swarm_mj.smallbody.shape_harmonics import load_eros

EROS = Ephemeris()
JD = julian_date(DEFAULT_EPOCH)


def unit(v):
    return v / np.linalg.norm(v)


@pytest.mark.parametrize(
    ("text", "jd"),
    [
        ("2000-01-01T12:00:00", 2451545.0),
        ("1858-11-17T00:00:00", 2400000.5),
        ("2018-01-15", 2458133.5),
        ("2019-05-02T00:00:00.000", 2458605.5),
        ("2018-01-01T18:00", 2458120.25),
    ],
)
def test_julian_dates_are_those_of_the_calendar(text, jd):
    assert julian_date(text) == jd


@pytest.mark.parametrize(
    "text", ["", "tomorrow", "2018-13-01T00:00:00", "2018-02-30", "2018-01-15T25:00:00", "2458133.5"]
)
def test_text_that_is_no_date_is_refused(text):
    with pytest.raises(ScenarioError, match="epoch .*ISO 8601, TDB"):
        julian_date(text)


@pytest.mark.parametrize("text", ["2018-01-15T00:00:00Z", "2018-01-15T00:00:00+01:00"])
def test_time_zones_are_refused_because_dates_are_tdb(text):
    with pytest.raises(ScenarioError, match="take no time zone"):
        julian_date(text)


def test_eros_turns_once_in_5_270255_hours():
    assert 2.0 * np.pi / EROS.rotation.spin_rate / 3600.0 == pytest.approx(5.270255, abs=5e-7)
    before, after = EROS.rotation.C_AN(JD, 0.0), EROS.rotation.C_AN(JD, 2.0 * np.pi / EROS.rotation.spin_rate)
    np.testing.assert_allclose(after, before, atol=1e-12)
    assert not np.allclose(EROS.rotation.C_AN(JD, np.pi / EROS.rotation.spin_rate), before, atol=0.5)


def test_pole_points_to_the_published_ecliptic_direction():
    # Miller et al. (2002): ecliptic longitude 17.24 deg, latitude 11.35 deg.
    longitude = np.degrees(np.arctan2(EROS.rotation.C_PN[2][1], EROS.rotation.C_PN[2][0]))
    latitude = np.degrees(np.arcsin(EROS.rotation.C_PN[2][2]))
    assert (longitude, latitude) == (pytest.approx(17.235, abs=0.02), pytest.approx(11.358, abs=0.02))


def test_frame_is_that_of_pole_and_prime_meridian_in_astropys_equatorial_frame():
    pytest.importorskip("astropy")
    from astropy.coordinates import BarycentricMeanEcliptic, SkyCoord

    rotation = EROS.rotation
    ecliptic = BarycentricMeanEcliptic(equinox="J2000")
    icrs = {"frame": "icrs", "unit": "deg"}
    pole = SkyCoord(rotation.pole_ra_deg, rotation.pole_dec_deg, **icrs).transform_to(ecliptic).cartesian.xyz.value
    node = SkyCoord(rotation.pole_ra_deg + 90.0, 0.0, **icrs).transform_to(ecliptic).cartesian.xyz.value
    W = np.radians(rotation.w0_deg)
    meridian = np.cos(W) * node + np.sin(W) * np.cross(pole, node)
    expected = np.array([meridian, np.cross(pole, meridian), pole])
    # Frame bias between ICRS and mean J2000 is 0.02 arcsec, the rounding of the obliquity 0.04 arcsec.
    np.testing.assert_allclose(EROS.rotation.C_AN(JD_J2000), expected, atol=1e-6)


def test_matrix_is_a_rotation_whose_rate_is_the_spin_about_the_pole():
    C = EROS.rotation.C_AN(JD, 321.0)
    np.testing.assert_allclose(C @ C.T, np.eye(3), atol=1e-15)
    assert np.linalg.det(C) == pytest.approx(1.0)
    step = 1.0
    rate = (EROS.rotation.C_AN(JD, 321.0 + step) - EROS.rotation.C_AN(JD, 321.0 - step)) / (2 * step)
    cross = -rate @ C.T
    expected = EROS.rotation.spin_rate * np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    np.testing.assert_allclose(cross, expected, atol=1e-10)


def test_seconds_past_the_epoch_continue_the_julian_date():
    np.testing.assert_allclose(EROS.rotation.C_AN(JD, 43_200.0), EROS.rotation.C_AN(JD + 0.5), atol=1e-7)
    rotation = EROS.rotation
    np.testing.assert_array_equal(spin_dcm(rotation.C_PN, rotation.phase(JD, 600.0)), EROS.rotation.C_AN(JD, 600.0))


def test_motion_is_smooth_at_a_microsecond():
    step = EROS.rotation.C_AN(JD, 1000.0 + 1e-6) - EROS.rotation.C_AN(JD, 1000.0)
    assert np.linalg.norm(step[0]) == pytest.approx(EROS.rotation.spin_rate * 1e-6, rel=1e-5)


def test_another_body_can_be_described():
    upright = Rotation(pole_ra_deg=0.0, pole_dec_deg=90.0, w0_deg=0.0, w_rate_deg_per_day=-360.0)
    sine, cosine = np.sin(np.radians(23.43928)), np.cos(np.radians(23.43928))
    np.testing.assert_allclose(upright.C_PN[2], [0.0, sine, cosine], atol=1e-15)
    assert upright.spin_rate == pytest.approx(-2.0 * np.pi / 86_400.0)
    np.testing.assert_allclose(upright.C_AN(JD_J2000)[0], [0.0, cosine, -sine], atol=1e-15)


def test_sub_point_inverts_latitude_and_longitude():
    for latitude, longitude in ((0.0, 90.0), (-45.0, 300.0), (12.5, 0.0)):
        phi, lam = np.radians([latitude, longitude])
        direction_A = np.array([np.cos(phi) * np.cos(lam), np.cos(phi) * np.sin(lam), np.sin(phi)])
        C = EROS.rotation.C_AN(JD)
        assert sub_point(7e11 * C.T @ direction_A, C) == pytest.approx((latitude, longitude % 360.0), abs=1e-10)


def test_sun_and_earth_are_seen_from_the_asteroid():
    eros = position_velocity(EROS_ORBIT, JD)[0]
    np.testing.assert_array_equal(EROS.sun_state_N(JD)[0], -eros)
    between = EROS.earth_state_N(JD)[0] - EROS.sun_state_N(JD)[0]
    assert np.linalg.norm(between) / AU == pytest.approx(0.9833, abs=1e-3)
    step = 0.1
    for state in (EROS.sun_state_N, EROS.earth_state_N):
        difference = (state(JD + step)[0] - state(JD - step)[0]) / (2 * step * 86_400.0)
        np.testing.assert_allclose(difference, state(JD)[1], rtol=1e-3)


def test_sub_solar_latitude_is_12_4_deg_at_the_default_epoch_and_88_at_that_of_the_elements():
    assert sub_point(EROS.sun_state_N(JD)[0], EROS.rotation.C_AN(JD))[0] == pytest.approx(12.4, abs=0.1)
    other = julian_date("2019-05-02")
    assert abs(sub_point(EROS.sun_state_N(other)[0], EROS.rotation.C_AN(other))[0]) == pytest.approx(88.0, abs=1.0)


def test_default_epoch_shows_the_target_in_sunlight_and_the_earth_unhidden():
    shape = load_eros()
    # In kilometres, because the ray caster's tolerances are absolute.
    mesh = trimesh.Trimesh(shape.vertices / 1e3, shape.faces, process=False)
    side = np.tan(np.radians(20.0)) / np.sqrt(2.0)
    x, y, z = shape.face_centroids.T
    target = (y > 0.0) & (np.abs(x) <= side * y) & (np.abs(z) <= side * y)
    surface = (shape.face_centroids[target] + 5.0 * shape.face_normals[target]) / 1e3
    start_N = EROS.rotation.C_AN(JD).T @ [0.0, 0.0, -30e3]
    arrival_N = EROS.rotation.C_AN(JD, 600.0).T @ [0.0, 22e3, 0.0]
    for t in (0.0, 300.0, 600.0, 900.0, 1030.0, 1200.0):
        C = EROS.rotation.C_AN(JD, t)
        sun, earth = (C @ unit(v) for v in (EROS.sun_state_N(JD)[0], EROS.earth_state_N(JD)[0]))
        if t <= 1030.0:
            assert np.degrees(np.arccos(sun[1])) < 45.0
            assert np.degrees(np.arccos(shape.face_normals[target] @ sun)).max() < 50.0
            assert not mesh.ray.intersects_any(surface, np.tile(sun, (len(surface), 1))).any()
        r_A = C @ (start_N + (arrival_N - start_N) * t / 600.0)
        assert not mesh.ray.intersects_any([r_A / 1e3], [earth]).any()
