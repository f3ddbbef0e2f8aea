"""Cost and memory of both programs by the number of spacecraft.

All fly the problem's flight with as many spacecraft, from the same start, by turns: in every round each flies the next stretch,
the same for all. At the end their states are compared. Memory is measured in a process for each program and number, which is
handed the problem ready made.
"""

from __future__ import annotations

import json
import pickle
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from benchmarks.basilisk.clock import seconds
from benchmarks.basilisk.problem import (
    DURATION_S,
    EQUAL_STEP_S,
    PROGRAMS,
    STEPPERS,
    Flight,
    Problem,
    difference,
    make_problem,
)
from benchmarks.measure import peak_memory_mib

SIZES = (1, 6, 20, 100, 1000)
#: Spacecraft times seconds that are flown in a round at most, and seconds at least.
WORK_S, SHORTEST_S = 3000, 5

Results = dict[str, Any]
ROOT = Path(__file__).parents[2]


class Flying(Protocol):
    """A flight under way."""

    def fly_to(self, end: float) -> None:
        """Fly on until `end` [s]."""
        ...

    def state(self) -> Flight:
        """Where the swarm is now, a flight of one sample."""
        ...


def start(program: str, problem: Problem) -> Flying:
    """The flight by a program, set up and not recorded."""
    if program == "basilisk":
        from benchmarks.basilisk import peer

        return peer.make(problem, EQUAL_STEP_S, record=False)
    from benchmarks.basilisk import ours

    return ours.Swarm(ours.make(problem, EQUAL_STEP_S, program))


def stretch(n: int, rounds: int) -> int:
    """Seconds that n spacecraft fly in a round, so that all rounds and one to warm up fit into the flight."""
    return min(int(DURATION_S) // (rounds + 1), max(SHORTEST_S, WORK_S // n))


def scaling(rounds: int, report: Callable[[str], None], sizes: Sequence[int] = SIZES) -> list[Results]:
    """Processor time and memory by number of spacecraft and stepper, and Basilisk's over ours."""
    rows = []
    for n in sizes:
        report(f"{n:,} spacecraft, {rounds} rounds")
        rows += _size_rows(make_problem(n), rounds)
    return rows


def _size_rows(problem: Problem, rounds: int) -> list[Results]:
    flown = stretch(problem.n, rounds)
    swarms = {program: start(program, problem) for program in PROGRAMS}
    times: dict[str, list[tuple[float, float]]] = {program: [] for program in PROGRAMS}
    for k in range(rounds + 1):
        for program, swarm in swarms.items():
            times[program].append(seconds(partial(swarm.fly_to, float((k + 1) * flown))))
    # The first round warms up.
    measured = {program: np.array(values[1:]) for program, values in times.items()}
    states = {program: swarm.state() for program, swarm in swarms.items()}
    # Last, so that nothing is compiled any more.
    memories = {program: memory(program, problem) for program in PROGRAMS}
    theirs = measured["basilisk"]
    rows = []
    for program in STEPPERS:
        mine = measured[program]
        ratios = theirs[:, 0] / mine[:, 0]
        rows.append(
            {
                "spacecraft": problem.n,
                "stepper": program,
                "flown_s": flown,
                "basilisk_cpu_s": float(np.median(theirs[:, 0])),
                "cpu_s": float(np.median(mine[:, 0])),
                "ratio": float(np.median(ratios)),
                "ratio_quartiles": np.quantile(ratios, [0.25, 0.75]).tolist(),
                "ratio_wall": float(np.median(theirs[:, 1] / mine[:, 1])),
                "basilisk_faster_than_flight": float(np.median(flown / theirs[:, 1])),
                "faster_than_flight": float(np.median(flown / mine[:, 1])),
                "basilisk_memory": memories["basilisk"],
                "memory": memories[program],
                "difference": vars(difference(states[program], states["basilisk"])),
            }
        )
    return rows


def memory(program: str, problem: Problem) -> Results:
    """Largest resident memory of a process that flies the problem by a program, and what it was before that [MiB]."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "problem"
        file.write_bytes(pickle.dumps(problem))
        command = [sys.executable, "-m", "benchmarks.basilisk.scale", program, str(file)]
        done = subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True)
    return dict(json.loads(done.stdout.splitlines()[-1]))


def fly_here(program: str, file: Path) -> Results:
    """Fly the problem in a file a little way in this process; returns its memory, see `memory`."""
    problem = pickle.loads(file.read_bytes())
    before = peak_memory_mib()
    start(program, problem).fly_to(float(SHORTEST_S))
    return {"peak_mib": peak_memory_mib(), "before_mib": before}


if __name__ == "__main__":
    print(json.dumps(fly_here(sys.argv[1], Path(sys.argv[2]))))
