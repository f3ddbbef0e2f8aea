"""Rates of both programs in interleaved rounds, and ours over theirs."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.bsk_rl.link import Peer
from benchmarks.measure import Row, rates, row
from benchmarks.performance.environment import PLANNED, SCENARIO, single_steps, vector_steps
from swarm_mj.scenarios.loading import load_scenario

Array = NDArray[np.float64]

#: Names in `examples.EXAMPLES`; the steps of `scanning_10s` are as long as ours.
EXAMPLES = ("scanning", "scanning_10s", "imaging")
#: Those of them that are bsk_rl's own, as its documentation shows them.
DOCUMENTED = ("scanning", "imaging")
NUM_ENVS, STEP_S = 64, 10.0
TARGET = ">= 30"
#: What is compared, and its unit.
STEPS, STEPS_CPU = "environment steps", "environment steps by processor time"
SIMULATED, SIMULATED_CPU = "simulated time", "simulated time by processor time"
MEASURES = {STEPS: "steps/s", STEPS_CPU: "steps/s", SIMULATED: "s/s", SIMULATED_CPU: "s/s"}


def compare(peer: Peer, rounds: int, seconds: float, report: Callable[[str], None]) -> dict[str, Any]:
    """Measure everything; each work takes `seconds` of wall clock in every round."""
    flyby = load_scenario(SCENARIO, PLANNED)
    works = {"single": single_steps(scenario=flyby), f"vector of {NUM_ENVS}": vector_steps(NUM_ENVS, scenario=flyby)}
    ours: dict[str, list[dict[str, float]]] = {name: [] for name in works}
    theirs: dict[str, list[dict[str, float]]] = {name: [] for name in EXAMPLES}
    answers: dict[str, list[dict[str, float]]] = {name: [] for name in EXAMPLES}
    for k in range(rounds + 1):
        report("warming up" if k == 0 else f"round {k} of {rounds}")
        for name, work in works.items():
            sample = our_rates(*rates(work, seconds))
            if k > 0:
                ours[name].append(sample)
        for name in EXAMPLES:
            answer = peer.measure(name, seconds)
            if k > 0:
                answers[name].append(answer)
                theirs[name].append(their_rates(answer))
    return {
        "peer": peer.versions,
        "rounds": rounds,
        "seconds": seconds,
        "examples": {name: summary(found) for name, found in answers.items()},
        "rows": [line.as_json() for line in rows(ours, theirs)],
    }


def our_rates(wall: float, cpu: float) -> dict[str, float]:
    """Rates by measure from steps per second of wall clock and of processor time."""
    return {STEPS: wall, STEPS_CPU: cpu, SIMULATED: wall * STEP_S, SIMULATED_CPU: cpu * STEP_S}


def their_rates(answer: dict[str, float]) -> dict[str, float]:
    """Rates by measure from what the peer answered; its resets are left out."""
    steps, simulated, wall, cpu = (answer[key] for key in ("steps", "simulated_s", "wall_s", "cpu_s"))
    return {STEPS: steps / wall, STEPS_CPU: steps / cpu, SIMULATED: simulated / wall, SIMULATED_CPU: simulated / cpu}


def summary(answers: list[dict[str, float]]) -> dict[str, float | None]:
    """Length of a step [s], and of a reset in processor time [s] (None: no episode ended), over all rounds."""
    total = {key: sum(answer[key] for answer in answers) for key in answers[0]}
    return {
        "step_s": total["simulated_s"] / total["steps"],
        "reset_cpu_s": total["reset_cpu_s"] / total["resets"] if total["resets"] else None,
        "reset_share_cpu": total["reset_cpu_s"] / (total["cpu_s"] + total["reset_cpu_s"]),
    }


def rows(ours: dict[str, list[dict[str, float]]], theirs: dict[str, list[dict[str, float]]]) -> Iterator[Row]:
    """Rates of everything, then the rounds' ratios; what the project asks for is wall clock per environment step."""
    for measure, unit in MEASURES.items():
        for name, samples in (*ours.items(), *theirs.items()):
            yield row(measure, name, of(measure, samples), unit)
    for measure in MEASURES:
        for one, mine in ours.items():
            for other, peers in theirs.items():
                target = TARGET if measure == STEPS and other in DOCUMENTED else ""
                ratio = of(measure, mine) / of(measure, peers)
                yield row(measure, f"{one} / {other}", ratio, "ratio", target)


def of(measure: str, samples: list[dict[str, float]]) -> Array:
    """One measure of all rounds, shape (rounds,)."""
    return np.array([sample[measure] for sample in samples])
