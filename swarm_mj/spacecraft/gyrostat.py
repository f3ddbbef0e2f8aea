"""Wheels as momentum states: three numbers per spacecraft instead of three bodies.

A wheel's state is its absolute axial momentum h = J (Omega + a . omega_BN_B) [kg m^2/s]: Omega the speed relative to the hub, a
the axis, J the spin inertia. A motor torque u alone changes it, dh/dt = u, which is MuJoCo's integrator activation. The body
carries the mass and inertia of hub and wheels, less the spin inertias, and feels the torque -(sum a u) - omega x (sum a h):
the equations of Schaub and Junkins, Analytical Mechanics of Space Systems, section 4.5.
"""

from __future__ import annotations

from swarm_mj.typing import Array, lean

#: qpos and qvel of one spacecraft without wheel joints: a free joint.
NQ_FREE, NV_FREE = 7, 6


@lean
def with_wheels(
    qpos: Array, qvel: Array, momentum: Array, spin_inertia: float, axes: Array, qpos_wheels: Array, qvel_wheels: Array
) -> None:
    """Lay a gyrostat's state out as if its wheels were joints.

    Args:
        qpos: MuJoCo's positions, shape (7 n,).
        qvel: MuJoCo's velocities, shape (6 n,).
        momentum: Absolute axial momenta of the wheels, shape (3 n,) [kg m^2/s].
        spin_inertia: Of a wheel [kg m^2].
        axes: Rows, in B, shape (3, 3).
        qpos_wheels: Receives position, quaternion and three wheel angles, shape (10 n,). The angles are no state: zero.
        qvel_wheels: Receives velocity, body rate and three wheel speeds relative to the hub, shape (9 n,).
    """
    for j in range(qpos.shape[0] // NQ_FREE):
        p, v = NQ_FREE * j, NV_FREE * j
        for k in range(NQ_FREE):
            qpos_wheels[10 * j + k] = qpos[p + k]
        for k in range(NV_FREE):
            qvel_wheels[9 * j + k] = qvel[v + k]
        for w in range(3):
            carried = axes[w, 0] * qvel[v + 3] + axes[w, 1] * qvel[v + 4] + axes[w, 2] * qvel[v + 5]
            qpos_wheels[10 * j + 7 + w] = 0.0
            qvel_wheels[9 * j + 6 + w] = momentum[3 * j + w] / spin_inertia - carried


def axial_momentum(omega_BN_B: Array, wheel_speed: Array, spin_inertia: float, axes: Array) -> Array:
    """Absolute axial momenta of the wheels.

    Args:
        omega_BN_B: Body rates, shape (n, 3) [rad/s].
        wheel_speed: Relative to the hub, shape (n, 3) [rad/s].
        spin_inertia: Of a wheel [kg m^2].
        axes: Rows, in B, shape (3, 3).

    Returns:
        Shape (n, 3) [kg m^2/s].
    """
    return spin_inertia * (wheel_speed + omega_BN_B @ axes.T)
