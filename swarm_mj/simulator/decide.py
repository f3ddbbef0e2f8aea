"""The arithmetic of one decision of one flight, compiled: state, gravity, guidance and wheels, in frames N and B, SI.

`loop.run` calls the parts in turn. `work` holds the decision's vectors, shape (len(Slot), n, 3).
"""

from __future__ import annotations

import numpy as np

from swarm_mj.compilation import allocation_free
from swarm_mj.mission.behaviors import TargetKind, looks_at_body
from swarm_mj.simulator.slots import Peak, Resting, Slot
from swarm_mj.smallbody.perturbations import gradient_torque_on
from swarm_mj.spacecraft.attitude.algebra import (
    combine,
    conjugate,
    cross,
    product,
    put_quaternion,
    put_vector,
    quaternion,
    rotate,
    scaled,
    times,
    vector,
)
from swarm_mj.spacecraft.attitude.guidance import Aiming
from swarm_mj.spacecraft.wheels import limited
from swarm_mj.typing import Array, Ints, Mask


@allocation_free
def lie_or_stay(
    resting: Ints, rest_A: Array, C_AN: Array, spin_N: Array, r_N: Array, v_N: Array, omega_B: Array, speed: Array
) -> None:
    """Hold the spacecraft whose flight is over: at their places on the turning body, or where they diverged.

    Args:
        resting: See `Resting`, shape (n,).
        rest_A: Places on the body, in A, shape (n, 3) [m].
        C_AN: Rotation from N to A.
        spin_N: Angular velocity of A in N, shape (3,) [rad/s].
        r_N: Positions, replaced, shape (n, 3) [m].
        v_N: Velocities, replaced, shape (n, 3) [m/s].
        omega_B: Body rates, set to zero, shape (n, 3) [rad/s].
        speed: Wheel speeds, set to zero, shape (n, w) [rad/s].
    """
    for j in range(resting.shape[0]):
        if resting[j] == Resting.FLYING:
            continue
        put_vector(v_N, j, (0.0, 0.0, 0.0))
        put_vector(omega_B, j, (0.0, 0.0, 0.0))
        for w in range(speed.shape[1]):
            speed[j, w] = 0.0
        if resting[j] == Resting.ON_THE_BODY:
            r = times(C_AN.T, vector(rest_A, j))
            put_vector(r_N, j, r)
            put_vector(v_N, j, cross((spin_N[0], spin_N[1], spin_N[2]), r))


@allocation_free
def is_finite(r_N: Array, v_N: Array, q_BN: Array, omega_B: Array, speed: Array) -> bool:
    """Whether every number of a state is finite."""
    # Several sums, so that none waits for the other; each is finite if everything in it is.
    turned, placed, moving, total = 0.0, 0.0, 0.0, 0.0
    for j in range(q_BN.shape[0]):
        for k in range(4):
            turned += q_BN[j, k]
        for k in range(3):
            placed += r_N[j, k]
            moving += v_N[j, k]
            total += omega_B[j, k]
        for w in range(speed.shape[1]):
            total += speed[j, w]
    return np.isfinite(turned + placed + moving + total)


@allocation_free
def read_motion(r_N: Array, v_N: Array, offset_N: Array, C_mid: Array, half_hold: float, work: Array) -> None:
    """Read positions and velocities, and where gravity is to be evaluated.

    Args:
        r_N: Positions, shape (n, 3) [m].
        v_N: Velocities, shape (n, 3) [m/s].
        offset_N: From there to the centres of mass, shape (n, 3) [m].
        C_mid: Rotation from N to A at the middle of the hold, shape (3, 3).
        half_hold: Half the control period [s].
        work: Receives R, V and R_A, see `Slot`.
    """
    for j in range(r_N.shape[0]):
        for k in range(3):
            work[Slot.R, j, k], work[Slot.V, j, k] = r_N[j, k], v_N[j, k]
        ahead = combine(1.0, vector(r_N, j), half_hold, vector(v_N, j))
        put_vector(work[Slot.R_A], j, times(C_mid, combine(1.0, ahead, 1.0, vector(offset_N, j))))


