"""The observation vector: which numbers stand where, and how they are scaled."""

from __future__ import annotations

import numpy as np
from gymnasium import spaces

from swarm_mj.flight.plan import Plan
from swarm_mj.mission.behaviors import TargetKind
from swarm_mj.typing import Array32

#: Per spacecraft, in this order: name, size (of the wheel speeds: with the usual three), bound of the absolute value, and
#: whether it may be negative.
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


class Readings:
    """Layout of the observation; `step_kernels` fills it.

    Args:
        plan: The mission, for the scales.
        patches: Number of patches.

    Attributes:
        space: The observation space.
        features: Numbers for each spacecraft.
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
        wheels = len(plan.properties.wheel_axes_B)
        sizes = [wheels if name == "wheel_speed" else size for name, size, _, _ in PER_SPACECRAFT]
        self.features, end, self.columns = sum(sizes), 0, {}
        high, low = np.empty(self.features), np.empty(self.features)
        for (name, _, bound, signed), size in zip(PER_SPACECRAFT, sizes, strict=True):
            part = self.columns[name] = slice(end, end + size)
            high[part], low[part] = bound, -bound if signed else 0.0
            end += size
        tail = np.ones(patches + 3)
        tail[-1] = 10.0
        self.space = spaces.Box(
            np.concatenate([np.tile(low, plan.n), 0.0 * tail]).astype(np.float32),
            np.concatenate([np.tile(high, plan.n), tail]).astype(np.float32),
            dtype=np.float32,
        )

    def split(self, observation: Array32) -> dict[str, Array32]:
        """The parts of an observation by name: per spacecraft shape (n, size), and patches, time_left, seen, delivered."""
        block = observation[: self._n * self.features].reshape(self._n, self.features)
        rest = observation[self._n * self.features :]
        parts = {name: block[:, columns] for name, columns in self.columns.items()}
        return parts | {"patches": rest[:-3], "time_left": rest[-3], "seen": rest[-2], "delivered": rest[-1]}
