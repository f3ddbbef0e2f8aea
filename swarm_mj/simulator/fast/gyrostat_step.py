"""Steps free gyrostats without MuJoCo: the closed equations of one rigid body with axial wheels, by the fast stepper's method.

Within a hold the force is constant, so that position and velocity follow in closed form. The attitude is integrated by the
Runge-Kutta method of fourth order with rotation vectors from each step's start, as in `integrator`, of

    J d omega / dt = tau - sum(a u) - omega x (J omega + sum(a h)),    d h / dt = u,

J without the wheels' spin inertias (`swarm_mj.spacecraft.gyrostat`), diagonal in B. State, forces and masses stand in
MuJoCo's arrays, so that whoever looks at an MjData sees the flight; nothing of MuJoCo is called.
"""

from __future__ import annotations

from typing import Any

from swarm_mj.simulator.fast.mj_memory import MjView
from swarm_mj.spacecraft.attitude.algebra import (
    combine,
    conjugate,
    cross,
    dot,
    half_angle_terms,
    normalised,
    product,
    rotate,
    scaled,
    select_each,
)
from swarm_mj.spacecraft.attitude.lanes import column, number, put_numbers, some, width
from swarm_mj.typing import Array, inlined, jittable


@inlined
def step_gyrostats(mj: MjView, nstep: int) -> None:
    """Integrate `nstep` timesteps of every spacecraft with motor torques and applied forces held."""
    axes, dt = mj.wheel_axes_B, mj.timestep
    hold = nstep * dt
    for j in range(0, mj.qpos.shape[0] // 7, width()):
        p, v, w, hub = 7 * j, 6 * j, 3 * j, mj.first_hub + j
        mass, r, speed = number(mj.body_mass, hub, 1), _three(mj.qpos, p, 7), _three(mj.qvel, v, 6)
        force, tau_N = _columns(mj.xfrc_applied, hub, 0), _columns(mj.xfrc_applied, hub, 3)
        a = (force[0] / mass, force[1] / mass, force[2] / mass)
        put_numbers(mj.qpos, p, 7, combine(1.0, r, hold, combine(1.0, speed, 0.5 * hold, a)))
        put_numbers(mj.qvel, v, 6, combine(1.0, speed, hold, a))
        J, omega = _columns(mj.body_inertia, hub, 0), _three(mj.qvel, v + 3, 6)
        x, y, z = _three(mj.qpos, p + 4, 7)
        q, momenta = (number(mj.qpos, p + 3, 7), x, y, z), _three(mj.act, w, 3)
        motors = (_motor(mj, w), _motor(mj, w + 1), _motor(mj, w + 2))
        h, u = _on_axes(axes, momenta), _on_axes(axes, motors)
        for _ in range(nstep):
            q, omega = _turn(q, omega, h, u, tau_N, J, dt)
            h = combine(1.0, h, dt, u)
        put_numbers(mj.qpos, p + 3, 7, q)
        put_numbers(mj.qvel, v + 3, 6, omega)
        put_numbers(mj.act, w, 3, combine(1.0, momenta, hold, motors))


@jittable
def _three(values: Array, first: int, step: int) -> Any:
    return number(values, first, step), number(values, first + 1, step), number(values, first + 2, step)


@jittable
def _columns(rows: Array, first: int, k: int) -> Any:
    return column(rows, first, 1, k), column(rows, first, 1, k + 1), column(rows, first, 1, k + 2)


@jittable
def _motor(mj: MjView, w: int) -> Any:
    least, most = column(mj.ctrlrange, w, 3, 0), column(mj.ctrlrange, w, 3, 1)
    return min(most, max(least, number(mj.ctrl, w, 3)))


@jittable
def _on_axes(axes: Array, along: Any) -> Any:
    """Sum of what is along each wheel's axis, in B."""
    a, b, c = along
    return (
        axes[0, 0] * a + axes[1, 0] * b + axes[2, 0] * c,
        axes[0, 1] * a + axes[1, 1] * b + axes[2, 1] * c,
        axes[0, 2] * a + axes[1, 2] * b + axes[2, 2] * c,
    )


@jittable
def _turn(q: Any, omega: Any, h: Any, u: Any, tau_N: Any, J: Any, dt: float) -> Any:
    """One timestep of the attitude and the body rate.

    Args:
        q: Attitude q_BN at the start.
        omega: Body rate in B at the start [rad/s].
        h: Momentum of the wheels in B at the start [kg m^2/s].
        u: Its rate, the motors' torque on the wheels [N m].
        tau_N: Torque applied, in N [N m].
        J: Principal moments of inertia about the axes of B [kg m^2].
        dt: [s].
    """
    half = 0.5 * dt
    rate1 = omega
    slope1 = _acceleration(omega, h, combine(-1.0, u, 1.0, _in_body(q, omega, 0.0, tau_N)), J)
    h_half = combine(1.0, h, half, u)
    omega2 = combine(1.0, omega, half, slope1)
    slope2 = _acceleration(omega2, h_half, combine(-1.0, u, 1.0, _in_body(q, rate1, half, tau_N)), J)
    rate2 = _displacement_rate(scaled(half, rate1), omega2)
    omega3 = combine(1.0, omega, half, slope2)
    slope3 = _acceleration(omega3, h_half, combine(-1.0, u, 1.0, _in_body(q, rate2, half, tau_N)), J)
    rate3 = _displacement_rate(scaled(half, rate2), omega3)
    omega4 = combine(1.0, omega, dt, slope3)
    torque = combine(-1.0, u, 1.0, _in_body(q, rate3, dt, tau_N))
    slope4 = _acceleration(omega4, combine(1.0, h, dt, u), torque, J)
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
    acts = (tau_N[0] != 0.0) | (tau_N[1] != 0.0) | (tau_N[2] != 0.0)
    if some(acts):
        return select_each(acts, rotate(conjugate(_moved(q, rate, dt)), tau_N), tau_N)
    return tau_N


@jittable
def _acceleration(omega: Any, h: Any, torque: Any, J: Any) -> Any:
    spin = (J[0] * omega[0] + h[0], J[1] * omega[1] + h[1], J[2] * omega[2] + h[2])
    x, y, z = combine(1.0, torque, -1.0, cross(omega, spin))
    return x / J[0], y / J[1], z / J[2]


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
