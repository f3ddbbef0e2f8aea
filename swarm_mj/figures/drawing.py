"""The figures of a run, drawn by processes on all cores, which get ready while this one flies.

Matplotlib draws on one core, and importing it with what the figures need takes as long as a short flight: `prepare_drawing` has
that done meanwhile. Nothing heavy is imported here.
"""

from __future__ import annotations

import gc
import pickle
import traceback
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from multiprocessing.connection import Connection
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from swarm_mj.io import workers
from swarm_mj.io.machine import usable_cores

if TYPE_CHECKING:
    import xarray as xr

    from swarm_mj.flight.observe import ObservationResult
    from swarm_mj.flight.plan import Plan

Progress = Callable[[float], None]

#: More processes than these wait for the slowest figure, and each takes its memory.
MAX_WORKERS = 6
#: What takes longest is begun first, so that nobody waits for it in the end.
SLOWEST = ("footprints", "illumination", "operation", "ground_track", "pointing_error")
#: What processes that draw have loaded.
PRELOADED = ("swarm_mj.figures.preloaded",)


def prepare_drawing() -> None:
    """Begin to load, beside this process, what `Drawing` needs; with one core nothing is started."""
    if usable_cores() > 1:
        with suppress(OSError):  # figures are drawn here then
            workers.preload(PRELOADED)


class Drawing:
    """The figures of a run, drawn into a folder as NAME.png by processes on all cores while this one does something else.

    A context manager: whatever is not drawn at the end of its block never is. On one core, and where something cannot be
    handed over, `finish` draws them here, one after another.

    Args:
        folder: Where.
        plan: What was flown.
        telemetry: How.
        result: What was observed.
        pdf: Whether to write NAME.pdf too.
    """

    def __init__(
        self, folder: Path, plan: Plan, telemetry: xr.Dataset, result: ObservationResult, *, pdf: bool = False
    ) -> None:
        from swarm_mj.figures.optional_figures import figures_of

        self.names = figures_of(telemetry)
        self._job = (folder.resolve(), plan, telemetry, result, pdf)
        self._jobs: workers.BackgroundJobs | None = None
        self._drawn = 0

    def __enter__(self) -> Self:
        """Start the processes."""
        processes = min(usable_cores(), MAX_WORKERS, len(self.names))
        pickled = _pickled(self._job) if processes > 1 else None
        if pickled is not None:
            slowest_first = sorted(
                self.names, key=lambda name: SLOWEST.index(name) if name in SLOWEST else len(SLOWEST)
            )
            self._jobs = workers.BackgroundJobs(
                slowest_first, _draw, workers=processes, setup=_opened, arguments=(pickled,), modules=PRELOADED
            ).__enter__()
        return self

    def __exit__(self, *error: object) -> None:
        """End the processes."""
        if self._jobs is not None:
            self._jobs.__exit__(*error)

    def nothing_to_wait_for(self) -> bool:
        """Whether other processes have no more to draw.

        Raises:
            SwarmError: A process that drew died.
        """
        if self._jobs is not None and not self._jobs.over:
            self._drawn += self._jobs.done(timeout_s=0.0)
        return self._jobs is None or self._jobs.over

    def finish(self, progress: Progress | None = None) -> None:
        """Wait until all are drawn; `progress` is told how many are.

        Raises:
            SwarmError: A process that drew died.
        """
        tell = progress or (lambda count: None)
        if self._jobs is None:
            for count, name in enumerate(self.names):
                _draw(self._job, name)
                tell(count + 1)
            return
        while not self._jobs.over:
            for _ in range(self._jobs.done()):
                self._drawn += 1
                tell(self._drawn)


def _pickled(job: tuple[Any, ...]) -> bytes | None:
    """What processes draw from; None where it holds what cannot be pickled."""
    folder, plan, *flown = job
    with suppress(pickle.PicklingError, TypeError, AttributeError):
        return pickle.dumps((folder, _without_plugins(plan), *flown))
    return None


def _opened(pickled: bytes) -> Any:
    """The job, in a process that draws and ends soon: what it no longer needs is not looked for."""
    gc.disable()
    return pickle.loads(pickled)


def _draw(job: tuple[Any, ...], name: str) -> None:
    from swarm_mj.figures.run_figures import draw

    folder, plan, telemetry, result, pdf = job
    try:
        draw(name, folder, plan, telemetry, result, pdf=pdf)
    except Exception as error:
        error.add_note(f"while {name}.png was drawn: {traceback.format_exc()}")
        raise


def compile_in_background(plan: Plan) -> None:
    """Have compiled by another process what a first flight of a plan needs last, as far as it comes to it."""
    if usable_cores() > 1:
        with suppress(OSError):
            workers.begin(_compile, (_without_plugins(plan),), modules=PRELOADED)


def _compile(pipe: Connection, plan: Plan) -> None:
    from swarm_mj.flight.compile_ahead import compile_ahead

    with suppress(Exception):  # what fails here fails in the flight too, which says why
        compile_ahead(plan)


def _without_plugins(plan: Plan) -> Plan:
    """A plan as figures read it: plug-ins, which they do not ask, need not be made for another process."""
    nothing: Any = None
    return replace(plan, behavior=nothing, controller=nothing, environment=replace(plan.environment, gravity=nothing))
