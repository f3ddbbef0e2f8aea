"""The main job, both configurations of the paper with figures and report, by stage: at first and again."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from time import perf_counter

import numpy as np

from swarm_mj.bench.measure import Row, row


def rows(quick: bool) -> Iterator[Row]:
    """Cold: compiled code and caches in an empty folder; warm: the same again. Figures and report are part of it."""
    scenarios = ["eros-quick"] if quick else ["eros-config1", "eros-config2"]
    with tempfile.TemporaryDirectory() as folder:
        caches = {"NUMBA_CACHE_DIR": f"{folder}/numba", "SWARM_MJ_CACHE": f"{folder}/cache"}
        for name in ("cold", "warm") if not quick else ("warm",):
            if quick:
                caches = {}
            seconds, stages = _run(scenarios, Path(folder) / name, caches)
            target = "<= 90" if name == "cold" else ""
            yield row("main job", f"{' and '.join(scenarios)}, {name}", np.array([seconds]), "s", target)
            for stage, value in stages.items():
                yield row("main job", f"  {stage}, {name}", np.array([value]), "s")


def _run(scenarios: list[str], out: Path, caches: dict[str, str]) -> tuple[float, dict[str, float]]:
    import json
    import os

    start = perf_counter()
    command = [sys.executable, "-m", "swarm_mj.cli", "run", *scenarios, "--quiet", "--out", str(out)]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, env=os.environ | caches)
    seconds = perf_counter() - start
    stages: dict[str, float] = {}
    for file in sorted(out.rglob("summary.json")):
        for stage, value in json.loads(file.read_text(encoding="utf-8")).get("wall_s", {}).items():
            stages[stage] = stages.get(stage, 0.0) + float(value)
    return seconds, stages
