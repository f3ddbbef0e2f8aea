"""MuJoCo's step in compiled code, and what passes between its arrays and those of flights.

Its C functions are called by name, with the signatures of MuJoCo 4 (mujoco.h); `pyproject.toml` bounds the version. Whoever
calls compiled code that uses them makes `MujocoFlight` first, which loads MuJoCo's library.
"""

from __future__ import annotations

import sys
from functools import cache
from pathlib import Path
from typing import NamedTuple

import mujoco
import numpy as np
from llvmlite import binding
from numba import types

from swarm_mj.compilation import allocation_free, jittable
from swarm_mj.errors import SimulationError
from swarm_mj.simulator.flights import Flights
from swarm_mj.simulator.slots import Resting, Slot
from swarm_mj.spacecraft.model import SwarmModel
from swarm_mj.typing import Array, Ints

#: Functions of two pointers: `mj_step(const mjModel*, mjData*)`, `mju_mat2Quat(mjtNum quat[4], const mjtNum mat[9])`.
_OF_TWO = types.void(types.uintp, types.uintp)
_step = types.ExternalFunction("mj_step", _OF_TWO)
_quaternion_of = types.ExternalFunction("mju_mat2Quat", _OF_TWO)


class MujocoFlight(NamedTuple):
    """Where MuJoCo has one flight of n spacecraft with w wheels; its arrays are live."""

    model: int  #: address of the mjModel
    data: int  #: address of the mjData
    whole: bool  #: whether each spacecraft is rigid, so that all its weight acts on its hub
    qpos: Array
    qvel: Array
    forces: Array  #: `xfrc_applied`
    ctrl: Array
    turned: Array  #: attitude of the body's picture, shape (4,)
    matrix: Array  #: the same as a matrix, scratch, shape (3, 3)
    hubs: Ints  #: see `Layout`, as the next three
    at_qpos: Ints
    at_qvel: Ints
    at_ctrl: Ints


def mujoco_flight(model: SwarmModel, data: mujoco.MjData) -> MujocoFlight:
    """MuJoCo's side of a flight; model and data must outlive it.

    Raises:
        SimulationError: MuJoCo's library is not where a package manager puts it.
    """
    _load_library()
    mjmodel, layout = model.mjmodel, model.layout
    return MujocoFlight(
        model=mjmodel._address,
        data=data._address,
        whole=model.own is None,
        qpos=data.qpos,
        qvel=data.qvel,
        forces=data.xfrc_applied,
        ctrl=data.ctrl,
        turned=data.mocap_quat[model.asteroid_mocap],
        matrix=np.empty((3, 3)),
        hubs=layout.hub_body,
        at_qpos=layout.qpos,
        at_qvel=layout.qvel,
        at_ctrl=layout.ctrl,
    )


@cache
def _load_library() -> None:
    prefix = Path(sys.prefix)
    folders = (Path(mujoco.__file__).parent, prefix / "lib", prefix / "Library/bin")
    for folder in folders:
        for pattern in ("libmujoco*.so*", "libmujoco*.dylib", "mujoco.dll"):
            for library in sorted(folder.glob(pattern)):
                binding.load_library_permanently(str(library))
                return
    raise SimulationError(
        f"compiled code needs MuJoCo's library, which is in none of {', '.join(map(str, folders))}; install mujoco anew"
    )


@jittable
def may_step(mj: MujocoFlight, flights: Flights, e: int) -> bool:
    """Whether `step` is all there is to a hold of flight e: of spacecraft that are whole, and all fly."""
    if not mj.whole:
        return False
    for j in range(mj.hubs.shape[0]):
        if flights.resting[e, j] != Resting.FLYING:
            return False
    return True


@allocation_free
def hold(mj: MujocoFlight, flights: Flights, e: int) -> None:
    """Give MuJoCo what flight e holds: forces, motor torques, attitude of the body.

    Of spacecraft that are not whole, the weight of each part must act already.
    """
    for i in range(3):
        for k in range(3):
            mj.matrix[i, k] = flights.C_AN[e, k, i]
    _quaternion_of(mj.turned.ctypes.data, mj.matrix.ctypes.data)
    for j in range(mj.hubs.shape[0]):
        hub, mass = mj.hubs[j], flights.mass[e, j]
        for k in range(3):
            weight = mass * flights.work[e, Slot.A, j, k] if mj.whole else mj.forces[hub, k]
            turning = 0.0 if mj.whole else mj.forces[hub, 3 + k]
            mj.forces[hub, k] = weight + flights.thrust_N[e, j, k]
            mj.forces[hub, 3 + k] = turning + flights.torque_N[e, j, k]
        for w in range(mj.at_ctrl.shape[1]):
            mj.ctrl[mj.at_ctrl[j, w]] = flights.motor[e, j, w]


@allocation_free
def read(mj: MujocoFlight, flights: Flights, e: int) -> None:
    """Take the state of flight e from MuJoCo."""
    for j in range(mj.hubs.shape[0]):
        for k in range(3):
            flights.r_N[e, j, k] = mj.qpos[mj.at_qpos[j, k]]
            flights.v_N[e, j, k] = mj.qvel[mj.at_qvel[j, k]]
            flights.omega_B[e, j, k] = mj.qvel[mj.at_qvel[j, 3 + k]]
        for k in range(4):
            flights.q_BN[e, j, k] = mj.qpos[mj.at_qpos[j, 3 + k]]
        for w in range(mj.at_ctrl.shape[1]):
            flights.wheel_speed[e, j, w] = mj.qvel[mj.at_qvel[j, 6 + w]]


@allocation_free
def step(mj: MujocoFlight, flights: Flights, e: int, timesteps: int) -> None:
    """Fly the hold of flight e."""
    hold(mj, flights, e)
    for _ in range(timesteps):
        _step(np.uintp(mj.model), np.uintp(mj.data))
    read(mj, flights, e)
