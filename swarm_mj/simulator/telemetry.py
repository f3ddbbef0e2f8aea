"""Telemetry as a labelled data set: what a stranger needs to check the flight from the file alone.

Dimensions time, spacecraft, xyz and wheel; every variable carries `units`, `frame` and `long_name`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import pi
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from swarm_mj.io.arrays import Declared
from swarm_mj.io.netcdf import read_netcdf
from swarm_mj.mission.behaviors import looks_at_body
from swarm_mj.simulator.simulation import FlightSamples
from swarm_mj.smallbody.environment import Environment
from swarm_mj.spacecraft.attitude.algebra import product
from swarm_mj.spacecraft.attitude.guidance import PLAIN, Aiming, pointing_error
from swarm_mj.spacecraft.attitude.mrp import mrp_from_quaternion, subtract_mrp
from swarm_mj.spacecraft.properties import SpacecraftProperties
from swarm_mj.typing import Array, Mask

#: Meaning of the flag values of `mode`, in the order of `TargetKind`.
MODES = ("asteroid_observation", "communication_tracking", "earth_tracking", "surface_observation", "direction_hold")
#: What is kept of every control period, in the order of `FlightSamples.peaks`.
PEAKS = ("wheel_speed_peak", "wheel_torque_peak", "wheel_saturation_time")
#: No length [m] or time [s] is larger, no speed [m/s, rad/s] or torque [N m], and no component of a unit vector or short MRP.
FARTHEST, FASTEST, SHORT = 1e15, 1e9, 1.001
_PLACE, _VECTOR, _WHEELS = ("time", "spacecraft"), ("time", "spacecraft", "xyz"), ("time", "spacecraft", "wheel")
_PEAK: dict[str, Any] = {"dims": ("spacecraft",), "optional": True}
_FAULT: dict[str, Any] = {"optional": True, "gaps": "nan"}


@dataclass(frozen=True)
class Variable(Declared):
    """A variable of the telemetry, as it must be to be read and as it is described.

    Attributes:
        units: Its unit.
        frame: Of its components; none: it has none.
        long_name: What it is.
        flags: What its values 0, 1, and so on mean, a word each.
    """

    units: str = "1"
    frame: str = "none"
    long_name: str = ""
    flags: str = ""

    def of(self, values: NDArray[Any]) -> xr.Variable:
        """Values with all that is said of them."""
        found = xr.Variable(
            self.dims, values.astype(self.dtype), {n: getattr(self, n) for n in ("units", "frame", "long_name")}
        )
        if self.flags:
            numbers = np.arange(len(self.flags.split()), dtype=self.dtype)
            found.attrs |= {"flag_values": numbers, "flag_meanings": self.flags}
        return found


def _signed(most: float, units: str, frame: str, words: str, dims: tuple[str, ...] = _VECTOR, **more: Any) -> Variable:
    return Variable("f8", dims, -most, most, units=units, frame=frame, long_name=words, **more)


def _amount(most: float, units: str, words: str, dims: tuple[str, ...] = _PLACE, **more: Any) -> Variable:
    return Variable("f8", dims, 0.0, most, units=units, long_name=words, **more)


def _bits(words: str) -> Variable:
    return Variable("i8", _PLACE, 0, FARTHEST, optional=True, units="bit", long_name=words)


def _flag(words: str, flags: str, optional: bool = True) -> Variable:
    return Variable("i1", _PLACE, 0, len(flags.split()) - 1, optional=optional, long_name=words, flags=flags)


#: What a file of telemetry says of every sample or of the whole flight; plug-ins and spacecraft from files add more.
VARIABLES = {
    "r_BN_N": _signed(FARTHEST, "m", "N", "position relative to the asteroid's centre"),
    "v_BN_N": _signed(FASTEST, "m s-1", "N", "velocity relative to the asteroid's centre"),
    "sigma_BN": _signed(SHORT, "1", "B relative to N", "attitude (MRP, short set)"),
    "omega_BN_B": _signed(FASTEST, "rad s-1", "B", "angular velocity of B relative to N"),
    "sigma_RN": _signed(SHORT, "1", "R relative to N", "reference attitude (MRP, short set)"),
    "sigma_BR": _signed(SHORT, "1", "B relative to R", "attitude tracking error (MRP, short set)"),
    "line_of_sight_N": _signed(SHORT, "1", "N", "unit vector to the target"),
    "pointing_error": _amount(pi, "rad", "angle between +z and the line of sight"),
    "mode": _flag("what +z tracks", " ".join(MODES), optional=False),
    "tracked_spacecraft": Variable(
        "i2", _PLACE, -1, "spacecraft", long_name="number of the spacecraft tracked, counted from 0; -1: none"
    ),
    "wheel_speed": _signed(FASTEST, "rad s-1", "B", "wheel speed relative to the hub", _WHEELS),
    "wheel_torque": _signed(FASTEST, "N m", "B", "motor torque on the wheel, held from this sample on", _WHEELS),
    "sigma_AN": _signed(SHORT, "1", "A relative to N", "asteroid attitude (MRP)", ("time", "xyz")),
    "link_closed": _flag("radio link closed", "open closed", optional=False),
    "wheel_speed_peak": _amount(
        FARTHEST, "rad s-1", "largest wheel speed of the whole flight, between samples too", frame="B", **_PEAK
    ),
    "wheel_torque_peak": _amount(
        FARTHEST, "N m", "largest motor torque of the whole flight, between samples too", frame="B", **_PEAK
    ),
    "wheel_saturation_time": _amount(
        FARTHEST, "s", "time in which a limit of torque or speed cut what the controller asked for", **_PEAK
    ),
    "coverage_percent": _amount(
        100.001, "percent", "observed share of the target's area, P_TO, whole swarm", ("time",), optional=True
    ),
    "operational": _flag("whether the spacecraft works", "lost operational"),
    "camera_on": _flag("whether the camera takes pictures", "off on"),
    "released": _flag("whether it has left the mothership", "aboard released"),
    "wheel_friction_torque": _signed(
        FASTEST, "N m", "B", "torque of the bearing on the wheel, held from this sample on", _WHEELS, **_FAULT
    ),
    "attitude_knowledge_error": _amount(
        SHORT * pi, "rad", "angle between the true attitude and the one given to the controller", **_FAULT
    ),
    "gyro_bias": _signed(FASTEST, "rad s-1", "B", "true bias of the gyro", **_FAULT),
    "gyro_bias_estimate": _signed(FASTEST, "rad s-1", "B", "the filter's estimate of it", **_FAULT),
    "r_BN_N_estimate": _signed(
        FARTHEST,
        "m",
        "N",
        "position relative to the asteroid's centre, as navigation by pictures knows it",
        optional=True,
    ),
    "v_BN_N_estimate": _signed(FASTEST, "m s-1", "N", "velocity, likewise", optional=True),
    "r_BN_N_sigma": _signed(
        FARTHEST,
        "m",
        "N",
        "standard deviation of the components of that position, as its filter believes",
        optional=True,
    ),
    "r_BN_N_correlation": _signed(
        1.001, "1", "N", "correlation of its components y and z, x and z, x and y, likewise", optional=True
    ),
    "thrust_N": _signed(FASTEST, "N", "N", "mean force of the thrusters, held from this sample on", optional=True),
    "propellant_kg": _amount(FASTEST, "kg", "propellant left in the tank", optional=True),
    "mass_kg": _amount(FASTEST, "kg", "mass with what is left in the tank", optional=True),
    "delta_v_m_s": _amount(FASTEST, "m s-1", "velocity gained by thrust so far, in whatever direction", optional=True),
    "coordination_bits": _bits("coordination messages sent so far"),
    "coordination_airtime": _amount(FARTHEST, "s", "time spent sending them", optional=True),
    "formation_error": _amount(FARTHEST, "m", "distance from the place in the formation", optional=True),
    "formation_bits": _bits("messages of place and velocity sent so far"),
    "formation_airtime": _amount(FARTHEST, "s", "time spent sending them", optional=True),
}
_COORDINATES = {
    "time": Declared("f8", ("time",), 0.0, FARTHEST, rising=True),
    "spacecraft": Declared("O", ("spacecraft",)),
    "xyz": Declared("O", ("xyz",)),
    "wheel": Declared("O", ("wheel",)),
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
LATER = ("link_closed", "released", "coverage_percent", *_COORDINATES)


def dataset(
    record: FlightSamples,
    names: tuple[str, ...],
    environment: Environment,
    properties: SpacecraftProperties,
    aiming: Aiming = PLAIN,
) -> xr.Dataset:
    """Name and describe the samples of a flight.

    Args:
        record: Raw samples.
        names: Spacecraft names in gene order.
        environment: For the asteroid's attitude and the attributes.
        properties: For the attributes: mass, inertia, wheels.
        aiming: How spacecraft are turned to their lines of sight.
    """
    values = dict(record.samples)
    q_BN, q_RN = values.pop("q_BN"), values.pop("q_RN")
    values |= {"sigma_BN": mrp_from_quaternion(q_BN), "sigma_RN": mrp_from_quaternion(q_RN)}
    if record.sensors_err:  # what was recorded is what the controller believed
        values["sigma_BR"] = subtract_mrp(values["sigma_BN"], values["sigma_RN"])
    values |= {
        "pointing_error": _pointing_error(q_BN, values["line_of_sight_N"], values["mode"], aiming),
        "sigma_AN": _asteroid_mrp(record.time, environment),
        **dict(zip(PEAKS, record.peaks.T, strict=True)),
    }
    variables = {name: what.of(values[name]) for name, what in VARIABLES.items() if name in values}
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


def correlated(covariance: Array) -> tuple[Array, Array]:
    """Standard deviations and correlations (yz, xz, xy) of covariances (..., 3, 3), shape (..., 3) each."""
    sigma = np.sqrt(np.maximum(np.einsum("...kk->...k", covariance), 0.0))
    both = np.einsum("...k,...l->...kl", sigma, sigma)
    shares = np.divide(covariance, both, out=np.zeros_like(covariance), where=both > 0.0)
    return sigma, np.stack((shares[..., 1, 2], shares[..., 0, 2], shares[..., 0, 1]), axis=-1)


def longest_sigma(telemetry: xr.Dataset) -> Array:
    """Standard deviation of what navigation by pictures knows of positions, along the longest axis [m], shape (t, n)."""
    return np.sqrt(np.maximum(np.linalg.eigvalsh(position_covariance(telemetry))[..., -1], 0.0))


def position_covariance(telemetry: xr.Dataset) -> Array:
    """Covariance in N of the positions that navigation by pictures knows [m^2], shape (t, n, 3, 3)."""
    sigma, shares = (telemetry[name].values for name in ("r_BN_N_sigma", "r_BN_N_correlation"))
    yz, xz, xy = np.moveaxis(shares, -1, 0)
    one = np.ones_like(xy)
    rows = ((one, xy, xz), (xy, one, yz), (xz, yz, one))
    correlation = np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)
    found: Array = correlation * np.einsum("...k,...l->...kl", sigma, sigma)
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
    return read_netcdf(path, {**_COORDINATES, **VARIABLES}, ATTRIBUTES, REMEDY, sizes={"xyz": 3, **(sizes or {})})


def _pointing_error(q_BN: Array, los: Array, mode: Array, aiming: Aiming) -> Array:
    if aiming.mounted:
        turned = np.stack(product(tuple(np.moveaxis(q_BN, -1, 0)), tuple(aiming.q_BC)), axis=-1)
        q_BN = np.where(looks_at_body(mode)[..., None], turned, q_BN)
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
