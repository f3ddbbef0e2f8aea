"""Guidance: the reference attitude R that keeps +z on a moving line of sight, in inertial components.

One rule fixes the rotation about the line of sight, which pointing leaves free: R is reached by the shortest rotation
from a base attitude. The base is the present body attitude when the target changes, so that no slew is longer than
the pointing needs, and the previous reference afterwards, so that R is carried along without turning about the line of
sight (parallel transport). With the unit vector l on the line of sight this gives

    omega_RN = l x l_dot,    d omega_RN / dt = l x l_ddot.

A second axis of the body may fix that rotation instead, see `roll_references`, and a camera that is mounted otherwise may
take the place of +z, see `swarm_mj.simulator.decide.mount_bases`.

Everything is compiled, loops over spacecraft and writes into arrays of the caller. See docs/theory/attitude_control.md.
"""

from enum import IntEnum
from math import atan2, cos, sin, sqrt
from typing import Final, NamedTuple

import numpy as np

from swarm_mj.compilation import allocation_free, jittable, kernel
from swarm_mj.spacecraft.attitude.algebra import (
    Quaternion,
    Vector,
    combine,
    conjugate,
    cross,
    dot,
    normalised,
    product,
    put_quaternion,
    put_vector,
    quaternion,
    rotate,
    scaled,
    short_mrp,
    vector,
    z_axis,
)
from swarm_mj.typing import Array, Mask

#: Bodies closer than this [m] have no line of sight: spacecraft leave the mothership from one point.
COINCIDENCE_DISTANCE: Final = 1.0
#: Below this |z + l| (0.01 microradian from opposite) the axis of the shortest rotation is taken as undefined.
_OPPOSITE: Final = 1e-8


#: Sine of the angle between line of sight and direction below which the direction says nothing of the second axis: 5.7 deg.
LEAST_SINE: Final = 0.1


class Towards(IntEnum):
    """What a second axis turns to."""

    NOTHING = 0  #: the rotation about the line of sight is the shortest one
    SUN = 1
    EARTH = 2
    VELOCITY = 3  #: of the spacecraft in N
    DIRECTION = 4  #: fixed in N
    ORBIT_NORMAL = 5  #: r x v in N


class Aiming(NamedTuple):
    """How spacecraft are turned to a line of sight, beyond +z on it."""

    q_BC: Array  #: from components in the camera's frame C to components in B (w, x, y, z), shape (4,)
    mounted: bool  #: whether C is another frame than B, so that not +z but the camera looks at the body
    towards: int  #: `Towards` of the second axis
    axis_B: Array  #: the second axis, shape (3,)
    direction_N: Array  #: where towards is DIRECTION, of length 1, shape (3,)


#: +z on the line of sight, by the shortest turn.
PLAIN: Final = Aiming(np.array([1.0, 0.0, 0.0, 0.0]), False, int(Towards.NOTHING), np.zeros(3), np.zeros(3))


class LineOfSight(NamedTuple):
    """From n spacecraft to their targets, in N."""

    rho_N: Array  #: position of the target minus position of the spacecraft [m], shape (n, 3)
    rho_dot_N: Array  #: its first time derivative [m/s], shape (n, 3)
    rho_ddot_N: Array  #: its second time derivative [m/s^2], shape (n, 3)


class Reference(NamedTuple):
    """Reference attitudes R of n spacecraft and their motion."""

    q_RN: Array  #: attitudes (w, x, y, z), shape (n, 4)
    omega_RN_N: Array  #: angular velocities [rad/s], shape (n, 3)
    domega_RN_N: Array  #: their inertial time derivatives [rad/s^2], shape (n, 3)
    los_N: Array  #: unit lines of sight, shape (n, 3)


class TrackingError(NamedTuple):
    """How n bodies miss their references, in body components."""

    sigma_BR: Array  #: attitude errors with |sigma| <= 1, shape (n, 3)
    omega_BR_B: Array  #: rate errors [rad/s], shape (n, 3)
    omega_RN_B: Array  #: reference rates [rad/s], shape (n, 3)
    domega_RN_B: Array  #: inertial derivatives of the reference rates [rad/s^2], shape (n, 3)


