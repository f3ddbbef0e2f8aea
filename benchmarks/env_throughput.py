"""Environment steps per second against raw `mj_step` of the same model: `python -m benchmarks.env_throughput`.

One environment step is 10 s of flight of 5 spacecraft at a physics and control step of 0.5 s, coverage and reward included,
with actions drawn at random (level `role`). Raw is `mj_step` alone, as often, on one thread. The rows are measured in turn
within each round; each ratio is the median over the rounds of ratios within a round. The ratio by processor time, over all
threads, holds on a machine that does other work beside.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from time import perf_counter, process_time

import gymnasium
import mujoco
import numpy as np
from swarm_mj.envs.swarm_observe import SwarmObserveEnv

from benchmarks.record import cores, write_results

TARGET_SINGLE, TARGET_VECTOR = 0.60, 0.80


def rates_of(work: Callable[[], int], seconds: float) -> tuple[float, float]:
    """Environment steps of `work`, which returns how many it did, per second and per second of processor time."""
    done, start, used = 0, perf_counter(), process_time()
    while perf_counter() - start < seconds:
        done += work()
    return done / (perf_counter() - start), done / (process_time() - used)


def raw_steps() -> Callable[[], int]:
    env: SwarmObserveEnv = gymnasium.make("swarm_mj:SwarmObserve-v0").unwrapped
    env.reset(seed=0)
    simulation = env.setting.simulation
    env.step(env.action_space.sample())
    simulation.data.qpos[:], simulation.data.qvel[:] = env.flybys.flights.qpos[0], env.flybys.flights.qvel[0]
    model, data, ticks = simulation.model.mjmodel, simulation.data, env.setting.ticks

    def work() -> int:
        for _ in range(10):
            mujoco.mj_step(model, data, nstep=ticks)
        return 10

    return work


def single_steps(**arguments: object) -> Callable[[], int]:
    env = gymnasium.make("swarm_mj:SwarmObserve-v0", **arguments).unwrapped
    env.reset(seed=0)
    env.action_space.seed(0)
    actions = [env.action_space.sample() for _ in range(64)]
    count = 0

    def work() -> int:
        nonlocal count
        for _ in range(10):
            count += 1
            _, _, terminated, truncated, _ = env.step(actions[count % 64])
            if terminated or truncated:
                env.reset()
        return 10

    return work


def vector_steps(num_envs: int, **arguments: object) -> Callable[[], int]:
    envs = gymnasium.make_vec("swarm_mj:SwarmObserve-v0", num_envs=num_envs, **arguments)
    envs.reset(seed=0)
    envs.action_space.seed(0)
    actions = [envs.action_space.sample() for _ in range(16)]
    count = 0

    def work() -> int:
        nonlocal count
        count += 1
        envs.step(actions[count % 16])
        return num_envs

    return work


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=9)
    parser.add_argument("--seconds", type=float, default=1.0, help="of each measurement")
    parser.add_argument("--num-envs", type=int, default=64)
    chosen = parser.parse_args()
    available = cores()
    rows = {
        "raw mj_step": raw_steps(),
        "single": single_steps(),
        "single, pointing": single_steps(control="pointing"),
        "single, torque": single_steps(control="torque"),
        f"vector of {chosen.num_envs}": vector_steps(chosen.num_envs),
        f"vector of {chosen.num_envs}, pointing": vector_steps(chosen.num_envs, control="pointing"),
    }
    for work in rows.values():
        work()
    rates = {name: np.empty((chosen.rounds, 2)) for name in rows}
    for k in range(chosen.rounds):
        for name, work in rows.items():
            rates[name][k] = rates_of(work, chosen.seconds)
    raw, results = rates["raw mj_step"], []
    print(f"{available} cores; environment steps of 10 s each, 5 spacecraft; medians of {chosen.rounds} rounds")
    print(f"{'':26}{'steps/s':>10}{'over raw':>10}{'per core':>10}{'by CPU time':>13}  target")
    for name, rate in rates.items():
        wall, processor = np.median(rate / raw, axis=0)
        vector = name.startswith("vector")
        each = wall / (available if vector else 1)
        target = "" if name == "raw mj_step" else f">= {TARGET_VECTOR if vector else TARGET_SINGLE:.2f}"
        steps = float(np.median(rate[:, 0]))
        print(f"{name:26}{steps:>10.0f}{wall:>10.2f}{each:>10.2f}{processor:>13.2f}  {target}")
        row = {
            "name": name,
            "steps_per_s": steps,
            "over_raw": wall,
            "per_core": each,
            "over_raw_by_cpu_time": processor,
        }
        results.append({key: value if isinstance(value, str) else float(value) for key, value in row.items()})
    write_results("env_throughput", results)


if __name__ == "__main__":
    main()
