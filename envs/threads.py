"""How many threads and flights fit on this machine."""

from __future__ import annotations

import os
from typing import Protocol

import mujoco

from swarm_mj.errors import ScenarioError
from swarm_mj.flight.plan import Plan
from swarm_mj.io.memory import available_bytes
from swarm_mj.simulator.batch import FlightSetup

#: What a flight takes, measured: its arrays whatever it flies, those of each spacecraft and cell of the target, and what the
#: Python binding keeps for an MjData besides MuJoCo's own memory.
FLIGHT_BYTES, SPACECRAFT_BYTES, CELL_BYTES, BINDING_BYTES = 16 * 1024, 4 * 1024, 17, 330 * 1024
#: As which a flight takes least.
LEAN = ["physics.stepper=kernel"]


def default_threads() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


class FlownTask(Protocol):
    """What flights belong to, as far as their memory goes."""

    plan: Plan
    setup: FlightSetup


def flight_bytes(task: FlownTask) -> int:
    """What each flight of a task takes in memory, an upper estimate [B]."""
    arrays = FLIGHT_BYTES + task.plan.n * SPACECRAFT_BYTES + task.plan.region.n_cells * CELL_BYTES
    if task.setup.model.stepper == "kernel":
        return arrays
    data = mujoco.MjData(task.setup.model.mjmodel)
    return arrays + BINDING_BYTES + int(data.nbuffer + data.narena)


def refuse_beyond_memory(task: FlownTask, count: int) -> None:
    """Foresee what MuJoCo would answer with an error that ends the process."""
    lean = task.setup.model.stepper == "kernel"
    refuse_more_than_fit(count, flight_bytes(task), "" if lean else f"; with overrides={LEAN} each takes a tenth")


def refuse_more_than_fit(count: int, each: int, remedy: str = "") -> None:
    """Refuse more flights than memory holds.

    Args:
        count: How many.
        each: What one takes, an upper estimate [B].
        remedy: What else helps, for the message.

    Raises:
        ScenarioError: They would not fit; the message says how many would.
    """
    free = available_bytes()
    if free is not None and count * each > free:
        raise ScenarioError(
            f"num_envs = {count}: so many flights take about {count * each / 2**30:.1f} GiB, {each / 2**20:.2f} MiB each, and "
            f"{free / 2**30:.1f} GiB are free; at most {free // each} fit here{remedy}"
        )
