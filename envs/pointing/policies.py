"""Scripted policies for `SwarmPointing-v0`: what a trained agent has to beat.

Each is a function of the environment's task and the numbers that are observed, shape (E, F), that returns actions, (E, 3).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from swarm_mj.spacecraft.control.base import ControlInput, Controller
from swarm_mj.spacecraft.control.feedback import MrpFeedback
from swarm_mj.spacecraft.control.sliding_mode import MrpSlidingMode
from swarm_mj.typing import Array, Array32

from .batch import PointingBatch
from .steps import RATE, REFERENCE_RATE
from .task import PointingTask

PointingPolicy = Callable[[PointingTask, Array32], Array]


class PointingOutcome(NamedTuple):
    """What E episodes came to.

    Attributes:
        total_reward: Shape (E,).
        on_target: Share of the steps within the tolerance, shape (E,).
        held: Share of the references held, shape (E,).
        error_deg: Angle between +z and the target at the end, shape (E,) [deg].
    """

    total_reward: Array
    on_target: Array
    held: Array
    error_deg: Array


class LawPolicy:
    """A control law of the package, without memory, as a policy, with what is observed and nothing else.

    The acceleration of the line of sight is not observed; the law takes it as zero.
    """

    def __init__(self, law: Controller) -> None:
        self._law = law

    def __call__(self, task: PointingTask, observation: Array32) -> Array:
        """Torques of the motors over their limit, clipped, shape (E, 3)."""
        parts = {name: part.astype(np.float64) for name, part in task.layout.split(observation).items()}
        properties, count = task.plan.properties, len(observation)
        omega_BR, omega_RN = RATE * parts["omega_BR"], REFERENCE_RATE * parts["omega_RN"]
        wheels = properties.wheel_spin_inertia * properties.max_wheel_speed * parts["wheel_speed"]
        inputs = ControlInput(
            sigma_BR=parts["sigma_BR"],
            omega_BR_B=omega_BR,
            omega_BN_B=omega_BR + omega_RN,
            omega_RN_B=omega_RN,
            domega_RN_B=np.zeros((count, 3)),
            wheel_momentum_B=wheels @ properties.wheel_axes_B,
            inertia_B=np.tile(properties.inertia_B, (count, 1, 1)),
            inertia_effective_B=np.tile(properties.inertia_effective_B, (count, 1, 1)),
            period=task.config.step_s,
        )
        torque_B, _ = self._law.torque(inputs, None)
        motor = -torque_B @ np.linalg.pinv(properties.wheel_axes_B)
        return np.clip(motor / properties.max_wheel_torque, -1.0, 1.0)


def zero(task: PointingTask, observation: Array32) -> Array:
    """Nothing is done."""
    return np.zeros((len(observation), 3))


class RandomPolicy:
    """Any action, evenly."""

    def __init__(self, seed: int = 0) -> None:
        self._rng = np.random.default_rng(seed)

    def __call__(self, task: PointingTask, observation: Array32) -> Array:
        """Draw an action for each episode, shape (E, 3)."""
        return self._rng.uniform(-1.0, 1.0, (len(observation), 3))


#: Those that are published; of the laws, the scenario's own, the feedback law as it comes, and as quick as the wheels allow.
POLICIES: dict[str, PointingPolicy] = {
    "zero": zero,
    "random": RandomPolicy(),
    "sliding mode": LawPolicy(MrpSlidingMode()),
    "PD": LawPolicy(MrpFeedback()),
    "quick PD": LawPolicy(MrpFeedback(frequency=0.2)),
}


def fly(task: PointingTask, act: Callable[[PointingBatch], Array], episodes: int, seed: int = 0) -> PointingOutcome:
    """Fly episodes of the flight seeds `seed`, `seed` + 1, ... side by side; `act` gives actions, shape (E, 3)."""
    batch = PointingBatch(task, episodes)
    batch.reset({e: seed + e for e in range(episodes)})
    total = np.zeros(episodes)
    for _ in range(task.steps):
        batch.step(act(batch))
        total += batch.state.reward
    state = batch.state
    return PointingOutcome(total, state.on_target / task.steps, state.held.mean(axis=1), np.degrees(state.error))


def fly_policy(task: PointingTask, policy: PointingPolicy, episodes: int, seed: int = 0) -> PointingOutcome:
    """The same with a policy of the numbers that are observed."""
    return fly(task, lambda batch: policy(task, batch.numbers), episodes, seed)
