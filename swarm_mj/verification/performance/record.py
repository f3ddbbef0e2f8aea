"""Results of a benchmark as JSON, with the machine they come from."""

from __future__ import annotations

import json
import platform
from importlib.metadata import version
from pathlib import Path
from typing import Any

from swarm_mj.io.cores import usable_cores

#: Where the project's own benchmarks keep their results, below the folder they are run in.
FOLDER = Path("benchmarks") / "results"
#: Whose versions are told.
PACKAGES = ("mujoco", "numpy", "numba", "swarm_mj")


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
