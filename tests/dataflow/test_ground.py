"""Earth turns under the antennas: against the astronomical triangle, astropy with measured UT1, and JPL's surveyed sites."""

import numpy as np
import pytest

from swarm_mj.dataflow.ground import NETWORKS, Station, best_station, elevations_deg, stations_from
from swarm_mj.errors import ScenarioError
from swarm_mj.scenarios.schema_link import Ground, GroundStation

FAR = 1e13  # so far that every place on Earth sees it in the same direction
#: JPL, "DSN station coordinates" of 2008-10-27 (ITRF 2005, epoch 2003.0) [m]; DSS-63 from Table 1 of JASS 40(2), 79.
SITES = {
    "Goldstone DSS-14": (-2353621.3873, -4641341.4492, 3677052.2629),
    "Canberra DSS-43": (-4460894.9092, 2682361.5401, -3674748.0458),
    "Madrid DSS-63": (4849092.518, -360180.348, 4115109.251),
    "Goldstone DSS-24": (-2354906.7043, -4646840.1231, 3669242.3109),
    "Canberra DSS-34": (-4461147.1342, 2682439.3011, -3674393.0678),
    "Madrid DSS-54": (4849434.5133, -360723.9325, 4114618.8160),
}


def station_at(latitude_deg, **changes):
    place = {"longitude_deg": 0.0, "height_m": 0.0, "diameter_m": 1.0, "g_over_t_db_k": 0.0}
    return Station(name="own", latitude_deg=latitude_deg, **{**place, **changes})


def ecliptic(ra_deg, dec_deg):
    """Unit vector in N of right ascension and declination of J2000."""
    a, d, e = np.radians([ra_deg, dec_deg, 84381.448 / 3600])
    x, y, z = np.cos(d) * np.cos(a), np.cos(d) * np.sin(a), np.sin(d)
    return np.array([x, np.cos(e) * y + np.sin(e) * z, -np.sin(e) * y + np.cos(e) * z])


def of_date(ra_deg, dec_deg, jd):
    """Mean right ascension and declination of date [deg], by the angles of Lieske 1979 (Meeus, chapter 21)."""
    t = (jd - 2451545.0) / 36525
    zeta = np.radians((2306.2181 * t + 0.30188 * t**2 + 0.017998 * t**3) / 3600)
    z = np.radians((2306.2181 * t + 1.09468 * t**2 + 0.018203 * t**3) / 3600)
    theta = np.radians((2004.3109 * t - 0.42665 * t**2 - 0.041833 * t**3) / 3600)
    a, d = np.radians([ra_deg, dec_deg])
    A = np.cos(d) * np.sin(a + zeta)
    B = np.cos(theta) * np.cos(d) * np.cos(a + zeta) - np.sin(theta) * np.sin(d)
    C = np.sin(theta) * np.cos(d) * np.cos(a + zeta) + np.cos(theta) * np.sin(d)
    return np.degrees(np.arctan2(A, B) + z), np.degrees(np.arcsin(C))


def sidereal_deg(jd_ut):
    """Mean sidereal time at Greenwich [deg] (Meeus, 12.4)."""
    d = jd_ut - 2451545.0
    return 280.46061837 + 360.98564736629 * d + 0.000387933 * (d / 36525) ** 2


@pytest.mark.parametrize(("ra", "dec"), [(10.0, -20.0), (200.0, 0.0), (300.0, 65.0)])
def test_elevations_are_those_of_the_astronomical_triangle(ra, dec):
    jd = 2458119.5 + np.linspace(0.0, 1.0, 97)  # 2018-01-01, TDB; UTC is 69.184 s behind
    found = elevations_deg(NETWORKS["dsn"], jd, np.tile(FAR * ecliptic(ra, dec), (97, 1)))
    a, d = of_date(ra, dec, jd[0])
    for k, station in enumerate(NETWORKS["dsn"]):
        hour, lat = (
            np.radians(sidereal_deg(jd - 69.184 / 86400) + station.longitude_deg - a),
            np.radians(station.latitude_deg),
        )
        sine = np.sin(lat) * np.sin(np.radians(d)) + np.cos(lat) * np.cos(np.radians(d)) * np.cos(hour)
        # Nutation, left out by hand, is 0.005 deg at most.
        np.testing.assert_allclose(found[:, k], np.degrees(np.arcsin(sine)), atol=0.01)


def test_culmination_rising_and_setting_follow_declination_and_latitude():
    step = 10.0 / 86400
    jd = 2458119.5 + np.arange(0.0, 1.0, step)
    _, d = of_date(40.0, -15.0, jd[0])
    found = elevations_deg(NETWORKS["dsn"], jd, np.tile(FAR * ecliptic(40.0, -15.0), (len(jd), 1)))
    for k, station in enumerate(NETWORKS["dsn"]):
        assert found[:, k].max() == pytest.approx(90 - abs(station.latitude_deg - d), abs=0.01)
        above = np.degrees(np.arccos(-np.tan(np.radians(station.latitude_deg)) * np.tan(np.radians(d)))) / 180
        assert (found[:, k] > 0).mean() == pytest.approx(above * 0.997_27 / step / len(jd), abs=0.003)


