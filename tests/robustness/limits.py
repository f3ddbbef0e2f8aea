"""Bounds that no answer to bad input may exceed, and the number of examples that a fuzzer tries."""

import os
import resource
import signal
from contextlib import contextmanager
from pathlib import Path

from hypothesis import HealthCheck, settings

#: A hang, not a measure of speed: the slowest good answer takes a tenth of it on one loaded core [s].
HANG_S = 120
#: What one call may take beyond what the process holds already [bytes].
MEMORY = 3 * 2**30
#: How many times the examples of a fuzzer are multiplied, and whether they are new ones: set SWARM_MJ_FUZZ=50 for a long hunt.
SCALE = int(os.environ.get("SWARM_MJ_FUZZ", "1"))


def examples(count):
    """Settings of a fuzzer: the same `count` examples in every run, or SCALE times as many random ones."""
    return settings(
        max_examples=count * SCALE,
        derandomize=SCALE == 1,
        database=None,
        deadline=None,
        suppress_health_check=list(HealthCheck),
    )


class Hang(BaseException):
    """Not an Exception: no handler for errors of the program may swallow it."""


@contextmanager
def bounded(seconds=HANG_S, memory=MEMORY):
    """Let a block neither hang nor take more memory than it may."""

    def stop(number, frame):
        raise Hang(f"no answer within {seconds} s")

    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    before = signal.signal(signal.SIGALRM, stop)
    resource.setrlimit(resource.RLIMIT_AS, (_address_space() + memory, hard))
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        resource.setrlimit(resource.RLIMIT_AS, (soft, hard))
        signal.signal(signal.SIGALRM, before)


def _address_space():
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    return pages * resource.getpagesize()
