"""The progress bars of long work, and how long its stages took."""

from __future__ import annotations

import sys
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import timedelta
from threading import Timer
from typing import Any, TypeAlias

from rich.console import Console
from rich.progress import BarColumn, Progress, ProgressColumn, Task, TaskID, TextColumn, TimeElapsedColumn
from rich.text import Text

from swarm_mj.io import interruption

#: A forecast is made after so long [s], and told where the whole takes longer than this [s].
FORECAST_AFTER_S, LONG_S = 2.0, 60.0
#: Share of the work from which on its rate counts even where that took less time.
WATCHED = 0.1
#: What nobody asked to be shown is, where somebody looks, after so long [s].
LATE_S = 2.0
#: Whether bars are shown: True, False, the bars to use, or None, which leaves it to how long the work takes and who looks.
Shown: TypeAlias = bool | Progress | None


class Bars(Progress):
    """Bars that stand from the first task on, and whose every movement notices an interruption that Python lost."""

    _begun = False

    def start(self) -> None:
        """Show the bars, if there is one: what is refused before any work begins says so without an empty line."""
        self._begun = True
        if self.task_ids:
            super().start()

    def stop(self) -> None:
        """Leave the bars as they stand."""
        self._begun = False
        if self.live.is_started:
            super().stop()

    def add_task(self, *arguments: Any, **keywords: Any) -> TaskID:
        """Begin a bar; arguments as in rich."""
        interruption.check()
        task = super().add_task(*arguments, **keywords)
        if self._begun:
            self.start()
        return task

    def update(self, *arguments: Any, **keywords: Any) -> None:
        """Move a bar; arguments as in rich."""
        interruption.check()
        super().update(*arguments, **keywords)

    def advance(self, *arguments: Any, **keywords: Any) -> None:
        """Move a bar by some steps; arguments as in rich."""
        interruption.check()
        super().advance(*arguments, **keywords)


class LateBars(Bars):
    """Bars that stand once the work has taken `LATE_S`."""

    _timer: Timer | None = None
    _over = False

    def start(self) -> None:
        """Start the clock."""
        self._timer = Timer(LATE_S, self._appear)
        self._timer.daemon = True
        self._timer.start()

    def stop(self) -> None:
        """Leave the bars as they stand, if they do."""
        with self._lock:
            self._over = True
        if self._timer is not None:
            self._timer.cancel()
        super().stop()

    def _appear(self) -> None:
        with self._lock:
            if not self._over:
                self._begun = True
                Progress.start(self)


class Remaining(ProgressColumn):
    """The time that is left, by the rate since work got on its way: what starts or compiles before the first step counts not.

    It is told once that rate has been watched for `FORECAST_AFTER_S`, or over `WATCHED` of the work.
    """

    max_refresh = 0.5

    def __init__(self) -> None:
        super().__init__()
        self._first: dict[TaskID, tuple[float, float]] = {}

    def render(self, task: Task) -> Text:
        """The time left as h:mm:ss."""
        left = 0.0 if task.finished else self._left(task)
        words = "-:--:--" if left is None else str(timedelta(seconds=max(0, int(left))))
        return Text(words, style="progress.remaining")

    def _left(self, task: Task) -> float | None:
        if not (task.total and task.elapsed and task.completed > 0.0):
            return None
        began, before = self._first.setdefault(task.id, (task.elapsed, task.completed))
        done, took = task.completed - before, task.elapsed - began
        if done <= 0.0 or (took < FORECAST_AFTER_S and done < WATCHED * task.total):
            return None
        return took * (task.total - task.completed) / done


def progress_bars(console: Console, quiet: bool = False, kind: type[Bars] = Bars) -> Progress:
    """Bars with elapsed and remaining time; none if quiet."""
    columns = (TextColumn("{task.description}", markup=False), BarColumn(), TimeElapsedColumn(), Remaining())
    return kind(*columns, console=console, disable=quiet)


