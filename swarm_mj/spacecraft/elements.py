"""Elements of a MuJoCo model by kind and name."""

from __future__ import annotations

import mujoco

_OBJECTS = {
    "body": mujoco.mjtObj.mjOBJ_BODY,
    "joint": mujoco.mjtObj.mjOBJ_JOINT,
    "geom": mujoco.mjtObj.mjOBJ_GEOM,
    "site": mujoco.mjtObj.mjOBJ_SITE,
    "actuator": mujoco.mjtObj.mjOBJ_ACTUATOR,
    "sensor": mujoco.mjtObj.mjOBJ_SENSOR,
    "equality": mujoco.mjtObj.mjOBJ_EQUALITY,
    "tendon": mujoco.mjtObj.mjOBJ_TENDON,
    "flex": mujoco.mjtObj.mjOBJ_FLEX,
    "plugin": mujoco.mjtObj.mjOBJ_PLUGIN,
    "keyframe": mujoco.mjtObj.mjOBJ_KEY,
}
#: Numbers of a joint in qpos and in qvel, by its type.
_SIZES = {
    int(mujoco.mjtJoint.mjJNT_FREE): (7, 6),
    int(mujoco.mjtJoint.mjJNT_BALL): (4, 3),
    int(mujoco.mjtJoint.mjJNT_SLIDE): (1, 1),
    int(mujoco.mjtJoint.mjJNT_HINGE): (1, 1),
}


def id_of(model: mujoco.MjModel, kind: str, name: str) -> int:
    """Number of an element; -1: there is none of that name."""
    return int(mujoco.mj_name2id(model, _OBJECTS[kind], name))


def name_of(model: mujoco.MjModel, kind: str, i: int) -> str:
    """Name of an element; empty if it has none."""
    return mujoco.mj_id2name(model, _OBJECTS[kind], i) or ""


def title_of(model: mujoco.MjModel, kind: str, i: int) -> str:
    """Kind and name of an element as they stand in messages, such as `joint panel`."""
    return f"{kind} {name_of(model, kind, i) or f'number {i} (without a name)'}"


def joint_kind(model: mujoco.MjModel, j: int) -> str:
    """What a joint is: free, ball, slide or hinge."""
    return mujoco.mjtJoint(model.jnt_type[j]).name.removeprefix("mjJNT_").lower()


def joints_of(model: mujoco.MjModel, body: int) -> list[int]:
    """Numbers of the joints by which a body moves against its parent."""
    first = int(model.body_jntadr[body])
    return list(range(first, first + int(model.body_jntnum[body])))


def qpos_indices(model: mujoco.MjModel, joint: int) -> range:
    """Indices of a joint's position in `qpos`."""
    first = int(model.jnt_qposadr[joint])
    return range(first, first + _SIZES[int(model.jnt_type[joint])][0])


def qvel_indices(model: mujoco.MjModel, joint: int) -> range:
    """Indices of a joint's velocity in `qvel`."""
    first = int(model.jnt_dofadr[joint])
    return range(first, first + _SIZES[int(model.jnt_type[joint])][1])


def subtree_of(model: mujoco.MjModel, root: int) -> range:
    """A body of the world and everything that hangs on it: MuJoCo numbers bodies depth first, so they stand together."""
    end = root + 1
    while end < model.nbody and model.body_rootid[end] == root:
        end += 1
    return range(root, end)
