"""Rotation of a small body: from its pole and prime meridian to the matrix C_AN.

The pole is given in the equatorial frame J2000, as the IAU does (Archinal et al. 2018), and N is ecliptic: the two
differ by the obliquity. A Julian date in double precision resolves no less than 40 us; for smooth motion times within a
simulation are therefore given in seconds after an epoch.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from swarm_mj.compilation import kernel
from swarm_mj.scenarios import constants
from swarm_mj.typing import Array


@dataclass(frozen=True, kw_only=True)
class Rotation:
    """Uniform rotation about a fixed pole; the defaults are those of 433 Eros.

    Attributes:
        pole_ra_deg: right ascension of the pole, equatorial J2000 [deg].
        pole_dec_deg: declination of the pole [deg].
        w0_deg: angle W of the prime meridian at J2000, along the equator from its ascending node [deg].
        w_rate_deg_per_day: rate of W [deg/day].
    """

    pole_ra_deg: float = constants.EROS_POLE_RA_DEG
    pole_dec_deg: float = constants.EROS_POLE_DEC_DEG
    w0_deg: float = constants.EROS_W0_DEG
    w_rate_deg_per_day: float = constants.EROS_W_RATE_DEG_PER_DAY

    @property
    def spin_rate(self) -> float:
        """Angular rate about the pole [rad/s]; negative for retrograde rotation."""
        return math.radians(self.w_rate_deg_per_day) / constants.DAY

    @cached_property
    def C_PN(self) -> Array:
        """From N to the frame P of the pole (z) and the ascending node of the body's equator (x), shape (3, 3)."""
        tilt = math.radians(90.0 - self.pole_dec_deg)
        node = math.radians(90.0 + self.pole_ra_deg)
        matrix = _rotation_1(tilt) @ _rotation_3(node) @ equatorial_from_ecliptic()
        matrix.setflags(write=False)
        return matrix

    def phase(self, jd: float, t_s: float = 0.0) -> float:
        """Angle W of the prime meridian [rad] `t_s` seconds after a Julian date (TDB); at the date itself in [0, 2 pi)."""
        turned = self.w_rate_deg_per_day * (jd - constants.JD_J2000)
        return math.radians((self.w0_deg + turned) % 360.0) + self.spin_rate * t_s

    def C_AN(self, jd: float, t_s: float = 0.0) -> Array:
        """From components in N to components in A, shape (3, 3), `t_s` seconds after a Julian date (TDB)."""
        return spin_dcm(self.C_PN, self.phase(jd, t_s))


def equatorial_from_ecliptic() -> Array:
    """From components in N, the ecliptic frame of J2000, to those in its equatorial frame, shape (3, 3)."""
    return _rotation_1(-math.radians(constants.OBLIQUITY_J2000_DEG))


@kernel
def spin_dcm(C_PN: Array, phase: float) -> Array:
    """Turn the frame P about its z axis by the phase [rad]: C_AN, shape (3, 3). For compiled loops."""
    out = np.empty((3, 3))
    write_spin_dcm(C_PN, phase, out)
    return out


@kernel
def write_spin_dcm(C_PN: Array, phase: float, out: Array) -> None:
    """The same into an array of the caller, shape (3, 3)."""
    c, s = np.cos(phase), np.sin(phase)
    for k in range(3):
        out[0, k] = c * C_PN[0, k] + s * C_PN[1, k]
        out[1, k] = c * C_PN[1, k] - s * C_PN[0, k]
        out[2, k] = C_PN[2, k]


def sub_point(direction_N: Array, C_AN: Array) -> tuple[float, float]:
    """Planetocentric latitude [-90, 90] and east longitude [0, 360) of a direction from the centre [deg]."""
    x, y, z = C_AN @ direction_N
    return math.degrees(math.atan2(z, math.hypot(x, y))), math.degrees(math.atan2(y, x)) % 360.0


def _rotation_1(angle: float) -> Array:
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[1.0, 0.0, 0.0], [0.0, c, s], [0.0, -s, c]])


def _rotation_3(angle: float) -> Array:
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
