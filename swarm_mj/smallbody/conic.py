"""Two-body orbits about the body: from elements, or from the B-plane of a hyperbola, to a state and back.

The B-plane stands in the body's centre across the incoming asymptote S: T = S x pole and R = S x T, both of length 1, and B
leads from the centre to the asymptote (Kizner 1961; Vallado 2013, section 12.7). All formulas hold down to GM = 0, a straight
line, and keep their digits where the eccentricity is 1e9: lengths a = GM / v_inf^2, b = |B| and c = sqrt(a^2 + b^2) = a e are
used, never e itself. Any inertial axes, metres, seconds, radians.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import asinh, atan2, cosh, hypot, inf, sinh, sqrt

import numpy as np

from swarm_mj.errors import MissionError
from swarm_mj.smallbody.ephemeris import perifocal_axes
from swarm_mj.typing import Array

#: Newton's method for the hyperbola ends below this relative change.
ANOMALY_TOLERANCE, MAX_STEPS = 1e-15, 200
#: Sine of the angle between asymptote and pole below which the B-plane has no directions.
LEAST_SINE = 1e-9


@dataclass(frozen=True, kw_only=True)
class Hyperbola:
    """A flyby of the body, seen from far away.

    Attributes:
        gm: Gravitational parameter [m^3/s^2], 0 or more.
        v_infinity: Velocity on the incoming asymptote, shape (3,) [m/s].
        B: From the centre to the asymptote, across it, shape (3,) [m].
        closest_approach: Time until it, negative afterwards [s].
    """

    gm: float
    v_infinity: Array
    B: Array
    closest_approach: float

    @classmethod
    def of_components(
        cls, gm: float, v_infinity: Array, pole: Array, b_t_r: tuple[float, float], closest_approach: float
    ) -> Hyperbola:
        """By B.T and B.R [m]; errors as for `b_plane_axes`."""
        T, R = b_plane_axes(v_infinity, pole)
        return cls(gm=gm, v_infinity=v_infinity, B=b_t_r[0] * T + b_t_r[1] * R, closest_approach=closest_approach)

    @property
    def speed(self) -> float:
        """On the asymptote [m/s]."""
        return float(np.linalg.norm(self.v_infinity))

    @property
    def semi_major_axis(self) -> float:
        """Of the hyperbola, as a positive length [m]."""
        return self.gm / self.speed**2

    @property
    def impact_parameter(self) -> float:
        """Length of B [m]."""
        return float(np.linalg.norm(self.B))

    @property
    def focal_distance(self) -> float:
        """From the hyperbola's centre to the body's [m]."""
        return hypot(self.semi_major_axis, self.impact_parameter)

    @property
    def eccentricity(self) -> float:
        """Of the hyperbola; infinite for a straight line."""
        a = self.semi_major_axis
        return self.focal_distance / a if a > 0.0 else inf

    @property
    def periapsis_radius(self) -> float:
        """Least distance from the body's centre [m]."""
        whole = self.semi_major_axis + self.focal_distance
        return self.impact_parameter**2 / whole if whole > 0.0 else 0.0

    @property
    def periapsis_speed(self) -> float:
        """At the closest approach [m/s]; infinite where the hyperbola leads through the centre of a mass."""
        a, b = self.semi_major_axis, self.impact_parameter
        if b == 0.0:
            return inf if a > 0.0 else self.speed
        return self.speed * (a + self.focal_distance) / b

    @property
    def turn_angle(self) -> float:
        """By which the body turns the velocity [rad]."""
        return 2.0 * atan2(self.semi_major_axis, self.impact_parameter)

    def components(self, pole: Array) -> tuple[float, float]:
        """B.T and B.R [m] for a pole; errors as for `b_plane_axes`."""
        T, R = b_plane_axes(self.v_infinity, pole)
        return float(self.B @ T), float(self.B @ R)


@dataclass(frozen=True, kw_only=True)
class ConicElements:
    """An orbit about the body.

    Attributes:
        periapsis_radius: Least distance from the centre [m].
        eccentricity: 0 or more.
        inclination: [rad].
        node: Longitude of the ascending node [rad].
        argument: Of periapsis [rad].
        true_anomaly: At the instant asked for [rad].
    """

    periapsis_radius: float
    eccentricity: float
    inclination: float
    node: float
    argument: float
    true_anomaly: float


def b_plane_axes(v_infinity: Array, pole: Array) -> tuple[Array, Array]:
    """Unit vectors T and R of the B-plane, by the velocity on the incoming asymptote and a pole, each of shape (3,).

    Raises:
        MissionError: The asymptote is parallel to the pole.
    """
    S = v_infinity / np.linalg.norm(v_infinity)
    across = np.cross(S, pole / np.linalg.norm(pole))
    sine = float(np.linalg.norm(across))
    if not sine > LEAST_SINE:
        raise MissionError(
            "the incoming asymptote is parallel to the pole of the B-plane, which then has no directions"
        )
    T = across / sine
    return T, np.cross(S, T)