@allocation_free
def track_line_of_sight(sight: LineOfSight, q_BN: Array, restart: Mask, reference: Reference) -> None:
    """Carry the references of n spacecraft to the present line of sight.

    A fixed direction is one with zero derivatives. Closer than `COINCIDENCE_DISTANCE` the base attitude is held at zero
    rate and the line of sight is its +z axis. When the line of sight is opposite to the base's +z axis, the shortest
    rotation is taken about the base's x axis.

    Args:
        sight: Where the targets are.
        q_BN: Present body attitudes (w, x, y, z), shape (n, 4); read only where `restart` is set.
        restart: Whether the target is new, so that the body attitude becomes the base, shape (n,).
        reference: Holds the previous attitudes, which are replaced by the present ones, and receives the rest.
    """
    for i in range(q_BN.shape[0]):
        base = quaternion(q_BN, i) if restart[i] else quaternion(reference.q_RN, i)
        rho, rho_dot, rho_ddot = vector(sight.rho_N, i), vector(sight.rho_dot_N, i), vector(sight.rho_ddot_N, i)
        q, omega, domega, los = _carried(normalised(base), rho, rho_dot, rho_ddot)
        put_quaternion(reference.q_RN, i, q)
        put_vector(reference.omega_RN_N, i, omega)
        put_vector(reference.domega_RN_N, i, domega)
        put_vector(reference.los_N, i, los)


@allocation_free
def roll_references(
    aiming: Aiming,
    sun_N: Array,
    earth_N: Array,
    r_N: Array,
    v_N: Array,
    a_N: Array,
    sight: LineOfSight,
    reference: Reference,
) -> None:
    """Turn references about their lines of sight, so that the second axis lies as near to its direction as it can.

    With the unit vector d along that direction, s = |d - (d.l) l|, y = (d - (d.l) l) / s and x = y x l, the part of the second
    axis across l lies on y, and the reference turns about l at omega.l = ((d.l) (l_dot.x) - d_dot.x) / s. Where s is below
    `LEAST_SINE`, the direction says nothing, and the reference is carried on as without a second axis. The turns of the
    directions to Sun and Earth (1e-7 rad/s) are left out of the rate.

    Args:
        aiming: Axis and direction.
        sun_N: Position of the Sun relative to the body, shape (3,) [m].
        earth_N: The same of Earth.
        r_N: Positions, shape (n, 3) [m].
        v_N: Velocities, shape (n, 3) [m/s].
        a_N: Accelerations, shape (n, 3) [m/s^2].
        sight: Where the targets are.
        reference: Is turned.
    """
    none = (0.0, 0.0, 0.0)
    for i in range(v_N.shape[0]):
        rho = vector(sight.rho_N, i)
        if dot(rho, rho) < COINCIDENCE_DISTANCE * COINCIDENCE_DISTANCE:
            continue
        d, d_dot = (aiming.direction_N[0], aiming.direction_N[1], aiming.direction_N[2]), none
        if aiming.towards == Towards.SUN:
            d = sun_N[0], sun_N[1], sun_N[2]
        elif aiming.towards == Towards.EARTH:
            d = earth_N[0], earth_N[1], earth_N[2]
        elif aiming.towards == Towards.VELOCITY:
            d, d_dot = vector(v_N, i), vector(a_N, i)
        elif aiming.towards == Towards.ORBIT_NORMAL:  # which a central force leaves where it is
            d = cross(vector(r_N, i), vector(v_N, i))
        length = sqrt(dot(d, d))
        if length == 0.0:
            continue
        d = scaled(1.0 / length, d)
        d_dot = scaled(1.0 / length, combine(1.0, d_dot, -dot(d_dot, d), d))
        q, los = quaternion(reference.q_RN, i), vector(reference.los_N, i)
        axis_B = aiming.axis_B[0], aiming.axis_B[1], aiming.axis_B[2]
        omega, domega = vector(reference.omega_RN_N, i), vector(reference.domega_RN_N, i)
        q, omega, domega = _rolled(q, omega, domega, los, rotate(q, axis_B), d, d_dot)
        put_quaternion(reference.q_RN, i, q)
        put_vector(reference.omega_RN_N, i, omega)
        put_vector(reference.domega_RN_N, i, domega)


