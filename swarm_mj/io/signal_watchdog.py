"""Ending a program whose main thread does not hear signals, because compiled code keeps it.

Python handles a signal between two of its own instructions. A kernel, a solver or the compiler may run for minutes without one.
A thread beside it therefore hears every signal at once; where the main thread has not answered within `GRACE_S`, the thread
undoes what is half-written, ends the processes that this one started, and ends the program.
"""

from __future__ import annotations

import os
import shutil
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

#: How long the main thread has to answer a signal [s].
GRACE_S = 1.2
#: Exit status of an interrupted program.
INTERRUPTED = 130

_half_written: list[Callable[[], object]] = []


@contextmanager
def undone_by(undo: Callable[[], object]) -> Iterator[None]:
    """Name what is to be done if the program is ended while the block runs, without any `finally` of it."""
    _half_written.append(undo)
    try:
        yield
    finally:
        _half_written.remove(undo)


def remove(path: Path | None) -> None:
    """Remove a file or a folder, if it can be."""
    if path is not None:
        shutil.rmtree(path, ignore_errors=True)
        with suppress(OSError):
            path.unlink(missing_ok=True)


@contextmanager
def watched(
    is_answered: Callable[[int], bool], is_held: Callable[[], bool], say: Callable[[], object]
) -> Iterator[None]:
    """End the program while the block runs if a signal is not answered; only for the main thread.

    Args:
        is_answered: Whether the main thread has answered this signal, or it is not its to answer.
        is_held: Whether interruptions are kept back for the moment.
        say: Tells the user that the program was interrupted.
    """
    read_fd, write_fd = os.pipe()
    os.set_blocking(write_fd, False)
    before = signal.set_wakeup_fd(write_fd, warn_on_full_buffer=False)

    def listen() -> None:
        while (signals := os.read(read_fd, 1)) not in (b"", b"\0"):
            waited = 0.0
            while waited < GRACE_S and not is_answered(signals[0]):
                time.sleep(0.05)
                waited = 0.0 if is_held() else waited + 0.05
            if not is_answered(signals[0]):
                _end(say)

    thread = threading.Thread(target=listen, name="signal watchdog", daemon=True)
    thread.start()
    try:
        yield
    finally:
        signal.set_wakeup_fd(before)
        os.write(write_fd, b"\0")
        thread.join()
        os.close(read_fd)
        os.close(write_fd)


def _end(say: Callable[[], object]) -> None:
    started = sys.modules.get(
        "multiprocessing"
    )  # what was never imported has started nothing, and an import may not end
    for child in started.active_children() if started else ():
        child.kill()
    for undo in reversed(_half_written):
        with suppress(Exception):
            undo()
    if sys.stdout.isatty():
        sys.stdout.write("\x1b[?25h")  # the bars had hidden the cursor
        sys.stdout.flush()
    say()
    os._exit(INTERRUPTED)