def test_elevations_agree_with_astropy_that_knows_measured_ut1():
    coordinates, time = pytest.importorskip("astropy.coordinates"), pytest.importorskip("astropy.time")
    from astropy.utils import iers

    jd = 2458119.5 + np.array([0.0, 0.3, 0.55, 0.9, 400.2, 1200.7])
    site = NETWORKS["dsn"][1]
    with iers.conf.set_temp("auto_download", False):
        moment = time.Time(jd, format="jd", scale="tdb")
        place = coordinates.EarthLocation.from_geodetic(site.longitude_deg, site.latitude_deg, site.height_m)
        star = coordinates.SkyCoord(np.full(6, 130.0), np.full(6, -40.0), unit="deg", frame="gcrs", obstime=moment)
        star_T = star.transform_to(coordinates.ITRS(obstime=moment)).cartesian.xyz.value.T
    lat, lon = np.radians([place.lat.deg, place.lon.deg])
    up = [np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)]
    found = elevations_deg([site], jd, np.tile(FAR * ecliptic(130.0, -40.0), (6, 1)))[:, 0]
    np.testing.assert_allclose(
        found, np.degrees(np.arcsin(star_T @ up)), atol=0.0045
    )  # 0.9 s of UT1 and the polar motion


@pytest.mark.parametrize("name", SITES)
def test_stations_stand_where_jpl_surveyed_them(name):
    station = next(s for network in NETWORKS.values() for s in network if s.name == name)
    x, y, z = SITES[name]
    a, f = 6378137.0, 1 / 298.257223563
    lat, lon, e2 = np.radians(station.latitude_deg), np.radians(station.longitude_deg), f * (2 - f)
    normal = a / np.sqrt(1 - e2 * np.sin(lat) ** 2)
    level = (normal + station.height_m) * np.cos(lat)
    here = (level * np.cos(lon), level * np.sin(lon), (normal * (1 - e2) + station.height_m) * np.sin(lat))
    np.testing.assert_allclose(here, (x, y, z), atol=0.5)


def test_a_near_spacecraft_is_seen_from_the_station_and_not_from_earths_centre():
    jd, site = np.array([2458119.5]), station_at(0.0)
    side = ecliptic(*_at_horizon(jd[0], site))
    # Level with the centre of Earth and a radius of Earth away: 45 deg below the horizon; from infinity on the horizon.
    found = elevations_deg([site], np.repeat(jd, 2), np.array([6378137.0 * side, FAR * side]))[:, 0]
    assert found == pytest.approx([-45.0, 0.0], abs=0.02)


def _at_horizon(jd, site):
    """A direction of J2000 90 deg east of a station's meridian, on the equator of date."""
    ra = sidereal_deg(jd - 69.184 / 86400) + site.longitude_deg + 90.0
    for _ in range(3):  # back from date to J2000
        a, d = of_date(ra, 0.0, jd)
        ra += (sidereal_deg(jd - 69.184 / 86400) + site.longitude_deg + 90.0 - a + 180) % 360 - 180
    return ra, -d


def test_three_complexes_lose_nothing_near_the_equator_and_the_mask_decides():
    jd = 2458119.5 + np.arange(0, 1, 1 / 288)
    elevation = elevations_deg(NETWORKS["dsn"], jd, np.tile(FAR * ecliptic(80.0, 5.0), (288, 1)))
    assert (best_station(NETWORKS["dsn"], elevation, 10.0) >= 0).all()
    assert (best_station(NETWORKS["dsn"], elevation, 60.0) == -1).any()
    assert best_station(NETWORKS["dsn"][:1], np.array([[9.99], [10.0]]), 10.0).tolist() == [-1, 0]


def test_the_most_sensitive_station_hears_and_of_equals_the_one_it_stands_highest_over():
    three = [station_at(0.0, g_over_t_db_k=g) for g in (50.0, 60.0, 60.0)]
    elevation = np.array([[80.0, 20.0, 30.0], [80.0, 31.0, 30.0], [80.0, 9.0, 9.5], [9.0, 9.0, -5.0]])
    assert best_station(three, elevation, 10.0).tolist() == [2, 1, 0, -1]


def test_stations_of_ones_own_stand_in_place_of_a_network():
    assert (
        stations_from(Ground()) == NETWORKS["dsn"] and stations_from(Ground(network="estrack")) == NETWORKS["estrack"]
    )
    own = GroundStation(name="roof", latitude_deg=48.1, longitude_deg=11.6, g_over_t_db_k=20.0)
    assert [s.name for s in stations_from(Ground(stations=(own,)))] == ["roof"]
    with pytest.raises(ScenarioError, match="'roof' is the name of two"):
        stations_from(Ground(stations=(own, own)))
    with pytest.raises(
        ScenarioError, match=r"link.ground.network = 'dsn35' .* did you mean 'dsn34'\? there are dsn, dsn34, estrack"
    ):
        stations_from(Ground(network="dsn35"))
    with pytest.raises(ScenarioError, match="latitude_deg = 91.0: must be within -90 and 90"):
        station_at(91.0)
    with pytest.raises(ScenarioError, match="g_over_t_db_k = inf: must be a finite number"):
        station_at(0.0, g_over_t_db_k=np.inf)
