"""What of a MuJoCo model is more than the packaged CubeSat, by name.

The loop knows rigid hubs that carry reaction wheels, driven by motors. It would pass over anything else without a word: weigh
no further body, drive another wheel by an actuator that stands before it, read no sensor. So everything in a model is either
known here or named, and what is named flies as a spacecraft of one's own.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import mujoco
import numpy as np

from swarm_mj.spacecraft.elements import joint_kind, name_of, subtree_of, title_of
from swarm_mj.spacecraft.properties import SpacecraftProperties
from swarm_mj.typing import Array, Mask

#: Sensors of the packaged spacecraft, whose readings the telemetry holds under names of its own.
KNOWN_SENSORS = ("attitude", "rates", "wheel_x_speed", "wheel_y_speed", "wheel_z_speed")
#: Relative difference of masses and inertias that is put down to rounding and to the digits of an MJCF file.
ROUNDING = 1e-9
#: Centres of mass this close to the free joint are there [m].
CENTRED_M = 1e-9


class Finding(NamedTuple):
    """Something that the packaged CubeSat does not have.

    Attributes:
        element: Kind and name, such as `joint panel`.
        what: What it is.
        allowed: What it has in its place.
    """

    element: str
    what: str
    allowed: str

    def __str__(self) -> str:
        """In one line."""
        return f"{self.element}: {self.what} (allowed: {self.allowed})"


def listed(findings: Sequence[Finding], most: int = 8) -> str:
    """Findings in one line, the first `most` of them."""
    more = f"; and {len(findings) - most} more" if len(findings) > most else ""
    return "; ".join(map(str, findings[:most])) + more


def examine_spacecraft(
    model: mujoco.MjModel, properties: SpacecraftProperties, hub: str, wheels: Sequence[str]
) -> list[Finding]:
    """Everything in the model of one spacecraft that the packaged CubeSat does not have; empty: it is that.

    Args:
        model: The spacecraft alone, with all that its MJCF file holds.
        properties: What the loop and the control law take it for.
        hub: Name of the hub's body.
        wheels: Names of the wheels' bodies, joints and motors, in order.
    """
    strange = [*_strangers(model, hub, wheels), *_sensors(model), *_contacts(model), *acting_elements(model)]
    if strange:
        return strange  # masses and motors are compared where nothing else is amiss
    return [*_motors(model, properties, wheels), *_masses(model, properties, hub, wheels)]


def _strangers(model: mujoco.MjModel, hub: str, wheels: Sequence[str]) -> Iterator[Finding]:
    """Bodies, joints and actuators that are none of the spacecraft's, or that it lacks."""
    known = {"body": {"world", hub, *wheels}, "joint": {"free", *wheels}, "actuator": set(wheels)}
    counts = {"body": model.nbody, "joint": model.njnt, "actuator": model.nactuator}
    allowed = f"{hub}, its free joint, and {', '.join(wheels)} with a motor each"
    for kind, count in counts.items():
        names = [name_of(model, kind, i) for i in range(count)]
        for i, name in enumerate(names):
            if name not in known[kind]:
                yield Finding(title_of(model, kind, i), _described(model, kind, i), allowed)
        yield from (Finding(f"{kind} {name}", "is missing", allowed) for name in sorted(known[kind] - set(names)))
    if model.nkey:
        yield Finding(title_of(model, "keyframe", 0), "a start of its own", "the scenario's start")


def _described(model: mujoco.MjModel, kind: str, i: int) -> str:
    if kind == "body":
        return f"a body of {model.body_mass[i]:g} kg, which nothing would weigh"
    if kind == "joint":
        return f"a {joint_kind(model, i)} joint, which no law steers"
    return "an actuator that no wheel has, which would shift the motors' places"


