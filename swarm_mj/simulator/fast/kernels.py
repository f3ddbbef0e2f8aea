"""Compiled inner arithmetic of the loop, on MuJoCo's own arrays. Frame N and B, SI.

Per spacecraft j: qpos[10 j:] = position, quaternion (w, x, y, z), three wheel angles; qvel[9 j:] = velocity in N, body rate
in B, three wheel speeds. `work` holds the loop's vectors, shape (len(Slot), n, 3), so that a call passes one array.
"""

from __future__ import annotations

from enum import IntEnum
from math import cos, sin

import numpy as np
from numpy.typing import NDArray

from swarm_mj.smallbody.perturbations import gravity_gradient_torque
from swarm_mj.smallbody.rotation import write_spin_dcm
from swarm_mj.spacecraft.attitude.algebra import put_vector, quaternion, rotate, vector
from swarm_mj.spacecraft.attitude.guidance import attitude_error, track_line_of_sight
from swarm_mj.spacecraft.model import NQ, NV
from swarm_mj.typing import Array, Ints, Mask, kernel


class Slot(IntEnum):
    """Rows of the loop's work array, each (n, 3)."""

    R = 0  #: position in N [m]
    V = 1  #: velocity in N [m/s]
    A = 2  #: acceleration in N [m/s^2]
    R_A = 3  #: position in A at the middle of the hold [m]
    OMEGA = 4  #: body rate in B [rad/s]
    WHEEL = 5  #: wheel speeds relative to the hub [rad/s]
    MOMENTUM = 6  #: wheel momentum relative to the hub in B [kg m^2/s]
    RHO = 7  #: target minus spacecraft in N [m]
    RHO_DOT = 8
    RHO_DDOT = 9
    OMEGA_R = 10  #: reference rate in N [rad/s]
    DOMEGA_R = 11  #: its derivative in N [rad/s^2]
    LOS = 12  #: unit line of sight in N
    SIGMA_BR = 13  #: attitude error
    OMEGA_BR = 14  #: rate error in B [rad/s]
    OMEGA_R_B = 15  #: reference rate in B [rad/s]
    DOMEGA_R_B = 16  #: its inertial derivative in B [rad/s^2]


# Numba folds plain integers into the machine code; members of an IntEnum it looks up.
_R, _V, _A, _R_A, _OMEGA, _WHEEL, _MOMENTUM = (int(Slot[k]) for k in "R V A R_A OMEGA WHEEL MOMENTUM".split())
_RHO, _RHO_DOT, _RHO_DDOT = int(Slot.RHO), int(Slot.RHO_DOT), int(Slot.RHO_DDOT)
_OMEGA_R, _DOMEGA_R, _LOS = int(Slot.OMEGA_R), int(Slot.DOMEGA_R), int(Slot.LOS)
_SIGMA_BR, _OMEGA_BR = int(Slot.SIGMA_BR), int(Slot.OMEGA_BR)
_OMEGA_R_B, _DOMEGA_R_B = int(Slot.OMEGA_R_B), int(Slot.DOMEGA_R_B)


@kernel
def sense(
    qpos: Array,
    qvel: Array,
    C_PN: Array,
    phase: float,
    half_turn: float,
    half_hold: float,
    wheel_inertia: float,
    wheel_axes: Array,
    work: Array,
    q_BN: Array,
    C_AN: Array,
    C_mid: Array,
) -> bool:
    """Read the state, the body frame now and at the middle of the hold, and where gravity is to be evaluated there.

    Args:
        qpos: MuJoCo's positions.
        qvel: MuJoCo's velocities.
        C_PN: Rotation from N to the pole frame.
        phase: Prime meridian angle now [rad].
        half_turn: What the body turns in half the hold [rad].
        half_hold: Half the control period [s].
        wheel_inertia: Spin inertia of a wheel [kg m^2].
        wheel_axes: Rows, in B, shape (3, 3).
        work: See `Slot`.
        q_BN: Receives the attitudes, shape (n, 4).
        C_AN: Receives the rotation from N to A now, shape (3, 3).
        C_mid: Receives the same at the middle of the hold, shape (3, 3).

    Returns:
        Whether every number is finite.
    """
    write_spin_dcm(C_PN, phase, C_AN)
    write_spin_dcm(C_PN, phase + half_turn, C_mid)
    total = 0.0
    for j in range(q_BN.shape[0]):
        p, v = NQ * j, NV * j
        for k in range(4):
            q_BN[j, k] = qpos[p + 3 + k]
            total += qpos[p + 3 + k]
        for k in range(3):
            work[_R, j, k] = qpos[p + k]
            work[_V, j, k] = qvel[v + k]
            work[_OMEGA, j, k] = qvel[v + 3 + k]
            work[_WHEEL, j, k] = qvel[v + 6 + k]
            total += qpos[p + k] + qvel[v + k] + qvel[v + 3 + k] + qvel[v + 6 + k]
        for k in range(3):
            work[_R_A, j, k] = (
                C_mid[k, 0] * (qpos[p] + half_hold * qvel[v])
                + C_mid[k, 1] * (qpos[p + 1] + half_hold * qvel[v + 1])
                + C_mid[k, 2] * (qpos[p + 2] + half_hold * qvel[v + 2])
            )
            work[_MOMENTUM, j, k] = wheel_inertia * (
                wheel_axes[0, k] * qvel[v + 6] + wheel_axes[1, k] * qvel[v + 7] + wheel_axes[2, k] * qvel[v + 8]
            )
    return np.isfinite(total)


