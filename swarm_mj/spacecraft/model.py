"""The MuJoCo model of a swarm: one asteroid on a mocap body and N CubeSats, assembled from the two MJCF parts.

World frame N (asteroid's centre, ecliptic J2000), SI. Spacecraft j carries the prefix `sc{j}_`, counted from 1. Spacecraft from
a file of one's own are assembled by `own_model`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import mujoco
import numpy as np

from swarm_mj.errors import MissionError
from swarm_mj.io.resources import asset_path
from swarm_mj.smallbody.shape import ShapeModel
from swarm_mj.spacecraft.elements import title_of
from swarm_mj.spacecraft.layout import Layout, resolve_layout, spacecraft_names
from swarm_mj.spacecraft.own_spacecraft import OwnSpacecraft
from swarm_mj.spacecraft.properties import SpacecraftProperties
from swarm_mj.spacecraft.template import HUB, compile_spec, make_template, read_spec, strip, wheel_names
from swarm_mj.typing import Array, Ints

#: qpos and qvel of a free joint.
NQ_FREE, NV_FREE = 7, 6

#: Working memory of MuJoCo for each spacecraft of a model without geometry; a step uses 1.7 KiB of it, 0.2 for each degree of
#: freedom, as any function of MuJoCo that was tried.
#: By default MuJoCo reserves megabytes for contacts, which a batch of thousands of flights would exhaust.
STACK_BYTES = 8 * 1024

#: Who steps a swarm: MuJoCo's `mj_step` on its model, or compiled code by the equations of free gyrostats.
Stepper = Literal["mujoco", "kernel"]


@dataclass(frozen=True)
class SwarmModel:
    """A compiled swarm and the places of its parts.

    Attributes:
        mjmodel: The compiled model.
        names: Prefix-free spacecraft names `sc1`, `sc2`, ..., in gene order.
        layout: Where the spacecraft's parts stand in MuJoCo's arrays.
        asteroid_mocap: Mocap id of the asteroid.
        properties: Mass properties and wheels of every spacecraft.
        stepper: Who steps it.
        own: What was read of a spacecraft of one's own, which MuJoCo steps; None: the packaged CubeSat.
    """

    mjmodel: mujoco.MjModel
    names: tuple[str, ...]
    layout: Layout
    asteroid_mocap: int
    properties: SpacecraftProperties
    stepper: Stepper = "mujoco"
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
        """Positions and velocities by spacecraft, wheels included.

        Returns:
            Position in N [m], quaternion, w wheel angles, shape (n, 7 + w), and velocity in N [m/s], body rate in B [rad/s],
            wheel speeds relative to the hub [rad/s], shape (n, 6 + w). Views of MuJoCo's arrays where these hold nothing else;
            copies of a spacecraft of one's own.
        """
        if self.own is not None:
            return data.qpos[self.layout.qpos], data.qvel[self.layout.qvel]
        return data.qpos.reshape(self.n, -1), data.qvel.reshape(self.n, -1)

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
        else:
            data.qpos[:], data.qvel[:] = qpos.ravel(), qvel.ravel()


def build_model(
    n: int,
    *,
    shape: ShapeModel,
    properties: SpacecraftProperties | None = None,
    timestep: float = 0.1,
    camera_half_angle_deg: float = 21.5,
    sun_N: Sequence[float] = (1.0, 0.0, 0.0),
    geometry: bool = True,
    stepper: Stepper = "mujoco",
) -> SwarmModel:
    """Assemble and compile the model of n spacecraft around a body.

    Args:
        n: Number of spacecraft, at least 1.
        shape: The body's mesh in A [m].
        properties: Mass properties and wheel limits; default: the 8 kg 3U CubeSat.
        timestep: Integration step [s].
        camera_half_angle_deg: Half of the drawn camera's vertical field of view [deg].
        sun_N: Direction to the Sun in N; lights the scene.
        geometry: Whether the model holds what can be seen (the body's mesh, the spacecraft's boxes, cameras, light) and what
            is measured (sites, sensors). None of it moves anything; without it, a step takes about a fifth less time.
        stepper: Who steps it.

    Raises:
        MissionError: The spacecraft is impossible, or the template holds what would not be flown; the message names it.
    """
    if n < 1:
        raise MissionError(f"a swarm needs at least one spacecraft, not {n}")
    properties = properties or SpacecraftProperties()
    part = make_template(properties, timestep, camera_half_angle_deg)
    spec = scene(shape, timestep, np.asarray(sun_N, float))
    if not geometry:
        strip(spec)
        strip(part)
        spec.memory = n * STACK_BYTES
    names = spacecraft_names(n)
    for name in names:
        spec.attach(part.copy(), frame=spec.worldbody.add_frame(), prefix=f"{name}_")
    compiled = compile_spec(spec)
    layout = resolve_layout(compiled, names, hub=HUB, wheels=wheel_names(properties))
    _require_plain_layout(compiled, layout, properties)
    return SwarmModel(
        mjmodel=compiled,
        names=names,
        layout=layout,
        asteroid_mocap=int(compiled.body("asteroid").mocapid[0]),
        properties=properties,
        stepper=stepper,
    )


def scene(shape: ShapeModel, timestep: float, sun_N: Array) -> mujoco.MjSpec:
    """The asteroid and the Sun, without spacecraft.

    Args:
        shape: The body's mesh in A [m].
        timestep: Integration step [s].
        sun_N: Direction to the Sun in N, shape (3,).
    """
    spec = read_spec(asset_path("mjcf/scene.xml"))
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


def _require_plain_layout(model: mujoco.MjModel, layout: Layout, properties: SpacecraftProperties) -> None:
    """See that MuJoCo's arrays hold the spacecraft in order, and nothing else.

    Raises:
        MissionError: They do not; the message names what stands in the way.
    """
    n, w = len(layout.hub_body), properties.n_wheels
    expected = {
        "nq": (model.nq, n * (NQ_FREE + w)),
        "nv": (model.nv, n * (NV_FREE + w)),
        "nu": (model.nu, n * w),
        "na": (model.na, 0),
        "nbody": (model.nbody, 2 + n * (1 + w)),  # the world and the asteroid
    }
    wrong = [f"{key} = {found}, not {right}" for key, (found, right) in expected.items() if found != right]
    rows = {"qpos": layout.qpos, "qvel": layout.qvel, "ctrl": layout.ctrl}
    wrong += [f"{key} in another order" for key, row in rows.items() if not _in_order(row)]
    if wrong:
        strange = set(range(1, model.nbody)) - set(layout.bodies.ravel().tolist()) - {model.body("asteroid").id}
        others = ", ".join(title_of(model, "body", i) for i in sorted(strange)) or "an actuator or a joint"
        raise MissionError(
            f"the compiled swarm is not what the loop reads ({'; '.join(wrong)}): mjcf/scene.xml holds {others}; "
            "it must hold the asteroid alone"
        )
    weight = model.body_subtreemass[layout.hub_body]
    if not np.allclose(weight, properties.mass, rtol=1e-9, atol=0.0):
        raise MissionError(
            f"a spacecraft weighs {weight.min():g} kg in the compiled swarm, {properties.mass:g} kg by plan"
        )


def _in_order(indices: Ints) -> bool:
    return np.array_equal(indices.ravel(), np.arange(indices.size))
