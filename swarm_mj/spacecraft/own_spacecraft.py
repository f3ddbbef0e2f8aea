"""A spacecraft of one's own, read from an MJCF file: what must be found in it by name, and what is measured of it.

What the file must hold:

- one body of the world with a free joint, the hub, whose origin and axes are the frame B; everything else hangs on it;
- the reaction wheels: hinge joints whose names begin with `wheel`, three or more, alike, each of a body fixed to the hub;
- a motor of the same name as each of them, with gear 1 and a symmetric `ctrlrange`, its torque limit [N m].

Anything else may be there: bodies on hinges with springs and dampers, sliding masses, tendons, contacts, actuators that hold
still, sensors, meshes. A keyframe named `start` gives the joints' initial positions and velocities. Nothing is taken out, and
`mj_step` flies it. A wheel's speed limit and the size of the drawn box are the scenario's, for no MJCF file says them.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from swarm_mj.errors import MissionError, ScenarioError
from swarm_mj.io.records import one_line
from swarm_mj.spacecraft.elastic import Mode, modes_of
from swarm_mj.spacecraft.elements import id_of, joint_kind, joints_of, name_of, title_of
from swarm_mj.spacecraft.measurement import Measured, measure, motor_faults, torque_range
from swarm_mj.spacecraft.model_limits import check_model
from swarm_mj.spacecraft.properties import SpacecraftProperties
from swarm_mj.spacecraft.sensors import Sensor, sensors_of
from swarm_mj.spacecraft.template import read_spec
from swarm_mj.spacecraft.thrusters import ThrusterAllocation, read_nozzles
from swarm_mj.typing import Array

#: How the names of the wheels' joints and motors begin.
WHEEL = "wheel"
#: Name of the keyframe from which the joints start.
START = "start"
#: Relative difference of two wheels of one spacecraft that is put down to the digits of the file.
ALIKE = 1e-6

Rows = tuple[tuple[float, ...], ...]


@dataclass(frozen=True, kw_only=True)
class MeasuredProperties(SpacecraftProperties):
    """Mass properties and wheels of a spacecraft as they were measured of its compiled model."""

    inertia_rows_B: Rows  #: inertia about the centre of mass at the start, every joint locked, rows [kg m^2]
    axis_rows_B: Rows  #: spin axes of the wheels, rows
    centre_B: tuple[float, float, float]  #: centre of mass relative to the hub's origin at the start [m]

    @property
    def n_wheels(self) -> int:
        """Number of wheels w."""
        return len(self.axis_rows_B)

    @property
    def wheel_axes_B(self) -> Array:
        """Spin axes as rows, shape (w, 3)."""
        return np.array(self.axis_rows_B)

    @property
    def inertia_B(self) -> Array:
        """Inertia about the centre of mass, every joint locked, shape (3, 3) [kg m^2]."""
        return np.array(self.inertia_rows_B)


@dataclass(frozen=True)
class ExtraJoint:
    """A joint that is neither the hub's nor a wheel's."""

    name: str  #: in the file, or by its number
    kind: str  #: hinge, slide or ball


@dataclass(frozen=True, kw_only=True)
class OwnSpacecraft:
    """What was read of a spacecraft's file."""

    path: Path  #: the file
    hub: str  #: name of the body with the free joint
    wheels: tuple[str, ...]  #: names of the wheels' joints and motors, in the file's order
    joints: tuple[ExtraJoint, ...]  #: all other joints
    sensors: tuple[Sensor, ...]  #: in the file's order
    properties: MeasuredProperties  #: measured, for loop and control law
    #: positions of all joints at the start, in the order of the file alone; the hub's are the scenario's
    start_qpos: tuple[float, ...]
    start_qvel: tuple[float, ...]  #: their velocities
    start_ctrl: tuple[float, ...]  #: controls of all actuators; those of the wheels are the control law's
    remarks: tuple[str, ...]  #: what a reader should know
    strength: float  #: of its thrusters, see `ThrusterAllocation`; 0 without thrusters


class _Refused(Exception):
    """Why a file is no spacecraft that can be flown; `read_spacecraft` says of which file."""


