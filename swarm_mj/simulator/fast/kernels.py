"""The arithmetic of a decision, compiled: state, gravity, guidance and wheels, in frames N and B, SI.

The same kernels serve the Python loop, which calls them one by one, and `flight_kernels`, which flies whole stretches. Per
spacecraft j with w wheels: qpos[(7 + w) j:] = position, quaternion (w, x, y, z), wheel angles; qvel[(6 + w) j:] = velocity in
N, body rate in B, wheel speeds. `work` holds the loop's vectors, shape (len(Slot), n, 3), so that a call passes one array.
"""

from __future__ import annotations

from math import cos, sin
from typing import Any

import numpy as np

from swarm_mj.mission.behaviors import TargetKind
from swarm_mj.simulator.slots import Slot
from swarm_mj.smallbody.perturbations import gradient_torque_on
from swarm_mj.smallbody.rotation import write_spin_dcm
from swarm_mj.spacecraft.attitude.algebra import conjugate, put_vector, quaternion, rotate, vector, vectors
from swarm_mj.spacecraft.attitude.guidance import (
    LineOfSight,
    Reference,
    TrackingError,
    attitude_error,
    track_line_of_sight,
)
from swarm_mj.spacecraft.attitude.lanes import put_columns, put_numbers, select, width
from swarm_mj.typing import Array, Ints, Mask, jittable, kernel, lean


@lean
def turn_frames(C_PN: Array, phase: float, half_turn: float, C_AN: Array, C_mid: Array) -> None:
    """Write the rotations from N to A, now and at the middle of the hold.

    Args:
        C_PN: Rotation from N to the pole frame, shape (3, 3).
        phase: Prime meridian angle now [rad].
        half_turn: What the body turns in half the hold [rad].
        C_AN: Receives the rotation now, shape (3, 3).
        C_mid: Receives the one at the middle of the hold, shape (3, 3).
    """
    write_spin_dcm(C_PN, phase, C_AN)
    write_spin_dcm(C_PN, phase + half_turn, C_mid)


@lean
def read_state(
    qpos: Array,
    qvel: Array,
    C_mid: Array,
    half_hold: float,
    wheel_inertia: float,
    wheel_axes_B: Array,
    q_BN: Array,
    work: Array,
) -> bool:
    """Read the state, the momentum of the wheels, and where gravity is to be evaluated.

    Args:
        qpos: Positions, attitudes and wheel angles, shape (n (7 + w),).
        qvel: Velocities, body rates and wheel speeds, shape (n (6 + w),).
        C_mid: Rotation from N to A at the middle of the hold, shape (3, 3).
        half_hold: Half the control period [s].
        wheel_inertia: Spin inertia of a wheel [kg m^2].
        wheel_axes_B: Rows, shape (w, 3).
        q_BN: Receives the attitudes, shape (n, 4).
        work: Receives R, V, OMEGA, WHEEL (of the first three wheels), MOMENTUM and R_A, see `Slot`.

    Returns:
        Whether every number is finite.
    """
    # Several sums, so that none waits for the other; each is finite if everything in it is.
    turned, placed, moving, total, wheels = 0.0, 0.0, 0.0, 0.0, wheel_axes_B.shape[0]
    for j in range(q_BN.shape[0]):
        p, v = (7 + wheels) * j, (6 + wheels) * j
        for k in range(4):
            q_BN[j, k] = qpos[p + 3 + k]
            turned += qpos[p + 3 + k]
        for k in range(3):
            work[Slot.R, j, k] = qpos[p + k]
            work[Slot.V, j, k] = qvel[v + k]
            work[Slot.OMEGA, j, k] = qvel[v + 3 + k]
            work[Slot.WHEEL, j, k] = qvel[v + 6 + k]
            placed += qpos[p + k]
            moving += qvel[v + k]
            total += qvel[v + 3 + k] + qvel[v + 6 + k]
        for k in range(3):
            work[Slot.R_A, j, k] = (
                C_mid[k, 0] * (qpos[p] + half_hold * qvel[v])
                + C_mid[k, 1] * (qpos[p + 1] + half_hold * qvel[v + 1])
                + C_mid[k, 2] * (qpos[p + 2] + half_hold * qvel[v + 2])
            )
            momentum = 0.0
            for w in range(wheels):
                momentum += wheel_axes_B[w, k] * qvel[v + 6 + w]
            work[Slot.MOMENTUM, j, k] = wheel_inertia * momentum
        for w in range(3, wheels):
            total += qvel[v + 6 + w]
    return np.isfinite(turned + placed + moving + total)


