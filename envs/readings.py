"""The observation vector: which numbers stand where, and how they are scaled."""

from __future__ import annotations

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from swarm_mj.mission.behaviors import TargetKind, Targets
from swarm_mj.planning import Plan

from .state import SwarmState

Array = NDArray[np.float64]

#: Per spacecraft, in this order: name, size, bound of the absolute value, lower bound is its negative or zero.
PER_SPACECRAFT = (
    ("position", 3, 10.0, True),
    ("velocity", 3, 10.0, True),
    ("sigma_BR", 3, 1.0, True),
    ("boresight", 3, 1.0, True),
    ("x_axis", 3, 1.0, True),
    ("rate", 3, 10.0, True),
    ("wheel_speed", 3, 1.0, True),
    ("imaging", 1, 1.0, False),
    ("link", 1, 1.0, False),
    ("stored", 1, 10.0, False),
    ("role", len(TargetKind), 1.0, False),
)
FEATURES = sum(size for _, size, _, _ in PER_SPACECRAFT)

#: Body rates are divided by this [rad/s].
RATE_SCALE = 0.1


class Readings:
    """Turns the swarm's state into the observation.

    Args:
        plan: The mission, for the scales.
        patches: Number of patches.

    Attributes:
        space: The observation space.
        columns: Places of each per-spacecraft quantity within a spacecraft's block.
    """

    def __init__(self, plan: Plan, patches: int) -> None:
        self._n, self._duration = plan.n, plan.scenario.duration_s
        self._position_scale = plan.scenario.behavior.imaging_radius_m
        self._velocity_scale = float(
            np.linalg.norm(plan.scenario.mothership.position_A_m) / plan.scenario.design.time_of_flight_s
        )
        self._spin_A = np.array([0.0, 0.0, plan.environment.spin_rate])
        self._max_speed = plan.properties.max_wheel_speed
        ends = np.cumsum([size for _, size, _, _ in PER_SPACECRAFT])
        self.columns = {
            name: slice(int(end) - size, int(end)) for (name, size, _, _), end in zip(PER_SPACECRAFT, ends, strict=True)
        }
        high = np.concatenate([np.full(size, bound) for _, size, bound, _ in PER_SPACECRAFT])
        low = np.concatenate([np.full(size, -bound if signed else 0.0) for _, size, bound, signed in PER_SPACECRAFT])
        tail = np.ones(patches + 3)
        tail[-1] = 10.0
        self.space = spaces.Box(
            np.concatenate([np.tile(low, plan.n), 0.0 * tail]).astype(np.float32),
            np.concatenate([np.tile(high, plan.n), tail]).astype(np.float32),
            dtype=np.float32,
        )

    def read(
        self,
        state: SwarmState,
        targets: Targets,
        *,
        sigma_BR: Array,
        imaging: NDArray[np.bool_],
        link: NDArray[np.bool_],
        stored: Array,
        patch_seen: Array,
        seen: float,
        delivered: float,
    ) -> NDArray[np.float32]:
        """The observation, a new array; see `SwarmObserveEnv` for its meaning."""
        block = np.hstack(
            [
                state.r_A / self._position_scale,
                self._relative_velocity_A(state) / self._velocity_scale,
                sigma_BR,
                state.C_BA[:, 2],
                state.C_BA[:, 0],
                state.omega_BN_B / RATE_SCALE,
                state.wheel_speed / self._max_speed,
                imaging[:, None],
                link[:, None],
                stored[:, None],
                np.eye(len(TargetKind))[targets.kind],
            ]
        )
        left = 1.0 - state.t / self._duration
        vector = np.concatenate([block.ravel(), patch_seen, [left, seen, delivered]]).astype(np.float32)
        return np.clip(vector, self.space.low, self.space.high)

    def _relative_velocity_A(self, state: SwarmState) -> Array:
        """Velocity as seen by somebody who turns with the body, in A, shape (n, 3) [m/s]."""
        return state.v_BN_N @ state.C_AN.T - np.cross(self._spin_A, state.r_A)

    def split(self, observation: NDArray[np.float32]) -> dict[str, NDArray[np.float32]]:
        """The parts of an observation by name: per spacecraft shape (n, size), and patches, time_left, seen, delivered."""
        block = observation[: self._n * FEATURES].reshape(self._n, FEATURES)
        rest = observation[self._n * FEATURES :]
        parts = {name: block[:, columns] for name, columns in self.columns.items()}
        return parts | {"patches": rest[:-3], "time_left": rest[-3], "seen": rest[-2], "delivered": rest[-1]}
