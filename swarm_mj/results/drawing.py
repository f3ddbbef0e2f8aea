"""The figures of a run, drawn here or by other processes on all cores, which get ready while this one flies.

Matplotlib draws on one core, and importing it with what the figures need takes as long as a short flight. Inside
`drawing_beside` another process (`results/figures/serve.py`) therefore imports it in the meantime, and `draw_all` hands it
what was flown. Nothing heavy is imported here.
"""

from __future__ import annotations

import os
import pickle
import signal
import subprocess
import sys
from base64 import b64decode
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from swarm_mj.errors import OutputError
from swarm_mj.io.cores import ONE_THREAD, usable_cores
from swarm_mj.io.interruption import held

if TYPE_CHECKING:
    import xarray as xr

    from swarm_mj.flight.observe import ObservationResult
    from swarm_mj.flight.plan import Plan

Progress = Callable[[float], None]

#: More processes than these wait for the slowest figure, and each takes its memory.
MAX_WORKERS = 6
#: What the other process does; it finds modules where this one does.
_SERVE = "import sys; sys.path[:] = {path!r}; from swarm_mj.results.figures.serve import serve; serve({workers})"


def draw_all(
    folder: Path,
    plan: Plan,
    telemetry: xr.Dataset,
    result: ObservationResult,
    *,
    pdf: bool = False,
    progress: Progress | None = None,
) -> None:
    """Write the figures of a run into a folder: by other processes inside `drawing_beside`, else here, one after another.

    Args:
        folder: Where, as NAME.png.
        plan: What was flown.
        telemetry: How.
        result: What was observed.
        pdf: Whether to write NAME.pdf too.
        progress: Told how many are done.

    Raises:
        OutputError: A process that drew ended before its time.
    """
    beside = _BESIDE.get()
    drawn = None if beside is None else beside.draw(folder, plan, telemetry, result, pdf)
    for count, _ in enumerate(_here(folder, plan, telemetry, result, pdf) if drawn is None else drawn):
        if progress is not None:
            progress(count + 1)


def _here(folder: Path, plan: Plan, telemetry: xr.Dataset, result: ObservationResult, pdf: bool) -> Iterator[str]:
    from swarm_mj.results.figures import composers, draw

    for name in composers(telemetry):
        draw(name, folder, plan, telemetry, result, pdf=pdf)
        yield name


def compile_beside(plan: Plan) -> None:
    """Inside `drawing_beside`, let the other process compile what a first flight of a plan needs last."""
    if beside := _BESIDE.get():
        beside.compile_ahead(plan)


@contextmanager
def drawing_beside(workers: int | None = None) -> Iterator[None]:
    """Let `draw_all` draw by other processes while the block runs; they end with it, however it ends.

    Inside another such block it changes nothing.

    Args:
        workers: Figures drawn at once; None: one per core, at most `MAX_WORKERS`. With one, nothing is started.
    """
    workers = min(usable_cores(), MAX_WORKERS) if workers is None else workers
    if workers < 2 or _BESIDE.get() is not None:
        yield
        return
    process = _start(workers)
    before = _BESIDE.set(process)
    try:
        yield
    finally:
        _BESIDE.reset(before)
        if process is not None:
            process.end()


def _start(workers: int) -> _Process | None:
    """The process that draws; None where another one cannot be started."""
    with suppress(OSError), held():
        return _Process(workers)
    return None


class _Process:
    """The process that draws; `serve` says what it reads and answers."""

    def __init__(self, workers: int) -> None:
        # In a session of its own: Ctrl-C is for the process that flies, which ends this one.
        self._process = subprocess.Popen(
            [sys.executable, "-c", _SERVE.format(path=sys.path, workers=workers)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            # It opens no window, for which mujoco would get ready.
            env=os.environ | dict.fromkeys(ONE_THREAD, "1") | {"MUJOCO_GL": "disable"},
            start_new_session=True,
        )
        assert self._process.stdin is not None and self._process.stdout is not None
        self._jobs, self._answers = self._process.stdin, self._process.stdout
        self._ended = False

    def draw(
        self, folder: Path, plan: Plan, telemetry: xr.Dataset, result: ObservationResult, pdf: bool
    ) -> Iterator[str] | None:
        """Have every figure drawn; gives the names of those that are done, or None where the process cannot do it."""
        job = (str(folder.resolve()), _without_plugins(plan), telemetry, result, pdf)
        return self._drawn() if self._hand_over("draw", job) else None

    def compile_ahead(self, plan: Plan) -> None:
        """Have compiled what a flight of a plan needs last, as far as it comes to it."""
        self._hand_over("compile", _without_plugins(plan))

    def _hand_over(self, kind: str, job: object) -> bool:
        """Whether a job could be handed over; where not, the process is gone, or will be."""
        if self._ended:
            return False
        try:
            pickle.dump((kind, job), self._jobs, protocol=pickle.HIGHEST_PROTOCOL)
            self._jobs.flush()
        except BaseException as error:
            self.end()
            if isinstance(error, (OSError, pickle.PicklingError, TypeError, AttributeError)):
                return False
            raise
        return True

    def _drawn(self) -> Iterator[str]:
        try:
            for line in self._answers:
                name, error, words = pickle.loads(b64decode(line))
                if error is not None:
                    error.add_note(words)
                    raise error
                if words:
                    raise OutputError(words)
                if name is None:
                    return
                yield name
            self.end()
            raise OutputError(
                f"the process that draws figures ended before its time ({self._process.returncode}); --no-figures goes without"
            )
        except BaseException:
            self.end()
            raise

    def end(self) -> None:
        """End it and its children at once, and wait until none of them can write any more."""
        if self._ended:
            return
        with held():
            self._ended = True
            with suppress(ProcessLookupError):
                os.killpg(self._process.pid, signal.SIGKILL)
            self._answers.read()  # to its end, which comes with that of the last child
            for pipe in (self._jobs, self._answers):
                with suppress(OSError):  # broken
                    pipe.close()
            self._process.wait()


def _without_plugins(plan: Plan) -> Plan:
    """A plan as figures read it: plug-ins, which they do not ask, need not be made for another process."""
    nothing: Any = None
    return replace(plan, behavior=nothing, controller=nothing, environment=replace(plan.environment, gravity=nothing))


#: The process that draws for the block of `drawing_beside` that this is in.
_BESIDE: ContextVar[_Process | None] = ContextVar("beside", default=None)
