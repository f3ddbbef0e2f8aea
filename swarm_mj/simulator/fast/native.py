"""MuJoCo's C functions for compiled code."""

from __future__ import annotations

import sys
from functools import cache
from pathlib import Path

import mujoco
from llvmlite import binding

from swarm_mj.errors import SimulationError


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
