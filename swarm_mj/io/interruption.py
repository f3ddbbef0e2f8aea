"""Ctrl-C that is never lost.

Python drops a KeyboardInterrupt that is raised inside a weakref callback, `__del__` or a ctypes callback, and libraries turn
one into errors of their own. The command line therefore lets `Interruption` handle the signals: it raises KeyboardInterrupt
and remembers that it was asked, so that `check` can raise it again.

Python handles a signal between two of its own instructions, and a kernel, a solver or the compiler may run for minutes without
one. A thread beside the main one therefore hears every signal at once; where the main thread has not answered within `GRACE_S`,
that thread undoes what is half-written, ends the processes that this one started, and ends the program.

Nothing here is heavy to import.
"""

from __future__ import annotations

import os
import shutil
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext, suppress
from pathlib import Path
from types import FrameType
from typing import Any

#: Ctrl-C, and whoever ends the program politely: both get the same tidy end.
SIGNALS = (signal.SIGINT, signal.SIGTERM)
#: How long the main thread has to answer a signal [s].
GRACE_S = 1.2
#: Exit status of an interrupted program.
INTERRUPTED = 130

_half_written: list[Callable[[], object]] = []


class Interruption:
    """A signal handler that raises KeyboardInterrupt and remembers that it was asked."""

    def __init__(self) -> None:
        self.asked = False
        self.held = 0

    def __call__(self, number: int, frame: FrameType | None) -> None:
        """Handle a signal: at once, or when nobody holds it any more."""
        self.asked = True
        if not self.held:
            raise KeyboardInterrupt


@contextmanager
def handled(say: Callable[[], object] | None = None) -> Iterator[Interruption]:
    """Handle the signals that end a program while the block runs, in the main thread; afterwards all is as before.

    A signal that this process was told to ignore (`nohup`, the background of a shell script) stays ignored.

    Args:
        say: Tells the user of an interruption that compiled code kept from being heard, before the program is ended all the
            same, see above; None: it waits until that code is done.
    """
    interruption = Interruption()
    if threading.current_thread() is not threading.main_thread():
        yield interruption  # only the main thread hears signals
        return
    before = {number: signal.getsignal(number) for number in SIGNALS}
    hook = sys.unraisablehook

    def without_interrupts(unraisable: Any) -> None:
        # It is not lost: `check` raises it again.
        if not (interruption.asked and issubclass(unraisable.exc_type, KeyboardInterrupt)):
            hook(unraisable)

    sys.unraisablehook = without_interrupts
    for number, earlier in before.items():
        if earlier not in (signal.SIG_IGN, None):
            signal.signal(number, interruption)

    def answered(number: int) -> bool:
        return interruption.asked or number not in SIGNALS or signal.getsignal(number) is not interruption

    watched = nullcontext() if say is None else _watched(answered, lambda: interruption.held > 0, say)
    try:
        with watched:
            yield interruption
    finally:
        for number, earlier in before.items():
            if signal.getsignal(number) is interruption:
                signal.signal(number, earlier)
        if sys.unraisablehook is without_interrupts:
            sys.unraisablehook = hook


def check() -> None:
    """Raise the interruption that was asked for, if there was one.

    Raises:
        KeyboardInterrupt: The program was asked to end, and the block in `held`, if any, is over.
    """
    interruption = _current()
    if interruption is not None and interruption.asked and not interruption.held:
        raise KeyboardInterrupt


@contextmanager
def held() -> Iterator[None]:
    """Keep interruptions back while the block runs, so that steps that belong together are all taken.

    Raises:
        KeyboardInterrupt: One was asked for, at the end of the block.
    """
    interruption = _current()
    if interruption is None:
        yield
        return
    interruption.held += 1
    try:
        yield
    finally:
        interruption.held -= 1
        check()


def _current() -> Interruption | None:
    """Who handles the signals of this process, if it is an `Interruption`."""
    for number in SIGNALS:
        handler = signal.getsignal(number)
        if isinstance(handler, Interruption):
            return handler
    return None


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
def _watched(
    is_answered: Callable[[int], bool], is_held: Callable[[], bool], say: Callable[[], object]
) -> Iterator[None]:
    """End the program while the block runs if the main thread neither answers a signal nor holds it back.

    `say` tells the user that it was interrupted.
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
    # What was never imported has started nothing, and an import may not end.
    started = sys.modules.get("multiprocessing")
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
