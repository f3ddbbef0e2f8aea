"""The MuJoCo model of a swarm: one asteroid on a mocap body and N CubeSats, assembled from the two MJCF parts.

World frame N (asteroid's centre, ecliptic J2000), SI. Spacecraft j carries the prefix `sc{j}_`, counted from 1. The CubeSat is
a template that the scenario fills with masses, wheels and a camera; `model_guard` looks whether it still is what the fast
stepper can fly. Spacecraft from a file of one's own are assembled by `own_model`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import mujoco
import numpy as np

from swarm_mj.errors import MissionError
from swarm_mj.io.resources import asset_path
from swarm_mj.smallbody.shape import ShapeModel
from swarm_mj.spacecraft.elements import title_of
from swarm_mj.spacecraft.gyrostat import NQ_FREE, NV_FREE, axial_momentum, with_wheels
from swarm_mj.spacecraft.layout import Layout, resolve_layout, spacecraft_names
from swarm_mj.spacecraft.model_guard import ROUNDING, Finding, examine_spacecraft, listed
from swarm_mj.spacecraft.own_spacecraft import OwnSpacecraft
from swarm_mj.spacecraft.properties import WHEEL_STATIONS_M, SpacecraftProperties
from swarm_mj.typing import Array, Ints

#: The template, its hub, and its wheels where they are orthogonal.
TEMPLATE, HUB, WHEELS = "mjcf/cubesat.xml", "cubesat", ("wheel_x", "wheel_y", "wheel_z")
#: qpos and qvel of one spacecraft: free joint (7, 6) and three wheels; the loop's kernels rely on this contiguous layout.
#: With four wheels MuJoCo holds one number more of each, and `FaultInjection` hands the kernels the first three.
#: Where wheels are no bodies, `SwarmModel.state` gives the same layout.
NQ, NV = 10, 9

#: The log file that MuJoCo writes into the current folder unless told otherwise.
DEFAULT_LOG = "MUJOCO_LOG.TXT"

WheelModel = Literal["bodies", "gyrostat"]
#: How a swarm is to be stepped: by compiled code around MuJoCo's accelerations, by `mj_step`, or by the first that can.
Stepper = Literal["auto", "fast", "mj_step"]


@dataclass(frozen=True)
class SwarmModel:
    """A compiled swarm and the places of its parts.

    Attributes:
        mjmodel: The compiled model.
        names: Prefix-free spacecraft names `sc1`, `sc2`, ..., in gene order.
        layout: Where the spacecraft's parts stand in MuJoCo's arrays.
        asteroid_mocap: Mocap id of the asteroid.
        properties: Mass properties and wheels of every spacecraft.
        wheels: Whether wheels are bodies on hinges or momentum states; `Integrator` steps both, `mj_step` the former.
        stepper: How it is to be stepped.
        own: What was read of a spacecraft of one's own, which flies by `mj_step`; None: the packaged CubeSat.
    """

    mjmodel: mujoco.MjModel
    names: tuple[str, ...]
    layout: Layout
    asteroid_mocap: int
    properties: SpacecraftProperties
    wheels: WheelModel = "bodies"
    stepper: Stepper = "auto"
    own: OwnSpacecraft | None = None

    @property
    def n(self) -> int:
        """Number of spacecraft."""
        return len(self.names)

    @property
    def hub_body(self) -> Ints:
        """Body ids of the hubs, shape (n,)."""
        return self.layout.hub_body

    def state(self, data: mujoco.MjData) -> tuple[Array, Array]:
        """Positions and velocities by spacecraft, wheels included, whichever way they are modelled.

        Returns:
            Position in N [m], quaternion, w wheel angles, shape (n, 7 + w), and velocity in N [m/s], body rate in B [rad/s],
            wheel speeds relative to the hub [rad/s], shape (n, 6 + w). Views of MuJoCo's arrays where these hold nothing else;
            copies of a spacecraft of one's own, and, with zero for the angles, where wheels are momentum states.
        """
        if self.own is not None:
            return data.qpos[self.layout.qpos], data.qvel[self.layout.qvel]
        if self.wheels == "bodies":
            return data.qpos.reshape(self.n, -1), data.qvel.reshape(self.n, -1)
        qpos, qvel = np.empty((self.n, NQ)), np.empty((self.n, NV))
        spin, axes = self.properties.wheel_spin_inertia, self.properties.wheel_axes_B
        with_wheels(data.qpos, data.qvel, data.act, spin, axes, qpos.reshape(-1), qvel.reshape(-1))
        return qpos, qvel

    def start(self, data: mujoco.MjData, qpos: Array, qvel: Array) -> None:
        """Put a flight at its start, see `set_state`: of a spacecraft of one's own the centre of mass stands and moves so.

        Its other joints stand as its file says.
        """
        own, layout = self.own, self.layout
        if own is None:
            self.set_state(data, qpos, qvel)
            return
        data.qpos[layout.all_qpos], data.qvel[layout.all_qvel] = own.start_qpos, own.start_qvel
        data.ctrl[:] = np.tile(own.start_ctrl, self.n)
        self.set_state(data, qpos, qvel)
        centre, velocity = self.centres_of_mass(data)
        moved_q, moved_v = qpos.copy(), qvel.copy()
        moved_q[:, :3] -= centre - qpos[:, :3]
        moved_v[:, :3] -= velocity - qvel[:, :3]
        self.set_state(data, moved_q, moved_v)

    def centres_of_mass(self, data: mujoco.MjData) -> tuple[Array, Array]:
        """Positions and velocities in N of the centres of mass of the spacecraft, shape (n, 3) [m] and (n, 3) [m/s].

        Kinematics are found anew, for `mj_step` leaves those of its last stage.
        """
        mujoco.mj_kinematics(self.mjmodel, data)
        mujoco.mj_comPos(self.mjmodel, data)
        mujoco.mj_comVel(self.mjmodel, data)
        mujoco.mj_subtreeVel(self.mjmodel, data)
        return data.subtree_com[self.hub_body], data.subtree_linvel[self.hub_body]

    def set_state(self, data: mujoco.MjData, qpos: Array, qvel: Array) -> None:
        """Write positions, shape (n, 7 + w), and velocities, shape (n, 6 + w), as `state` gives them; other joints stay."""
        if self.own is not None:
            data.qpos[self.layout.qpos], data.qvel[self.layout.qvel] = qpos, qvel
            return
        if self.wheels == "bodies":
            data.qpos[:], data.qvel[:] = qpos.ravel(), qvel.ravel()
            return
        data.qpos[:], data.qvel[:] = qpos[:, :NQ_FREE].ravel(), qvel[:, :NV_FREE].ravel()
        spin, axes = self.properties.wheel_spin_inertia, self.properties.wheel_axes_B
        data.act[:] = axial_momentum(qvel[:, 3:6], qvel[:, 6:9], spin, axes).ravel()


def build_model(
    n: int,
    *,
    shape: ShapeModel,
    properties: SpacecraftProperties | None = None,
    timestep: float = 0.1,
    camera_half_angle_deg: float = 21.5,
    sun_N: Sequence[float] = (1.0, 0.0, 0.0),
    wheels: WheelModel = "bodies",
    geometry: bool = True,
    stepper: Stepper = "auto",
) -> SwarmModel:
    """Assemble and compile the model of n spacecraft around a body.

    Args:
        n: Number of spacecraft, at least 1.
        shape: The body's mesh in A [m].
        properties: Mass properties and wheel limits; default: the 8 kg 3U CubeSat.
        timestep: Integration step [s].
        camera_half_angle_deg: Half of the drawn camera's vertical field of view [deg].
        sun_N: Direction to the Sun in N; lights the scene.
        wheels: Bodies on hinges, or momentum states of gyrostats.
        geometry: Whether the model holds what can be seen (the body's mesh, the spacecraft's boxes, cameras, light) and what
            is measured (sites, sensors). None of it moves anything; without it, a step takes about a fifth less time.
        stepper: How it is to be stepped.

    Raises:
        MissionError: The spacecraft is impossible, or the template holds what would not be flown; the message names it.
    """
    if n < 1:
        raise MissionError(f"a swarm needs at least one spacecraft, not {n}")
    properties = properties or SpacecraftProperties()
    part = _template(properties, timestep, camera_half_angle_deg)
    _refuse_strangers(_examined(part, properties))
    if wheels == "gyrostat":
        _replace_wheels(part, properties)
    spec = scene(shape, timestep, np.asarray(sun_N, float))
    if not geometry:
        _strip(spec)
        _strip(part)
    for name in spacecraft_names(n):
        spec.attach(part.copy(), frame=spec.worldbody.add_frame(), prefix=f"{name}_")
    layout = resolve_layout(
        compiled := compile_spec(spec),
        spacecraft_names(n),
        hub=HUB,
        wheels=wheel_names(properties),
        wheels_are_joints=wheels == "bodies",
    )
    _require_fast_layout(compiled, layout, properties, wheels)
    return SwarmModel(
        mjmodel=compiled,
        names=spacecraft_names(n),
        layout=layout,
        asteroid_mocap=int(compiled.body("asteroid").mocapid[0]),
        properties=properties,
        wheels=wheels,
        stepper=stepper,
    )


def examine_template(properties: SpacecraftProperties) -> list[Finding]:
    """What of the packaged spacecraft the fast stepper cannot fly; empty unless its file was changed."""
    return _examined(_template(properties, 0.1, 21.5), properties)


def wheel_names(properties: SpacecraftProperties) -> tuple[str, ...]:
    """Names of the packaged spacecraft's wheels, in order."""
    if properties.wheel_layout == "orthogonal":
        return WHEELS
    return tuple(f"wheel_{k + 1}" for k in range(properties.n_wheels))


