"""The whole loop against raw `mj_step` of the same model, interleaved in one run: python -m benchmarks.loop_overhead.

The unit is one control period (0.5 s of flight, five steps of 0.1 s). The raw case lets MuJoCo integrate the same model with
the same non-zero forces and torques held; the loop adds gravity, behaviour, guidance, control and telemetry.
"""

from __future__ import annotations

import argparse
import time

import mujoco
import numpy as np

from swarm_mj.flight import make_simulation
from swarm_mj.planning import make_plan
from swarm_mj.scenarios.loading import load_scenario

ROUNDS, PERIODS = 15, 400


def measure(n_observers: int) -> tuple[float, float, float]:
    """Median microseconds per control period of loop and raw step, and the median ratio of the rounds."""
    points = [1 + k % 51 for k in range(n_observers)]
    scenario = load_scenario("eros-config1", [f"design.visiting_points={points}"])
    simulation = make_simulation(make_plan(scenario))
    periods = max(20, PERIODS * 6 // (n_observers + 1))
    simulation.run(10.0, 1.0)  # compiles
    rows = []
    for _ in range(ROUNDS):
        start = time.perf_counter()
        simulation.run(periods * simulation.period, 1.0)
        middle = time.perf_counter()
        mujoco.mj_step(simulation.model.mjmodel, simulation.data, nstep=5 * periods)
        end = time.perf_counter()
        rows.append((middle - start, end - middle))
        simulation.tick += periods
    loop, raw = np.array(rows).T / periods * 1e6
    return float(np.median(loop)), float(np.median(raw)), float(np.median(loop / raw))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("observers", nargs="*", type=int, default=[5, 99])
    print("spacecraft   loop [us]    raw [us]   loop / raw   (medians; per control period of 0.5 s)")
    for n in parser.parse_args().observers:
        loop, raw, ratio = measure(n)
        print(f"{n + 1:10d} {loop:11.1f} {raw:11.1f} {ratio:12.3f}", flush=True)


if __name__ == "__main__":
    main()
