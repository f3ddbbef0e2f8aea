"""The packaged CubeSat: an MJCF template that the scenario fills with masses, wheels and a camera.

A person may open the file in MuJoCo's viewer. Once changed, it flies as a spacecraft of its own, with all that it then holds.
"""

from __future__ import annotations

from hashlib import sha256
from importlib.resources.abc import Traversable
from pathlib import Path

import mujoco
import numpy as np

from swarm_mj.errors import MissionError
from swarm_mj.io.resources import asset_path
from swarm_mj.spacecraft.properties import WHEEL_STATIONS_M, SpacecraftProperties
from swarm_mj.spacecraft.thrusters import NOZZLE, add_nozzles, packaged_nozzles
from swarm_mj.typing import Array

#: The file, its hub, and its wheels where they are orthogonal.
TEMPLATE, HUB, WHEELS = "mjcf/cubesat.xml", "cubesat", ("wheel_x", "wheel_y", "wheel_z")
#: SHA-256 of the file as it is shipped; whoever maintains it puts the new one here.
SHIPPED = "691fa1ac4d330fa943a8d65d210909d9a35ab9fe6e64b04be53bb2da4bb0fa49"
#: The log file that MuJoCo writes into the current folder unless told otherwise.
DEFAULT_LOG = "MUJOCO_LOG.TXT"


def wheel_names(properties: SpacecraftProperties) -> tuple[str, ...]:
    """Names of the packaged spacecraft's wheels, in order."""
    if properties.wheel_layout == "orthogonal":
        return WHEELS
    return tuple(f"wheel_{k + 1}" for k in range(properties.n_wheels))


def is_shipped() -> bool:
    """Whether the packaged file is the one that was shipped; a changed one may hold what the scenario's numbers do not say."""
    return sha256(asset_path(TEMPLATE).read_text("utf-8").encode()).hexdigest() == SHIPPED


def make_template(properties: SpacecraftProperties, timestep: float, camera_half_angle_deg: float) -> mujoco.MjSpec:
    """The packaged spacecraft with the scenario's numbers.

    Args:
        properties: Mass properties and wheels.
        timestep: Integration step [s].
        camera_half_angle_deg: Half of the drawn camera's vertical field of view [deg].

    Raises:
        MissionError: The file was changed, or the numbers make no spacecraft.
    """
    if not is_shipped():
        raise MissionError(f"{TEMPLATE} was changed: fly it as a spacecraft of your own (spacecraft.mjcf)")
    part = _cubesat(properties, timestep, camera_half_angle_deg)
    if properties.wheel_layout != "orthogonal":
        _lay_out_wheels(part, properties)
    if properties.thrusters is not None:
        add_nozzles(part.body(HUB), packaged_nozzles(properties.thrusters.layout, properties.size))
    return part


def read_spec(path: Path | Traversable) -> mujoco.MjSpec:
    """Read a file of MJCF, which MuJoCo may warn of on the console alone, unless somebody named a log file.

    Raises:
        ValueError: MuJoCo cannot read it.
    """
    log = mujoco.MjLogConfig.get()
    if log.logto_file and log.logfile == DEFAULT_LOG:
        log.logto_file = False
        log.set()
    return mujoco.MjSpec.from_file(str(path))


def compile_spec(spec: mujoco.MjSpec) -> mujoco.MjModel:
    """Compile, and say in our words what MuJoCo cannot build.

    Raises:
        MissionError: It cannot.
    """
    try:
        return spec.compile()
    except ValueError as error:
        raise MissionError(f"MuJoCo cannot build the spacecraft: {error}; check masses, sizes and inertias") from None


def _cubesat(properties: SpacecraftProperties, timestep: float, camera_half_angle_deg: float) -> mujoco.MjSpec:
    spec = read_spec(asset_path(TEMPLATE))
    spec.option.timestep = timestep  # attaching warns when parent and child differ
    hub = spec.body(HUB)
    hub.mass, hub.inertia = properties.hub_mass, properties.hub_inertia.tolist()
    moments = np.linalg.eigvalsh(properties.inertia_B - properties.wheels_inertia_B)
    if moments.min() <= 0 or 2 * moments.max() > moments.sum():
        raise MissionError(
            f"spacecraft: the wheels leave the hub an impossible inertia {np.round(moments, 6).tolist()} "
            "kg m^2; make the spacecraft heavier or larger, or the wheels smaller"
        )
    for name, axis, z in zip(WHEELS, np.eye(3), WHEEL_STATIONS_M, strict=True):
        wheel = spec.body(name)
        wheel.pos, wheel.mass = [0.0, 0.0, z], properties.wheel_mass
        spin, transverse = properties.wheel_spin_inertia, properties.wheel_transverse_inertia
        wheel.inertia = (transverse + (spin - transverse) * axis**2).tolist()
        motor = spec.actuator(name)
        motor.ctrlrange = [-properties.max_wheel_torque, properties.max_wheel_torque]
    spec.geom("bus").size = [0.5 * edge for edge in properties.size]
    spec.camera("camera").fovy = 2.0 * camera_half_angle_deg
    return spec


def strip(spec: mujoco.MjSpec) -> None:
    """Take away everything that moves nothing; nozzles stay, for thrust acts where they are."""
    sites = spec.sites
    for parts in (spec.sensors, spec.geoms, sites, spec.cameras, spec.lights, spec.meshes, spec.materials):
        for part in list(parts):
            if not (parts is sites and part.name.startswith(NOZZLE)):
                spec.delete(part)


def _lay_out_wheels(part: mujoco.MjSpec, properties: SpacecraftProperties) -> None:
    """Put wheels about any axes in the place of the three orthogonal ones."""
    drawn = part.geom(WHEELS[0])
    material, radius, half_height = drawn.material, float(drawn.size[0]), float(drawn.size[1])
    for name in WHEELS:
        part.delete(part.body(name))
    hub = part.body(HUB)
    hub.mass, hub.fullinertia = properties.hub_mass, _six(properties.inertia_B - properties.wheels_inertia_B)
    hub.inertia = [0.0] * 3
    spin, transverse = properties.wheel_spin_inertia, properties.wheel_transverse_inertia
    for number, (axis, z) in enumerate(zip(properties.wheel_axes_B, properties.wheel_stations_m, strict=True), 1):
        name = f"wheel_{number}"
        wheel = hub.add_body(name=name, pos=[0.0, 0.0, z], mass=properties.wheel_mass, explicitinertial=True)
        wheel.ipos = [0.0, 0.0, 0.0]
        wheel.fullinertia = _six(transverse * np.eye(3) + (spin - transverse) * np.outer(axis, axis))
        wheel.add_joint(name=name, type=mujoco.mjtJoint.mjJNT_HINGE, axis=axis.tolist())
        geom = wheel.add_geom(name=name, type=mujoco.mjtGeom.mjGEOM_CYLINDER, size=[radius, half_height, 0.0], mass=0.0)
        geom.alt.zaxis, geom.material, geom.contype, geom.conaffinity, geom.group = axis.tolist(), material, 0, 0, 1
        motor = part.add_actuator(name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        motor.ctrlrange = [-properties.max_wheel_torque, properties.max_wheel_torque]


def _six(tensor: Array) -> list[float]:
    return [float(tensor[i, j]) for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]
