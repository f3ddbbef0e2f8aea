"""Accuracy and cost of both programs on the problem."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.basilisk import ours, peer, reference
from benchmarks.basilisk.clock import seconds
from benchmarks.basilisk.problem import EQUAL_STEP_S, PERIOD_S, PROGRAMS, STEPPERS, Flight, Problem, difference
from benchmarks.basilisk.rounding import drift

#: Whole fractions of the control period, longest first.
STEPS_S = (0.5, 0.25, 0.1, 0.05)
#: What a step must keep to count as accurate enough.
ATTITUDE_DEG, POSITION_M = 5e-4, 1e-3

Results = dict[str, Any]
Array = NDArray[np.float64]


def fly(program: str, problem: Problem, step: float) -> Flight:
    """The flight by a program, recorded."""
    return peer.fly(problem, step) if program == "basilisk" else ours.fly(problem, step, program)


def ready(program: str, problem: Problem, step: float) -> Callable[[], object]:
    """The flight by a program, set up and not recorded."""
    if program == "basilisk":
        return peer.ready(problem, step)
    return ours.ready(problem, step, program)


def agreement(problem: Problem, report: Callable[[str], None]) -> Results:
    """Differences of every program and step from SciPy, and of the programs from each other at the equal step."""
    report("SciPy DOP853")
    truth = reference.fly(problem)
    report("SciPy DOP853, longer steps")
    own = difference(reference.fly(problem, PERIOD_S), truth)
    flights: dict[tuple[str, float], Flight] = {}
    for step in STEPS_S:
        for program in PROGRAMS:
            report(f"{program}, step {step:g} s")
            flights[program, step] = fly(program, problem, step)
    others = [flights[program, EQUAL_STEP_S] for program in PROGRAMS]
    return {
        "reference_with_longer_steps": vars(own),
        "steps": [
            {"program": program, "step_s": step, **vars(difference(flight, truth))}
            for (program, step), flight in flights.items()
        ],
        "drift": drift(problem),
        "between": [
            {"program": program, "step_s": EQUAL_STEP_S, **vars(difference(other, others[0]))}
            for program, other in zip(PROGRAMS[1:], others[1:], strict=True)
        ],
    }


def cheapest_step(rows: list[Results], program: str) -> float:
    """The longest step of a program that is accurate enough [s]."""
    accurate = [
        row["step_s"]
        for row in rows
        if row["program"] == program
        and np.degrees(row["attitude_rad"]) < ATTITUDE_DEG
        and row["position_m"] < POSITION_M
    ]
    return max(accurate)


def timing(problem: Problem, rows: list[Results], rounds: int, report: Callable[[str], None]) -> list[Results]:
    """Processor time of whole flights, interleaved, and Basilisk's over ours, medians of the rounds."""
    chosen = [(EQUAL_STEP_S,) * 3, tuple(cheapest_step(rows, program) for program in PROGRAMS)]
    cases = {(program, step): partial(ready, program, problem, step) for program, step in _cases(chosen)}
    for program, step in _cases(chosen):
        if program in STEPPERS:
            cases[f"{program} stepping", step] = partial(ours.stepping, problem, step, program)
    for case in cases.values():
        case()()  # compiles
    times: dict[tuple[str, float], list[tuple[float, float]]] = {key: [] for key in cases}
    for k in range(rounds):
        report(f"timing, round {k + 1} of {rounds}")
        for key, case in cases.items():
            times[key].append(seconds(case()))
    measured = {key: np.array(values) for key, values in times.items()}
    return [
        _row(what, program, steps[0], step, measured)
        for what, steps in zip(("equal step", "cheapest accurate step"), chosen, strict=True)
        for program, step in zip(PROGRAMS[1:], steps[1:], strict=True)
    ]


def _cases(chosen: list[tuple[float, ...]]) -> list[tuple[str, float]]:
    return sorted({(program, step) for steps in chosen for program, step in zip(PROGRAMS, steps, strict=True)})


def _row(what: str, program: str, their_step: float, step: float, measured: dict[tuple[str, float], Array]) -> Results:
    theirs, mine = measured[PROGRAMS[0], their_step], measured[program, step]
    stepping = measured[f"{program} stepping", step]
    ratios = theirs[:, 0] / mine[:, 0]
    return {
        "what": what,
        "stepper": program,
        "basilisk_step_s": their_step,
        "step_s": step,
        "basilisk_cpu_s": float(np.median(theirs[:, 0])),
        "cpu_s": float(np.median(mine[:, 0])),
        "ratio": float(np.median(ratios)),
        "ratio_quartiles": np.quantile(ratios, [0.25, 0.75]).tolist(),
        "ratio_wall": float(np.median(theirs[:, 1] / mine[:, 1])),
        "stepping_cpu_s": float(np.median(stepping[:, 0])),
        "ratio_of_stepping": float(np.median(theirs[:, 0] / stepping[:, 0])),
    }
