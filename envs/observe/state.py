"""The swarm of one episode at one instant."""

from __future__ import annotations

from dataclasses import dataclass

from swarm_mj.typing import Array


@dataclass(frozen=True, eq=False)
class SwarmState:
    """The swarm in truth, whatever its sensors say; copies, not views.

    Attributes:
        t: Time past the epoch [s].
        r_BN_N: Positions, shape (n, 3) [m].
        v_BN_N: Velocities, shape (n, 3) [m/s].
        C_BN: Rotations from N to B, shape (n, 3, 3).
        omega_BN_B: Body rates, shape (n, 3) [rad/s].
        wheel_speed: Shape (n, w) [rad/s].
        C_AN: Rotation from N to A, shape (3, 3).
    """

    t: float
    r_BN_N: Array
    v_BN_N: Array
    C_BN: Array
    omega_BN_B: Array
    wheel_speed: Array
    C_AN: Array

    @property
    def boresight_N(self) -> Array:
        """Where +z looks in N, shape (n, 3)."""
        return self.C_BN[:, 2].copy()