def read_spacecraft(path: Path, planned: SpacecraftProperties) -> OwnSpacecraft:
    """Read a spacecraft's file and measure what it describes.

    Args:
        path: The MJCF file.
        planned: What the scenario says: its speed limit of the wheels and size of the box are taken, and its torque limit where
            the file has none.

    Raises:
        ScenarioError: The file cannot be read, or holds no such spacecraft; the message names the element and the remedy.
    """
    part = load_part(path)
    try:
        model = part.compile()
        return _read(path, model, planned)
    except (ValueError, _Refused) as error:
        raise ScenarioError(f"spacecraft.mjcf = {path}: {one_line(error)}") from None


def small_motions(own: OwnSpacecraft) -> list[Mode]:
    """Motions of its joints about the start, the fastest first."""
    return modes_of(load_part(own.path).compile(), np.array(own.start_qpos), [joint.name for joint in own.joints])


def load_part(path: Path) -> mujoco.MjSpec:
    """The file as MuJoCo's specification, with a name for every body, joint, actuator and sensor that has none.

    Raises:
        ScenarioError: It cannot be read, or is no MJCF.
    """
    try:
        check_model(path)
        part = read_spec(path)
    except (OSError, ValueError) as error:
        raise ScenarioError(f"spacecraft.mjcf = {path}: MuJoCo cannot read it: {one_line(error)}") from None
    _name_the_nameless(part)
    return part


def _name_the_nameless(part: mujoco.MjSpec) -> None:
    for kind, elements in (
        ("body", part.bodies[1:]),
        ("joint", part.joints),
        ("actuator", part.actuators),
        ("sensor", part.sensors),
    ):
        taken = {element.name for element in elements}
        for k, element in enumerate(elements, 1):
            if not element.name:
                name = f"{kind}_{k}"
                while name in taken:
                    name += "_"
                element.name = name
                taken.add(name)


def _read(path: Path, model: mujoco.MjModel, planned: SpacecraftProperties) -> OwnSpacecraft:
    hub = _find_hub(model)
    wheels = _find_wheels(model, hub)
    for wheel in wheels:
        _check_motor(model, wheel)
    start = _start(model)
    found = measure(model, name_of(model, "body", hub), wheels, start[0])
    properties = _properties(model, wheels, found, planned)
    strength = 0.0 if planned.thrusters is None else _strength(model, hub, planned.thrusters.propellant_kg)
    others = [
        j for j in range(model.njnt) if j not in joints_of(model, hub) and name_of(model, "joint", j) not in wheels
    ]
    qpos, qvel, ctrl = (tuple(row.tolist()) for row in start)
    return OwnSpacecraft(
        path=path,
        hub=name_of(model, "body", hub),
        wheels=wheels,
        joints=tuple(ExtraJoint(name_of(model, "joint", j), joint_kind(model, j)) for j in others),
        sensors=sensors_of(model),
        properties=properties,
        start_qpos=qpos,
        start_qvel=qvel,
        start_ctrl=ctrl,
        remarks=tuple(_remarks(model, wheels, properties, planned)),
        strength=strength,
    )


def _find_hub(model: mujoco.MjModel) -> int:
    """The body with the free joint, on which everything else hangs.

    Raises:
        _Refused: There is none, or several, or something stands beside it.
    """
    roots = [i for i in range(1, model.nbody) if model.body_parentid[i] == 0]
    free = mujoco.mjtJoint.mjJNT_FREE
    hubs = [i for i in roots if any(model.jnt_type[j] == free for j in joints_of(model, i))]
    if len(hubs) != 1:
        named = ", ".join(title_of(model, "body", i) for i in hubs) or "none of " + (
            ", ".join(title_of(model, "body", i) for i in roots) or "no bodies"
        )
        raise _Refused(
            f"a spacecraft is one body with a free joint, the hub, and what hangs on it; the file has {named}. Give the hub a "
            "<freejoint/> and put all other bodies inside it"
        )
    if beside := [title_of(model, "body", i) for i in roots if i != hubs[0]]:
        raise _Refused(
            f"{', '.join(beside)}: stands beside the hub, fixed in space; put it inside {title_of(model, 'body', hubs[0])}"
        )
    if fixed := [title_of(model, "geom", i) for i in range(model.ngeom) if model.geom_bodyid[i] == 0]:
        raise _Refused(f"{', '.join(fixed)}: fixed in space; put it inside a body of the spacecraft")
    for i in range(model.neq):
        if 0 in _tied_bodies(model, i):
            raise _Refused(
                f"{title_of(model, 'equality', i)}: ties the spacecraft to a point in space; name two of its bodies"
            )
    return hubs[0]


