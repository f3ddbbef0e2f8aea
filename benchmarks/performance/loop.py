"""The whole loop against raw `mj_step` of the same model with the same forces held; real-time factor and memory."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from typing import Any

import mujoco
import numpy as np

from benchmarks.measure import Row, in_turn, peak_memory_mib, row
from swarm_mj.flight.fly import make_simulation
from swarm_mj.flight.plan import make_plan
from swarm_mj.scenarios.loading import load_scenario
from swarm_mj.simulator.simulation import Simulation

#: Numbers of spacecraft, and those of the quick version.
SIZES, QUICK_SIZES = (1, 6, 20, 100, 1000), (1, 6, 20)
#: Spacecraft and, where there is one, the bound of the ratio.
TARGETS = {6: "<= 1.20", 100: "<= 1.15", 1000: "<= 1.15"}
#: Memory of a process that flies 1,000 spacecraft [MiB].
MEMORY_TARGET = "<= 1024"


def swarm(n: int) -> Simulation:
    """Configuration 1 of the paper with n spacecraft; visiting points repeat where there are more spacecraft than points."""
    points = [1 + k % 51 for k in range(max(1, n - 1))]
    overrides: dict[str, Any] = {"design.visiting_points": points}
    if n == 1:
        overrides["behavior.name"] = "adaptable_roles"
    plan = make_plan(load_scenario("eros-config1", overrides), check_separation=False)
    return make_simulation(plan)


def loop_rows(n: int, rounds: int) -> list[Row]:
    """Loop over raw step, and how much faster than the flight it runs, for n spacecraft."""
    simulation = swarm(n)
    periods = max(5, min(400, 2400 // n))
    hold = round(simulation.period / simulation.model.mjmodel.opt.timestep)
    simulation.run(5.0, 1.0)  # compiles

    def whole() -> None:
        simulation.fly(periods)

    def raw() -> None:
        mujoco.mj_step(simulation.model.mjmodel, simulation.data, nstep=hold * periods)

    times = in_turn({"loop": whole, "raw": raw}, rounds)
    factor = periods * simulation.period / times["loop"]
    return [
        row("loop", f"loop / raw mj_step, {n} spacecraft", times["loop"] / times["raw"], "ratio", TARGETS.get(n, "")),
        row("loop", f"faster than the flight, {n} spacecraft", factor, "times"),
    ]


def memory_row(n: int) -> Row:
    """Largest resident memory of a process of its own that plans and flies n spacecraft, everything imported counted."""
    done = subprocess.run(
        [sys.executable, "-m", "benchmarks.performance.loop", str(n)],
        check=True,
        capture_output=True,
        text=True,
    )
    return row(
        "loop",
        f"memory, {n} spacecraft",
        np.array([json.loads(done.stdout)["memory_MiB"]]),
        "MiB",
        MEMORY_TARGET if n == 1000 else "",
    )


def rows(quick: bool) -> Iterator[Row]:
    """All of it."""
    for n in QUICK_SIZES if quick else SIZES:
        yield from loop_rows(n, 7 if quick else 15)
        yield memory_row(n)


if __name__ == "__main__":
    flown = swarm(int(sys.argv[1]))
    flown.run(5.0, 1.0)
    print(json.dumps({"memory_MiB": peak_memory_mib()}))