@lean
def hold_gravity(a_A: Array, C_mid: Array, mass: float, hub: Ints, xfrc: Array, work: Array) -> None:
    """Turn accelerations from A to N and hold them as forces at the centres of mass.

    Args:
        a_A: Accelerations in A, shape (n, 3) [m/s^2].
        C_mid: Rotation from N to A at the time of `a_A`.
        mass: Of one spacecraft [kg].
        hub: Body ids of the hubs, shape (n,).
        xfrc: MuJoCo's `xfrc_applied`; force and torque in N.
        work: See `Slot`.
    """
    for j in range(hub.shape[0]):
        for k in range(3):
            a = C_mid[0, k] * a_A[j, 0] + C_mid[1, k] * a_A[j, 1] + C_mid[2, k] * a_A[j, 2]
            work[Slot.A, j, k] = a
            xfrc[hub[j], k] = mass * a


@lean
def weigh(mass_ratio: Array, hub: Ints, xfrc: Array) -> None:
    """Let gravity pull with the true masses instead of the planned ones: (n,) true over planned; see `hold_gravity`."""
    for j in range(hub.shape[0]):
        for k in range(3):
            xfrc[hub[j], k] *= mass_ratio[j]


@lean
def mark_new_targets(kind: Ints, spacecraft: Ints, last_kind: Ints, last_spacecraft: Ints, restart: Mask) -> bool:
    """Tell whose target is another one than at the decision before.

    Args:
        kind: `TargetKind` values, shape (n,).
        spacecraft: Spacecraft to follow, shape (n,).
        last_kind: The kinds of the decision before, replaced by the present ones, shape (n,).
        last_spacecraft: The same of the spacecraft.
        restart: Receives the answer, shape (n,).

    Returns:
        Whether the targets make sense: known kinds, and spacecraft that exist.
    """
    n = kind.shape[0]
    for j in range(n):
        if not 0 <= kind[j] <= TargetKind.DIRECTION:
            return False
        if kind[j] == TargetKind.SPACECRAFT and not 0 <= spacecraft[j] < n:
            return False
        restart[j] = kind[j] != last_kind[j] or spacecraft[j] != last_spacecraft[j]
        last_kind[j], last_spacecraft[j] = kind[j], spacecraft[j]
    return True


