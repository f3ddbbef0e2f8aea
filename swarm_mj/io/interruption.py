"""Ctrl-C that is never lost.

Python drops a KeyboardInterrupt that is raised inside a weakref callback, `__del__` or a ctypes callback, and libraries turn
one into errors of their own. The command line therefore lets `Interruption` handle the signals: it raises KeyboardInterrupt
and remembers that it was asked, so that `check` can raise it again. Nothing here is heavy to import.
"""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from types import FrameType
from typing import Any

from swarm_mj.io import signal_watchdog

#: Ctrl-C, and whoever ends the program politely: both get the same tidy end.
SIGNALS = (signal.SIGINT, signal.SIGTERM)


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
            same, see `signal_watchdog`; None: it waits until that code is done.
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

    watched = nullcontext() if say is None else signal_watchdog.watched(answered, lambda: interruption.held > 0, say)
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
