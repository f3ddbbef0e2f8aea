"""Telemetry as a labelled data set: what a stranger needs to check the flight from the file alone.

Dimensions time, spacecraft, xyz and wheel; every variable carries `units`, `frame` and `long_name`.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import pi
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from swarm_mj.io.arrays import Declared
from swarm_mj.io.netcdf import read_netcdf
from swarm_mj.simulator.record import Record
from swarm_mj.smallbody.environment import Environment
from swarm_mj.spacecraft.attitude.guidance import pointing_error
from swarm_mj.spacecraft.attitude.mrp import mrp_from_quaternion, subtract_mrp
from swarm_mj.spacecraft.properties import SpacecraftProperties
from swarm_mj.typing import Array, Mask

#: Meaning of the flag values of `mode`, in the order of `TargetKind`.
MODES = ("asteroid_observation", "communication_tracking", "earth_tracking", "surface_observation", "direction_hold")
#: What is kept of every control period, in the order of `Record.peaks`.
PEAKS = (
    ("wheel_speed_peak", "rad s-1", "B", "largest wheel speed of the whole flight, between samples too"),
    ("wheel_torque_peak", "N m", "B", "largest motor torque of the whole flight, between samples too"),
    (
        "wheel_saturation_time",
        "s",
        "none",
        "time in which a limit of torque or speed cut what the controller asked for",
    ),
)
#: No length [m] or time [s] is larger, no speed [m/s, rad/s] or torque [N m], and no component of a unit vector or short MRP.
FARTHEST, FASTEST, SHORT = 1e15, 1e9, 1.001
_PLACE, _VECTOR, _WHEELS = ("time", "spacecraft"), ("time", "spacecraft", "xyz"), ("time", "spacecraft", "wheel")
#: Variables of a file of telemetry, as they are written and as they must be to be read. Those of faults may be there,
#: those of plug-ins as well.
VARIABLES = {
    "time": Declared("f8", ("time",), 0.0, FARTHEST, rising=True),
    "spacecraft": Declared("O", ("spacecraft",)),
    "xyz": Declared("O", ("xyz",)),
    "wheel": Declared("O", ("wheel",)),
    "r_BN_N": Declared("f8", _VECTOR, -FARTHEST, FARTHEST),
    "v_BN_N": Declared("f8", _VECTOR, -FASTEST, FASTEST),
    "sigma_BN": Declared("f8", _VECTOR, -SHORT, SHORT),
    "omega_BN_B": Declared("f8", _VECTOR, -FASTEST, FASTEST),
    "sigma_RN": Declared("f8", _VECTOR, -SHORT, SHORT),
    "sigma_BR": Declared("f8", _VECTOR, -SHORT, SHORT),
    "line_of_sight_N": Declared("f8", _VECTOR, -SHORT, SHORT),
    "pointing_error": Declared("f8", _PLACE, 0.0, pi),
    "mode": Declared("i1", _PLACE, 0, len(MODES) - 1),
    "tracked_spacecraft": Declared("i2", _PLACE, -1, "spacecraft"),
    "wheel_speed": Declared("f8", _WHEELS, -FASTEST, FASTEST),
    "wheel_torque": Declared("f8", _WHEELS, -FASTEST, FASTEST),
    "sigma_AN": Declared("f8", ("time", "xyz"), -SHORT, SHORT),
    "link_closed": Declared("i1", _PLACE, 0, 1),
    **{name: Declared("f8", ("spacecraft",), 0.0, FARTHEST, optional=True) for name, *_ in PEAKS},
    "coverage_percent": Declared("f8", ("time",), 0.0, 100.001, optional=True),
    "operational": Declared("i1", _PLACE, 0, 1, optional=True),
    "camera_on": Declared("i1", _PLACE, 0, 1, optional=True),
    "thrust_N": Declared("f8", _VECTOR, -FASTEST, FASTEST, optional=True),
    **{
        name: Declared("f8", _PLACE, 0.0, FASTEST, optional=True)
        for name in ("propellant_kg", "mass_kg", "delta_v_m_s")
    },
    "coordination_bits": Declared("i8", _PLACE, 0, FARTHEST, optional=True),
    "coordination_airtime": Declared("f8", _PLACE, 0.0, FARTHEST, optional=True),
    "formation_error": Declared("f8", _PLACE, 0.0, FARTHEST, optional=True),
    "formation_bits": Declared("i8", _PLACE, 0, FARTHEST, optional=True),
    "formation_airtime": Declared("f8", _PLACE, 0.0, FARTHEST, optional=True),
    "released": Declared("i1", _PLACE, 0, 1, optional=True),
}
#: Attributes of the file that its readers need.
ATTRIBUTES = {
    "wheel_max_speed_rad_s": Declared("f8", (1,), 0.0, FASTEST),
    "sun_N_m": Declared("f8", (3,), -FARTHEST, FARTHEST),
    "earth_N_m": Declared("f8", (3,), -FARTHEST, FARTHEST),
}
#: What to do about a file that cannot be read.
REMEDY = "fly the scenario again with `swarm-mj fly`"
#: Names that are given to what is added once the flight is over.
LATER = ("link_closed", "released", "coverage_percent", "time", "spacecraft", "xyz", "wheel")


def dataset(
    record: Record, names: tuple[str, ...], environment: Environment, properties: SpacecraftProperties
) -> xr.Dataset:
    """Name and describe the samples of a flight.

    Args:
        record: Raw samples.
        names: Spacecraft names in gene order.
        environment: For the asteroid's attitude and the attributes.
        properties: For the attributes: mass, inertia, wheels.
    """
    q_BN, q_RN = record.attitude[:, 0], record.attitude[:, 1]
    r, v, omega, sigma_BR, speed, torque, los = np.moveaxis(record.vectors, 1, 0)
    if record.faults is not None:
        speed, torque = record.faults.wheels[:, 0], record.faults.wheels[:, 1]
        if record.faults.imperfect_knowledge:
            # What was recorded is what the controller believed.
            sigma_BR = subtract_mrp(mrp_from_quaternion(q_BN), mrp_from_quaternion(q_RN))
    described: dict[str, tuple[NDArray[Any], str, str, str]] = {
        "r_BN_N": (r, "m", "N", "position relative to the asteroid's centre"),
        "v_BN_N": (v, "m s-1", "N", "velocity relative to the asteroid's centre"),
        "sigma_BN": (mrp_from_quaternion(q_BN), "1", "B relative to N", "attitude (MRP, short set)"),
        "omega_BN_B": (omega, "rad s-1", "B", "angular velocity of B relative to N"),
        "sigma_RN": (mrp_from_quaternion(q_RN), "1", "R relative to N", "reference attitude (MRP, short set)"),
        "sigma_BR": (sigma_BR, "1", "B relative to R", "attitude tracking error (MRP, short set)"),
        "line_of_sight_N": (los, "1", "N", "unit vector to the target"),
        "pointing_error": (_pointing_error(q_BN, los), "rad", "none", "angle between +z and the line of sight"),
        "mode": (record.aim[:, 0].astype(np.int8), "1", "none", "what +z tracks"),
        "tracked_spacecraft": (
            record.aim[:, 1],
            "1",
            "none",
            "number of the spacecraft tracked, counted from 0; -1: none",
        ),
        "wheel_speed": (speed, "rad s-1", "B", "wheel speed relative to the hub"),
        "wheel_torque": (torque, "N m", "B", "motor torque on the wheel, held from this sample on"),
        "sigma_AN": (_asteroid_mrp(record.time, environment), "1", "A relative to N", "asteroid attitude (MRP)"),
    }
    variables = {name: _variable(name, *what) for name, what in described.items()}
    variables["mode"].attrs |= {"flag_values": np.arange(len(MODES), dtype=np.int8), "flag_meanings": " ".join(MODES)}
    for k, (name, units, frame, words) in enumerate(PEAKS):
        variables[name] = _variable(name, record.peaks[:, k], units, frame, words)
    if record.faults is not None:
        for name, variable in record.faults.variables().items():
            variables[name] = xr.Variable(*variable)
    if record.propulsion is not None:
        for name, variable in record.propulsion.variables().items():
            variables[name] = xr.Variable(*variable)
    if record.instruments is not None:
        for name, variable in record.instruments.variables({*variables, *LATER}).items():
            variables[name] = xr.Variable(*variable)
    coordinates = {
        "time": ("time", record.time, {"units": "s", "long_name": "time past the epoch"}),
        "spacecraft": list(names),
        "xyz": ["x", "y", "z"],
        "wheel": list(properties.wheel_labels),
    }
    return xr.Dataset(variables, coordinates, attrs=_attributes(environment, properties))


def released_flags(times: Array, release_s: Array) -> xr.Variable:
    """Who has left the mothership at each sample, as telemetry says it.

    Args:
        times: Shape (t,) [s].
        release_s: Of each spacecraft, shape (n,) [s].
    """
    flags = (times[:, None] >= release_s * (1.0 - 1e-12)).astype(np.int8)
    found = _variable("released", flags, "1", "none", "whether it has left the mothership")
    found.attrs |= {"flag_values": np.array([0, 1], np.int8), "flag_meanings": "aboard released"}
    return found


def working(telemetry: xr.Dataset) -> Mask:
    """Who works and has left the mothership at each sample of a flight, shape (t, n)."""
    works = np.ones((telemetry.sizes["time"], telemetry.sizes["spacecraft"]), np.bool_)
    for name in ("operational", "released"):
        if name in telemetry:
            works &= telemetry[name].values == 1
    return works


def read_telemetry(path: Path, sizes: Mapping[str, int] | None = None) -> xr.Dataset:
    """Read a file of telemetry into memory.

    Args:
        path: The file.
        sizes: Of dimensions that are known from elsewhere, as `spacecraft` is.

    Raises:
        OutputError: It cannot be read or is no telemetry; the message says what is wrong.
    """
    return read_netcdf(path, VARIABLES, ATTRIBUTES, REMEDY, sizes={"xyz": 3, **(sizes or {})})


def _variable(name: str, values: NDArray[Any], units: str, frame: str, long_name: str) -> xr.Variable:
    return xr.Variable(VARIABLES[name].dims, values, {"units": units, "frame": frame, "long_name": long_name})


def _pointing_error(q_BN: Array, los: Array) -> Array:
    flat = pointing_error(np.ascontiguousarray(q_BN.reshape(-1, 4)), np.ascontiguousarray(los.reshape(-1, 3)))
    return flat.reshape(q_BN.shape[:2])


def _asteroid_mrp(times: Array, environment: Environment) -> Array:
    matrices = np.array([environment.C_AN(t).T for t in times])
    return mrp_from_quaternion(Rotation.from_matrix(matrices).as_quat(scalar_first=True))


def _attributes(environment: Environment, properties: SpacecraftProperties) -> dict[str, Any]:
    return {
        "frames": "N: inertial, origin at the asteroid's centre of mass, axes of the ecliptic J2000; A: fixed in the asteroid, "
        "z along the spin axis; B: spacecraft, camera and dish along +z; R: reference attitude",
        "attitude_convention": "MRP as in Schaub and Junkins; C_BN maps components in N to components in B",
        "mass_kg": properties.mass,
        "inertia_B_kg_m2": properties.inertia_B.ravel(),
        "inertia_note": "hub and wheels together about their centre of mass, row-major, wheels locked",
        "wheel_axes_B": properties.wheel_axes_B.ravel(),
        "wheel_spin_inertia_kg_m2": properties.wheel_spin_inertia,
        "wheel_max_speed_rad_s": properties.max_wheel_speed,
        "wheel_max_torque_n_m": properties.max_wheel_torque,
        "spin_rate_rad_s": environment.spin_rate,
        "spin_axis_N": environment.C_PN[2],
        "sun_N_m": environment.sun.position,
        "earth_N_m": environment.earth.position,
    }
