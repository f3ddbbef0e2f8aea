"""How many threads and episodes fit on this machine."""

from __future__ import annotations

import os

from swarm_mj.errors import ScenarioError
from swarm_mj.io.machine import available_bytes


def default_threads() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def refuse_more_than_fit(count: int, each: int) -> None:
    """Refuse more episodes than memory holds.

    Args:
        count: How many.
        each: What one takes, an upper estimate [B].

    Raises:
        ScenarioError: They would not fit; the message says how many would.
    """
    free = available_bytes()
    if free is not None and count * each > free:
        raise ScenarioError(
            f"num_envs = {count}: so many flights take about {count * each / 2**30:.1f} GiB, {each / 2**20:.2f} MiB each, and "
            f"{free / 2**30:.1f} GiB are free; at most {free // each} fit here"
        )
