"""The main job, both configurations of the paper with figures and report, by stage: at first and again; and its figures."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from time import perf_counter

import numpy as np

from benchmarks.measure import Row, in_turn, row
from swarm_mj.figures.drawing import composers, draw_all, prepare_drawing
from swarm_mj.figures.run_figures import draw
from swarm_mj.flight.fly import simulate
from swarm_mj.flight.observe import observe_flight
from swarm_mj.flight.plan import make_plan
from swarm_mj.io.machine import usable_cores
from swarm_mj.reports import REPORT_NAME
from swarm_mj.scenarios.loading import load_scenario

#: What no stage counts: Python and its imports, files of results, tables on the screen.
REST = "start-up, files and the rest"


def rows(quick: bool) -> Iterator[Row]:
    """Cold: compiled code and caches in an empty folder; warm: the same again. The stages sum to the whole.

    The quick version runs a small scenario once, with what compiled code and caches there are.
    """
    if quick:
        with tempfile.TemporaryDirectory() as folder:
            yield from _rows(["eros-quick"], "once, caches as found", *run(["eros-quick"], Path(folder) / "once", {}))
        yield drawing("eros-quick", 1)
        return
    scenarios = ["eros-config1", "eros-config2"]
    with tempfile.TemporaryDirectory() as folder:
        caches = {"NUMBA_CACHE_DIR": f"{folder}/numba", "SWARM_MJ_CACHE": f"{folder}/cache"}
        whole = {}
        for name, target in (("cold", "<= 90"), ("warm", "")):
            whole[name], by_stage = run(scenarios, Path(folder) / name, caches)
            yield from _rows(scenarios, name, whole[name], by_stage, target)
    yield row(
        "main job", "first run, cold, over the next one, warm", np.array([whole["cold"] / whole["warm"]]), "ratio"
    )
    yield drawing(scenarios[0], 5)


def drawing(scenario: str, rounds: int) -> Row:
    """The figures of a flight by other processes, over one after another; neither counts what the first ones load."""
    plan = make_plan(load_scenario(scenario))
    telemetry = simulate(plan)
    result = observe_flight(plan, telemetry)
    prepare_drawing()
    with tempfile.TemporaryDirectory() as folder:

        def here() -> None:
            for name in composers(telemetry):
                draw(name, Path(folder), plan, telemetry, result)

        seconds = in_turn({"beside": lambda: draw_all(Path(folder), plan, telemetry, result), "here": here}, rounds)
    name = f"figures of {scenario}, by other processes / one after another"
    return row("main job", name, seconds["beside"] / seconds["here"], "ratio", note=f"on {usable_cores()} cores")


def _rows(scenarios: list[str], name: str, seconds: float, stages: dict[str, float], target: str = "") -> Iterator[Row]:
    yield row("main job", f"{' and '.join(scenarios)}, {name}", np.array([seconds]), "s", target)
    for stage, value in stages.items():
        yield row("main job", f"  {stage}, {name}", np.array([value]), "s")


def run(scenarios: list[str], out: Path, caches: dict[str, str]) -> tuple[float, dict[str, float]]:
    """Fly scenarios by the command, into a folder that does not exist yet.

    Returns:
        Seconds of the whole command, and by stage over all scenarios; they sum to the whole.
    """
    start = perf_counter()
    command = [sys.executable, "-m", "swarm_mj.cli.main", "fly", *scenarios, "--quiet", "--out", str(out)]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, env=os.environ | caches)
    seconds = perf_counter() - start
    return seconds, stages(out, seconds)


def stages(out: Path, seconds: float) -> dict[str, float]:
    """Seconds by stage of the runs below a folder, and what of the whole no stage counts."""
    found: dict[str, float] = {}
    for file in sorted(out.rglob("summary.json")):
        of_run = {
            stage: float(value) for stage, value in json.loads(file.read_text(encoding="utf-8"))["wall_s"].items()
        }
        # The summary is written before the report, which can tell its time by its file alone.
        report = file.with_name(REPORT_NAME)
        of_run["figures"] = of_run.pop("figures", 0.0)  # where it belongs in the order
        of_run["report"] = 1e-9 * (report.stat().st_mtime_ns - file.stat().st_mtime_ns)
        for stage, value in of_run.items():
            found[stage] = found.get(stage, 0.0) + value
    return found | {REST: seconds - sum(found.values())}