@allocation_free
def read_rotation(omega_B: Array, speed: Array, wheel_inertia: float, wheel_axes_B: Array, work: Array) -> None:
    """Read body rates and wheels.

    Args:
        omega_B: Shape (n, 3) [rad/s].
        speed: Of the wheels relative to the hub, shape (n, w) [rad/s].
        wheel_inertia: Spin inertia of a wheel [kg m^2].
        wheel_axes_B: Rows, shape (w, 3).
        work: Receives OMEGA, WHEEL (of the first three wheels) and MOMENTUM, see `Slot`.
    """
    for j in range(omega_B.shape[0]):
        for k in range(3):
            work[Slot.OMEGA, j, k], work[Slot.WHEEL, j, k] = omega_B[j, k], speed[j, k]
            momentum = 0.0
            for w in range(wheel_axes_B.shape[0]):
                momentum += wheel_axes_B[w, k] * speed[j, w]
            work[Slot.MOMENTUM, j, k] = wheel_inertia * momentum


@allocation_free
def hold_gravity(a_A: Array, C_mid: Array, resting: Ints, work: Array) -> None:
    """Turn accelerations from A to N; what lies on the body is not pulled.

    Args:
        a_A: Accelerations in A, shape (n, 3) [m/s^2].
        C_mid: Rotation from N to A at the time of `a_A`.
        resting: See `Resting`, shape (n,).
        work: Receives A, see `Slot`.
    """
    for j in range(a_A.shape[0]):
        a_N = times(C_mid.T, vector(a_A, j))
        put_vector(work[Slot.A], j, a_N if resting[j] == Resting.FLYING else (0.0, 0.0, 0.0))


@allocation_free
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