@kernel
def push(a_A: Array, C_mid: Array, mass: float, hub: Ints, xfrc: Array, work: Array) -> None:
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
            work[_A, j, k] = a
            xfrc[hub[j], k] = mass * a


@kernel
def guide(
    kind: Ints,
    index: Ints,
    vector: Array,
    earth: Array,
    earth_velocity: Array,
    spin_N: Array,
    C_AN: Array,
    q_BN: Array,
    aim: Ints,
    restart: Mask,
    q_RN: Array,
    work: Array,
) -> bool:
    """From targets to references and tracking errors.

    Args:
        kind: `TargetKind` values, shape (n,).
        index: Spacecraft to follow, shape (n,).
        vector: Surface point in A [m] or direction in N, shape (n, 3).
        earth: Position of Earth relative to the body in N, shape (3,) [m].
        earth_velocity: Its velocity, shape (3,) [m/s].
        spin_N: Angular velocity of A in N, shape (3,) [rad/s].
        C_AN: Rotation from N to A.
        q_BN: Attitudes, shape (n, 4).
        aim: The previous instant's kind and index, replaced by the present ones, shape (2, n).
        restart: Scratch, shape (n,).
        q_RN: Reference attitudes, replaced by the present ones, shape (n, 4).
        work: See `Slot`.

    Returns:
        Whether the targets make sense: known kinds, and spacecraft that exist.
    """
    for j in range(kind.shape[0]):
        if not 0 <= kind[j] <= 4 or (kind[j] == 1 and not 0 <= index[j] < kind.shape[0]):
            return False
        restart[j] = kind[j] != aim[0, j] or index[j] != aim[1, j]
        aim[0, j], aim[1, j] = kind[j], index[j]
        for k in range(3):
            work[_RHO, j, k] = -work[_R, j, k]
            work[_RHO_DOT, j, k] = -work[_V, j, k]
            work[_RHO_DDOT, j, k] = -work[_A, j, k]
        if kind[j] == 1:
            for k in range(3):
                work[_RHO, j, k] += work[_R, index[j], k]
                work[_RHO_DOT, j, k] += work[_V, index[j], k]
                work[_RHO_DDOT, j, k] += work[_A, index[j], k]
        elif kind[j] == 2:
            for k in range(3):
                work[_RHO, j, k] += earth[k]
                work[_RHO_DOT, j, k] += earth_velocity[k]
        elif kind[j] == 3:
            _add_surface_point(vector[j], C_AN, spin_N, work, j)
        elif kind[j] == 4:
            for k in range(3):
                # Far enough that the coincidence rule never applies; the length of a direction does not matter.
                work[_RHO, j, k] = 1e9 * vector[j, k]
                work[_RHO_DOT, j, k] = 0.0
                work[_RHO_DDOT, j, k] = 0.0
    track_line_of_sight(
        work[_RHO], work[_RHO_DOT], work[_RHO_DDOT], q_BN, restart, q_RN, work[_OMEGA_R], work[_DOMEGA_R], work[_LOS]
    )
    attitude_error(
        q_BN,
        work[_OMEGA],
        q_RN,
        work[_OMEGA_R],
        work[_DOMEGA_R],
        work[_SIGMA_BR],
        work[_OMEGA_BR],
        work[_OMEGA_R_B],
        work[_DOMEGA_R_B],
    )
    return True


@kernel
def _add_surface_point(point_A: Array, C_AN: Array, w: Array, work: Array, j: int) -> None:
    x = C_AN[0, 0] * point_A[0] + C_AN[1, 0] * point_A[1] + C_AN[2, 0] * point_A[2]
    y = C_AN[0, 1] * point_A[0] + C_AN[1, 1] * point_A[1] + C_AN[2, 1] * point_A[2]
    z = C_AN[0, 2] * point_A[0] + C_AN[1, 2] * point_A[1] + C_AN[2, 2] * point_A[2]
    vx, vy, vz = w[1] * z - w[2] * y, w[2] * x - w[0] * z, w[0] * y - w[1] * x
    work[_RHO, j, 0] += x
    work[_RHO, j, 1] += y
    work[_RHO, j, 2] += z
    work[_RHO_DOT, j, 0] += vx
    work[_RHO_DOT, j, 1] += vy
    work[_RHO_DOT, j, 2] += vz
    work[_RHO_DDOT, j, 0] += w[1] * vz - w[2] * vy
    work[_RHO_DDOT, j, 1] += w[2] * vx - w[0] * vz
    work[_RHO_DDOT, j, 2] += w[0] * vy - w[1] * vx


