"""The flights at one instant: in truth, and as the flight software knows it."""

from __future__ import annotations

from typing import NamedTuple

from swarm_mj.spacecraft.attitude.algebra import Quaternion, quaternion, rotate
from swarm_mj.typing import Array, Mask, kernel


class Now(NamedTuple):
    """The flights at one instant.

    Attributes:
        t: Seconds past the epoch, shape (E,).
        r: Positions in N, shape (E, n, 3) [m].
        v: Velocities in N, shape (E, n, 3) [m/s].
        q: Attitudes q_BN, shape (E, n, 4).
        omega: Body rates in B, shape (E, n, 3) [rad/s].
        wheel: Wheel speeds, shape (E, n, w) [rad/s].
        C_AN: Rotations from N to A, shape (E, 3, 3).
        r_A: Positions in A, shape (E, n, 3) [m].
        C_BN: Shape (E, n, 3, 3).
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


class Known(NamedTuple):
    """Attitudes and rates as the flight software has them at that instant: the truth, unless sensors are imperfect or late.

    Attributes:
        q: Attitudes q_BN, shape (E, n, 4).
        omega: Body rates in B, shape (E, n, 3) [rad/s].
        C_BN: Shape (E, n, 3, 3).
    """

    q: Array
    omega: Array
    C_BN: Array


@kernel
def learn(now: Now, known: Known, flights: Mask) -> None:
    """Take the truth for what these flights, shape (E,), know."""
    for e in range(flights.shape[0]):
        if flights[e]:
            for j in range(known.q.shape[1]):
                for k in range(4):
                    known.q[e, j, k] = now.q[e, j, k]
                for k in range(3):
                    known.omega[e, j, k] = now.omega[e, j, k]
                    for m in range(3):
                        known.C_BN[e, j, k, m] = now.C_BN[e, j, k, m]


@kernel
def turn(known: Known, flights: Mask) -> None:
    """Work out C_BN of these flights, shape (E,), from the attitudes."""
    for e in range(flights.shape[0]):
        if flights[e]:
            for j in range(known.q.shape[1]):
                write_dcm(quaternion(known.q[e], j), known.C_BN[e, j])


@kernel
def write_dcm(q: Quaternion, C: Array) -> None:
    """Write the rotation from N to B, shape (3, 3), of an attitude q_BN."""
    inverse = (q[0], -q[1], -q[2], -q[3])
    for k in range(3):
        column = rotate(inverse, (1.0 if k == 0 else 0.0, 1.0 if k == 1 else 0.0, 1.0 if k == 2 else 0.0))
        for i in range(3):
            C[i, k] = column[i]
