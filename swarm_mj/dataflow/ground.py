"""Stations on Earth: where they are, what they hear, and how high a spacecraft stands over them.

Earth turns by IAU 2006/2000B (pyerfa, which needs no files): TDB is taken for TT (2 ms), leap seconds are ERFA's, and UT1 for
UTC (less than 0.9 s, 0.004 deg; the same again for each leap second that ERFA does not know of yet). Left out are polar motion
(0.0002 deg), annual and diurnal aberration (0.006 deg), the 0.02 arcsec between ICRF and J2000, and refraction, which lifts a
spacecraft by 0.1 deg at 10 deg of elevation.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite
from typing import NamedTuple

import numpy as np

from swarm_mj.dataflow.radios import known_name
from swarm_mj.errors import ScenarioError
from swarm_mj.scenarios.constants import DAY, SPEED_OF_LIGHT
from swarm_mj.scenarios.schema_link import Ground
from swarm_mj.smallbody.ephemeris import julian_date
from swarm_mj.smallbody.rotation import equatorial_from_ecliptic
from swarm_mj.typing import Array, Ints


@dataclass(frozen=True, kw_only=True)
class Station:
    """A dish on Earth that listens."""

    name: str  #: as plans and tables call it
    latitude_deg: float  #: geodetic latitude, WGS 84 [deg]
    longitude_deg: float  #: east longitude [deg]
    height_m: float  #: above the ellipsoid [m]
    diameter_m: float  #: of the dish [m]
    g_over_t_db_k: float  #: figure of merit at X band, at some 30 deg of elevation [dB/K]
    source: str = "of the scenario"  #: where the numbers are from

    def __post_init__(self) -> None:
        """Refuse what stands nowhere.

        Raises:
            ScenarioError: A number is not finite, or the latitude is beyond 90 deg.
        """
        for key in ("latitude_deg", "longitude_deg", "height_m", "diameter_m", "g_over_t_db_k"):
            if not isfinite(value := getattr(self, key)):
                raise ScenarioError(f"station {self.name!r}: {key} = {value!r}: must be a finite number")
        if abs(self.latitude_deg) > 90.0:
            raise ScenarioError(
                f"station {self.name!r}: latitude_deg = {self.latitude_deg!r}: must be within -90 and 90"
            )


#: 74.2 dBi at 8.42 GHz without atmosphere (Richter and Slobin 1989, TDA Progress Report 42-97), 25 K assumed for 30 deg of
#: elevation in 90 % of the weather (DSN 810-005, module 101, class): 74.2 - 10 lg 25.
G_OVER_T_70_M = 60.2
#: 68.2 dBi (73 % of the aperture), 27 K (DSN 810-005, module 104, class): 68.2 - 10 lg 27.
G_OVER_T_34_M = 53.9
#: ESA's dishes of 35 m at X band (ESTRACK Facilities Manual, class).
G_OVER_T_35_M = 50.1
_DSN = "DSN 810-005, module 301"
_DSN_70_M = {"diameter_m": 70.0, "g_over_t_db_k": G_OVER_T_70_M, "source": f"{_DSN}; G/T of module 101, class"}
_DSN_34_M = {"diameter_m": 34.0, "g_over_t_db_k": G_OVER_T_34_M, "source": f"{_DSN}; G/T of module 104, class"}
_ESA_35_M = {"diameter_m": 35.0, "g_over_t_db_k": G_OVER_T_35_M, "source": "ESTRACK Facilities Manual; G/T class"}


def _station(name: str, latitude_deg: float, longitude_deg: float, height_m: float, kind: dict) -> Station:
    return Station(name=name, latitude_deg=latitude_deg, longitude_deg=longitude_deg, height_m=height_m, **kind)


#: Networks by name.
NETWORKS: dict[str, tuple[Station, ...]] = {
    "dsn": (
        _station("Goldstone DSS-14", 35.425901, 243.110464, 1001.4, _DSN_70_M),
        _station("Canberra DSS-43", -35.402424, 148.981267, 688.9, _DSN_70_M),
        _station("Madrid DSS-63", 40.431210, 355.751991, 864.8, _DSN_70_M),
    ),
    "dsn34": (
        _station("Goldstone DSS-24", 35.339893, 243.125206, 951.5, _DSN_34_M),
        _station("Canberra DSS-34", -35.398479, 148.981964, 692.0, _DSN_34_M),
        _station("Madrid DSS-54", 40.425620, 355.745901, 837.1, _DSN_34_M),
    ),
    "estrack": (
        _station("New Norcia", -31.0482, 116.1915, 252.0, _ESA_35_M),
        _station("Cebreros", 40.4527, 355.6324, 794.0, _ESA_35_M),
        _station("Malargue", -35.7760, 290.6018, 1550.0, _ESA_35_M),
    ),
}


def stations_from(ground: Ground) -> tuple[Station, ...]:
    """The stations of a scenario: its own, or those of the network that it names.

    Raises:
        ScenarioError: There is no such network, or two of its own stations have one name.
    """
    if not ground.stations:
        return NETWORKS[known_name(ground.network, NETWORKS, "link.ground.network", "network")]
    names = [station.name for station in ground.stations]
    if twice := [name for name in names if names.count(name) > 1]:
        raise ScenarioError(f"link.ground.stations: {twice[0]!r} is the name of two: names must differ")
    return tuple(Station(**station.model_dump()) for station in ground.stations)


def elevations_deg(stations: Sequence[Station], jd_tdb: Array, r_SE_N: Array) -> Array:
    """Elevation of the spacecraft over the horizon of each station.

    Args:
        stations: Of the network.
        jd_tdb: Julian dates (TDB) at which the signal is received, shape (t,).
        r_SE_N: Spacecraft relative to Earth's centre, in N, when it sends, shape (t, 3) [m].

    Returns:
        Shape (t, len(stations)) [deg]; the direction is that from the station, the zenith the ellipsoid's normal.
    """
    import erfa

    matrices = _terrestrial_from_ecliptic(np.atleast_1d(np.asarray(jd_tdb, np.float64)))
    r_SE_T = np.einsum("tij,tj->ti", matrices, np.asarray(r_SE_N, np.float64))
    longitude, latitude = (np.radians([getattr(s, key) for s in stations]) for key in ("longitude_deg", "latitude_deg"))
    site_T = erfa.gd2gc(1, longitude, latitude, np.array([s.height_m for s in stations]))  # 1: WGS 84
    up_T = np.column_stack(
        (np.cos(latitude) * np.cos(longitude), np.cos(latitude) * np.sin(longitude), np.sin(latitude))
    )
    way = r_SE_T[:, None, :] - site_T
    above = np.einsum("tsi,si->ts", way, up_T)
    return np.degrees(np.arctan2(above, np.linalg.norm(way - above[..., None] * up_T, axis=-1)))


def _terrestrial_from_ecliptic(jd_tdb: Array) -> Array:
    """From components in N to the frame that turns with Earth (ITRF), shape (t, 3, 3)."""
    import erfa

    # Split at the day, so that the fraction keeps its digits.
    day = np.floor(jd_tdb)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", erfa.ErfaWarning)  # "dubious year": leap seconds to come, see above
        utc = erfa.taiutc(*erfa.tttai(day, jd_tdb - day))
        matrices = erfa.c2t00b(day, jd_tdb - day, *erfa.utcut1(*utc, 0.0), 0.0, 0.0)
    turned: Array = matrices @ equatorial_from_ecliptic()
    return turned


def best_station(stations: Sequence[Station], elevation_deg: Array, min_elevation_deg: float) -> Ints:
    """Which station hears: of those that see the spacecraft the most sensitive; of equals the one over which it stands highest.

    Args:
        stations: Of the network.
        elevation_deg: Of the spacecraft, shape (t, len(stations)) [deg].
        min_elevation_deg: A station hears what stands as high or higher [deg].

    Returns:
        Numbers of stations from 0; -1 where none sees it, shape (t,).
    """
    sees = elevation_deg >= min_elevation_deg
    g_over_t = np.where(sees, [station.g_over_t_db_k for station in stations], -np.inf)
    most = sees & (g_over_t == g_over_t.max(axis=1, keepdims=True))
    highest: Ints = np.where(most, elevation_deg, -np.inf).argmax(axis=1).astype(np.int64)
    return np.where(sees.any(axis=1), highest, -1)


class EarthSchedule(NamedTuple):
    """Who on Earth hears a spacecraft at t instants."""

    station: Ints  #: the `best_station` when the signal arrives, by number from 0; -1 where none sees it, shape (t,)
    light_time_s: Array  #: of the way from the origin of N to Earth, shape (t,)


def earth_schedule(
    ground: Ground, epoch: str, t: Array, r_N: Array, earth_N: Array, *, turn_s: float = 0.0
) -> EarthSchedule:
    """When which station of a scenario's network hears what a spacecraft sends.

    Args:
        ground: Names the network, and from which elevation on its stations hear.
        epoch: Of the scenario (TDB).
        t: Past it, when it is sent [s], shape (t,).
        r_N: Where the spacecraft is, shape (t, 3) or (3,) [m].
        earth_N: Position of Earth, shape (t, 3) [m].
        turn_s: By which Earth has turned on, for an arrival at another hour of the day [s].
    """
    stations = stations_from(ground)
    light_time_s = np.linalg.norm(earth_N, axis=1) / SPEED_OF_LIGHT
    heard_jd = julian_date(epoch) + (t + light_time_s + turn_s) / DAY
    elevation_deg = elevations_deg(stations, heard_jd, r_N - earth_N)
    return EarthSchedule(best_station(stations, elevation_deg, ground.min_elevation_deg), light_time_s)