@lean
def locate_targets(
    kind: Ints,
    spacecraft: Ints,
    vector: Array,
    earth_N: Array,
    earth_velocity_N: Array,
    spin_N: Array,
    C_AN: Array,
    work: Array,
) -> None:
    """From targets to lines of sight and their derivatives.

    Args:
        kind: `TargetKind` values, shape (n,).
        spacecraft: Spacecraft to follow, shape (n,).
        vector: Surface point in A [m] or direction in N, shape (n, 3).
        earth_N: Position of Earth relative to the body in N, shape (3,) [m].
        earth_velocity_N: Its velocity, shape (3,) [m/s].
        spin_N: Angular velocity of A in N, shape (3,) [rad/s].
        C_AN: Rotation from N to A.
        work: Gives R, V and A, receives RHO, RHO_DOT and RHO_DDOT, see `Slot`.
    """
    for j in range(kind.shape[0]):
        for k in range(3):
            work[Slot.RHO, j, k] = -work[Slot.R, j, k]
            work[Slot.RHO_DOT, j, k] = -work[Slot.V, j, k]
            work[Slot.RHO_DDOT, j, k] = -work[Slot.A, j, k]
        if kind[j] == TargetKind.SPACECRAFT:
            for k in range(3):
                work[Slot.RHO, j, k] += work[Slot.R, spacecraft[j], k]
                work[Slot.RHO_DOT, j, k] += work[Slot.V, spacecraft[j], k]
                work[Slot.RHO_DDOT, j, k] += work[Slot.A, spacecraft[j], k]
        elif kind[j] == TargetKind.EARTH:
            for k in range(3):
                work[Slot.RHO, j, k] += earth_N[k]
                work[Slot.RHO_DOT, j, k] += earth_velocity_N[k]
        elif kind[j] == TargetKind.SURFACE:
            _add_surface_point(vector[j], C_AN, spin_N, work, j)
        elif kind[j] == TargetKind.DIRECTION:
            for k in range(3):
                # Far enough that the coincidence rule never applies; the length of a direction does not matter.
                work[Slot.RHO, j, k] = 1e9 * vector[j, k]
                work[Slot.RHO_DOT, j, k] = 0.0
                work[Slot.RHO_DDOT, j, k] = 0.0


@jittable
def _add_surface_point(point_A: Array, C_AN: Array, w: Array, work: Array, j: int) -> None:
    x = C_AN[0, 0] * point_A[0] + C_AN[1, 0] * point_A[1] + C_AN[2, 0] * point_A[2]
    y = C_AN[0, 1] * point_A[0] + C_AN[1, 1] * point_A[1] + C_AN[2, 1] * point_A[2]
    z = C_AN[0, 2] * point_A[0] + C_AN[1, 2] * point_A[1] + C_AN[2, 2] * point_A[2]
    vx, vy, vz = w[1] * z - w[2] * y, w[2] * x - w[0] * z, w[0] * y - w[1] * x
    work[Slot.RHO, j, 0] += x
    work[Slot.RHO, j, 1] += y
    work[Slot.RHO, j, 2] += z
    work[Slot.RHO_DOT, j, 0] += vx
    work[Slot.RHO_DOT, j, 1] += vy
    work[Slot.RHO_DOT, j, 2] += vz
    work[Slot.RHO_DDOT, j, 0] += w[1] * vz - w[2] * vy
    work[Slot.RHO_DDOT, j, 1] += w[2] * vx - w[0] * vz
    work[Slot.RHO_DDOT, j, 2] += w[0] * vy - w[1] * vx


@lean
def guide(q_BN: Array, restart: Mask, q_RN: Array, work: Array) -> None:
    """From lines of sight to references and tracking errors.

    Args:
        q_BN: Attitudes, shape (n, 4).
        restart: Whose target is new, shape (n,).
        q_RN: Reference attitudes, replaced by the present ones, shape (n, 4).
        work: Gives the lines of sight and body rates, receives references and errors, see `Slot`.
    """
    sight = LineOfSight(work[Slot.RHO], work[Slot.RHO_DOT], work[Slot.RHO_DDOT])
    reference = Reference(q_RN, work[Slot.OMEGA_R], work[Slot.DOMEGA_R], work[Slot.LOS])
    error = TrackingError(work[Slot.SIGMA_BR], work[Slot.OMEGA_BR], work[Slot.OMEGA_R_B], work[Slot.DOMEGA_R_B])
    track_line_of_sight(sight, q_BN, restart, reference)
    attitude_error(q_BN, work[Slot.OMEGA], reference, error)


