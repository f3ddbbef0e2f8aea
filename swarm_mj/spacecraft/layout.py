"""Where the parts of every spacecraft stand in MuJoCo's arrays, found by name.

Spacecraft j carries the prefix `sc{j}_`, counted from 1. What a compiled model holds in which order is MuJoCo's affair; the
loop reads and writes through these index arrays.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from swarm_mj.errors import MissionError
from swarm_mj.spacecraft.elements import id_of, joints_of, qpos_indices, qvel_indices, subtree_of, title_of
from swarm_mj.typing import Ints


def spacecraft_names(n: int) -> tuple[str, ...]:
    """Names of n spacecraft: sc1, sc2, ..."""
    return tuple(f"sc{j + 1}" for j in range(n))


@dataclass(frozen=True)
class Layout:
    """Places of n spacecraft with w wheels each in the arrays of an MjModel and its MjData."""

    hub_body: Ints  #: body ids of the hubs, shape (n,)
    bodies: Ints  #: body ids of every body of a spacecraft, the hub first, shape (n, bodies)
    qpos: Ints  #: where hub position (3), hub attitude (4) and wheel angles stand in `qpos`, shape (n, 7 + w)
    qvel: Ints  #: where hub velocity (3), body rate (3) and wheel speeds stand in `qvel`, shape (n, 6 + w)
    actuators: Ints  #: ids of the wheels' motors, shape (n, w)
    ctrl: Ints  #: where their torques stand in `ctrl`, shape (n, w)
    all_qpos: Ints  #: every number of a spacecraft in `qpos`, shape (n, ...)
    all_qvel: Ints  #: the same in `qvel`, shape (n, ...)


def resolve_layout(model: mujoco.MjModel, names: Sequence[str], *, hub: str, wheels: Sequence[str]) -> Layout:
    """Find the parts of every spacecraft.

    Args:
        model: The compiled swarm.
        names: Of the spacecraft; `NAME_` is the prefix of their parts.
        hub: Name of the hub's body without prefix; the free joint is its only one.
        wheels: Names of the wheels' joints and motors without prefix, in order.

    Raises:
        MissionError: A part is not there, or is something else; the message names it.
    """
    hubs = [_named(model, "body", f"{name}_{hub}") for name in names]
    motors = [[_named(model, "actuator", f"{name}_{wheel}") for wheel in wheels] for name in names]
    joints = [[_free_joint(model, body)] for body in hubs]
    for row, name in zip(joints, names, strict=True):
        row += [_named(model, "joint", f"{name}_{wheel}") for wheel in wheels]
    bodies = [list(subtree_of(model, body)) for body in hubs]
    every = [[j for body in row for j in joints_of(model, body)] for row in bodies]
    actuators = np.array(motors, np.int64)
    return Layout(
        hub_body=np.array(hubs, np.int64),
        bodies=np.array(bodies, np.int64),
        qpos=_rows(qpos_indices, model, joints),
        qvel=_rows(qvel_indices, model, joints),
        actuators=actuators,
        ctrl=model.actuator_ctrladr[actuators].astype(np.int64),
        all_qpos=_rows(qpos_indices, model, every),
        all_qvel=_rows(qvel_indices, model, every),
    )


def _named(model: mujoco.MjModel, kind: str, name: str) -> int:
    found = id_of(model, kind, name)
    if found < 0:
        raise MissionError(f"the compiled model has no {kind} {name}; was the MJCF changed?")
    return found


def _free_joint(model: mujoco.MjModel, body: int) -> int:
    joints = joints_of(model, body)
    if len(joints) != 1 or model.jnt_type[joints[0]] != mujoco.mjtJoint.mjJNT_FREE:
        raise MissionError(f"{title_of(model, 'body', body)}: a hub must have a free joint and no other one")
    return joints[0]


def _rows(indices: Callable[[mujoco.MjModel, int], range], model: mujoco.MjModel, joints: list[list[int]]) -> Ints:
    return np.array([[k for j in row for k in indices(model, j)] for row in joints], np.int64)