def _tied_bodies(model: mujoco.MjModel, equality: int) -> list[int]:
    """The bodies that an equality constraint ties together; empty if it ties something else, such as joints."""
    ends = [int(model.eq_obj1id[equality]), int(model.eq_obj2id[equality])]
    if model.eq_objtype[equality] == mujoco.mjtObj.mjOBJ_SITE:
        return [int(model.site_bodyid[site]) for site in ends]
    return ends if model.eq_objtype[equality] == mujoco.mjtObj.mjOBJ_BODY else []


def _find_wheels(model: mujoco.MjModel, hub: int) -> tuple[str, ...]:
    """Names of the wheels, in the file's order.

    Raises:
        _Refused: There are fewer than three, or one is no wheel of the hub.
    """
    wheels = [j for j in range(model.njnt) if name_of(model, "joint", j).startswith(WHEEL)]
    names = tuple(name_of(model, "joint", j) for j in wheels)
    if len(wheels) < 3:
        raise _Refused(
            f"needs three reaction wheels or more: hinge joints whose names begin with {WHEEL!r}, such as wheel_x, and motors "
            f"of the same names; it has {', '.join(names) or 'none'}"
        )
    for j in wheels:
        body = int(model.jnt_bodyid[j])
        if joint_kind(model, j) != "hinge" or len(joints_of(model, body)) != 1:
            raise _Refused(
                f"{title_of(model, 'joint', j)}: a wheel turns on one hinge; this is a {joint_kind(model, j)} joint"
            )
        while (body := int(model.body_parentid[body])) != hub:
            if joints_of(model, body):
                raise _Refused(
                    f"{title_of(model, 'joint', j)}: its wheel hangs on {title_of(model, 'body', body)}, which moves against "
                    "the hub; wheels must be fixed to the hub"
                )
    return names


def _strength(model: mujoco.MjModel, hub: int, propellant: float) -> float:
    """The strength of its nozzles.

    Raises:
        _Refused: There are no nozzles, or the tank does not fit into the hub.
    """
    try:
        strength = ThrusterAllocation(read_nozzles(model, hub), model.body_ipos[hub]).strength
    except MissionError as error:
        raise _Refused(str(error)) from None
    if propellant >= (mass := float(model.body_mass[hub])):
        raise _Refused(f"spacecraft.thrusters.propellant_kg = {propellant:g}: must be below the hub's {mass:g} kg")
    return strength


def _check_motor(model: mujoco.MjModel, wheel: str) -> None:
    """See that a wheel is driven by the motor of its name and by nothing else.

    Raises:
        _Refused: It is not.
    """
    joint, motor = id_of(model, "joint", wheel), id_of(model, "actuator", wheel)
    on_a_joint = model.actuator_trntype == mujoco.mjtTrn.mjTRN_JOINT
    drivers = np.flatnonzero(on_a_joint & (model.actuator_trnid[:, 0] == joint))
    others = [title_of(model, "actuator", int(i)) for i in drivers if i != motor]
    if motor < 0:
        hint = f"; {', '.join(others)} drives it: name it {wheel}" if others else ""
        raise _Refused(f"joint {wheel}: there is no motor of its name{hint}")
    if others:
        raise _Refused(f"joint {wheel}: {', '.join(others)} drives it besides its motor")
    if what := motor_faults(model, motor, joint):
        raise _Refused(f"actuator {wheel}: {what}; a wheel needs <motor name={wheel!r} joint={wheel!r} ctrlrange=.../>")
    low, high = torque_range(model, motor)
    if low != -high or not high > 0.0:
        raise _Refused(
            f"actuator {wheel}: a torque of {low:g} to {high:g} N m; ctrlrange must be symmetric, such as -0.004 0.004"
        )