@jittable
def _rolled(
    q: Quaternion, omega: Vector, domega: Vector, los: Vector, axis: Vector, d: Vector, d_dot: Vector
) -> tuple[Quaternion, Vector, Vector]:
    """A reference without rate about the line of sight, turned about it: `axis` towards d, both in N, see `roll_references`."""
    c = dot(d, los)
    across = combine(1.0, d, -c, los)
    s = sqrt(dot(across, across))
    if s < LEAST_SINE:
        return q, omega, domega
    y = scaled(1.0 / s, across)
    x = cross(y, los)
    half = 0.5 * atan2(-dot(axis, x), dot(axis, y))
    turned = normalised(product((cos(half), -sin(half) * los[0], -sin(half) * los[1], -sin(half) * los[2]), q))
    los_dot, los_ddot = cross(omega, los), cross(domega, los)  # the latter less its part along los
    g, c_dot = dot(los_dot, x), dot(d_dot, los) + dot(d, los_dot)
    rate = (c * g - dot(d_dot, x)) / s
    whole = combine(1.0, omega, rate, los)
    g_dot = dot(los_ddot, x) + dot(los_dot, cross(whole, x))
    s_dot = -c * c_dot / s
    rate_dot = (c_dot * g + c * g_dot) / s - rate * s_dot / s
    change = combine(rate_dot, los, rate, los_dot)
    return turned, whole, combine(1.0, domega, 1.0, change)


@allocation_free
def attitude_error(q_BN: Array, omega_BN_B: Array, reference: Reference, error: TrackingError) -> None:
    """Compare n bodies with their references.

    Args:
        q_BN: Body attitudes (w, x, y, z), shape (n, 4).
        omega_BN_B: Body rates in B [rad/s], shape (n, 3).
        reference: What they should be.
        error: Receives how they differ.
    """
    for i in range(q_BN.shape[0]):
        q_B = quaternion(q_BN, i)
        q_NB = conjugate(q_B)
        omega_RN = rotate(q_NB, vector(reference.omega_RN_N, i))
        put_vector(error.sigma_BR, i, short_mrp(product(conjugate(quaternion(reference.q_RN, i)), q_B)))
        put_vector(error.omega_RN_B, i, omega_RN)
        put_vector(error.omega_BR_B, i, combine(1.0, vector(omega_BN_B, i), -1.0, omega_RN))
        put_vector(error.domega_RN_B, i, rotate(q_NB, vector(reference.domega_RN_N, i)))


@kernel
def pointing_error(q_BN: Array, los_N: Array) -> Array:
    """Return the angle between +z and the line of sight [rad], shape (n,), exact to rounding at 0 and pi too.

    Args:
        q_BN: Body attitudes (w, x, y, z), shape (n, 4).
        los_N: Unit lines of sight in N, shape (n, 3).
    """
    angle = np.empty(q_BN.shape[0])
    for i in range(q_BN.shape[0]):
        z, los = z_axis(quaternion(q_BN, i)), vector(los_N, i)
        sine = cross(z, los)
        angle[i] = atan2(sqrt(dot(sine, sine)), dot(z, los))
    return angle


@jittable
def _carried(
    base: Quaternion, rho: Vector, rho_dot: Vector, rho_ddot: Vector
) -> tuple[Quaternion, Vector, Vector, Vector]:
    """Attitude, rate, its derivative and line of sight of a reference that is carried on from a unit quaternion."""
    distance = sqrt(dot(rho, rho))
    if distance < COINCIDENCE_DISTANCE:
        return base, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), z_axis(base)
    los = (rho[0] / distance, rho[1] / distance, rho[2] / distance)
    # The first turn is ill-conditioned when it is near half a turn; the second takes out what rounding left.
    q = _shortest_to(los, _shortest_to(los, base))
    omega, domega = _sight_rates(los, distance, rho_dot, rho_ddot)
    return q, omega, domega, los


@jittable
def _shortest_to(los: Vector, q: Quaternion) -> Quaternion:
    """Return the attitude with +z on the line of sight that is closest to the unit quaternion q."""
    z = z_axis(q)
    half = combine(1.0, z, 1.0, los)
    if dot(half, half) < _OPPOSITE * _OPPOSITE:
        # Half a turn about the attitude's own x axis; what then remains is tiny and well defined.
        q = (-q[1], q[0], q[3], -q[2])
        z = scaled(-1.0, z)
        half = combine(1.0, z, 1.0, los)
    half = scaled(1.0 / sqrt(dot(half, half)), half)
    # The rotation from z to a direction, with the unit vector h halfway between them, is the quaternion (z.h, z x h).
    axis = cross(z, half)
    return normalised(product((dot(z, half), axis[0], axis[1], axis[2]), q))


@jittable
def _sight_rates(los: Vector, distance: float, rho_dot: Vector, rho_ddot: Vector) -> tuple[Vector, Vector]:
    """Return omega = l x rho_dot / r and its derivative l x l_ddot = (l x rho_ddot - 2 r_dot omega) / r."""
    omega = scaled(1.0 / distance, cross(los, rho_dot))
    closing = dot(los, rho_dot)
    domega = combine(1.0 / distance, cross(los, rho_ddot), -2.0 * closing / distance, omega)
    return omega, domega
