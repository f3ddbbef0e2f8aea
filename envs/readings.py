"""The observation vector: which numbers stand where, and how they are scaled."""

from __future__ import annotations

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from swarm_mj.mission.behaviors import TargetKind
from swarm_mj.planning import Plan

from .step_kernels import FEATURES

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
assert sum(size for _, size, _, _ in PER_SPACECRAFT) == FEATURES

class Readings:
    """Layout of the observation; `step_kernels` fills it.

    Args:
        plan: The mission, for the scales.
        patches: Number of patches.

    Attributes:
        space: The observation space.
        position_scale: Positions are divided by this [m].
        velocity_scale: Velocities are divided by this [m/s].
        columns: Places of each per-spacecraft quantity within a spacecraft's block.
    """

    def __init__(self, plan: Plan, patches: int) -> None:
        self._n = plan.n
        self.position_scale = plan.scenario.behavior.imaging_radius_m
        self.velocity_scale = float(
            np.linalg.norm(plan.scenario.mothership.position_A_m) / plan.scenario.design.time_of_flight_s
        )
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

    def split(self, observation: NDArray[np.float32]) -> dict[str, NDArray[np.float32]]:
        """The parts of an observation by name: per spacecraft shape (n, size), and patches, time_left, seen, delivered."""
        block = observation[: self._n * FEATURES].reshape(self._n, FEATURES)
        rest = observation[self._n * FEATURES :]
        parts = {name: block[:, columns] for name, columns in self.columns.items()}
        return parts | {"patches": rest[:-3], "time_left": rest[-3], "seen": rest[-2], "delivered": rest[-1]}
