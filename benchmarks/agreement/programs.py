"""The other programs: what they need, whether it is here, and their answers, each from a process of its own."""

from __future__ import annotations

import importlib.util
import subprocess
import sys
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
ROOT: Final = Path(__file__).parents[2]
TIMEOUT_S: Final = 900


@dataclass(frozen=True)
class Program:
    """One of the programs.

    Attributes:
        title: For the page.
        module: That Python imports.
        package: Distribution, for its version.
        install: What pip is told.
        what: What of it is used.
    """

    title: str
    module: str
    package: str
    install: str
    what: str


PROGRAMS: Final = {
    "scipy": Program("SciPy", "scipy", "scipy", "pip install scipy", "DOP853; equations written anew, the arbiter"),
    "orekit": Program(
        "Orekit",
        "orekit_jcc",
        "orekit-jcc",
        "pip install orekit-jcc",
        "DormandPrince853, Holmes-Featherstone gravity, frames, DE-430, parsers of OEM and AEM",
    ),
    "brahe": Program(
        "brahe", "brahe", "brahe", "pip install brahe", "RKF78, spherical harmonics, rotations, readers of OEM and AEM"
    ),
    "spiceypy": Program(
        "SPICE", "spiceypy", "spiceypy", "pip install spiceypy", "reads the kernels: PCK, SPK, CK, DSK, LSK"
    ),
    "basilisk": Program(
        "Basilisk",
        "Basilisk",
        "bsk",
        "pip install bsk",
        "RK4, gravity of a rotating planet, spacecraft with balanced wheels",
    ),
}


def installed(name: str) -> str | None:
    """Version of a program, None where it is not installed."""
    program = PROGRAMS[name]
    if importlib.util.find_spec(program.module) is None:
        return None
    try:
        return version(program.package)
    except PackageNotFoundError:
        return None


def ask(name: str, folder: Path) -> dict[str, Array]:
    """What a program answers to the job in a folder.

    Raises:
        RuntimeError: It fails; the last lines that it wrote.
    """
    command = [sys.executable, "-m", f"benchmarks.agreement.in_{'spice' if name == 'spiceypy' else name}", str(folder)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=TIMEOUT_S, check=False)
    if done.returncode:
        raise RuntimeError(f"{name} failed: " + "\n".join(done.stderr.splitlines()[-12:]))
    with np.load(folder / f"{name}.npz") as file:
        return {key: file[key] for key in file.files}