@lean
def actuate(
    torque_B: Array,
    allocation: Array,
    speed_gain: float,
    max_torque: float,
    max_speed: float,
    work: Array,
    ctrl: Array,
    peaks: Array,
) -> None:
    """Turn body torques into motor torques within the wheels' limits.

    Args:
        torque_B: Torque that the wheels shall exert on the body, shape (n, 3) [N m].
        allocation: Maps a body torque to motor torques: minus the pseudo-inverse of the axes, shape (3, 3).
        speed_gain: Change of wheel speed in one hold per motor torque [rad/s per N m].
        max_torque: [N m].
        max_speed: [rad/s].
        work: See `Slot`.
        ctrl: Receives the motor torques, shape (3 n,) [N m].
        peaks: Brought up to date, see `Peak`, shape (n, 3).
    """
    for j in range(0, torque_B.shape[0], width()):
        L, speed = vectors(torque_B, j), vectors(work[Slot.WHEEL], j)
        asked = (_motor_of(allocation, 0, L), _motor_of(allocation, 1, L), _motor_of(allocation, 2, L))
        u0 = _within(asked[0], speed[0], speed_gain, max_torque, max_speed)
        u1 = _within(asked[1], speed[1], speed_gain, max_torque, max_speed)
        u2 = _within(asked[2], speed[2], speed_gain, max_torque, max_speed)
        put_numbers(ctrl, 3 * j, 3, (u0, u1, u2))
        fastest, strongest, holds = vectors(peaks, j)  # in the order of `Peak`
        fastest = max(max(max(fastest, abs(speed[0])), abs(speed[1])), abs(speed[2]))
        strongest = max(max(max(strongest, abs(u0)), abs(u1)), abs(u2))
        cut = (u0 != asked[0]) | (u1 != asked[1]) | (u2 != asked[2])
        put_columns(peaks, j, 1, (fastest, strongest, select(cut, holds + 1.0, holds)))


@jittable
def _motor_of(allocation: Array, w: int, torque_B: Any) -> Any:
    return allocation[w, 0] * torque_B[0] + allocation[w, 1] * torque_B[1] + allocation[w, 2] * torque_B[2]


@jittable
def _within(u: Any, speed: Any, speed_gain: float, max_torque: float, max_speed: float) -> Any:
    """A motor torque within the limits; one that would carry the wheel past its top speed in the hold just reaches it."""
    u = min(max_torque, max(-max_torque, u))
    return min(max(0.0, (max_speed - speed) / speed_gain), max(min(0.0, (-max_speed - speed) / speed_gain), u))


@kernel
def hold_gravity_gradient(
    q_BN: Array, gm: float, inertia: Array, C_mid: Array, hub: Ints, xfrc: Array, work: Array
) -> None:
    """Hold the gravity-gradient torque of the central field.

    Args:
        q_BN: Attitudes, shape (n, 4).
        gm: Gravitational parameter of the body [m^3/s^2].
        inertia: Of every spacecraft in B, shape (n, 3, 3) [kg m^2].
        C_mid: Rotation from N to A at the middle of the hold.
        hub: Body ids of the hubs, shape (n,).
        xfrc: MuJoCo's `xfrc_applied`; force and torque in N.
        work: See `Slot`.
    """
    for j in range(hub.shape[0]):
        x, y, z = vector(work[Slot.R_A], j)
        r_N = (
            C_mid[0, 0] * x + C_mid[1, 0] * y + C_mid[2, 0] * z,
            C_mid[0, 1] * x + C_mid[1, 1] * y + C_mid[2, 1] * z,
            C_mid[0, 2] * x + C_mid[1, 2] * y + C_mid[2, 2] * z,
        )
        q = quaternion(q_BN, j)
        torque_B = gradient_torque_on(rotate(conjugate(q), r_N), inertia[j], gm)
        put_vector(xfrc[:, 3:], hub[j], rotate(q, torque_B))


@lean
def write_body_quaternion(q_P: Array, phase: float, mocap_quat: Array) -> None:
    """Write the attitude of A, the pole frame turned by `phase` [rad] about z, as MuJoCo's quaternion."""
    c, s = cos(0.5 * phase), sin(0.5 * phase)
    mocap_quat[0] = q_P[0] * c - q_P[3] * s
    mocap_quat[1] = q_P[1] * c + q_P[2] * s
    mocap_quat[2] = q_P[2] * c - q_P[1] * s
    mocap_quat[3] = q_P[3] * c + q_P[0] * s
