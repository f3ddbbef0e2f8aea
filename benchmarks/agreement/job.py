"""What a program is asked, in a folder, and what it answers. Nothing of swarm_mj: the programs compute by themselves.

Frame E is EME2000 (SPICE's J2000), N is ecliptic (SPICE's ECLIPJ2000), A is fixed in the body, B in the spacecraft. SI.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from dataclasses import dataclass
from math import radians
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
DAY = 86_400.0


@dataclass(frozen=True)
class Job:
    """A flight as a program gets it.

    Attributes:
        folder: It holds `job.json`, `asked.npz`, the export in `export`, messages of the newer generation in `export3`.
        facts: The content of `job.json`, see `flights.facts`.
        asked: Times and starts, see `flights.asked`.
    """

    folder: Path
    facts: dict[str, Any]
    asked: dict[str, Array]

    @classmethod
    def read(cls, folder: Path) -> Job:
        """The job in a folder."""
        with np.load(folder / "asked.npz") as file:
            asked = {name: file[name] for name in file.files}
        return cls(folder, json.loads((folder / "job.json").read_text(encoding="utf-8")), asked)

    def answer(self, program: str, **values: Any) -> None:
        """Write what a program answers."""
        np.savez(self.folder / f"{program}.npz", **{key: np.asarray(value) for key, value in values.items()})

    def file(self, name: str) -> str:
        """Path of an exported file."""
        return str(self.folder / "export" / name)

    def files(self, kind: str, generation: int = 2) -> list[str]:
        """Paths of the messages of all spacecraft, in order."""
        folder = "export" if generation == 2 else "export3"
        return [str(self.folder / folder / kind / f"{name}.{kind}") for name in self.facts["names"]]

    def angles(self, which: str) -> tuple[float, float, float, float]:
        """Right ascension and declination of the pole, W at the epoch [rad] and its rate [rad/s].

        Args:
            which: `exported`, in the PCK, or `published`, in the scenario.
        """
        ra, dec, w0, rate = self.facts["rotation"][which]
        turned = (w0 + rate * self.facts["et"] / DAY) % 360.0
        return radians(ra), radians(dec), radians(turned), radians(rate) / DAY


def work(program: str, compute: Callable[[Job], dict[str, Any]]) -> None:
    """Of a worker: read the job in the folder of the command line, compute, write the answer."""
    job = Job.read(Path(sys.argv[1]))
    job.answer(program, **compute(job))
