"""A place for results that one process at a time may write to: an advisory lock that the system drops with the process.

The lock is a file beside a result (`reserved`) or inside a folder that several commands share (`only_one`); none stays behind.
"""

from __future__ import annotations

import os
import platform
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from pathlib import Path
from typing import Literal

from swarm_mj.errors import OutputError
from swarm_mj.io.interruption import undone_by
from swarm_mj.io.records import bytes_of

try:
    import fcntl
except ImportError:  # only where POSIX is not: two that write into one place at once are then not told apart
    fcntl = None  # type: ignore[assignment]

Kind = Literal["folder", "file"]

#: Name of the lock inside a folder that is held by `only_one`.
LOCK = ".lock"


def reserved(destination: Path, kind: Kind = "folder") -> AbstractContextManager[None]:
    """Hold a place in a folder that is there, until the block or this process ends, however it ends; `kind` is for messages.

    Raises:
        OutputError: Another process holds it, or nothing can be written beside it.
    """
    lock = destination.with_name(f".{destination.name}.lock")
    return _held(lock, destination, kind, "another run is writing there")


def only_one(folder: Path) -> AbstractContextManager[None]:
    """Hold a campaign's folder, which is made if need be.

    Raises:
        OutputError: Another process holds it; the message names that process. Or the folder cannot be written.
    """
    return _held(folder / LOCK, folder, "folder", "another campaign is writing here", make_folder=True)


def unwritable(destination: Path, error: OSError, kind: Kind = "folder") -> OutputError:
    """The error that says that a place cannot be written."""
    return OutputError(f"{destination}: cannot be written ({error.strerror}); choose another {kind} with --out")


@contextmanager
def _held(lock: Path, destination: Path, kind: Kind, taken: str, *, make_folder: bool = False) -> Iterator[None]:
    """Hold a lock file while the block runs; `taken` says what another holder means."""
    try:
        handle = _locked(lock, make_folder)
    except BlockingIOError:
        remedy = f"wait for it, or choose another {kind} with --out"
        raise OutputError(f"{destination}: {taken} ({_holder(lock)}); {remedy}") from None
    except OSError as error:
        raise unwritable(destination, error, kind) from None
    try:
        _sign(handle)
        with undone_by(lock.unlink):
            yield
    finally:
        # Removed while it is held: whoever opened it meanwhile finds, once it has the lock, another file or none in its place.
        with suppress(OSError):
            if _in_place(handle, lock):
                lock.unlink()
        os.close(handle)


def _locked(lock: Path, make_folder: bool) -> int:
    """Handle of the lock file, locked and still in its place; the folder that holds it is made if asked for.

    Raises:
        BlockingIOError: Another process holds it.
    """
    while True:
        if make_folder:
            lock.parent.mkdir(parents=True, exist_ok=True)
        # A link is not followed: what it names belongs to somebody else.
        handle = os.open(lock, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW, 0o644)
        try:
            if fcntl is not None:
                fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if _in_place(handle, lock):
                return handle
        except OSError:
            os.close(handle)
            raise
        os.close(handle)  # its last holder removed it between the opening and the lock: the next one is in its place


def _in_place(handle: int, lock: Path) -> bool:
    """Whether the open file is the one that processes to come will open."""
    try:
        return os.path.samestat(os.fstat(handle), os.stat(lock, follow_symlinks=False))
    except FileNotFoundError:
        return False


def _sign(handle: int) -> None:
    with suppress(OSError):  # a full disk: what is to be written there says so; only the holder's name is lost
        os.ftruncate(handle, 0)
        os.pwrite(handle, f"process {os.getpid()} on {platform.node()}\n".encode(), 0)


def _holder(lock: Path) -> str:
    with suppress(OSError, ValueError):
        return bytes_of(lock, 200).decode("utf-8", "replace").strip() or "unknown process"
    return "unknown process"
