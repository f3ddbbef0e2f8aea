"""Environment steps against raw `mj_step` of the same model: 10 s of flight of 5 spacecraft, coverage and reward included."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator
from typing import Any

import gymnasium
import mujoco
import numpy as np

from swarm_mj.io.cores import usable_cores
from swarm_mj.verification.performance.measure import Row, rates, row

ID = "swarm_mj.envs:SwarmObserve-v0"
#: The environment's fast way: free gyrostats by their own equations, without MuJoCo.
FAST, FAST_NAME = ["physics.wheels=gyrostat", "physics.stepper=kernel"], "stepper kernel"
#: As which a scenario flies that says nothing of it.
DEFAULT_NAME = "default stepper"
#: The first flights take the sums over the polyhedron that all others share.
POLYHEDRAL = "polyhedral gravity after the first flights"
#: What may go wrong in an episode, and gravity that is dear; each on both ways.
WRONG = {
    "masses": ["dispersions.mass_percent=3", "dispersions.inertia_percent=3"],
    "friction and a wheel that fails": [
        "dispersions.wheel_coulomb_n_m=2e-5",
        'faults=[{"kind": "wheel_lost", "spacecraft": "sc1", "wheel": 1, "at_s": 60}]',
    ],
    "perturbations": ["perturbations.solar_tide=true", "perturbations.gravity_gradient_torque=true"],
    "sensors and filter": ["dispersions.star_tracker_noise_arcsec=10", "dispersions.gyro_bias_deg_h=1"],
    POLYHEDRAL: ["body.gravity.model=polyhedron"],
}
#: The same for wheels that are bodies alone.
FOUR_WHEELS = {"four wheels": ["spacecraft.wheel_layout=pyramid"]}
TARGET_WRONG = ">= 0.80"
TARGET_SINGLE, TARGET_VECTOR = ">= 0.60", ">= 0.80"


def raw_steps() -> Callable[[], int]:
    """Ten times as many raw steps as one environment step takes; forces and torques held, as in the raw row of the loop."""
    env: Any = gymnasium.make(ID).unwrapped
    simulation, ticks = env.task.simulation, env.task.ticks
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
    with warnings.catch_warnings():
        # What is measured is v0, which v1 has made out of date.
        warnings.filterwarnings("ignore", message=".*out of date")
        raw, works = raw_steps(), _works(quick, num_envs)
    for work in (raw, *works.values()):
        work()
    rounds, seconds = (5, 0.4) if quick else (9, 1.0)
    shares = {} if quick else {f"vector of {num_envs}, role, {name}": name for name in _wrong()}
    measured: dict[str, list[tuple[float, float]]] = {name: [] for name in ("raw", *works)}
    for _ in range(rounds):
        measured["raw"].append(rates(raw, seconds))
        for name, work in works.items():
            measured[name].append(rates(work, seconds if name not in shares else 0.5 * seconds))
    usual, fast = f"vector of {num_envs}, role", f"vector of {num_envs}, role, {FAST_NAME}"
    ratio = np.array(measured[fast])[:, 1] / np.array(measured[usual])[:, 1]
    wrong = {name: measured.pop(work) for work, name in shares.items()}
    base = np.array(measured.pop("raw"))
    yield row("environment", "raw mj_step, one thread", base[:, 0], "steps/s")
    for name, values in measured.items():
        rate, vector = np.array(values), name.startswith("vector")
        target = TARGET_VECTOR if vector else TARGET_SINGLE
        per_core = rate[:, 0] / base[:, 0] / (usable_cores() if vector else 1)
        yield row("environment", name, rate[:, 0], "steps/s")
        yield row("environment", f"{name} / raw, per core", per_core, "ratio", target)
        yield row("environment", f"{name} / raw, by processor time", rate[:, 1] / base[:, 1], "ratio")
    yield row("environment", f"{fast} / default stepper, by processor time", ratio, "ratio")
    for name, values in wrong.items():
        planned = usual if name.endswith(DEFAULT_NAME) else fast
        share = np.array(values)[:, 1] / np.array(measured[planned])[:, 1]
        yield row("environment", f"{name} / as planned, by processor time", share, "ratio", TARGET_WRONG)


def _wrong() -> dict[str, list[str]]:
    fast = {name: [*FAST, *overrides] for name, overrides in WRONG.items()}
    return fast | {f"{name}, {DEFAULT_NAME}": overrides for name, overrides in (WRONG | FOUR_WHEELS).items()}


def _works(quick: bool, num_envs: int) -> dict[str, Callable[[], int]]:
    """What is measured, by the name of its rows."""
    works: dict[str, Callable[[], int]] = {
        "single, role": single_steps(),
        f"vector of {num_envs}, role": vector_steps(num_envs),
        f"vector of {num_envs}, role, {FAST_NAME}": vector_steps(num_envs, overrides=FAST),
    }
    if not quick:
        works |= {
            "single, pointing": single_steps(control="pointing"),
            "single, torque": single_steps(control="torque"),
            f"vector of {num_envs}, pointing": vector_steps(num_envs, control="pointing"),
            f"vector of {num_envs}, torque": vector_steps(num_envs, control="torque"),
        }
        works |= {
            f"vector of {num_envs}, role, {name}": vector_steps(
                num_envs, name.startswith(POLYHEDRAL), overrides=overrides
            )
            for name, overrides in _wrong().items()
        }
    return works