@kernel
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
        peaks: Largest wheel speed [rad/s] and torque [N m] so far, and holds in which a limit cut a torque, shape (n, 3).
    """
    for j in range(torque_B.shape[0]):
        cut = False
        for w in range(3):
            u = (
                allocation[w, 0] * torque_B[j, 0]
                + allocation[w, 1] * torque_B[j, 1]
                + allocation[w, 2] * torque_B[j, 2]
            )
            asked = u
            u = min(max_torque, max(-max_torque, u))
            # A torque that would carry the wheel past its top speed within the hold is cut to just reach it.
            speed = work[_WHEEL, j, w]
            u = min(max(0.0, (max_speed - speed) / speed_gain), max(min(0.0, (-max_speed - speed) / speed_gain), u))
            ctrl[3 * j + w] = u
            cut = cut or u != asked
            peaks[j, 0] = max(peaks[j, 0], abs(speed))
            peaks[j, 1] = max(peaks[j, 1], abs(u))
        if cut:
            peaks[j, 2] += 1.0


@kernel
def push_gradient(q_BN: Array, gm: float, inertia: Array, C_mid: Array, hub: Ints, xfrc: Array, work: Array) -> None:
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
    r_B = np.empty((hub.shape[0], 3))
    for j in range(hub.shape[0]):
        r_N = C_mid.T @ work[_R_A, j]
        w, x, y, z = quaternion(q_BN, j)
        put_vector(r_B, j, rotate((w, -x, -y, -z), (r_N[0], r_N[1], r_N[2])))
    torque_B = gravity_gradient_torque(r_B, inertia, gm)
    for j in range(hub.shape[0]):
        put_vector(xfrc[:, 3:], hub[j], rotate(quaternion(q_BN, j), vector(torque_B, j)))


@kernel
def turn_body(q_P: Array, phase: float, mocap_quat: Array) -> None:
    """Write the attitude of A, the pole frame turned by `phase` [rad] about z, as MuJoCo's quaternion."""
    c, s = cos(0.5 * phase), sin(0.5 * phase)
    mocap_quat[0] = q_P[0] * c - q_P[3] * s
    mocap_quat[1] = q_P[1] * c + q_P[2] * s
    mocap_quat[2] = q_P[2] * c - q_P[1] * s
    mocap_quat[3] = q_P[3] * c + q_P[0] * s


@kernel
def record(
    row: int,
    kind: Ints,
    index: Ints,
    q_BN: Array,
    q_RN: Array,
    ctrl: Array,
    work: Array,
    vectors: Array,
    attitude: Array,
    aim: NDArray[np.int16],
) -> None:
    """Write one telemetry sample.

    Args:
        row: Sample number.
        kind: Target kinds, shape (n,).
        index: Spacecraft tracked where kind says so, shape (n,).
        q_BN: Attitudes, shape (n, 4).
        q_RN: Reference attitudes, shape (n, 4).
        ctrl: Motor torques held from now on, shape (3 n,) [N m].
        work: See `Slot`.
        vectors: Receives r, v, omega, sigma_BR, wheel speed, wheel torque, line of sight, shape (time, 7, n, 3).
        attitude: Receives q_BN, q_RN, shape (time, 2, n, 4).
        aim: Receives kind and tracked spacecraft (-1: none), shape (time, 2, n).
    """
    for j in range(kind.shape[0]):
        aim[row, 0, j] = kind[j]
        aim[row, 1, j] = index[j] if kind[j] == 1 else -1
        for k in range(4):
            attitude[row, 0, j, k] = q_BN[j, k]
            attitude[row, 1, j, k] = q_RN[j, k]
        for k in range(3):
            vectors[row, 0, j, k] = work[_R, j, k]
            vectors[row, 1, j, k] = work[_V, j, k]
            vectors[row, 2, j, k] = work[_OMEGA, j, k]
            vectors[row, 3, j, k] = work[_SIGMA_BR, j, k]
            vectors[row, 4, j, k] = work[_WHEEL, j, k]
            vectors[row, 5, j, k] = ctrl[3 * j + k]
            vectors[row, 6, j, k] = work[_LOS, j, k]
