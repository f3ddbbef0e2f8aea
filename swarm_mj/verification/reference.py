"""Closed forms that the checks compare with. They use constants of the program, but none of its physics.

Frames as everywhere: N ecliptic J2000 about the body's centre, A fixed in the body, B in the spacecraft. SI.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, radians, sin, sqrt

import numpy as np

from swarm_mj.scenarios import constants
from swarm_mj.typing import Array

#: 2018-01-01 03:15 TDB, the epoch of the packaged scenarios, as a Julian date.
EPOCH_JD = 2_458_119.5 + 3.25 / 24.0
#: Spin rate of Eros [rad/s].
SPIN_RATE = radians(constants.EROS_W_RATE_DEG_PER_DAY) / constants.DAY


def degree_2_matrix() -> Array:
    """Matrix Q of U = GM/r + GM R^2 (r.Q.r) / r^5, the field of degree 2 of Eros in Cartesian form, shape (3, 3)."""
    (c20, _), (c21, s21), (c22, s22) = (constants.EROS_DEGREE_2[2, m] for m in range(3))
    c20, c21, s21 = sqrt(5.0) * c20, sqrt(5.0 / 3.0) * c21, sqrt(5.0 / 3.0) * s21
    c22, s22 = sqrt(5.0 / 12.0) * c22, sqrt(5.0 / 12.0) * s22
    return np.array(
        [
            [3.0 * c22 - 0.5 * c20, 3.0 * s22, 1.5 * c21],
            [3.0 * s22, -3.0 * c22 - 0.5 * c20, 1.5 * s21],
            [1.5 * c21, 1.5 * s21, c20],
        ]
    )


def eros_potential(r_A: Array) -> Array:
    """Potential of Eros of degree 2 [m^2/s^2], shape (n,), at positions in A, shape (n, 3) [m]."""
    r = np.linalg.norm(r_A, axis=-1)
    form = np.einsum("...i,ij,...j", r_A, degree_2_matrix(), r_A)
    return constants.EROS_GM * (1.0 / r + constants.EROS_REFERENCE_RADIUS**2 * form / r**5)


def eros_acceleration(r_A: Array) -> Array:
    """Attraction of Eros of degree 2 in A [m/s^2] at a position in A, shape (3,) [m]."""
    matrix, r = degree_2_matrix(), sqrt(r_A @ r_A)
    turned = matrix @ r_A
    oblate = 2.0 * turned / r**5 - 5.0 * (r_A @ turned) * r_A / r**7
    return constants.EROS_GM * (-r_A / r**3 + constants.EROS_REFERENCE_RADIUS**2 * oblate)


def eros_attitude(t: float) -> Array:
    """C_AN of Eros `t` seconds after `EPOCH_JD`, from the vectors of pole, node and prime meridian, shape (3, 3)."""
    ra, dec = radians(constants.EROS_POLE_RA_DEG), radians(constants.EROS_POLE_DEC_DEG)
    pole = ecliptic(np.array([cos(dec) * cos(ra), cos(dec) * sin(ra), sin(dec)]))
    node = ecliptic(np.array([-sin(ra), cos(ra), 0.0]))
    days = (EPOCH_JD - constants.JD_J2000) + t / constants.DAY
    angle = radians((constants.EROS_W0_DEG + constants.EROS_W_RATE_DEG_PER_DAY * days) % 360.0)
    meridian = cos(angle) * node + sin(angle) * np.cross(pole, node)
    return np.array([meridian, np.cross(pole, meridian), pole])


def ecliptic(equatorial: Array) -> Array:
    """Components along equatorial J2000 axes turned into components along ecliptic J2000 axes, shape (..., 3)."""
    obliquity = radians(constants.OBLIQUITY_J2000_DEG)
    x, y, z = np.moveaxis(equatorial, -1, 0)
    c, s = cos(obliquity), sin(obliquity)
    return np.stack([x, c * y + s * z, c * z - s * y], axis=-1)


@dataclass(frozen=True, kw_only=True)
class Gyrostat:
    """A rigid body with three wheels along its axes, after Schaub and Junkins, section 4.5.

    Attributes:
        inertia: Of body and locked wheels about the centre of mass, shape (3, 3) [kg m^2].
        wheel_inertia: Of one wheel about its axis [kg m^2].
    """

    inertia: Array
    wheel_inertia: float

    def rates(self, state: Array, motor: Array) -> Array:
        """Time derivative of (q (w, x, y, z), omega, wheel speeds), shape (10,), under motor torques (3,) [N m]."""
        q, omega, wheels = state[:4], state[4:7], state[7:]
        w, v = q[0], q[1:]
        q_dot = 0.5 * np.concatenate(([-v @ omega], w * omega + np.cross(v, omega)))
        momentum = self.inertia @ omega + self.wheel_inertia * wheels
        effective = self.inertia - self.wheel_inertia * np.eye(3)
        omega_dot = np.linalg.solve(effective, -np.cross(omega, momentum) - motor)
        return np.concatenate((q_dot, omega_dot, motor / self.wheel_inertia - omega_dot))

    def momentum_B(self, omega: Array, wheels: Array) -> Array:
        """Angular momentum in B, shape (..., 3) [kg m^2/s]."""
        return omega @ self.inertia.T + self.wheel_inertia * wheels

    def energy(self, omega: Array, wheels: Array) -> Array:
        """Kinetic energy of rotation, shape (...) [J]."""
        body = 0.5 * np.einsum("...i,ij,...j", omega, self.inertia, omega)
        return body + self.wheel_inertia * np.sum(omega * wheels + 0.5 * wheels**2, axis=-1)
