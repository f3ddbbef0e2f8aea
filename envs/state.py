"""The swarm's state at one instant, read from the simulation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swarm_mj.attitude.mrp import dcm, mrp_from_quaternion
from swarm_mj.simulation.simulation import Simulation
from swarm_mj.spacecraft.model import NQ, NV

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class SwarmState:
    """Copies, not views.

    Attributes:
        t: Time past the epoch [s].
        r_BN_N: Positions, shape (n, 3) [m].
        v_BN_N: Velocities, shape (n, 3) [m/s].
        C_BN: Rotations from N to B, shape (n, 3, 3).
        omega_BN_B: Body rates, shape (n, 3) [rad/s].
        wheel_speed: Shape (n, 3) [rad/s].
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
    def r_A(self) -> Array:
        """Positions in A, shape (n, 3) [m]."""
        return self.r_BN_N @ self.C_AN.T

    @property
    def C_BA(self) -> Array:
        """Rotations from A to B, shape (n, 3, 3)."""
        return self.C_BN @ self.C_AN.T

    @property
    def boresight_N(self) -> Array:
        """Where +z looks in N, shape (n, 3)."""
        return self.C_BN[:, 2].copy()


def is_finite(simulation: Simulation) -> bool:
    """Whether every number of the state is finite."""
    return bool(np.isfinite(simulation.data.qpos).all() and np.isfinite(simulation.data.qvel).all())


def read_state(simulation: Simulation) -> SwarmState:
    """The state now."""
    n = simulation.model.n
    qpos, qvel = simulation.data.qpos.reshape(n, NQ).copy(), simulation.data.qvel.reshape(n, NV).copy()
    return SwarmState(
        t=simulation.time,
        r_BN_N=qpos[:, :3],
        v_BN_N=qvel[:, :3],
        C_BN=dcm(mrp_from_quaternion(qpos[:, 3:7])),
        omega_BN_B=qvel[:, 3:6],
        wheel_speed=qvel[:, 6:9],
        C_AN=simulation.environment.C_AN(simulation.time),
    )