def compile_spec(spec: mujoco.MjSpec) -> mujoco.MjModel:
    """Compile, and say in our words what MuJoCo cannot build.

    Raises:
        MissionError: It cannot.
    """
    try:
        return spec.compile()
    except ValueError as error:
        raise MissionError(f"MuJoCo cannot build the spacecraft: {error}; check masses, sizes and inertias") from None


def _template(properties: SpacecraftProperties, timestep: float, camera_half_angle_deg: float) -> mujoco.MjSpec:
    """The packaged spacecraft with the scenario's masses, its wheels as bodies."""
    part = _cubesat(properties, timestep, camera_half_angle_deg)
    if properties.wheel_layout != "orthogonal":
        _lay_out_wheels(part, properties)
    return part


def _examined(part: mujoco.MjSpec, properties: SpacecraftProperties) -> list[Finding]:
    return examine_spacecraft(compile_spec(part.copy()), properties, HUB, wheel_names(properties))


def _refuse_strangers(findings: list[Finding]) -> None:
    if findings:
        raise MissionError(
            f"{TEMPLATE} was changed, and the fast stepper cannot fly it: {listed(findings)}. Fly it with physics.stepper: "
            "mj_step or auto, or as a spacecraft of your own (spacecraft.mjcf)"
        )


def _keep_warnings_off_disk() -> None:
    """Let MuJoCo warn on the console alone, unless somebody named a log file: it would write MUJOCO_LOG.TXT where one is."""
    log = mujoco.MjLogConfig.get()
    if log.logto_file and log.logfile == DEFAULT_LOG:
        log.logto_file = False
        log.set()


