"""Scripted policies for the control level `role`: what a trained agent has to beat.

Each is a function of the environment's task and an observation that returns an action. Inside the imaging radius a
spacecraft looks at what the policy says; outside it talks to Earth, which hears the spacecraft one after another.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from swarm_mj.typing import Array, Array32

from ..observe.single import SwarmObserveEnv
from ..observe.task import Task
from .policy import geometry_of, greedy_actions

Action = NDArray[Any]
Policy = Callable[[Task, Array32], Action]

#: How long the sweep stays on a patch [s]: on `eros-observe` 30 s sees more than 60 s.
DWELL_S = 30.0


class Outcome(NamedTuple):
    """What an episode came to."""

    total_reward: float
    coverage_percent: float
    delivered_bit: float
    terms: dict[str, float]


def body_centre(task: Task, observation: Array32) -> Action:
    """All look at the body's centre, as in the paper."""
    return _talk_outside(task, observation, np.full(task.plan.n, task.patches.count))


def target_centre(task: Task, observation: Array32) -> Action:
    """All look at the patch whose centre is nearest to the middle of the target."""
    return _talk_outside(task, observation, np.full(task.plan.n, middle_patch(task)))


def sweep(task: Task, observation: Array32) -> Action:
    """Everyone goes through the patches row by row, to and fro, each starting at another place."""
    n, count = task.plan.n, task.patches.count
    k = round(count**0.5)
    order = np.arange(count).reshape(k, k)
    order[1::2] = order[1::2, ::-1].copy()
    elapsed = (1.0 - float(task.observation_layout.split(observation)["time_left"])) * task.plan.scenario.duration_s
    start = np.arange(n) * count // n
    return _talk_outside(task, observation, order.ravel()[(start + int(elapsed / DWELL_S)) % count])


def greedy(task: Task, observation: Array32) -> Action:
    """Everyone takes the unseen patch that it can picture best, each a different one; with none in reach, it talks."""
    parts = task.observation_layout.split(observation)
    worth = _worth(task, parts)
    choice = np.zeros(task.plan.n, np.int64)
    for j in range(task.plan.n):
        choice[j] = int(np.argmax(worth[j]))
        worth[:, choice[j]] *= 1e-3  # others take it only when nothing else is left
    receding = (parts["position"] * parts["velocity"]).sum(axis=1) > 0.0
    done = (worth.max(axis=1) <= 0.0) & receding | (parts["seen"] >= 1.0)
    return np.where(done, _earth(task), _talk_outside(task, observation, choice))


def greedy_ahead(task: Task, observation: Array32) -> Action:
    """The greedy rule by worth of the pictures, area and data; while nothing is in reach, everyone turns to what will be."""
    geometry = geometry_of(task)
    return greedy_actions(geometry.features(observation[None]), geometry)[0]


def _worth(task: Task, parts: dict[str, Array32]) -> Array:
    """Unseen area of every patch for every spacecraft, zero where no picture of it would count, shape (n, count) [m^2]."""
    patches, scenario = task.patches, task.plan.scenario
    to_camera = positions_A(task, parts)[:, None] - patches.centre_A
    distance = np.linalg.norm(to_camera, axis=2)
    up = patches.centre_A / np.linalg.norm(patches.centre_A, axis=1, keepdims=True)
    cosine = np.maximum(np.einsum("jki,ki->jk", to_camera, up) / distance, 1e-6)
    gsd = distance * task.observer.camera.pixel_angle / cosine
    limit = scenario.observation.max_gsd_m or np.inf
    return (1.0 - parts["patches"]) * patches.area * (gsd <= limit)


def positions_A(task: Task, parts: dict[str, Array32]) -> Array:
    """Positions in A, shape (n, 3) [m]."""
    return parts["position"].astype(np.float64) * task.plan.scenario.behavior.imaging_radius_m


POLICIES: dict[str, Policy] = {
    "body centre": body_centre,
    "target centre": target_centre,
    "sweep": sweep,
    "greedy": greedy,
    "greedy ahead": greedy_ahead,
}


def middle_patch(task: Task) -> int:
    """The patch whose centre lies nearest to the axis of the target's pyramid."""
    centre = task.patches.centre_A / np.linalg.norm(task.patches.centre_A, axis=1, keepdims=True)
    return int(np.argmax(centre @ task.plan.region.axes_A[2]))


def fly(env: SwarmObserveEnv, policy: Policy, seed: int) -> Outcome:
    """One episode from `reset(seed=seed)`."""
    observation, _ = env.reset(seed=seed)
    total, terms, done = 0.0, dict.fromkeys(env.reward_weights, 0.0), False
    while not done:
        observation, reward, terminated, truncated, info = env.step(policy(env.task, observation))
        total += reward
        for name, value in info["reward_terms"].items():
            terms[name] += value
        done = terminated or truncated
    return Outcome(total, info["coverage_percent"], info["delivered_bit"], terms)


def _earth(task: Task) -> int:
    return task.patches.count + task.plan.n + 1


def _talk_outside(task: Task, observation: Array32, looking: NDArray[np.integer]) -> Action:
    # Positions are given in imaging radii.
    outside = np.linalg.norm(task.observation_layout.split(observation)["position"], axis=1) > 1.0
    return np.where(outside, _earth(task), looking).astype(np.int64)