@allocation_free
def locate_targets(
    kind: Ints,
    spacecraft: Ints,
    aim: Array,
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
        aim: Surface point in A [m] or direction in N, shape (n, 3).
        earth_N: Position of Earth relative to the body in N, shape (3,) [m].
        earth_velocity_N: Its velocity, shape (3,) [m/s].
        spin_N: Angular velocity of A in N, shape (3,) [rad/s].
        C_AN: Rotation from N to A.
        work: Gives R, V and A, receives RHO, RHO_DOT and RHO_DDOT, see `Slot`.
    """
    spin, nowhere = (spin_N[0], spin_N[1], spin_N[2]), (0.0, 0.0, 0.0)
    for j in range(kind.shape[0]):
        r, v, a = nowhere, nowhere, nowhere  # the body's centre
        if kind[j] == TargetKind.SPACECRAFT:
            k = spacecraft[j]
            r, v, a = vector(work[Slot.R], k), vector(work[Slot.V], k), vector(work[Slot.A], k)
        elif kind[j] == TargetKind.EARTH:
            r = earth_N[0], earth_N[1], earth_N[2]
            v = earth_velocity_N[0], earth_velocity_N[1], earth_velocity_N[2]
        elif kind[j] == TargetKind.SURFACE:
            r = times(C_AN.T, vector(aim, j))
            v = cross(spin, r)
            a = cross(spin, v)
        rho = combine(1.0, r, -1.0, vector(work[Slot.R], j))
        rho_dot = combine(1.0, v, -1.0, vector(work[Slot.V], j))
        rho_ddot = combine(1.0, a, -1.0, vector(work[Slot.A], j))
        if kind[j] == TargetKind.DIRECTION:
            # Far enough that the coincidence rule never applies; the length of a direction does not matter.
            rho, rho_dot, rho_ddot = scaled(1e9, vector(aim, j)), nowhere, nowhere
        put_vector(work[Slot.RHO], j, rho)
        put_vector(work[Slot.RHO_DOT], j, rho_dot)
        put_vector(work[Slot.RHO_DDOT], j, rho_ddot)


@allocation_free
def guess_positions(since: float, off_r_N: Array, off_v_N: Array, work: Array) -> None:
    """Put what is known of positions and velocities in the place of the truth.

    Args:
        since: Time for which the next two have grown [s].
        off_r_N: Known positions less the true ones, shape (n, 3) [m].
        off_v_N: Known velocities less the true ones, shape (n, 3) [m/s].
        work: R and V are changed, see `Slot`.
    """
    for j in range(off_r_N.shape[0]):
        for k in range(3):
            work[Slot.R, j, k] += off_r_N[j, k] + since * off_v_N[j, k]
            work[Slot.V, j, k] += off_v_N[j, k]


@allocation_free
def mount_bases(aiming: Aiming, kind: Ints, restart: Mask, q_BN: Array, q_RN: Array) -> None:
    """Turn the attitudes that guidance begins with into those of cameras, of spacecraft that look at the body.

    Args:
        aiming: How the camera is mounted.
        kind: `TargetKind` values, shape (n,).
        restart: Who begins with the body attitude, shape (n,).
        q_BN: Body attitudes, shape (n, 4).
        q_RN: References so far, with which the others begin; replaced, shape (n, 4).
    """
    q_BC = aiming.q_BC[0], aiming.q_BC[1], aiming.q_BC[2], aiming.q_BC[3]
    for j in range(kind.shape[0]):
        base = quaternion(q_BN, j) if restart[j] else quaternion(q_RN, j)
        put_quaternion(q_RN, j, product(base, q_BC) if looks_at_body(kind[j]) else base)


@allocation_free
def unmount_references(aiming: Aiming, kind: Ints, q_RN: Array) -> None:
    """Turn references of cameras back into those of the spacecraft that carry them; args as of `mount_bases`."""
    q_CB = aiming.q_BC[0], -aiming.q_BC[1], -aiming.q_BC[2], -aiming.q_BC[3]
    for j in range(kind.shape[0]):
        if looks_at_body(kind[j]):
            put_quaternion(q_RN, j, product(quaternion(q_RN, j), q_CB))


@allocation_free
def actuate(
    torque_B: Array,
    allocation: Array,
    speed_gain: float,
    max_torque: float,
    max_speed: float,
    speed: Array,
    motor: Array,
    peaks: Array,
) -> None:
    """Turn body torques into motor torques within the wheels' limits.

    Args:
        torque_B: Torque that the wheels shall exert on the body, shape (n, 3) [N m].
        allocation: Maps a body torque to motor torques: minus the pseudo-inverse of the axes, shape (w, 3).
        speed_gain: Change of wheel speed in one hold per motor torque [rad/s per N m].
        max_torque: [N m].
        max_speed: [rad/s].
        speed: Of the wheels relative to the hub, shape (n, w) [rad/s].
        motor: Receives the motor torques, shape (n, w) [N m].
        peaks: Brought up to date, see `Peak`, shape (n, 3).
    """
    for j in range(torque_B.shape[0]):
        cut = False
        for w in range(allocation.shape[0]):
            asked = (
                allocation[w, 0] * torque_B[j, 0]
                + allocation[w, 1] * torque_B[j, 1]
                + allocation[w, 2] * torque_B[j, 2]
            )
            u = limited(asked, speed[j, w], speed_gain, max_torque, max_speed)
            cut = cut or u != asked
            motor[j, w] = u
            peaks[j, Peak.WHEEL_SPEED] = max(peaks[j, Peak.WHEEL_SPEED], abs(speed[j, w]))
            peaks[j, Peak.MOTOR_TORQUE] = max(peaks[j, Peak.MOTOR_TORQUE], abs(u))
        if cut:
            peaks[j, Peak.CUT_HOLDS] += 1.0


@allocation_free
def hold_gravity_gradient(
    q_BN: Array, gm: float, inertia: Array, C_mid: Array, released: Mask, torque_N: Array, work: Array
) -> None:
    """Hold the gravity-gradient torque of the central field.

    Args:
        q_BN: Attitudes, shape (n, 4).
        gm: Gravitational parameter of the body [m^3/s^2].
        inertia: Of every spacecraft in B, shape (n, 3, 3) [kg m^2].
        C_mid: Rotation from N to A at the middle of the hold.
        released: Who has left the mothership, shape (n,); nothing turns the others.
        torque_N: Receives the torques, shape (n, 3) [N m].
        work: See `Slot`.
    """
    for j in range(q_BN.shape[0]):
        q, r_N = quaternion(q_BN, j), times(C_mid.T, vector(work[Slot.R_A], j))
        torque_B = gradient_torque_on(rotate(conjugate(q), r_N), inertia[j], gm)
        put_vector(torque_N, j, rotate(q, torque_B) if released[j] else (0.0, 0.0, 0.0))
