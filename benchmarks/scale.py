"""Time and memory of the designer from small to large problems: python -m benchmarks.scale [--write docs/results/scale.md].

Each case runs in a process of its own, on the Eros harmonics sampled at another frequency, with horizon maps as observer, an
empty cache and one worker, after compilation.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import resource
import subprocess
import sys
import tempfile
import time
from contextlib import closing
from operator import itemgetter
from pathlib import Path
from typing import Any

import numpy as np

from swarm_mj.typing import Mask

#: Frequency of the mesh (20 N^2 faces), half-angle of the target and of the camera [deg].
CASES = ((20, 11.0, 4.1), (20, 20.0, 4.1), (71, 20.0, 4.1), (224, 3.5, 1.0), (224, 11.0, 2.3))


def seen_by(scenario: Any, flights: Any) -> Mask:
    """The matrix of what a scenario's candidates see of the target in their flights, shape (n, cells)."""
    from swarm_mj.designer.candidates.pictures import Judge, Watcher
    from swarm_mj.designer.candidates.visibility import imaging_model_from

    watchers = [Watcher(flights, j) for j in range(flights.n)]
    with closing(Judge(flights.plan.region, imaging_model_from(scenario), scenario.observation, workers=1)) as judge:
        return np.array([row for _, row in sorted(judge.seen(watchers), key=itemgetter(0))])


def warm_up() -> None:
    """Compile what `run_case` measures, on a small case."""
    from swarm_mj.designer.candidates.flights import fly_candidates
    from swarm_mj.designer.exact import solve_exact
    from swarm_mj.designer.genetic import GeneticSettings, evolve
    from swarm_mj.designer.problem import CoverProblem
    from swarm_mj.scenarios.loading import load_scenario

    warm = load_scenario("eros-quick", {"observation.criterion": "arrival", "observation.observer": "horizon"})
    flights = fly_candidates(warm)
    small = CoverProblem(sees=seen_by(warm, flights), area=flights.plan.region.area)
    solve_exact(small)
    evolve(small, GeneticSettings(max_generations=2))


def run_case(frequency: int, target: float, camera: float) -> dict[str, Any]:
    """Build and solve one case, with everything compiled before; times in seconds, memory in MiB."""
    from scripts.pages.eros_mesh import eros_at
    from swarm_mj.designer.candidates.flights import fly_candidates
    from swarm_mj.designer.candidates.visibility import imaging_model_from
    from swarm_mj.designer.exact import solve_exact
    from swarm_mj.designer.genetic import GeneticSettings, evolve
    from swarm_mj.designer.problem import CoverProblem
    from swarm_mj.observation.horizon import HorizonObserver
    from swarm_mj.scenarios.loading import load_scenario

    warm_up()
    laps: dict[str, float] = {}

    def lap(name: str, start: float) -> float:
        laps[name] = time.perf_counter() - start
        return time.perf_counter()

    with tempfile.TemporaryDirectory() as folder:
        body = eros_at(frequency, Path(folder))[1]
        scenario = load_scenario(
            "eros-config1",
            {
                **body,
                "target.half_angle_deg": target,
                "camera.half_angle_deg": camera,
                "observation.observer": "horizon",
            },
        )
        start = time.perf_counter()
        flights = fly_candidates(scenario)
        region, imaging_model = flights.plan.region, imaging_model_from(scenario)
        start = lap("flights", start)
        HorizonObserver(region, imaging_model.camera)  # kept on disk from here on
        start = lap("maps", start)
        sees = seen_by(scenario, flights)
        start = lap("pictures", start)
    problem = CoverProblem(sees=sees, area=region.area)
    evolved = evolve(problem, GeneticSettings(max_generations=67, patience=1000))
    start = lap("genetic", start)
    exact = solve_exact(problem, 120.0)
    lap("proof", start)
    return {
        "faces": len(flights.plan.shape.faces),
        "target_faces": region.n_cells,
        "points": flights.n,
        "observers": [evolved.n_observers, exact.n_observers, exact.status],
        "seconds": laps,
        "memory_mib": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
    }


def measured(case: tuple[int, float, float]) -> dict[str, Any]:
    """Run a case in a process of its own, with an empty cache."""
    with tempfile.TemporaryDirectory() as cache:
        command = [sys.executable, "-m", "benchmarks.scale", "--case", json.dumps(case)]
        done = subprocess.run(
            command, env={**os.environ, "SWARM_MJ_CACHE": cache}, stdout=subprocess.PIPE, text=True, check=True
        )
    return dict(json.loads(done.stdout.splitlines()[-1]))


def page(rows: list[dict[str, Any]]) -> str:
    """The table as a page of the documentation."""
    lines = []
    for r in rows:
        s, (evolved, exact, status) = r["seconds"], r["observers"]
        proof = str(exact) if status == "optimal" else f"{exact}, not proven"
        lines.append(
            f"| {r['faces']:,} | {r['target_faces']:,} | {r['points']:,} | {s['flights']:.1f} | {s['maps']:.1f} | "
            f"{s['pictures']:.2f} | {s['genetic']:.2f} | {s['proof']:.2f} | {evolved} | {proof} | {r['memory_mib']:,.0f} |"
        )
    return TEXT.format(rows="\n".join(lines), machine=f"{os.cpu_count()} cores, Python {platform.python_version()}")


TEXT = """\
# Scale of the designer

Generated by `python -m benchmarks.scale --write docs/results/scale.md` ({machine}; times of one run on a shared machine, so read them as
orders of magnitude). Eros's harmonics at finer and finer sampling, the instant of the arrival, horizon maps with one worker and an
empty cache, 67 generations of 100 designs, 120 s for the proof. *Flights* holds loading and checking the mesh, cutting the target
and shooting to every point; *maps* are computed once per target and kept on disk (the second row's were made
while warming up: it is the same target).

| faces | target faces | points | flights [s] | maps [s] | pictures [s] | genetic [s] | proof [s] | observers, genetic | observers, proof | memory [MiB] |
|---|---|---|---|---|---|---|---|---|---|---|
{rows}
"""


def main() -> None:
    """Run one case, or all and print or write the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--case", type=json.loads, help="run only this case, in this process")
    parser.add_argument("--write", type=Path, help="write the page here")
    arguments = parser.parse_args()
    if arguments.case:
        print(json.dumps(run_case(*arguments.case)))
        return
    rows = []
    for case in CASES:
        rows.append(measured(case))
        print(rows[-1], flush=True)
    text = page(rows)
    if arguments.write:
        arguments.write.write_text(text, encoding="utf-8")
    else:
        print(text)


if __name__ == "__main__":
    main()
