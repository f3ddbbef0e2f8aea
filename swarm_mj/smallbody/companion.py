"""One more body, as of a binary asteroid: where it is, how it is turned, how it pulls.

N's origin stays the first body's centre, to which the path of the other is relative: a Keplerian orbit, or samples of a file. N
falls with the first body, so of the companion's attraction that on the first body, taken as a point, is subtracted.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from swarm_mj.plugins import as_array, call
from swarm_mj.smallbody.ephemeris import eccentric_anomaly
from swarm_mj.smallbody.gravity.base import Gravity
from swarm_mj.smallbody.rotation import spin_dcm
from swarm_mj.smallbody.shape import ShapeModel
from swarm_mj.typing import Array


class RelativePath(Protocol):
    """Where the companion is relative to the first body's centre."""

    def state(self, t: float) -> tuple[Array, Array]:
        """Position [m] and velocity [m/s] in N at a time past the epoch [s], each of shape (3,)."""


@dataclass(frozen=True, kw_only=True)
class KeplerianPath:
    """An elliptic orbit.

    Attributes:
        semi_major_axis: [m].
        eccentricity: Below 1.
        P_N: Direction of the periapsis, shape (3,).
        Q_N: Direction of the motion there.
        mean_anomaly: At the epoch [rad].
        mean_motion: [rad/s].
    """

    semi_major_axis: float
    eccentricity: float
    P_N: Array
    Q_N: Array
    mean_anomaly: float
    mean_motion: float

    def state(self, t: float) -> tuple[Array, Array]:
        """See `RelativePath.state`."""
        a, e = self.semi_major_axis, self.eccentricity
        E = eccentric_anomaly(self.mean_anomaly + self.mean_motion * t, e)
        sine, cosine, minor = np.sin(E), np.cos(E), np.sqrt((1.0 - e) * (1.0 + e))
        rate = self.mean_motion / (1.0 - e * cosine)
        position = a * ((cosine - e) * self.P_N + minor * sine * self.Q_N)
        return position, a * rate * (-sine * self.P_N + minor * cosine * self.Q_N)


class SampledPath:
    """A path through states at some times, by Hermite's cubic polynomials.

    Args:
        times: Past the epoch [s], shape (k,); the path holds between the first and the last.
        states_N: Position [m] and velocity [m/s], shape (k, 6).
    """

    def __init__(self, times: Array, states_N: Array) -> None:
        self._position = CubicHermiteSpline(times, states_N[:, :3], states_N[:, 3:])
        self._velocity = self._position.derivative()

    def state(self, t: float) -> tuple[Array, Array]:
        """See `RelativePath.state`."""
        return self._position(t), self._velocity(t)


@dataclass(frozen=True, kw_only=True)
class Companion:
    """The companion during one flight. Its body-fixed frame is A2.

    Attributes:
        name: Of the body.
        shape: Its mesh in A2 [m].
        gravity: Its field in A2.
        path: Where its centre is.
        C_PN: Rotation from N to the frame of its pole, shape (3, 3).
        phase0: Angle of its prime meridian at the epoch [rad].
        own_rate: Of its rotation [rad/s].
        locked: Whether it turns its +x to the first body, z along the orbit's normal, instead.
    """

    name: str
    shape: ShapeModel
    gravity: Gravity
    path: RelativePath
    C_PN: Array
    phase0: float
    own_rate: float
    locked: bool = False

    @property
    def spin_rate(self) -> float:
        """About its pole [rad/s]; of one that is locked, at the epoch."""
        if not self.locked:
            return self.own_rate
        r, v = self.path.state(0.0)
        return float(np.linalg.norm(np.cross(r, v)) / (r @ r))

    def position(self, t: float) -> Array:
        """Of its centre in N, shape (3,) [m]."""
        return self.path.state(t)[0]

    def C_AN(self, t: float) -> Array:
        """Rotation from N to A2 at a time past the epoch [s], shape (3, 3)."""
        if not self.locked:
            return spin_dcm(self.C_PN, self.phase0 + self.own_rate * t)
        return facing_dcm(*self.path.state(t))

    def acceleration_N(self, t: float, r_BN_N: Array) -> Array:
        """What it does to bodies at `r_BN_N`, shape (n, 3) [m], in N [m/s^2]: its attraction less that on the origin of N.

        Raises:
            PluginError: The field fails, or answers something else than its protocol says.
        """
        C_AN = self.C_AN(t)
        r_A = (np.vstack((r_BN_N, np.zeros(3))) - self.position(t)) @ C_AN.T
        answer = call(self.gravity, "gravity field", "acceleration", r_A)
        what = "the gravity field {} of the companion answers an acceleration that"
        a_N = as_array(answer, r_A.shape, np.float64, self.gravity, what) @ C_AN
        return np.asarray(a_N[:-1] - a_N[-1])


def facing_dcm(r_N: Array, v_N: Array) -> Array:
    """Rotation from N to a frame at `r_N` [m] whose +x looks to the origin and whose z is the orbit's normal, shape (3, 3)."""
    x, h = -r_N / np.linalg.norm(r_N), np.cross(r_N, v_N)
    z = h / np.linalg.norm(h)
    return np.stack([x, np.cross(z, x), z])
