"""The clock of both comparisons of cost."""

from __future__ import annotations

import time
from collections.abc import Callable


def seconds(flight: Callable[[], object]) -> tuple[float, float]:
    """Processor and wall-clock time of one flight [s]."""
    wall, processor = time.perf_counter(), time.process_time()
    flight()
    return time.process_time() - processor, time.perf_counter() - wall
