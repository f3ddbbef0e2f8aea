"""Paired timing, and results as JSON with the machine that they come from.

The works take turns in every round, and what counts are medians and the rounds' ratios.
"""

from __future__ import annotations

import json
import platform
import resource
import sys
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path
from time import perf_counter, process_time
from typing import Any

import numpy as np

from swarm_mj.io.machine import usable_cores
from swarm_mj.typing import Array

#: Where the project's own benchmarks keep their results, below the folder they are run in.
FOLDER = Path("benchmarks") / "results"
#: Whose versions are told.
PACKAGES = ("mujoco", "numpy", "numba", "swarm_mj")
#: Where Linux tells what a process needs.
STATUS = Path("/proc/self/status")


@dataclass(frozen=True, kw_only=True)
class Row:
    """One line of a table.

    Attributes:
        group: Benchmark it belongs to.
        name: What was measured.
        value: Median.
        unit: Of the value; "ratio" for a quotient of two medians of one run.
        low: Lower quartile over the rounds.
        high: Upper quartile.
        target: What it shall be, as text such as ">= 4", or empty.
        note: What a reader must know.
    """

    group: str
    name: str
    value: float
    unit: str
    low: float
    high: float
    target: str = ""
    note: str = ""

    @property
    def met(self) -> bool | None:
        """Whether the target is met; None without one."""
        if not self.target:
            return None
        relation, bound = self.target.split()
        return self.value <= float(bound) if relation == "<=" else self.value >= float(bound)

    def as_json(self) -> dict[str, Any]:
        """Everything, and whether the target is met."""
        return asdict(self) | {"met": self.met}


def row(group: str, name: str, samples: Array, unit: str, target: str = "", note: str = "") -> Row:
    """A row from the samples of all rounds."""
    low, value, high = np.percentile(samples, [25.0, 50.0, 75.0])
    return Row(
        group=group,
        name=name,
        value=float(value),
        unit=unit,
        low=float(low),
        high=float(high),
        target=target,
        note=note,
    )


def in_turn(works: Mapping[str, Callable[[], object]], rounds: int, warm_up: int = 1) -> dict[str, Array]:
    """Seconds of each work in each round, shape (rounds,); the rounds that warm up are not counted."""
    times: dict[str, list[float]] = {name: [] for name in works}
    for k in range(warm_up + rounds):
        for name, work in works.items():
            start = perf_counter()
            work()
            if k >= warm_up:
                times[name].append(perf_counter() - start)
    return {name: np.array(values) for name, values in times.items()}


def rates(work: Callable[[], int], seconds: float) -> tuple[float, float]:
    """Units of `work`, which returns how many it did, per second and per second of processor time; it works once at least."""
    start, used = perf_counter(), process_time()
    done = work()
    while perf_counter() - start < seconds:
        done += work()
    return done / (perf_counter() - start), done / (process_time() - used)


def peak_memory_mib() -> float:
    """Largest resident memory of this process so far [MiB]."""
    if STATUS.exists():
        # Not ru_maxrss: Linux hands that of the parent down to what it starts.
        fields = dict(line.split(":", 1) for line in STATUS.read_text().splitlines())
        if "VmHWM" in fields:
            return float(fields["VmHWM"].split()[0]) / 1024
    unit = 1024**2 if sys.platform == "darwin" else 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / unit


def machine() -> dict[str, Any]:
    """Processor, cores, system and versions."""
    model = platform.processor() or platform.machine()
    info = Path("/proc/cpuinfo")
    if info.exists():
        names = [
            line.split(":", 1)[1].strip() for line in info.read_text().splitlines() if line.startswith("model name")
        ]
        model = names[0] if names else model
    return {
        "processor": model,
        "cores": usable_cores(),
        "system": platform.system(),
        "python": platform.python_version(),
        **{name: version(name) for name in PACKAGES},
    }


def write_results(name: str, results: Any, folder: Path = FOLDER) -> Path:
    """Write `results` to `<folder>/<name>.json`; returns the file."""
    folder.mkdir(parents=True, exist_ok=True)
    file, part = folder / f"{name}.json", folder / f".{name}.json.part"
    part.write_text(json.dumps({"machine": machine(), "results": results}, indent=2) + "\n", encoding="utf-8")
    part.replace(file)
    return file