def scene(shape: ShapeModel, timestep: float, sun_N: Array) -> mujoco.MjSpec:
    """The asteroid and the Sun, without spacecraft.

    Args:
        shape: The body's mesh in A [m].
        timestep: Integration step [s].
        sun_N: Direction to the Sun in N, shape (3,).
    """
    _keep_warnings_off_disk()
    spec = mujoco.MjSpec.from_file(str(asset_path("mjcf/scene.xml")))
    spec.option.timestep = timestep
    spec.stat.extent = max(1.0, 1.13 * shape.max_radius)
    mesh = spec.mesh("asteroid")
    mesh.file = ""
    mesh.uservert = shape.vertices.ravel().tolist()
    mesh.userface = shape.faces.ravel().tolist()
    light = spec.light("sun")
    light.dir = (-sun_N / np.linalg.norm(sun_N)).tolist()
    light.pos = (sun_N / np.linalg.norm(sun_N) * 3.0 * shape.max_radius).tolist()
    return spec


def _cubesat(properties: SpacecraftProperties, timestep: float, camera_half_angle_deg: float) -> mujoco.MjSpec:
    spec = mujoco.MjSpec.from_file(str(asset_path(TEMPLATE)))
    spec.option.timestep = timestep  # attaching warns when parent and child differ
    hub = _required(spec, "body", HUB)
    hub.mass, hub.inertia = properties.hub_mass, properties.hub_inertia.tolist()
    moments = np.linalg.eigvalsh(properties.inertia_B - properties.wheels_inertia_B)
    if moments.min() <= 0 or 2 * moments.max() > moments.sum():
        raise MissionError(
            f"spacecraft: the wheels leave the hub an impossible inertia {np.round(moments, 6).tolist()} "
            "kg m^2; make the spacecraft heavier or larger, or the wheels smaller"
        )
    for name, axis, z in zip(WHEELS, np.eye(3), WHEEL_STATIONS_M, strict=True):
        wheel = _required(spec, "body", name)
        wheel.pos, wheel.mass = [0.0, 0.0, z], properties.wheel_mass
        spin, transverse = properties.wheel_spin_inertia, properties.wheel_transverse_inertia
        wheel.inertia = (transverse + (spin - transverse) * axis**2).tolist()
        motor = _required(spec, "actuator", name)
        motor.ctrlrange = [-properties.max_wheel_torque, properties.max_wheel_torque]
    _required(spec, "geom", "bus").size = [0.5 * edge for edge in properties.size]
    _required(spec, "camera", "camera").fovy = 2.0 * camera_half_angle_deg
    return spec


