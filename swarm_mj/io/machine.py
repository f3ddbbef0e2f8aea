"""Cores and memory of this machine: how many processes may work at once, how each keeps to one core, what is free."""

from __future__ import annotations

import os
from pathlib import Path

from swarm_mj.errors import OutputError

#: Libraries start as many threads as these say; in one of several processes they must not start any.
ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")

#: Limit and use of the control group that a container's processes are in (Linux, cgroup v2).
CGROUP = Path("/sys/fs/cgroup")
MEMINFO = Path("/proc/meminfo")


def keep_algebra_on_one_thread() -> None:
    """Let NumPy and SciPy, which must not be loaded yet, do linear algebra on one thread, unless the user asked for others.

    Vectors of thousands of states are threaded by OpenBLAS, whose threads wait for each other by spinning: on cores that others
    use too that takes several times as long. Sums also come out the same on any number of cores then.
    """
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


def usable_cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def usable_threads() -> int:
    """Threads that may work at once in this process: as many as Numba is told of, see `ONE_THREAD`; else one per core."""
    return int(os.environ.get("NUMBA_NUM_THREADS") or usable_cores())


def check_workers(workers: int | None) -> None:
    """See that a number of processes that was asked for is one; None: as many as there are cores.

    Raises:
        OutputError: It is not.
    """
    if workers is not None and workers < 1:
        raise OutputError(f"workers = {workers} (--workers): must be at least 1")


def available_bytes(meminfo: Path = MEMINFO, cgroup: Path = CGROUP) -> int | None:
    """Memory that can be taken without swapping or being killed; None where the system does not tell (not Linux).

    `meminfo` is the kernel's account of the whole machine, `cgroup` the folder of the control group's.
    """
    return min((free for free in (_of_machine(meminfo), _of_group(cgroup)) if free is not None), default=None)


def _of_machine(meminfo: Path) -> int | None:
    try:
        lines = meminfo.read_text().splitlines()
    except OSError:
        return None
    return next((int(line.split()[1]) * 1024 for line in lines if line.startswith("MemAvailable:")), None)


def _of_group(cgroup: Path) -> int | None:
    try:
        limit, used = (cgroup / "memory.max").read_text().strip(), (cgroup / "memory.current").read_text()
        return None if limit == "max" else max(0, int(limit) - int(used))
    except (OSError, ValueError):
        return None
