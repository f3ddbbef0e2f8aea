"""One campaign at a time in a folder: an advisory lock that the system drops with the process, however it ends."""

from __future__ import annotations

import fcntl
import os
import platform
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from swarm_mj.errors import OutputError

LOCK = ".lock"


@contextmanager
def only_one(folder: Path) -> Iterator[None]:
    """Hold the lock of a folder, which is made if need be; no file of it stays behind.

    Raises:
        OutputError: Another process holds it; the message names that process. Or the folder cannot be written.
    """
    try:
        handle = _locked(folder)
    except BlockingIOError:
        raise OutputError(
            f"{folder}: another campaign is writing here ({_holder(folder)}); wait for it, or choose another folder with --out"
        ) from None
    except OSError as error:
        raise OutputError(f"{folder}: cannot be written ({error.strerror}); choose another folder with --out") from None
    try:
        _sign(handle)
        yield
    finally:
        # Removed while it is held: whoever opened it meanwhile finds, once it has the lock, another file or none in its place.
        with suppress(OSError):
            if _in_place(handle, folder):
                (folder / LOCK).unlink()
        os.close(handle)


def _locked(folder: Path) -> int:
    """Handle of the lock file, locked and still in its place.

    Raises:
        BlockingIOError: Another process holds it.
    """
    while True:
        folder.mkdir(parents=True, exist_ok=True)
        # A link is not followed: what it names belongs to somebody else.
        handle = os.open(folder / LOCK, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW, 0o644)
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if _in_place(handle, folder):
                return handle
        except OSError:
            os.close(handle)
            raise
        os.close(handle)  # its last holder removed it between the opening and the lock: the next one is in its place


def _in_place(handle: int, folder: Path) -> bool:
    """Whether the open file is the one that processes to come will open."""
    try:
        return os.path.samestat(os.fstat(handle), os.stat(folder / LOCK, follow_symlinks=False))
    except FileNotFoundError:
        return False


def _sign(handle: int) -> None:
    with suppress(OSError):  # a full disk must not keep a campaign from being read; only the holder's name is lost
        os.ftruncate(handle, 0)
        os.pwrite(handle, f"process {os.getpid()} on {platform.node()}\n".encode(), 0)


def _holder(folder: Path) -> str:
    with suppress(OSError):
        return (folder / LOCK).read_bytes()[:200].decode("utf-8", "replace").strip() or "unknown"
    return "unknown"
