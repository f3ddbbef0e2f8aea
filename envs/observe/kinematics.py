"""The flights at one instant: in truth, and as the flight software knows it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numba.typed import List

from swarm_mj.compilation import allocation_free, kernel
from swarm_mj.spacecraft.attitude.algebra import Quaternion, quaternion, rotate
from swarm_mj.typing import Array, Ints, Mask

#: Constants of the missions of an environment, one after another, a typed list for compiled code.
PerMission = Sequence


@kernel
def listed(first: Any) -> Any:
    """A list for compiled code, of constants of one kind."""
    items = List()
    items.append(first)
    return items


@kernel
def add_listed(items: Any, item: Any) -> None:
    """Append to such a list."""
    items.append(item)


class Kinematics(NamedTuple):
    """Motion of E flights of n spacecraft at one instant.

    Attributes:
        t: Time past the epoch, shape (E,) [s].
        r: Positions in N, shape (E, n, 3) [m].
        v: Velocities in N, shape (E, n, 3) [m/s].
        q: Attitudes q_BN, shape (E, n, 4).
        omega: Body rates in B, shape (E, n, 3) [rad/s].
        wheel: Wheel speeds, shape (E, n, w) [rad/s].
        C_AN: Rotations from N to A, shape (E, 3, 3).
        r_A: Positions in A, shape (E, n, 3) [m].
        C_BN: Rotations from N to B, shape (E, n, 3, 3).
    """

    t: Array
    r: Array
    v: Array
    q: Array
    omega: Array
    wheel: Array
    C_AN: Array
    r_A: Array
    C_BN: Array


class AttitudeEstimate(NamedTuple):
    """Attitudes and rates as the flight software has them at that instant: the truth, unless sensors are imperfect or late.

    Attributes:
        q: Attitudes q_BN, shape (E, n, 4).
        omega: Body rates in B, shape (E, n, 3) [rad/s].
        C_BN: Rotations from N to B, shape (E, n, 3, 3).
    """

    q: Array
    omega: Array
    C_BN: Array


class Tracking(NamedTuple):
    """What the spacecraft track since the last decision.

    Attributes:
        kind: `TargetKind` values, shape (E, n).
        spacecraft: Whom, from 0, where that is a spacecraft, shape (E, n).
        sigma_BR: Attitude errors at the decision, MRP, shape (E, n, 3).
        blind: Whose camera is off, shape (E, n).
    """

    kind: Ints
    spacecraft: Ints
    sigma_BR: Array
    blind: Mask


class BodyRotation(NamedTuple):
    """How the body turns.

    Attributes:
        C_PN: Rotation from N to the pole frame, shape (3, 3).
        phase0: Prime meridian angle at the epoch [rad].
        spin_rate: Of the body [rad/s].
    """

    C_PN: Array
    phase0: float
    spin_rate: float


def no_kinematics(count: int, n: int, wheels: int) -> Kinematics:
    """Zeros for that many flights, spacecraft and wheels."""
    return Kinematics(
        t=np.zeros(count),
        r=np.zeros((count, n, 3)),
        v=np.zeros((count, n, 3)),
        q=np.zeros((count, n, 4)),
        omega=np.zeros((count, n, 3)),
        wheel=np.zeros((count, n, wheels)),
        C_AN=np.zeros((count, 3, 3)),
        r_A=np.zeros((count, n, 3)),
        C_BN=np.zeros((count, n, 3, 3)),
    )


def no_estimate(count: int, n: int) -> AttitudeEstimate:
    """Zeros for that many flights and spacecraft."""
    return AttitudeEstimate(np.zeros((count, n, 4)), np.zeros((count, n, 3)), np.zeros((count, n, 3, 3)))


@kernel
def update_rotations(
    bodies: PerMission[BodyRotation], mission: Ints, now: Kinematics, live: Mask, finite: Mask
) -> None:
    """Work out C_AN, r_A and C_BN of the live flights, shape (E,), from time, positions and attitudes.

    `bodies` turn by mission, and `mission` is that of each flight, shape (E,); `finite`, shape (E,), tells whose state is.
    """
    for m in range(len(bodies)):
        body = bodies[m]
        for e in range(live.shape[0]):
            if live[e] and mission[e] == m:
                finite[e] = _update_flight(body, now, e)


@allocation_free
def _update_flight(body: BodyRotation, now: Kinematics, e: int) -> bool:
    phase = body.phase0 + body.spin_rate * now.t[e]
    c, s = np.cos(phase), np.sin(phase)
    C, P = now.C_AN[e], body.C_PN
    for k in range(3):
        C[0, k], C[1, k], C[2, k] = c * P[0, k] + s * P[1, k], c * P[1, k] - s * P[0, k], P[2, k]
    total = 0.0  # finite if everything is
    for j in range(now.r.shape[1]):
        r = now.r[e, j]
        q = quaternion(now.q[e], j)
        write_dcm(q, now.C_BN[e, j])
        for k in range(3):
            now.r_A[e, j, k] = C[k, 0] * r[0] + C[k, 1] * r[1] + C[k, 2] * r[2]
            total += now.r_A[e, j, k] + now.v[e, j, k] + now.omega[e, j, k] + q[0] + now.C_BN[e, j, k, k]
        for w in range(now.wheel.shape[2]):
            total += now.wheel[e, j, w]
    return np.isfinite(total)


def copy_instant(now: Kinematics, to: Kinematics, live: Mask) -> None:
    """Copy what the live flights, shape (E,), are at one instant."""
    for ours, theirs in zip(to, now, strict=True):
        ours[live] = theirs[live]


def copy_truth(now: Kinematics, estimate: AttitudeEstimate, live: Mask) -> None:
    """Let the estimate of the live flights, shape (E,), be the truth."""
    for name, ours in estimate._asdict().items():
        ours[live] = getattr(now, name)[live]


@kernel
def update_estimated_rotations(estimate: AttitudeEstimate, flights: Mask) -> None:
    """Work out C_BN of these flights, shape (E,), from the estimated attitudes."""
    for e in range(flights.shape[0]):
        if flights[e]:
            for j in range(estimate.q.shape[1]):
                write_dcm(quaternion(estimate.q[e], j), estimate.C_BN[e, j])


@allocation_free
def write_dcm(q: Quaternion, C: Array) -> None:
    """Write the rotation from N to B, shape (3, 3), of an attitude q_BN."""
    inverse = (q[0], -q[1], -q[2], -q[3])
    for k in range(3):
        column = rotate(inverse, (1.0 if k == 0 else 0.0, 1.0 if k == 1 else 0.0, 1.0 if k == 2 else 0.0))
        for i in range(3):
            C[i, k] = column[i]
