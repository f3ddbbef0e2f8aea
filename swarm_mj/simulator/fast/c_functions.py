"""MuJoCo's C functions that compiled code calls: all of them stand here, each with what it is called for.

Their signatures are those of MuJoCo 4 (mujoco.h); `pyproject.toml` bounds the version. Every pointer is passed as an address.
`load_mujoco` must have been called before a compiled function that uses them is compiled or read from the cache.
"""

from __future__ import annotations

import sys
from functools import cache
from pathlib import Path

import mujoco
from llvmlite import binding
from numba import types

from swarm_mj.errors import SimulationError

_ADDRESS = types.intp
_OF_STATE = types.void(_ADDRESS, _ADDRESS)  # (const mjModel*, mjData*)

#: One whole timestep, of models that are not stepped stage by stage.
mj_step = types.ExternalFunction("mj_step", _OF_STATE)
#: Poses of all bodies from qpos.
mj_kinematics = types.ExternalFunction("mj_kinematics", _OF_STATE)
#: Centres of mass and the motion axes of the joints about them.
mj_comPos = types.ExternalFunction("mj_comPos", _OF_STATE)
#: The inertia matrix M.
mj_makeM = types.ExternalFunction("mj_makeM", _OF_STATE)
#: Its factors, by which accelerations are solved for.
mj_factorM = types.ExternalFunction("mj_factorM", _OF_STATE)
#: Moment arms of the motors, once a hold.
mj_transmission = types.ExternalFunction("mj_transmission", _OF_STATE)
#: The motors' torques from ctrl, once a hold.
mj_fwdActuation = types.ExternalFunction("mj_fwdActuation", _OF_STATE)
#: Velocities of all bodies.
mj_comVel = types.ExternalFunction("mj_comVel", _OF_STATE)
#: qacc_smooth from applied forces, motors and bias forces.
mj_fwdAcceleration = types.ExternalFunction("mj_fwdAcceleration", _OF_STATE)
#: The bias forces (gyroscopic and centrifugal): recursive Newton-Euler without accelerations; (model, data, flag, result).
mj_rne = types.ExternalFunction("mj_rne", types.void(_ADDRESS, _ADDRESS, types.intc, _ADDRESS))
#: Move qpos along a velocity for a time, on the sphere where it is a quaternion; (model, qpos, qvel, dt).
mj_integratePos = types.ExternalFunction("mj_integratePos", types.void(_ADDRESS, _ADDRESS, _ADDRESS, types.float64))


@cache
def load_mujoco() -> None:
    """Make MuJoCo's symbols known to compiled code, which finds them by name.

    Raises:
        SimulationError: MuJoCo's library is not where a package manager puts it.
    """
    prefix = Path(sys.prefix)
    folders = (Path(mujoco.__file__).parent, prefix / "lib", prefix / "Library/bin")
    for folder in folders:
        libraries = sorted(
            (*folder.glob("libmujoco*.so*"), *folder.glob("libmujoco*.dylib"), *folder.glob("mujoco.dll"))
        )
        if libraries:
            binding.load_library_permanently(str(libraries[0]))
            return
    raise SimulationError(
        f"compiled code needs MuJoCo's library, which is in none of {', '.join(map(str, folders))}; install mujoco anew"
    )