def _start(model: mujoco.MjModel) -> tuple[Array, Array, Array]:
    """Positions, velocities and controls at the start: of the keyframe of that name, else those of the file."""
    key = id_of(model, "keyframe", START)
    if key < 0:
        return model.qpos0.copy(), np.zeros(model.nv), np.zeros(model.nu)
    return model.key_qpos[key].copy(), model.key_qvel[key].copy(), model.key_ctrl[key].copy()


def _properties(
    model: mujoco.MjModel, wheels: Sequence[str], found: Measured, planned: SpacecraftProperties
) -> MeasuredProperties:
    """What loop and control law are to know.

    Raises:
        _Refused: The wheels are not alike, or turn the spacecraft about fewer than three axes.
    """
    spin = np.linalg.norm(found.wheel_momentum_B, axis=1)
    limits = np.array([torque_range(model, id_of(model, "actuator", wheel))[1] for wheel in wheels])
    masses = np.array([model.body_subtreemass[model.joint(wheel).bodyid[0]] for wheel in wheels])
    for what, values, unit in (("spin inertias", spin, "kg m^2"), ("torque limits", limits, "N m")):
        if not np.allclose(values, values[0], rtol=ALIKE, atol=0.0):
            listed = ", ".join(f"{wheel} {value:g}" for wheel, value in zip(wheels, values, strict=True))
            raise _Refused(f"wheels of one spacecraft must be alike, but have the {what} {listed} {unit}")
    if not spin[0] > 0.0:
        raise _Refused(f"joint {wheels[0]}: the wheel has no inertia about its axis; give its body an <inertial>")
    axes = found.wheel_momentum_B / spin[:, None]
    if np.linalg.matrix_rank(axes, tol=1e-3) < 3:
        raise _Refused(
            f"the axes of {', '.join(wheels)} lie in one plane; wheels must turn the spacecraft about all three axes"
        )
    return MeasuredProperties(
        mass=found.mass,
        size=planned.size,
        wheel_mass=float(masses[0]),
        wheel_spin_inertia=float(spin[0]),
        wheel_transverse_inertia=planned.wheel_transverse_inertia,
        max_wheel_torque=float(limits[0]) if np.isfinite(limits[0]) else planned.max_wheel_torque,
        max_wheel_speed=planned.max_wheel_speed,
        thrusters=planned.thrusters,
        inertia_rows_B=_rows(found.inertia_B),
        axis_rows_B=_rows(axes),
        centre_B=tuple(found.centre_B.tolist()),
    )


def _rows(matrix: Array) -> Rows:
    return tuple(tuple(row) for row in matrix.tolist())


def _remarks(
    model: mujoco.MjModel, wheels: Sequence[str], properties: MeasuredProperties, planned: SpacecraftProperties
) -> Iterator[str]:
    """What of the file is not as its author may think."""
    for i in range(model.nactuator):
        if name_of(model, "actuator", i) not in wheels:
            yield f"{title_of(model, 'actuator', i)} belongs to no wheel: nobody commands it, its control stays as at the start"
    if not np.isfinite(torque_range(model, id_of(model, "actuator", wheels[0]))[1]):
        limit = planned.max_wheel_torque
        yield f"the motors have no ctrlrange: spacecraft.wheel.max_torque_n_m = {limit:g} N m is their limit"
    if model.opt.integrator not in (mujoco.mjtIntegrator.mjINT_EULER, mujoco.mjtIntegrator.mjINT_RK4):
        name = mujoco.mjtIntegrator(model.opt.integrator).name.removeprefix("mjINT_")
        yield f"option integrator = {name} of the file is not used: flights are integrated by RK4"
    if model.nkey and id_of(model, "keyframe", START) < 0:
        yield f"no keyframe of the file is named {START!r}: the joints begin at their reference positions"
    if model.nsensor and model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_SENSOR:
        yield "option flag sensor = disable of the file: its sensors read zero"
    if model.ngravcomp:
        yield "gravcomp of the file has no effect: the small body's gravity is applied as forces"
    offset = float(np.linalg.norm(properties.centre_B))
    if offset > 1e-6:
        yield f"the centre of mass stands {1e3 * offset:.3g} mm off the hub's origin, which is where r_BN_N points to"
