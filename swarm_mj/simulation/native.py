"""MuJoCo's C functions for compiled code."""

from __future__ import annotations

import ctypes
from functools import cache
from pathlib import Path

import mujoco

from swarm_mj.errors import SimulationError


@cache
def load_mujoco() -> None:
    """Make MuJoCo's symbols global in the process, where compiled code finds them by name.

    Raises:
        SimulationError: MuJoCo's library is not where the package is.
    """
    folder = Path(mujoco.__file__).parent
    libraries = sorted((*folder.glob("libmujoco*"), *folder.glob("mujoco.dll")))
    if not libraries:
        raise SimulationError(
            f"compiled code needs MuJoCo's library, which is not in {folder}; use physics.wheels: bodies"
        )
    ctypes.CDLL(str(libraries[0]), mode=ctypes.RTLD_GLOBAL)
