"""What the sensors of a spacecraft's own file read, and how its other joints stand, at the samples of a flight.

Readings are taken of a copy of the flight's state, by `mj_forward` with the forces and torques of the hold that begins; the
flight does not notice. An accelerometer of MuJoCo gives the acceleration of its site in N less the model's uniform gravity,
which is zero here, because the small body's pull is applied as a force. A real one is pulled as its proof mass is and does not
feel it. So the gravity that is held is taken away, the Sun's tide with it; radiation pressure stays, for that is a push.
"""

from __future__ import annotations

import re
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from swarm_mj.simulator.mujoco import tide
from swarm_mj.simulator.slots import Slot
from swarm_mj.simulator.state import FlightState
from swarm_mj.spacecraft.elements import id_of, qpos_indices, qvel_indices
from swarm_mj.spacecraft.own_spacecraft import ExtraJoint
from swarm_mj.spacecraft.sensors import Sensor
from swarm_mj.typing import Array, Ints

Variable = tuple[tuple[str, ...], NDArray[Any], dict[str, Any]]

#: Units of a joint's position and velocity, by its kind.
JOINT_UNITS = {"hinge": ("rad", "rad s-1"), "slide": ("m", "m s-1"), "ball": ("1", "rad s-1")}


class Instruments:
    """Readings of the sensors and joints of one flight.

    Args:
        state: Of the flight, whose spacecraft come from a file.
        samples: How many are taken.
        gradient_gm: Gravitational parameter whose gradient acts [m^3/s^2]; 0: none does.
    """

    def __init__(self, state: FlightState, samples: int, gradient_gm: float) -> None:
        assert state.model.own is not None
        self._state, self._own, self._gradient_gm = state, state.model.own, gradient_gm
        self._copy = mujoco.MjData(state.model.mjmodel)
        n = state.model.n
        self._sensors = [self._places(sensor) for sensor in self._own.sensors]
        self._sites = [self._site(sensor) for sensor in self._own.sensors]
        self._joints = [self._joint(joint) for joint in self._own.joints]
        self._readings = [np.empty((samples, n, sensor.size)) for sensor in self._own.sensors]
        self._positions = [np.empty((samples, *qpos.shape)) for qpos, _ in self._joints]
        self._velocities = [np.empty((samples, *qvel.shape)) for _, qvel in self._joints]
        self._centres = np.empty((2, samples, n, 3))

    def _names(self, name: str) -> list[str]:
        return [f"{spacecraft}_{name}" for spacecraft in self._state.model.names]

    def _places(self, sensor: Sensor) -> Ints:
        """Where the readings of a sensor stand in `sensordata`, shape (n, size)."""
        model = self._state.model.mjmodel
        first = [int(model.sensor_adr[id_of(model, "sensor", name)]) for name in self._names(sensor.name)]
        return np.array(first, np.int64)[:, None] + np.arange(sensor.size)

    def _site(self, sensor: Sensor) -> list[int]:
        """The sites of an accelerometer, shape (n,); of others, none."""
        model = self._state.model.mjmodel
        return [id_of(model, "site", name) for name in self._names(sensor.site)] if sensor.site else []

    def _joint(self, joint: ExtraJoint) -> tuple[Ints, Ints]:
        model = self._state.model.mjmodel
        ids = [id_of(model, "joint", name) for name in self._names(joint.name)]
        return np.array([list(qpos_indices(model, j)) for j in ids]), np.array(
            [list(qvel_indices(model, j)) for j in ids]
        )

    def keep(self, row: int) -> None:
        """Take a sample; forces and torques of the coming hold have been set."""
        model, data, copy = self._state.model.mjmodel, self._state.data, self._copy
        mujoco.mj_copyState(model, data, copy, mujoco.mjtState.mjSTATE_INTEGRATION)
        mujoco.mj_forward(model, copy)
        for sensor, places, sites, readings in zip(
            self._own.sensors, self._sensors, self._sites, self._readings, strict=True
        ):
            readings[row] = copy.sensordata[places]
            if sensor.site:
                readings[row] -= self._gravity_in(sites)
        for (qpos, qvel), positions, velocities in zip(self._joints, self._positions, self._velocities, strict=True):
            positions[row], velocities[row] = copy.qpos[qpos], copy.qvel[qvel]
        self._centres[:, row] = self._state.model.centres_of_mass(copy)

    def _gravity_in(self, sites: list[int]) -> Array:
        """Gravity that is held, at sites and in their axes, shape (n, 3) [m/s^2]."""
        state, copy = self._state, self._copy
        environment, r_N = state.environment, state.work[Slot.R_A] @ state.C_mid
        push = environment.pressure_acceleration_N(state.time + 0.5 * state.period, r_N)
        gravity_N = state.work[Slot.A] - push
        if self._gradient_gm > 0.0:
            arm_N = copy.site_xpos[sites] - copy.subtree_com[state.model.hub_body]
            gravity_N = gravity_N + tide(arm_N, r_N, self._gradient_gm)
        return np.einsum("nij,ni->nj", copy.site_xmat[sites].reshape(-1, 3, 3), gravity_N)

    def variables(self, taken: set[str]) -> dict[str, Variable]:
        """Variables for the telemetry: dimensions, values, attributes.

        Args:
            taken: Names that it has already; a sensor of such a name is called `sensor_NAME`.
        """
        words = "of the centre of mass of the whole spacecraft, relative to the asteroid's centre"
        found = {
            "r_CN_N": _variable("r_CN_N", self._centres[0], "m", "N", f"position {words}"),
            "v_CN_N": _variable("v_CN_N", self._centres[1], "m s-1", "N", f"velocity {words}"),
        }
        for joint, positions, velocities in zip(self._own.joints, self._positions, self._velocities, strict=True):
            name = f"joint_{_word(joint.name)}"
            units, rates = JOINT_UNITS[joint.kind]
            for what, values, unit in (("position", positions, units), ("velocity", velocities, rates)):
                words = f"{what} of the {joint.kind} joint {joint.name}"
                found[f"{name}_{what}"] = _variable(f"{name}_{what}", values, unit, "none", words)
        for sensor, readings in zip(self._own.sensors, self._readings, strict=True):
            name = _word(sensor.name)
            while name in taken or name in found:
                name = f"sensor_{name}"
            found[name] = _variable(name, readings, sensor.units, sensor.frame, sensor.long_name)
        return found


def _variable(name: str, values: Array, units: str, frame: str, long_name: str) -> Variable:
    """One number a sample has no further dimension, three are x, y, z, four a quaternion, others have one of their own."""
    size = values.shape[-1]
    attributes = {"units": units, "frame": frame, "long_name": long_name}
    if size == 1:
        return ("time", "spacecraft"), values[..., 0], attributes
    further = {3: "xyz", 4: "wxyz"}.get(size, f"{name}_component")
    return ("time", "spacecraft", further), values, attributes


def _word(name: str) -> str:
    """A name of MuJoCo's as a name of NetCDF's, which knows no slash."""
    return re.sub(r"[^A-Za-z0-9_]", "_", name)
