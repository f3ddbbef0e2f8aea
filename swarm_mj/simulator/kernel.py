"""Steps free gyrostats: the closed equations of one rigid body with axial wheels, without MuJoCo.

Within a hold the force is constant, so that position and velocity follow in closed form. The attitude is integrated by the
Runge-Kutta method of fourth order with rotation vectors from each step's start (Munthe-Kaas, BIT Numerical Mathematics 38,
1998), of

    J d omega / dt = tau - sum(a u) - omega x (J omega + sum(a h)),    d h / dt = u,

J without the wheels' spin inertias (`swarm_mj.spacecraft.gyrostat`), tau the applied torque, u what motor and bearing exert on
a wheel about its axis a, h its absolute axial momentum.
"""

from __future__ import annotations

from typing import Any

from swarm_mj.compilation import allocation_free, jittable
from swarm_mj.simulator.slots import Slot
from swarm_mj.spacecraft.attitude.algebra import (
    combine,
    conjugate,
    cross,
    dot,
    half_angle_terms,
    normalised,
    product,
    put_quaternion,
    put_vector,
    quaternion,
    rotate,
    scaled,
    symmetric_inverse,
    transformed,
    vector,
)
from swarm_mj.typing import Array


@allocation_free
def move(r_N: Array, v_N: Array, work: Array, thrust_N: Array, mass: Array, hold: float) -> None:
    """Positions and velocities after a hold.

    Args:
        r_N: Positions, replaced, shape (n, 3) [m].
        v_N: Velocities, replaced, shape (n, 3) [m/s].
        work: Gives A, see `Slot`.
        thrust_N: Shape (n, 3) [N].
        mass: Shape (n,) [kg].
        hold: [s].
    """
    for j in range(r_N.shape[0]):
        a, v = combine(1.0, vector(work[Slot.A], j), 1.0 / mass[j], vector(thrust_N, j)), vector(v_N, j)
        put_vector(r_N, j, combine(1.0, vector(r_N, j), hold, combine(1.0, v, 0.5 * hold, a)))
        put_vector(v_N, j, combine(1.0, v, hold, a))


@allocation_free
def turn_gyrostats(
    q_BN: Array,
    omega_B: Array,
    momentum: Array,
    speed: Array,
    motor: Array,
    torque_N: Array,
    inertia_B: Array,
    axes: Array,
    spin_inertia: float,
    dt: float,
    steps: int,
) -> None:
    """Attitudes, rates and wheels after a hold.

    Args:
        q_BN: Attitudes, replaced, shape (n, 4).
        omega_B: Body rates, replaced, shape (n, 3) [rad/s].
        momentum: Absolute axial momenta of the wheels, replaced, shape (n, w) [kg m^2/s].
        speed: Receives the wheel speeds relative to the hub, shape (n, w) [rad/s].
        motor: On the wheels, shape (n, w) [N m].
        torque_N: Applied to the bodies, shape (n, 3) [N m].
        inertia_B: Wheels locked, shape (n, 3, 3) [kg m^2].
        axes: Of the wheels, rows in B, shape (w, 3).
        spin_inertia: Of a wheel [kg m^2].
        dt: Of one step [s].
        steps: In the hold.
    """
    for j in range(q_BN.shape[0]):
        J = _hub_inertia(inertia_B[j], axes, spin_inertia)
        inverse = symmetric_inverse(J)
        q, omega, tau_N = quaternion(q_BN, j), vector(omega_B, j), vector(torque_N, j)
        h, u = _on_axes(axes, momentum[j]), _on_axes(axes, motor[j])
        for _ in range(steps):
            q, omega = _turn(q, omega, h, u, tau_N, J, inverse, dt)
            h = combine(1.0, h, dt, u)
        put_quaternion(q_BN, j, q)
        put_vector(omega_B, j, omega)
        for w in range(axes.shape[0]):
            momentum[j, w] += steps * dt * motor[j, w]
            carried = axes[w, 0] * omega[0] + axes[w, 1] * omega[1] + axes[w, 2] * omega[2]
            speed[j, w] = momentum[j, w] / spin_inertia - carried