def _sensors(model: mujoco.MjModel) -> Iterator[Finding]:
    for i in range(model.nsensor):
        if name_of(model, "sensor", i) not in KNOWN_SENSORS:
            kind = mujoco.mjtSensor(model.sensor_type[i]).name.removeprefix("mjSENS_").lower()
            yield Finding(title_of(model, "sensor", i), f"{kind}, which nothing would read", "those it came with")


def _contacts(model: mujoco.MjModel) -> Iterator[Finding]:
    for i in np.flatnonzero(model.geom_contype | model.geom_conaffinity):
        yield Finding(title_of(model, "geom", int(i)), "it may touch others", "contype = conaffinity = 0")
    if model.npair:
        yield Finding(f"contact pair {model.pair(0).name or 'number 0'}", "a contact", "no contacts")


def acting_elements(model: mujoco.MjModel) -> list[Finding]:
    """Everything that acts in a model besides applied forces, motors of constant torque and the bodies' inertia."""
    found = [*_passive(model), *_drives(model)]
    kinds = {"equality": model.neq, "tendon": model.ntendon, "flex": model.nflex, "plugin": model.nplugin}
    for kind, count in kinds.items():
        if count:
            found.append(Finding(title_of(model, kind, 0), f"one of {count}", "none"))
    if model.ngravcomp:
        body = int(np.flatnonzero(model.body_gravcomp)[0])
        found.append(Finding(title_of(model, "body", body), "gravcomp", "no gravity compensation"))
    if model.opt.density or model.opt.viscosity:
        found.append(Finding("option", "density or viscosity of a medium", "a vacuum"))
    return found


def _passive(model: mujoco.MjModel) -> Iterator[Finding]:
    """Springs, dampers, friction and limits of joints."""
    of_joints = {
        "a spring": (model.jnt_stiffness != 0.0) | model.jnt_stiffnesspoly.any(axis=1) | (model.jnt_plasticadr >= 0),
        "a limit": (model.jnt_limited != 0) | (model.jnt_actfrclimited != 0),
    }
    of_dofs = {
        "a damper": (model.dof_damping != 0.0) | model.dof_dampingpoly.any(axis=1),
        "dry friction": model.dof_frictionloss != 0.0,
        "an armature": model.dof_armature != 0.0,
    }
    for word, dofs in of_dofs.items():
        of_joints[word] = np.isin(np.arange(model.njnt), model.dof_jntid[dofs])
    for joint, what in _flagged(of_joints):
        yield Finding(title_of(model, "joint", joint), what, "joints that turn freely")


def _drives(model: mujoco.MjModel) -> Iterator[Finding]:
    """Actuators that are more than torques on their joints."""
    for actuator, what in _flagged(_drive_facts(model)):
        yield Finding(title_of(model, "actuator", actuator), what, "motors of constant torque")


def _drive_facts(model: mujoco.MjModel) -> dict[str, Mask]:
    """How actuators differ from motors that turn their control into torque, each of shape (actuators,)."""
    return {
        "dynamics": model.actuator_dyntype != mujoco.mjtDyn.mjDYN_NONE,
        "a gain that is not constant": model.actuator_gaintype != mujoco.mjtGain.mjGAIN_FIXED,
        "a bias": model.actuator_biastype != mujoco.mjtBias.mjBIAS_NONE,
        "damping": (model.actuator_damping != 0.0) | model.actuator_dampingpoly.any(axis=1),
        "an armature": model.actuator_armature != 0.0,
        "a delay": model.actuator_delay != 0.0,
        "several controls": model.actuator_ctrlnum != 1,
        "a plug-in": model.actuator_plugin >= 0,
    }


def _flagged(facts: dict[str, Mask]) -> Iterator[tuple[int, str]]:
    """Numbers of which something is true, and what, in words."""
    for i in np.flatnonzero(np.any(list(facts.values()), axis=0)):
        yield int(i), " and ".join(word for word, true in facts.items() if true[i])


