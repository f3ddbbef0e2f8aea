"""The fewest spacecraft for whole bodies, ours against plain HiGHS: python -m benchmarks.global_design [--full].

Faces lie at random on a sphere, with areas that differ, candidates see random caps, and all but 0.1 % of the area
must be seen once. Plain HiGHS is given the whole model by `scipy.optimize.milp`. Each case runs in a process of its own, after
compilation, on what cores there are; the peak of its memory is that of the process, the matrix included. With --full the large
cases are run and `docs/results/global_design.md` is written.
"""

from __future__ import annotations

import argparse
import json
import math
import platform
import resource
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import Bounds, LinearConstraint, milp
from scipy.sparse import csr_array, eye_array, hstack

from swarm_mj.designer.exact import solve_exact
from swarm_mj.designer.problem import CoverProblem
from swarm_mj.io.machine import usable_cores

PAGE = Path("docs/results/global_design.md")
#: Faces, candidates, half-angle of their caps [deg], and the tolerance [%].
SMALL = ((1000, 100, 35.0, 0.1), (2000, 200, 30.0, 0.0))
FULL = (
    (1000, 100, 35.0, 0.1),
    (4000, 200, 30.0, 0.1),
    (10_000, 500, 20.0, 0.1),
    (100_000, 2000, 30.0, 0.1),
    (100_000, 2000, 12.0, 0.1),
)
#: What both are given [s].
TIME_LIMIT_S = {False: 10.0, True: 30.0}


def caps(faces: int, candidates: int, half_angle_deg: float, tolerance_percent: float) -> CoverProblem:
    """Faces of unlike area in random directions, and candidates that see caps from 0.7 to 1.3 times the half-angle."""
    rng = np.random.default_rng(33)
    normals, axes = (rng.normal(size=(n, 3)) for n in (faces, candidates))
    normals, axes = (v / np.linalg.norm(v, axis=1, keepdims=True) for v in (normals, axes))
    least = np.cos(np.radians(half_angle_deg * rng.uniform(0.7, 1.3, candidates)))
    sees = np.array([normals @ axis > cos for axis, cos in zip(axes, least, strict=True)])
    area = rng.uniform(0.5, 1.5, faces)
    return CoverProblem(sees=sees, area=area, tolerance_percent=tolerance_percent, max_observers=candidates)


def plain_highs(problem: CoverProblem, time_limit_s: float) -> tuple[int | None, float, bool]:
    """Fewest spacecraft by HiGHS on the whole model: (number, lower bound, whether proven)."""
    n, faces = problem.n_points, np.flatnonzero(problem.coverable)
    covers = hstack([csr_array(problem.sees[:, faces].T.astype(np.float64)), eye_array(len(faces))], format="csr")
    share = 100.0 * problem.area[faces] / problem.area.sum()
    slack = problem.tolerance_percent - (100.0 - share.sum())
    missed = csr_array(np.concatenate([np.zeros(n), share])[None, :])
    answer = milp(
        np.concatenate([np.ones(n), np.zeros(len(faces))]),
        constraints=[LinearConstraint(covers, 1.0, np.inf), LinearConstraint(missed, -np.inf, max(slack, 0.0))],
        integrality=np.ones(n + len(faces)),
        bounds=Bounds(0.0, 1.0),
        options={"time_limit": time_limit_s, "mip_rel_gap": 0.0},
    )
    number = None if answer.x is None else int(np.rint(answer.x[:n]).sum())
    bound = math.ceil(max(answer.mip_dual_bound or 0.0, 0.0) - 1e-6)
    return number, float(bound), answer.status == 0