def _required(spec: mujoco.MjSpec, kind: str, name: str) -> Any:
    """A part of the template that the scenario fills.

    Raises:
        MissionError: It is missing.
    """
    found = getattr(spec, kind)(name)
    if found is None:
        raise MissionError(
            f"{TEMPLATE} was changed: {kind} {name} is missing, which the scenario's numbers fill. Put it back, or fly the "
            "file as a spacecraft of your own (spacecraft.mjcf)"
        )
    return found


def _strip(spec: mujoco.MjSpec) -> None:
    """Take away everything that moves nothing."""
    for parts in (spec.sensors, spec.geoms, spec.sites, spec.cameras, spec.lights, spec.meshes, spec.materials):
        for part in list(parts):
            spec.delete(part)


def _lay_out_wheels(part: mujoco.MjSpec, properties: SpacecraftProperties) -> None:
    """Put wheels about any axes in the place of the three orthogonal ones."""
    material, radius, half_height = _drawn_wheel(part)
    for name in WHEELS:
        part.delete(part.body(name))
    hub = part.body(HUB)
    hub.mass, hub.fullinertia = properties.hub_mass, _six(properties.inertia_B - properties.wheels_inertia_B)
    hub.inertia = [0.0] * 3
    spin, transverse = properties.wheel_spin_inertia, properties.wheel_transverse_inertia
    for number, (axis, z) in enumerate(zip(properties.wheel_axes_B, properties.wheel_stations_m, strict=True), 1):
        name = f"wheel_{number}"
        wheel = hub.add_body(name=name, pos=[0.0, 0.0, z], mass=properties.wheel_mass, explicitinertial=True)
        wheel.ipos, wheel.fullinertia = (
            [0.0, 0.0, 0.0],
            _six(transverse * np.eye(3) + (spin - transverse) * np.outer(axis, axis)),
        )
        wheel.add_joint(name=name, type=mujoco.mjtJoint.mjJNT_HINGE, axis=axis.tolist())
        geom = wheel.add_geom(name=name, type=mujoco.mjtGeom.mjGEOM_CYLINDER, size=[radius, half_height, 0.0], mass=0.0)
        geom.alt.zaxis, geom.material, geom.contype, geom.conaffinity, geom.group = axis.tolist(), material, 0, 0, 1
        motor = part.add_actuator(name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        motor.ctrlrange = [-properties.max_wheel_torque, properties.max_wheel_torque]


def _drawn_wheel(part: mujoco.MjSpec) -> tuple[str, float, float]:
    geom = part.geom(WHEELS[0])
    return geom.material, float(geom.size[0]), float(geom.size[1])


def _six(tensor: Array) -> list[float]:
    return [float(tensor[i, j]) for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]


def _replace_wheels(part: mujoco.MjSpec, properties: SpacecraftProperties) -> None:
    for name, axis in zip(WHEELS, properties.wheel_axes_B, strict=True):
        part.delete(part.body(name))
        part.add_actuator(
            name=name,
            target="free",
            trntype=mujoco.mjtTrn.mjTRN_JOINT,
            gear=[0.0, 0.0, 0.0, *axis],
            dyntype=mujoco.mjtDyn.mjDYN_INTEGRATOR,
            gainprm=[0.0] * 10,
            ctrlrange=[-properties.max_wheel_torque, properties.max_wheel_torque],
        )
    hub = part.body(HUB)
    hub.mass, hub.inertia = properties.mass, np.diag(properties.inertia_effective_B).tolist()


def _require_fast_layout(
    model: mujoco.MjModel, layout: Layout, properties: SpacecraftProperties, wheels: WheelModel
) -> None:
    """See that MuJoCo's arrays hold the spacecraft in the order and width that compiled code reads, and nothing else.

    Raises:
        MissionError: They do not; the message names what stands in the way.
    """
    n, w, bodies = len(layout.hub_body), properties.n_wheels, wheels == "bodies"
    expected = {
        "nq": (model.nq, n * (NQ_FREE + w * bodies)),
        "nv": (model.nv, n * (NV_FREE + w * bodies)),
        "nu": (model.nu, n * w),
        "na": (model.na, 0 if bodies else n * w),
        "nbody": (model.nbody, 2 + n * (1 + w * bodies)),  # the world and the asteroid
    }
    wrong = [f"{key} = {found}, not {right}" for key, (found, right) in expected.items() if found != right]
    rows = {"qpos": layout.qpos, "qvel": layout.qvel, "ctrl": layout.ctrl}
    wrong += [f"{key} in another order" for key, row in rows.items() if not _in_order(row)]
    if wrong:
        strange = set(range(1, model.nbody)) - set(layout.bodies.ravel().tolist()) - {model.body("asteroid").id}
        others = ", ".join(title_of(model, "body", i) for i in sorted(strange)) or "an actuator or a joint"
        raise MissionError(
            f"the compiled swarm is not what the fast stepper reads ({'; '.join(wrong)}): mjcf/scene.xml holds {others}; "
            "it must hold the asteroid alone"
        )
    weight = model.body_subtreemass[layout.hub_body]
    if not np.allclose(weight, properties.mass, rtol=ROUNDING, atol=0.0):
        raise MissionError(
            f"a spacecraft weighs {weight.min():g} kg in the compiled swarm, {properties.mass:g} kg by plan"
        )


def _in_order(places: Ints) -> bool:
    return np.array_equal(places.ravel(), np.arange(places.size))