def motor_faults(model: mujoco.MjModel, actuator: int, joint: int) -> str:
    """How an actuator differs from a motor that turns its control, in N m, into a torque on a joint; empty: not at all."""
    gear = model.actuator_gear[actuator]
    facts = {
        f"it does not drive the joint {name_of(model, 'joint', joint)}": (
            model.actuator_trntype[actuator] != mujoco.mjtTrn.mjTRN_JOINT or model.actuator_trnid[actuator, 0] != joint
        ),
        f"gear {' '.join(f'{g:g}' for g in gear)}, not 1": gear[0] != 1.0 or gear[1:].any(),
        f"gain {model.actuator_gainprm[actuator, 0]:g}, not 1": model.actuator_gainprm[actuator, 0] != 1.0,
    }
    drive = [word for word, true in _drive_facts(model).items() if true[actuator]]
    return " and ".join([*drive, *(word for word, true in facts.items() if true)])


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


def _motors(model: mujoco.MjModel, properties: SpacecraftProperties, wheels: Sequence[str]) -> Iterator[Finding]:
    limit = properties.max_wheel_torque
    for wheel in wheels:
        actuator, joint = model.actuator(wheel).id, model.joint(wheel).id
        if what := motor_faults(model, actuator, joint):
            yield Finding(f"actuator {wheel}", what, f"a motor of gear 1 on the joint {wheel}")
        low, high = torque_range(model, actuator)
        if not np.allclose((low, high), (-limit, limit), rtol=ROUNDING, atol=0.0):
            yield Finding(f"actuator {wheel}", f"a torque of {low:g} to {high:g} N m", f"{-limit:g} to {limit:g} N m")


def _masses(
    model: mujoco.MjModel, properties: SpacecraftProperties, hub: str, wheels: Sequence[str]
) -> Iterator[Finding]:
    """Mass, centre of mass, inertia and wheels of the model, against what the loop takes them for."""
    measured = measure(model, hub, wheels)
    scale = float(np.trace(properties.inertia_B))
    expected = f"{properties.mass:g} kg, as the scenario's spacecraft"
    if abs(measured.mass - properties.mass) > ROUNDING * properties.mass:
        yield Finding(f"body {hub}", f"weighs {measured.mass:.9g} kg with all it carries", expected)
    if np.linalg.norm(measured.centre_B) > CENTRED_M:
        where = f"its centre of mass stands at {np.round(measured.centre_B, 6).tolist()} m"
        yield Finding(f"body {hub}", where, "at the free joint")
    if np.abs(measured.inertia_B - properties.inertia_B).max() > ROUNDING * scale:
        what = f"has the inertia {np.round(measured.inertia_B, 9).tolist()} kg m^2 with all it carries"
        yield Finding(f"body {hub}", what, f"{np.round(properties.inertia_B, 9).tolist()} kg m^2, by the scenario")
    spin = properties.wheel_spin_inertia
    for wheel, axis, momentum in zip(wheels, properties.wheel_axes_B, measured.wheel_momentum_B, strict=True):
        if np.abs(momentum - spin * axis).max() > ROUNDING * spin:
            what = f"carries {np.round(momentum, 12).tolist()} kg m^2/s at 1 rad/s"
            yield Finding(f"joint {wheel}", what, f"{np.round(spin * axis, 12).tolist()} kg m^2/s, by the scenario")


class Measured(NamedTuple):
    """Mass properties of one compiled spacecraft in the configuration in which its file holds it.

    Attributes:
        mass: [kg].
        centre_B: Centre of mass relative to the hub's origin, shape (3,) [m].
        inertia_B: About the centre of mass, every joint locked, shape (3, 3) [kg m^2].
        wheel_momentum_B: Angular momentum of each wheel at 1 rad/s relative to a hub at rest, shape (w, 3) [kg m^2/s]: its spin
            inertia times its axis, if it is balanced.
    """

    mass: float
    centre_B: Array
    inertia_B: Array
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
