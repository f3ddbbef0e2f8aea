"""The swarm of one episode at one instant, and what `info` tells of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from swarm_mj.typing import Array

from .batch import Flybys


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


def state_of(flybys: Flybys, e: int) -> SwarmState:
    """Flight e between two steps."""
    now = flybys.now
    return SwarmState(
        t=float(now.t[e]),
        r_BN_N=now.r[e].copy(),
        v_BN_N=now.v[e].copy(),
        C_BN=now.C_BN[e].copy(),
        omega_BN_B=now.omega[e].copy(),
        wheel_speed=now.wheel[e].copy(),
        C_AN=now.C_AN[e].copy(),
    )


def info_of(flybys: Flybys, e: int) -> dict[str, Any]:
    """What every step tells of flight e."""
    return {
        "time_s": float(flybys.time_s[e]),
        "coverage_percent": float(flybys.percent[e]),
        "delivered_bit": float(flybys.books.delivered[e]),
        "stored_bit": flybys.books.stored[e].tolist(),
    }
