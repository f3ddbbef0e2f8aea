"""E episodes spread over threads: each thread flies a batch of its own; the heavy work leaves the interpreter lock."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from swarm_mj.errors import ScenarioError
from swarm_mj.flight.plan import Plan
from swarm_mj.io.memory import available_bytes
from swarm_mj.simulator.simulation import Simulation
from swarm_mj.typing import Array32, Mask

from .observe.batch import EpisodeBatch
from .observe.rewards import StepResult, joined
from .observe.task import Task

#: What a flight takes, measured: its arrays whatever it flies, those of each spacecraft and cell of the target, and what the
#: Python binding keeps for an MjData besides MuJoCo's own memory.
FLIGHT_BYTES, SPACECRAFT_BYTES, CELL_BYTES, BINDING_BYTES = 16 * 1024, 4 * 1024, 17, 330 * 1024
#: As which a flight takes least.
LEAN = ["physics.wheels=gyrostat", "physics.stepper=kernel"]


def default_threads() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


class FlownTask(Protocol):
    """What flights belong to, as far as their memory goes."""

    plan: Plan
    simulation: Simulation


def flight_bytes(task: FlownTask) -> int:
    """What each flight of a task takes in memory, an upper estimate [B]."""
    arrays = FLIGHT_BYTES + task.plan.n * SPACECRAFT_BYTES + task.plan.region.n_cells * CELL_BYTES
    simulation = task.simulation
    if simulation.stepper == "kernel" and simulation.injection is None:
        return arrays
    data = simulation.state.data
    # What is drawn for a flight stands in a model of its own.
    model = 0 if simulation.injection is None else int(simulation.model.mjmodel.nbuffer)
    return arrays + BINDING_BYTES + int(data.nbuffer + data.narena) + model


def refuse_beyond_memory(task: FlownTask, count: int) -> None:
    """Foresee what MuJoCo would answer with an error that ends the process."""
    lean = task.simulation.stepper == "kernel"
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


class ThreadedBatch:
    """Episodes 0 to E - 1, in order over the batches of the threads.

    Args:
        task: What they share.
        count: Number of episodes E.
        threads: Most that are used; observers other than the horizon maps are not safe to share, so that they get one.
        continues_after_impact: See `EpisodeBatch`.

    Attributes:
        task: What they share.
        batches: One for each thread.
        count: Number of episodes E.

    Raises:
        ScenarioError: So many flights would take more memory than there is.
    """

    def __init__(self, task: Task, count: int, threads: int, *, continues_after_impact: bool = False) -> None:
        refuse_beyond_memory(task, count)
        self.task, self.count = task, count
        used = max(1, min(threads, count)) if task.scene is not None else 1
        bounds = np.linspace(0, count, used + 1).round().astype(int)
        self._parts = [slice(int(a), int(b)) for a, b in zip(bounds[:-1], bounds[1:], strict=True)]
        goes_on = continues_after_impact
        self.batches = [
            EpisodeBatch(task, part.stop - part.start, continues_after_impact=goes_on) for part in self._parts
        ]
        self._pool = ThreadPoolExecutor(used, "swarm_mj episodes") if used > 1 else None

    def reset(self, seeds: dict[int, int]) -> None:
        """Start episodes anew from their flight seeds, by number of the episode."""
        for batch, part in zip(self.batches, self._parts, strict=True):
            for e in range(part.start, part.stop):
                if e in seeds:
                    batch.reset(e - part.start, seeds[e])

    def step(self, actions: NDArray[Any], live: Mask) -> StepResult:
        """Fly the live episodes one step; see `EpisodeBatch.step`."""

        def fly(k: int) -> StepResult:
            return self.batches[k].step(actions[self._parts[k]], live[self._parts[k]])

        results = list(self._pool.map(fly, range(len(self.batches)))) if self._pool else [fly(0)]
        return results[0] if len(results) == 1 else joined(results)

    def gather(self, pick: Callable[[EpisodeBatch], NDArray[Any]]) -> NDArray[Any]:
        """One array over all episodes from `pick(batch)` of each batch."""
        return np.concatenate([np.asarray(pick(batch)) for batch in self.batches])

    @property
    def observation(self) -> Array32:
        """Of all episodes, a copy, shape (E, F)."""
        return self.gather(lambda batch: batch.observation)

    def locate(self, e: int) -> tuple[EpisodeBatch, int]:
        """The batch that flies episode e, and its number there."""
        for batch, part in zip(self.batches, self._parts, strict=True):
            if part.start <= e < part.stop:
                return batch, e - part.start
        raise IndexError(e)

    def cause(self, e: int) -> str:
        """Why flight e diverged."""
        batch, k = self.locate(e)
        return batch.flights.causes[k]

    def close(self) -> None:
        """End the threads and release the observer."""
        if self._pool is not None:
            self._pool.shutdown()
        self.task.close()
