"""How many processes may work at once, and how each keeps to one core."""

from __future__ import annotations

import os

from swarm_mj.errors import OutputError

#: Libraries start as many threads as these say; in one of several processes they must not start any.
ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")


def keep_algebra_on_one_thread() -> None:
    """Let NumPy and SciPy, which must not be loaded yet, do linear algebra on one thread, unless the user asked for others.

    Vectors of thousands of states are threaded by OpenBLAS, whose threads wait for each other by spinning: on cores that others
    use too that takes several times as long. Sums also come out the same on any number of cores then.
    """
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


def usable_cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def check_workers(workers: int | None) -> None:
    """See that a number of processes that was asked for is one; None: as many as there are cores.

    Raises:
        OutputError: It is not.
    """
    if workers is not None and workers < 1:
        raise OutputError(f"workers = {workers} (--workers): must be at least 1")
