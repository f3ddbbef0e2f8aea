"""E episodes spread over threads: each lane flies its share on its own batch; the heavy work leaves the interpreter lock."""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarm_mj.typing import Array32, Mask

from .batch import Flybys, Step
from .config import Setting


def default_threads() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


class Lanes:
    """Flights 0 to E - 1, in order over the lanes.

    Args:
        setting: What they share.
        count: Number of flights E.
        threads: Number of lanes at most; observers other than the horizon maps are not safe to share, so that they get one.

    Attributes:
        setting: What they share.
        lanes: The shares.
        count: Number of flights E.
        observation: Of all flights, shape (E, F), a copy made at each step.
    """

    def __init__(self, setting: Setting, count: int, threads: int) -> None:
        self.setting, self.count = setting, count
        used = max(1, min(threads, count)) if setting.scene is not None else 1
        bounds = np.linspace(0, count, used + 1).round().astype(int)
        self._parts = [slice(int(a), int(b)) for a, b in zip(bounds[:-1], bounds[1:], strict=True)]
        self.lanes = [Flybys(setting, part.stop - part.start) for part in self._parts]
        self._pool = ThreadPoolExecutor(used, "swarm_mj lane") if used > 1 else None

    def reset(self, seeds: dict[int, int]) -> None:
        """Start flights anew from their flight seeds, by number of the flight."""
        for lane, part in zip(self.lanes, self._parts, strict=True):
            for e in range(part.start, part.stop):
                if e in seeds:
                    lane.reset(e - part.start, seeds[e])

    def step(self, actions: NDArray[Any], live: Mask) -> Step:
        """Fly the live flights one step; see `Flybys.step`."""

        def fly(k: int) -> Step:
            return self.lanes[k].step(actions[self._parts[k]], live[self._parts[k]])

        steps = list(self._pool.map(fly, range(len(self.lanes)))) if self._pool else [fly(0)]
        if len(steps) == 1:
            return steps[0]
        names = ("terms", "reward", "end", "truncated", "hit")
        return Step(*(np.concatenate([getattr(step, name) for step in steps]) for name in names))

    def gather(self, pick: Any) -> NDArray[Any]:
        """One array over all flights from `pick(flybys)` of each lane."""
        return np.concatenate([np.asarray(pick(lane)) for lane in self.lanes])

    @property
    def observation(self) -> Array32:
        """Of all flights, a copy, shape (E, F)."""
        return self.gather(lambda lane: lane.observation)

    def cause(self, e: int) -> str:
        """Why flight e diverged."""
        for lane, part in zip(self.lanes, self._parts, strict=True):
            if part.start <= e < part.stop:
                return lane.flights.causes[e - part.start]
        raise IndexError(e)

    def close(self) -> None:
        """End the threads and release the observer."""
        if self._pool is not None:
            self._pool.shutdown()
        self.setting.close()
