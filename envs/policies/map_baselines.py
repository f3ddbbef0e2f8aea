"""Scripted policies of SwarmMap-v0: what a trained agent has to beat."""

from __future__ import annotations

import numpy as np

from swarm_mj.typing import Array, Array32

from ..observe.task import Task
from .baselines import Action, Policy, positions_A
from .policy import geometry_of

#: How long the sweep stays on a patch [s].
DWELL_S = 240.0


def body_centre(task: Task, observation: Array32) -> Action:
    """All look at the body's centre."""
    return np.full(task.plan.n, task.patches.count)


def sweep(task: Task, observation: Array32) -> Action:
    """Everyone goes through all patches by number, each starting at another place."""
    n, count = task.plan.n, task.patches.count
    start = np.arange(n) * count // n
    return np.asarray((start + int(time_s(task, observation) / DWELL_S)) % count)


def greedy(task: Task, observation: Array32) -> Action:
    """Everyone takes the patch with most to see now, each a different one: unseen, lit, turned to it and near enough.

    Of what is left of a patch a picture shows no more than its footprint.
    """
    parts = task.observation_layout.split(observation)
    worth, n = patch_worth(task, parts, time_s(task, observation)), task.plan.n
    choice = np.zeros(n, np.int64)
    for j in range(n):
        choice[j] = int(np.argmax(worth[j])) if worth[j].max() > 0.0 else task.patches.count
        worth[:, choice[j] % task.patches.count] *= 1e-3
    return choice


def patch_worth(task: Task, parts: dict[str, Array32], t: float) -> Array:
    """Area that a picture of each patch by each spacecraft would add, about, shape (n, K) [m^2]."""
    geometry, criterion, environment = geometry_of(task), task.criterion, task.plan.environment
    to_camera = positions_A(task, parts)[:, None] - geometry.centre_A
    distance = np.linalg.norm(to_camera, axis=2)
    cosine = np.einsum("jki,ki->jk", to_camera, geometry.normal_A) / distance
    gsd = distance * geometry.pixel_angle / np.maximum(cosine, 1e-6)
    sun_A = environment.C_AN(t) @ environment.sun.at(t)
    limit_deg = criterion.max_incidence_deg or (90.0 if criterion.shadows else 180.0)
    lit = geometry.normal_A @ (sun_A / np.linalg.norm(sun_A)) >= np.cos(np.radians(limit_deg))
    footprint = (2.0 * distance * np.tan(geometry.half_angle)) ** 2 / np.maximum(cosine, 0.2)
    # A picture shows the middle of a patch, of which what is seen already is taken to be a part.
    new = np.maximum(np.minimum(geometry.area, footprint) - parts["patches"] * geometry.area, 0.0)
    return np.asarray(new * lit * (cosine > 0.0) * (gsd <= geometry.max_gsd))


def time_s(task: Task, observation: Array32) -> float:
    """Past the epoch [s]."""
    left = float(task.observation_layout.split(observation)["time_left"])
    return (1.0 - left) * task.plan.scenario.duration_s


MAP_POLICIES: dict[str, Policy] = {"body centre": body_centre, "sweep": sweep, "greedy": greedy}
