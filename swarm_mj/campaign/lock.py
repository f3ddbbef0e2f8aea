"""One campaign at a time in a folder: an advisory lock that the system drops with the process, however it ends."""

from __future__ import annotations

import fcntl
import os
import platform
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from swarm_mj.errors import OutputError

LOCK = ".lock"


@contextmanager
def only_one(folder: Path) -> Iterator[None]:
    """Hold the lock of a folder, which is made if need be.

    Raises:
        OutputError: Another process holds it; the message names that process. Or the folder cannot be written.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        handle = os.open(folder / LOCK, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
    except OSError as error:
        raise OutputError(f"{folder}: cannot be written ({error.strerror}); choose another folder with --out") from None
    try:
        _acquire(handle, folder)
        yield
    finally:
        # The file stays: were it removed, a third process could lock a new one while a second waits for the old.
        os.close(handle)


def _acquire(handle: int, folder: Path) -> None:
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        holder = os.pread(handle, 200, 0).decode("utf-8", "replace").strip() or "unknown"
        raise OutputError(
            f"{folder}: another campaign is writing here ({holder}); wait for it, or choose another folder with --out"
        ) from None
    try:
        os.ftruncate(handle, 0)
        os.pwrite(handle, f"process {os.getpid()} on {platform.node()}\n".encode(), 0)
    except OSError:
        pass  # a full disk must not keep a campaign from being read; only the holder's name is lost
