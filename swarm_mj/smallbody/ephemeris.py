"""Where the Sun and the Earth stand, and how the asteroid is turned, at any epoch.

Orbits are Keplerian and positions geometric: light-time and aberration (up to 0.01 deg each) are neglected. Dates are
TDB; no leap seconds are involved (UTC is 69 s behind in 2018, 1.3 deg of Eros's rotation).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from datetime import datetime

from swarm_mj.errors import ScenarioError
from swarm_mj.scenarios.constants import DAY
from swarm_mj.smallbody.kepler import EARTH_ORBIT, EROS_ORBIT, OrbitalElements, position_velocity
from swarm_mj.smallbody.rotation import Rotation
from swarm_mj.typing import Array

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
