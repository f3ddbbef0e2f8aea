"""A place for results that one process at a time may write to."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, Literal

from swarm_mj.errors import OutputError

try:
    import fcntl
except ImportError:  # only where POSIX is not: two that write into one place at once are then not told apart
    fcntl = None  # type: ignore[assignment]

Kind = Literal["folder", "file"]


@contextmanager
def reserved(destination: Path, kind: Kind = "folder") -> Iterator[None]:
    """Hold a place for this process; the system lets go of it when the process ends, however it ends.

    Args:
        destination: The place; the folder that holds it is there.
        kind: What stands there, for messages.

    Raises:
        OutputError: Another process holds it, or nothing can be written beside it.
    """
    lock = destination.with_name(f".{destination.name}.lock")
    try:
        file = _locked(lock)
    except BlockingIOError:
        raise OutputError(
            f"{destination}: another run is writing there ({_owner(lock)}); wait for it, or choose another {kind} with --out"
        ) from None
    except OSError as error:
        raise unwritable(destination, error, kind) from None
    try:
        yield
    finally:
        # Removed before it is released: whoever opened it meanwhile finds it gone and makes a new one.
        with suppress(OSError):
            lock.unlink()
        file.close()


def unwritable(destination: Path, error: OSError, kind: Kind = "folder") -> OutputError:
    """The error that says that a place cannot be written."""
    return OutputError(f"{destination}: cannot be written ({error.strerror}); choose another {kind} with --out")


def _locked(lock: Path) -> IO[bytes]:
    """Open and lock a file that is still in its place.

    Raises:
        BlockingIOError: Another run holds it.
    """
    while True:
        file = lock.open("ab", buffering=0)
        try:
            if fcntl is not None:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if lock.exists() and os.path.samestat(os.fstat(file.fileno()), lock.stat()):
                with suppress(OSError):  # a full disk; what is to be written there says so
                    file.truncate(0)
                    file.write(f"process {os.getpid()}".encode())
                return file
        except OSError:
            file.close()
            raise
        file.close()


def _owner(lock: Path) -> str:
    with suppress(OSError, ValueError):
        return lock.read_text("utf-8")[:40] or "unknown process"
    return "unknown process"