@contextmanager
def using_bars(progress: Shown) -> Iterator[Progress | None]:
    """Bars that stand while the block runs: new ones if asked for, those that are given, or none.

    If nothing is said, they stand on stderr where somebody looks at it, once the block has taken `LATE_S`.
    """
    if isinstance(progress, Progress):
        yield progress
    elif progress or (progress is None and is_watched()):
        late = progress is None
        with progress_bars(Console(stderr=late), kind=LateBars if late else Bars) as bars:
            yield bars
    else:
        yield None


def is_watched() -> bool:
    """Whether stderr is a terminal or a notebook."""
    console = Console(stderr=True)
    return console.is_terminal or console.is_jupyter


@contextmanager
def said_when_late(words: str) -> Iterator[None]:
    """Say on stderr, where somebody looks at it, what the block does once it has taken `LATE_S`."""
    timer = Timer(LATE_S, print, (words,), {"file": sys.stderr, "flush": True})
    timer.daemon = True
    if is_watched():
        timer.start()
    try:
        yield
    finally:
        timer.cancel()


class Stages:
    """Wall-clock seconds by stage, `wall_s`, of a piece of work, and a bar for each that begins with the work's name."""

    def __init__(self, name: str, bars: Progress | None = None) -> None:
        self.wall_s: dict[str, float] = {}
        self._name, self._bars = name, bars

    @contextmanager
    def stage(self, name: str, label: str, total: float | None = None) -> Iterator[Callable[[float], None]]:
        """Time a stage; gives the function that reports how much of `total` is done."""
        start, bars = time.perf_counter(), self._bars
        if bars is None:
            yield lambda done: interruption.check()
        else:
            task: TaskID = bars.add_task(f"{self._name}: {label}", total=total)
            yield lambda done: bars.update(task, completed=done)
            size = total or 1.0
            bars.update(task, total=size, completed=size)
        self.wall_s[name] = time.perf_counter() - start

    def say(self, words: str) -> None:
        """Tell the user something that is no error: above the bars, or as a warning where there are none."""
        if self._bars is None:
            warnings.warn(f"{self._name}: {words}", stacklevel=3)
        else:
            self._bars.console.print(f"{self._name}: {words}", soft_wrap=True, highlight=False, markup=False)


class Forecast:
    """Says once, while a long piece of work is under way, how long it will take, by the rate that it has shown.

    Called with how much is done, it passes that on. The first call starts the clock, so that what is compiled before it does
    not count; and what is compiled later slows one piece only, so that the last piece must have been slow as well.

    `what` is to be done, in words, and `total` how much that is; `tell` is told how much is done, `say` the forecast.
    """

    def __init__(self, what: str, total: float, tell: Callable[[float], None], say: Callable[[str], None]) -> None:
        self._what, self._total, self._tell, self._say = what, total, tell, say
        self._first: tuple[float, float] | None = None
        self._last = (0.0, 0.0)
        self._said = False

    def __call__(self, done: float) -> None:
        """Tell how much is done."""
        self._tell(done)
        now = time.perf_counter()
        last, self._last = self._last, (now, done)
        if self._first is None:
            self._first = now, done
            return
        if self._said or now - self._first[0] < FORECAST_AFTER_S or done <= last[1]:
            return
        whole = self._whole(self._first, now, done)
        if whole > LONG_S and last != self._first and self._whole(last, now, done) > LONG_S:
            self._said = True
            self._say(f"{self._what} will take about {in_words(whole)}")

    def _whole(self, since: tuple[float, float], now: float, done: float) -> float:
        """Seconds from the first call to the end at the rate since an instant."""
        assert self._first is not None
        return (now - since[0]) * (self._total - self._first[1]) / (done - since[1])


def in_words(seconds: float) -> str:
    """A long time in the unit that fits."""
    for unit, size in (("days", 86400.0), ("h", 3600.0), ("min", 60.0)):
        if seconds >= 2.0 * size:
            return f"{seconds / size:.0f} {unit}"
    return f"{seconds:.0f} s"