@jittable
def _hub_inertia(inertia_B: Array, axes: Array, spin_inertia: float) -> Any:
    """Inertia without the wheels' spin inertias, a tuple of rows [kg m^2]."""
    xx, yy, zz = inertia_B[0, 0], inertia_B[1, 1], inertia_B[2, 2]
    xy, xz, yz = inertia_B[0, 1], inertia_B[0, 2], inertia_B[1, 2]
    for w in range(axes.shape[0]):
        x, y, z = axes[w, 0], axes[w, 1], axes[w, 2]
        xx, yy, zz = xx - spin_inertia * x * x, yy - spin_inertia * y * y, zz - spin_inertia * z * z
        xy, xz, yz = xy - spin_inertia * x * y, xz - spin_inertia * x * z, yz - spin_inertia * y * z
    return (xx, xy, xz), (xy, yy, yz), (xz, yz, zz)


@jittable
def _on_axes(axes: Array, along: Array) -> Any:
    """Sum of what is along each wheel's axis, in B."""
    x, y, z = 0.0, 0.0, 0.0
    for w in range(axes.shape[0]):
        x, y, z = x + axes[w, 0] * along[w], y + axes[w, 1] * along[w], z + axes[w, 2] * along[w]
    return x, y, z


@jittable
def _turn(q: Any, omega: Any, h: Any, u: Any, tau_N: Any, J: Any, inverse: Any, dt: float) -> Any:
    """One timestep dt [s] of the attitude q_BN and the body rate omega in B [rad/s].

    In B are h, the momentum of the wheels at the start [kg m^2/s], u, its rate, the torque on them [N m], and the inertia J
    [kg m^2], a tuple of rows, with its inverse; tau_N is the torque applied, in N [N m].
    """
    half = 0.5 * dt
    rate1 = omega
    slope1 = _acceleration(omega, h, combine(-1.0, u, 1.0, _in_body(q, omega, 0.0, tau_N)), J, inverse)
    h_half = combine(1.0, h, half, u)
    omega2 = combine(1.0, omega, half, slope1)
    slope2 = _acceleration(omega2, h_half, combine(-1.0, u, 1.0, _in_body(q, rate1, half, tau_N)), J, inverse)
    rate2 = _displacement_rate(scaled(half, rate1), omega2)
    omega3 = combine(1.0, omega, half, slope2)
    slope3 = _acceleration(omega3, h_half, combine(-1.0, u, 1.0, _in_body(q, rate2, half, tau_N)), J, inverse)
    rate3 = _displacement_rate(scaled(half, rate2), omega3)
    omega4 = combine(1.0, omega, dt, slope3)
    torque = combine(-1.0, u, 1.0, _in_body(q, rate3, dt, tau_N))
    slope4 = _acceleration(omega4, combine(1.0, h, dt, u), torque, J, inverse)
    rate4 = _displacement_rate(scaled(dt, rate3), omega4)
    mean_rate, mean_slope = _simpson(rate1, rate2, rate3, rate4), _simpson(slope1, slope2, slope3, slope4)
    return _moved(q, mean_rate, dt), combine(1.0, omega, dt, mean_slope)


@jittable
def _simpson(a: Any, b: Any, c: Any, d: Any) -> Any:
    """Mean of four stages of the Runge-Kutta method."""
    return combine(1.0 / 6.0, combine(1.0, a, 1.0, d), 1.0 / 3.0, combine(1.0, b, 1.0, c))


@jittable
def _in_body(q: Any, rate: Any, dt: float, tau_N: Any) -> Any:
    """A torque in B at a stage that is turned from q by the rotation vector rate dt; nothing is turned for none."""
    if tau_N[0] != 0.0 or tau_N[1] != 0.0 or tau_N[2] != 0.0:
        return rotate(conjugate(_moved(q, rate, dt)), tau_N)
    return tau_N


@jittable
def _acceleration(omega: Any, h: Any, torque: Any, J: Any, inverse: Any) -> Any:
    spin = combine(1.0, transformed(J, omega), 1.0, h)
    return transformed(inverse, combine(1.0, torque, -1.0, cross(omega, spin)))


@jittable
def _displacement_rate(p: Any, omega: Any) -> Any:
    """Rate of a rotation vector p at the body rate omega, up to terms beyond fourth order."""
    a = cross(p, omega)
    return combine(1.0, combine(1.0, omega, 0.5, a), 1.0 / 12.0, cross(p, a))


@jittable
def _moved(q: Any, rate: Any, dt: float) -> Any:
    """The attitude turned by the rotation vector rate dt in B."""
    c, share = half_angle_terms(0.25 * dt * dt * dot(rate, rate), 0.5 * dt)
    return normalised(product(q, (c, share * rate[0], share * rate[1], share * rate[2])))
