"""Flying a policy over many seeds at once, and what the returns say: means, intervals, paired differences."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np
from gymnasium.vector import AutoresetMode
from scipy.stats import t as student

from swarm_mj.typing import Array, Array32, Ints

from ..observe.task import Task
from ..observe.vector import SwarmObserveVectorEnv

#: From observations, shape (E, F), to actions, shape (E, n).
VectorPolicy = Callable[[Array32], Ints]
Progress = Callable[[int], None]


class Acts(Protocol):
    """A policy with everything it needs."""

    @property
    def act(self) -> VectorPolicy:
        """From observations to actions."""


class Trained(Protocol):
    """A policy that was trained for one task and must be fitted to another, such as `ArrayPolicy`."""

    def for_task(self, task: Task) -> Acts:
        """The policy as it flies there, or an error that names why it cannot."""


#: Flights at once.
WIDTH = 25


class Returns(NamedTuple):
    """Of each flight, in the order of the seeds.

    Attributes:
        total: Return of the episode, shape (m,).
        coverage_percent: Shape (m,) [%].
        delivered_bit: Shape (m,) [bit].
    """

    total: Array
    coverage_percent: Array
    delivered_bit: Array


class Interval(NamedTuple):
    """A mean and the half width of its 95 % confidence interval."""

    mean: float
    half_width: float


def interval(values: Array) -> Interval:
    """Of independent values, by Student's t; shape (m,), m at least 2."""
    m = len(values)
    spread = float(np.std(values, ddof=1)) / m**0.5
    return Interval(float(np.mean(values)), float(student.ppf(0.975, m - 1)) * spread)


def fly_seeds(
    policy: VectorPolicy | Trained, seeds: Sequence[int], progress: Progress | None = None, **arguments: Any
) -> Returns:
    """One episode for each seed, each bit for bit that of a single environment after `reset(seed=...)`.

    Args:
        policy: From observations to actions; or a trained one, which is fitted to the environment's patches and camera.
        seeds: Of the episodes.
        progress: Called with the number of episodes flown.
        arguments: Those of `SwarmObserveVectorEnv`.

    Raises:
        ScenarioError: The trained policy cannot fly there; the message names what differs.
    """
    parts: list[Returns] = []
    width = min(WIDTH, len(seeds))
    env = SwarmObserveVectorEnv(width, autoreset_mode=AutoresetMode.NEXT_STEP, **arguments)
    try:
        act = policy if callable(policy) else policy.for_task(env.batch.task).act
        for start in range(0, len(seeds), width):
            some = [int(seed) for seed in seeds[start : start + width]]
            # The last group may be short: what fills it up is not counted.
            flown = _fly(env, act, some + [0] * (width - len(some)))
            parts.append(Returns(*(values[: len(some)] for values in flown)))
            if progress is not None:
                progress(start + len(some))
    finally:
        env.close()
    return Returns(*(np.concatenate(values) for values in zip(*parts, strict=True)))


def _fly(env: SwarmObserveVectorEnv, policy: VectorPolicy, seeds: list[int]) -> Returns:
    observations, _ = env.reset(seed=list(seeds))
    total, over = np.zeros(len(seeds)), np.zeros(len(seeds), np.bool_)
    coverage, delivered = np.zeros(len(seeds)), np.zeros(len(seeds))
    while not over.all():
        observations, rewards, terminated, truncated, infos = env.step(policy(observations))
        total[~over] += rewards[~over]
        ends = (terminated | truncated) & ~over
        coverage[ends], delivered[ends] = infos["coverage_percent"][ends], infos["delivered_bit"][ends]
        over |= ends
    return Returns(total, coverage, delivered)