def state_of_hyperbola(flyby: Hyperbola) -> tuple[Array, Array]:
    """Position [m] and velocity [m/s] at the instant from which the closest approach is counted, each of shape (3,)."""
    V, a, b, c = flyby.speed, flyby.semi_major_axis, flyby.impact_parameter, flyby.focal_distance
    S, t = flyby.v_infinity / V, -flyby.closest_approach
    if c == 0.0:
        return V * t * S, V * S
    B = flyby.B / b if b > 0.0 else _any_across(S)
    P, Q = (a * S + b * B) / c, (b * S - a * B) / c
    least = flyby.periapsis_radius
    H = hyperbolic_anomaly(V * t, least, a)
    x, y = least - 2.0 * a * sinh(0.5 * H) ** 2, b * sinh(H)
    distance = least + 2.0 * c * sinh(0.5 * H) ** 2
    if distance == 0.0:
        raise MissionError("the hyperbola leads through the body's centre at this instant")
    return x * P + y * Q, V / distance * (-a * sinh(H) * P + b * cosh(H) * Q)


def hyperbola_of_state(r: Array, v: Array, gm: float) -> Hyperbola | None:
    """The flyby that a state [m, m/s] belongs to, each of shape (3,), by GM [m^3/s^2], 0 or more; None where it is bound."""
    distance = float(np.linalg.norm(r))
    square = float(v @ v) - 2.0 * gm / distance
    if not square > 0.0:
        return None
    V, h = sqrt(square), np.cross(r, v)
    a, b = gm / square, float(np.linalg.norm(h)) / V
    c = hypot(a, b)
    if b == 0.0:
        S = -r / distance if gm > 0.0 else v / V
        B = np.zeros(3)
    else:
        W = h / np.linalg.norm(h)
        towards = np.cross(v, h) - gm * r / distance
        P = towards / np.linalg.norm(towards)
        S = (a * P + b * np.cross(W, P)) / c
        B = b * np.cross(S, W)
    radial = float(r @ v) / V  # c sinh H
    H = asinh(radial / c) if c > 0.0 else 0.0
    share = b / (a + c) * (b / c) if c > 0.0 else 1.0  # 1 - a / c
    path = radial * share + a * _sinh_less(H)
    return Hyperbola(gm=gm, v_infinity=V * S, B=B, closest_approach=-path / V)


def state_of_elements(elements: ConicElements, gm: float) -> tuple[Array, Array]:
    """Position [m] and velocity [m/s] of an orbit, each of shape (3,); GM above 0.

    Raises:
        MissionError: A hyperbola has no such true anomaly.
    """
    e, nu = elements.eccentricity, elements.true_anomaly
    P, Q = perifocal_axes(elements.inclination, elements.node, elements.argument)
    parameter = elements.periapsis_radius * (1.0 + e)
    width = 1.0 + e * np.cos(nu)
    if not width > 1e-12:
        raise MissionError("beyond the asymptote: 1 + eccentricity * cos(true anomaly) must be above 0")
    r = parameter / width
    speed = sqrt(gm / parameter)
    return r * (np.cos(nu) * P + np.sin(nu) * Q), speed * (-np.sin(nu) * P + (e + np.cos(nu)) * Q)


def elements_of_state(r: Array, v: Array, gm: float) -> ConicElements:
    """The orbit of a state; GM above 0, angles in [0, 2 pi), node and argument 0 where they have no meaning."""
    h, distance = np.cross(r, v), float(np.linalg.norm(r))
    W = h / np.linalg.norm(h)
    towards = np.cross(v, h) / gm - r / distance
    e = float(np.linalg.norm(towards))
    across = hypot(W[0], W[1])
    inclination = atan2(across, W[2])
    N = np.array([-W[1], W[0], 0.0]) / across if across > LEAST_SINE else np.array([1.0, 0.0, 0.0])
    M = np.cross(W, N)
    P = towards / e if e > LEAST_SINE else N
    full = 2.0 * np.pi
    return ConicElements(
        periapsis_radius=float(h @ h) / gm / (1.0 + e),
        eccentricity=e,
        inclination=inclination,
        node=atan2(N[1], N[0]) % full,
        argument=atan2(float(P @ M), float(P @ N)) % full,
        true_anomaly=atan2(float(r @ np.cross(W, P)), float(r @ P)) % full,
    )


def hyperbolic_anomaly(path: float, periapsis_radius: float, semi_major_axis: float) -> float:
    """H of Kepler's equation of a hyperbola, r_p sinh H + a (sinh H - H) = v_inf t.

    Args:
        path: v_inf t, the time since periapsis as a length [m].
        periapsis_radius: r_p [m], 0 or more.
        semi_major_axis: a as a positive length [m], or 0: a straight line; not both 0.
    """
    tau, least, a = abs(path), periapsis_radius, semi_major_axis
    # Where the left side surely is larger; from there Newton's steps only go down, for it rises and is convex.
    bounds = [asinh(tau / least)] if least > 0.0 else []
    if a > 0.0:
        bounds += [(6.0 * tau / a) ** (1.0 / 3.0), max(2.5, asinh(2.0 * tau / a))]
    H = min(bounds)
    for _ in range(MAX_STEPS):
        slope = least * cosh(H) + 2.0 * a * sinh(0.5 * H) ** 2
        if slope == 0.0:
            break
        step = (least * sinh(H) + a * _sinh_less(H) - tau) / slope
        H -= step
        if abs(step) <= ANOMALY_TOLERANCE * H:
            break
    return H if path >= 0.0 else -H


def _sinh_less(H: float) -> float:
    """Difference sinh H - H, without loss of digits."""
    if abs(H) > 0.5:
        return sinh(H) - H
    term, total, square = H**3 / 6.0, 0.0, H * H
    for k in range(4, 22, 2):
        total += term
        term *= square / (k * (k + 1))
    return total


def _any_across(S: Array) -> Array:
    across = np.cross(S, np.eye(3)[np.argmin(np.abs(S))])
    out: Array = across / np.linalg.norm(across)
    return out
