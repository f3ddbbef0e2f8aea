"""How much memory this process may still take."""

from __future__ import annotations

from pathlib import Path

#: Limit and use of the control group that a container's processes are in (Linux, cgroup v2).
CGROUP = Path("/sys/fs/cgroup")
MEMINFO = Path("/proc/meminfo")


def available_bytes(meminfo: Path = MEMINFO, cgroup: Path = CGROUP) -> int | None:
    """Memory that can be taken without swapping or being killed; None where the system does not tell (not Linux).

    Args:
        meminfo: The kernel's account of the whole machine.
        cgroup: Folder of the control group's account.
    """
    found = [free for free in (_of_machine(meminfo), _of_group(cgroup)) if free is not None]
    return min(found, default=None)


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
