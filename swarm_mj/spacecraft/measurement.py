"""What a compiled spacecraft weighs, how its wheels carry momentum, and how its actuators differ from plain motors."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import mujoco
import numpy as np

from swarm_mj.spacecraft.elements import name_of, subtree_of
from swarm_mj.typing import Array


class Measured(NamedTuple):
    """Mass properties of one compiled spacecraft in the configuration in which its file holds it."""

    mass: float  #: [kg]
    centre_B: Array  #: centre of mass relative to the hub's origin, shape (3,) [m]
    inertia_B: Array  #: about the centre of mass, every joint locked, shape (3, 3) [kg m^2]
    #: angular momentum of each wheel at 1 rad/s relative to a hub at rest, shape (w, 3) [kg m^2/s]: its spin inertia times its
    #: axis, if it is balanced
    wheel_momentum_B: Array


def measure(model: mujoco.MjModel, hub: str, wheels: Sequence[str], qpos: Array | None = None) -> Measured:
    """Weigh a spacecraft; `qpos` other than the file's turns its joints, and where its free joint stands does not matter."""
    data, body = mujoco.MjData(model), model.body(hub).id
    if qpos is not None:
        data.qpos[:] = qpos
    free = int(model.jnt_qposadr[model.body_jntadr[body]])
    data.qpos[free : free + 7] = 0, 0, 0, 1, 0, 0, 0  # frames N and B coincide
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    centre, inertia = data.subtree_com[body].copy(), np.zeros((3, 3))
    for i in subtree_of(model, body):
        inertia += _about(
            data.ximat[i].reshape(3, 3), model.body_inertia[i], model.body_mass[i], data.xipos[i] - centre
        )
    momenta = [_momentum(model, data, int(model.jnt_dofadr[model.joint(wheel).id])) for wheel in wheels]
    return Measured(float(model.body_subtreemass[body]), centre, inertia, np.array(momenta).reshape(-1, 3))


def _about(axes: Array, moments: Array, mass: float, offset: Array) -> Array:
    """Inertia of a body about a point at `-offset` from its centre of mass, shape (3, 3) [kg m^2]."""
    return (axes * moments) @ axes.T + mass * (offset @ offset * np.eye(3) - np.outer(offset, offset))


def _momentum(model: mujoco.MjModel, data: mujoco.MjData, dof: int) -> Array:
    """Angular momentum of the whole about its centre of mass when one joint moves at 1 rad/s, shape (3,) [kg m^2/s]."""
    data.qvel[:] = 0.0
    data.qvel[dof] = 1.0
    mujoco.mj_comVel(model, data)
    mujoco.mj_subtreeVel(model, data)
    return np.asarray(data.subtree_angmom[model.body_rootid[model.dof_bodyid[dof]]]).copy()


def motor_faults(model: mujoco.MjModel, actuator: int, joint: int) -> str:
    """How an actuator differs from a motor that turns its control, in N m, into a torque on a joint; empty: not at all."""
    gear, gain = model.actuator_gear[actuator], model.actuator_gainprm[actuator, 0]
    facts = {
        "dynamics": model.actuator_dyntype[actuator] != mujoco.mjtDyn.mjDYN_NONE,
        "a gain that is not constant": model.actuator_gaintype[actuator] != mujoco.mjtGain.mjGAIN_FIXED,
        "a bias": model.actuator_biastype[actuator] != mujoco.mjtBias.mjBIAS_NONE,
        "damping": model.actuator_damping[actuator] != 0.0 or model.actuator_dampingpoly[actuator].any(),
        "an armature": model.actuator_armature[actuator] != 0.0,
        "a delay": model.actuator_delay[actuator] != 0.0,
        "several controls": model.actuator_ctrlnum[actuator] != 1,
        "a plug-in": model.actuator_plugin[actuator] >= 0,
        f"it does not drive the joint {name_of(model, 'joint', joint)}": (
            model.actuator_trntype[actuator] != mujoco.mjtTrn.mjTRN_JOINT or model.actuator_trnid[actuator, 0] != joint
        ),
        f"gear {' '.join(f'{g:g}' for g in gear)}, not 1": gear[0] != 1.0 or gear[1:].any(),
        f"gain {gain:g}, not 1": gain != 1.0,
    }
    return " and ".join(word for word, true in facts.items() if true)


def torque_range(model: mujoco.MjModel, actuator: int) -> Array:
    """Lowest and highest torque that an actuator gives by its control and force ranges [N m]; infinite where unlimited."""
    low, high = -np.inf, np.inf
    for limited, limits in (
        (model.actuator_ctrllimited[actuator], model.actuator_ctrlrange[actuator]),
        (model.actuator_forcelimited[actuator], model.actuator_forcerange[actuator]),
    ):
        if limited:
            low, high = max(low, limits[0]), min(high, limits[1])
    return np.array([low, high])