def run_case(who: str, faces: int, candidates: int, angle: float, tolerance: float, limit: float) -> dict[str, Any]:
    """One case: number, bound, whether proven, time of the clock and of the processor [s], peak memory [MB]."""
    solve_exact(caps(200, 30, 50.0, 1.0))  # compiles
    problem = caps(faces, candidates, angle, tolerance)
    start, busy = time.perf_counter(), time.process_time()
    if who == "swarm_mj":
        result = solve_exact(problem, limit)
        number, bound, proven = result.n_observers, result.bound, result.status == "optimal"
    else:
        number, bound, proven = plain_highs(problem, limit)
    seconds, cpu_s = time.perf_counter() - start, time.process_time() - busy
    peak_MB = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
    return {"number": number, "bound": bound, "proven": proven, "seconds": seconds, "cpu_s": cpu_s, "peak_MB": peak_MB}


def row(case: tuple[int, int, float, float], who: str, found: dict[str, Any] | None) -> str:
    """A line of the table."""
    faces, candidates, angle, tolerance = case
    head = f"| {faces:,} x {candidates:,} | {angle:g} | {tolerance:g} | {who} |"
    if found is None:
        return f"{head} no answer in twice the time and a minute | - | - | - | - | - |"
    number = "none" if found["number"] is None else str(found["number"])
    gap = "-" if found["number"] is None else f"{100.0 * (1.0 - found['bound'] / found['number']):.0f} %"
    proof = "proven" if found["proven"] else gap
    times = f"{found['seconds']:.1f} | {found['cpu_s']:.1f}"
    return f"{head} {number} | {found['bound']:g} | {proof} | {times} | {found['peak_MB']:.0f} |"


def measured(cases: tuple[tuple[int, int, float, float], ...], limit: float) -> list[str]:
    """The table."""
    lines = [
        "| faces x candidates | caps [deg] | tolerance [%] | by | spacecraft | lower bound | gap "
        "| time [s] | processor [s] | peak [MB] |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for case in cases:
        for who in ("swarm_mj", "HiGHS alone"):
            command = [sys.executable, "-m", "benchmarks.global_design", "--case", who, *map(str, case), str(limit)]
            try:
                done = subprocess.run(command, capture_output=True, text=True, timeout=2.0 * limit + 60.0, check=False)
                found = json.loads(done.stdout) if done.returncode == 0 else None
            except subprocess.TimeoutExpired:
                found = None
            lines.append(row(case, who, found))
            print(lines[-1], flush=True)
    return lines


def page(lines: list[str], limit: float) -> str:
    """The page of the results."""
    return f"""# Design of whole bodies

`python -m benchmarks.global_design --full`: the fewest spacecraft that see all but the tolerance of a sphere, by
`swarm_mj.designer.exact.solve_exact` and by HiGHS alone on the whole model (`scipy.optimize.milp`), both told to stop after
{limit:g} s. Faces lie at random over a sphere with areas from 0.5 to 1.5, candidates see caps of 0.7 to 1.3 times the
half-angle about random axes; the seed is fixed. Time is wall-clock time of the solver alone, after compilation; HiGHS looks at
the clock between steps and may take longer than it is given. Memory is the peak of the process, the matrix of what is seen
included (one byte a face and candidate). The gap is that between the design and the proven lower bound. Where processor
time is far below the time, other programs shared the cores, and solvers may find closer bounds on idle ones.
{usable_cores()} cores, {platform.machine()}.

These are no flights: random caps stand for pictures, nothing is hidden or dark, and once is enough; designs of a real body
may be harder or easier. Quality classes and designs with a probability are not in the table.

{chr(10).join(lines)}
"""


def main() -> None:
    """Read the arguments and measure."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--full", action="store_true", help="up to 100,000 faces and 2,000 candidates, and write the page"
    )
    parser.add_argument("--case", nargs=6, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.case:
        who, faces, candidates, *rest = arguments.case
        print(json.dumps(run_case(who, int(faces), int(candidates), *map(float, rest))))
        return
    limit = TIME_LIMIT_S[arguments.full]
    lines = measured(FULL if arguments.full else SMALL, limit)
    if arguments.full:
        PAGE.write_text(page(lines, limit))


if __name__ == "__main__":
    main()
