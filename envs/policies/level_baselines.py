"""Scripted policies for the levels `pointing` and `torque`; those of `role` are in `baselines`.

At these levels the scenario's behaviour says who observes and who talks. A policy of the level `pointing` chooses points of the
target, one of the level `torque` turns the spacecraft to where the behaviour wants them.
"""

from __future__ import annotations

import numpy as np

from swarm_mj.spacecraft.control.feedback import MrpFeedback
from swarm_mj.typing import Array, Array32

from ..observe.patches import tangents
from ..observe.task import Task
from .baselines import POLICIES, Policy, body_centre, greedy, sweep

#: Which of the numbers `role` of an observation says that a spacecraft looks at the body's centre.
_CENTRE = 0


def points(policy: Policy) -> Policy:
    """A policy of the level `role` at the level `pointing`: the middles of its patches, else the middle of the target."""

    def aimed(task: Task, observation: Array32) -> Array32:
        choice, count = policy(task, observation), task.patches.count
        middles = np.vstack([tangents(task.plan.region, task.patches.centre_A), np.zeros((1, 2))])
        return np.clip(middles[np.minimum(choice, count)], -1.0, 1.0).astype(np.float32).ravel()

    return aimed


def feedback(task: Task, observation: Array32) -> Array32:
    """Motor torques by `MrpFeedback` with its defaults, from attitude error and rate as they are observed.

    The rate at which the line of sight to the body's centre turns is fed forward, without which the error would be 4 deg.
    """
    parts, properties, law = task.observation_layout.split(observation), task.plan.properties, MrpFeedback()
    omega = 0.1 * parts["rate"].astype(np.float64) - _line_of_sight_rate(task, parts)
    wanted = law.attitude_gain * parts["sigma_BR"] + law.rate_gain * omega
    torque_B = -wanted @ properties.inertia_B.T
    # The body feels L = -A^T u of motor torques u about the wheel axes A.
    motor = -torque_B @ np.linalg.pinv(properties.wheel_axes_B)
    return np.clip(motor / properties.max_wheel_torque, -1.0, 1.0).astype(np.float32).ravel()


def _line_of_sight_rate(task: Task, parts: dict[str, Array32]) -> Array:
    """Rate of the line of sight to the body's centre in B, zero for who looks elsewhere, shape (n, 3) [rad/s]."""
    layout = task.observation_layout
    r_A = layout.position_scale * parts["position"].astype(np.float64)
    spin_A = np.array([0.0, 0.0, task.plan.environment.spin_rate])
    v_A = layout.velocity_scale * parts["velocity"].astype(np.float64) + np.cross(spin_A, r_A)
    rate_A = np.cross(r_A, v_A) / (r_A**2).sum(axis=1, keepdims=True)
    z_A, x_A = parts["boresight"].astype(np.float64), parts["x_axis"].astype(np.float64)
    C_BA = np.stack([x_A, np.cross(z_A, x_A), z_A], axis=1)
    looks = parts["role"][:, _CENTRE, None] > 0.5
    return np.where(looks, np.einsum("jik,jk->ji", C_BA, rate_A), 0.0)


#: Policies by level and name.
LEVEL_POLICIES: dict[str, dict[str, Policy]] = {
    "role": POLICIES,
    "pointing": {"target centre": points(body_centre), "sweep": points(sweep), "greedy": points(greedy)},
    "torque": {"feedback": feedback},
}
