"""Environment steps against raw `mj_step` of the same swarm: decisions of a flyby of five, pictures and reward included."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import gymnasium
import mujoco
import numpy as np

from benchmarks.measure import Row, rates, row
from swarm_mj.flight.fly import make_simulation
from swarm_mj.flight.plan import make_plan
from swarm_mj.io.machine import usable_cores
from swarm_mj.scenarios.loading import load_scenario, parse_overrides

ID, SCENARIO = "swarm_mj.envs:SwarmObserve-v0", "eros-observe"
#: What is as planned: what sensors err by has a row of its own.
PLANNED = {"spacecraft.sensors": "ideal"}
#: Length of a decision [s].
STEP_S = 10.0
#: The first flights take the sums over the polyhedron that all others share.
POLYHEDRAL = "polyhedral gravity after the first flights"
#: What may go wrong in an episode, and gravity that is dear.
WRONG = {
    "masses": ["dispersions.mass_percent=3", "dispersions.inertia_percent=3"],
    "friction and a wheel that fails": [
        "dispersions.wheel_coulomb_n_m=2e-5",
        'faults=[{"kind": "wheel_lost", "spacecraft": "sc1", "wheel": 1, "at_s": 60}]',
    ],
    "perturbations": ["perturbations.solar_tide=true", "perturbations.gravity_gradient_torque=true"],
    "sensors and filter": ["spacecraft.sensors=cubesat"],
    POLYHEDRAL: ["body.gravity.model=polyhedron"],
}
TARGET_WRONG = ">= 0.80"
TARGET_SINGLE, TARGET_VECTOR = ">= 0.60", ">= 0.80"


def raw_steps() -> Callable[[], int]:
    """Ten times as many raw steps as one environment step takes; forces and torques held, as in the raw row of the loop."""
    scenario = load_scenario(SCENARIO, PLANNED)
    simulation, ticks = make_simulation(make_plan(scenario)), round(STEP_S / scenario.control.period_s)
    simulation.decide()
    start = simulation.data.qpos.copy(), simulation.data.qvel.copy()

    def work() -> int:
        # Held torques would spin the wheels up without end.
        simulation.data.qpos[:], simulation.data.qvel[:] = start
        for _ in range(10):
            mujoco.mj_step(simulation.model.mjmodel, simulation.data, nstep=ticks)
        return 10

    return work


def single_steps(**arguments: Any) -> Callable[[], int]:
    """Ten steps of the single environment, started anew when an episode ends."""
    env: Any = gymnasium.make(ID, **arguments).unwrapped
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


def vector_steps(num_envs: int, after_first_flights: bool = False, **arguments: Any) -> Callable[[], int]:
    """One step of the vector environment, whose first flights, which fill what the others share, may be over."""
    envs = gymnasium.make_vec(ID, num_envs=num_envs, **arguments)
    envs.reset(seed=0)
    envs.action_space.seed(0)
    actions = [envs.action_space.sample() for _ in range(16)]
    count, landed = 0, not after_first_flights

    def work() -> int:
        nonlocal count, landed
        count += 1
        _, _, terminated, truncated, _ = envs.step(actions[count % 16])
        landed = landed or bool((terminated | truncated).any())
        return num_envs

    while not landed:
        work()
    return work


def rows(quick: bool, num_envs: int = 64) -> Iterator[Row]:
    """All of it; by wall clock, and by processor time over all threads, which holds where the machine is shared."""
    raw, works = raw_steps(), _works(quick, num_envs)
    for work in (raw, *works.values()):
        work()
    rounds, seconds = (5, 0.4) if quick else (9, 1.0)
    measured: dict[str, list[tuple[float, float]]] = {name: [] for name in ("raw", *works)}
    for _ in range(rounds):
        measured["raw"].append(rates(raw, seconds))
        for name, work in works.items():
            measured[name].append(rates(work, 0.5 * seconds if name in WRONG else seconds))
    wrong = {name: measured.pop(name) for name in WRONG if name in works}
    base = np.array(measured.pop("raw"))
    yield row("environment", "raw mj_step, one thread", base[:, 0], "steps/s")
    for name, values in measured.items():
        rate, vector = np.array(values), name.startswith("vector")
        target = TARGET_VECTOR if vector else TARGET_SINGLE
        per_core = rate[:, 0] / base[:, 0] / (usable_cores() if vector else 1)
        yield row("environment", name, rate[:, 0], "steps/s")
        yield row("environment", f"{name} / raw, per core", per_core, "ratio", target)
        yield row("environment", f"{name} / raw, by processor time", rate[:, 1] / base[:, 1], "ratio")
    planned = np.array(measured[f"vector of {num_envs}"])[:, 1]
    for name, values in wrong.items():
        share = np.array(values)[:, 1] / planned
        yield row("environment", f"{name} / as planned, by processor time", share, "ratio", TARGET_WRONG)


def _works(quick: bool, num_envs: int) -> dict[str, Callable[[], int]]:
    """What is measured, by the name of its rows."""
    given: dict[str, Any] = {"scenario": load_scenario(SCENARIO, PLANNED), "decision_s": STEP_S}
    works: dict[str, Callable[[], int]] = {
        "single": single_steps(**given),
        f"vector of {num_envs}": vector_steps(num_envs, **given),
    }
    if not quick:
        works[f"vector of {num_envs}, eight missions"] = vector_steps(num_envs)
        for name, changes in WRONG.items():
            scenario = load_scenario(SCENARIO, {**PLANNED, **parse_overrides(changes)})
            works[name] = vector_steps(num_envs, name == POLYHEDRAL, **given | {"scenario": scenario})
    return works
