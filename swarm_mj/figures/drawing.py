"""The figures of a run, drawn by processes on all cores, which get ready while this one flies.

Matplotlib draws on one core, and importing it with what the figures need takes as long as a short flight: `prepare_drawing` has
that done meanwhile. Nothing heavy is imported here.
"""

from __future__ import annotations

import gc
import pickle
import traceback
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import replace
from multiprocessing.connection import Connection
from pathlib import Path
from typing import TYPE_CHECKING, Any

from swarm_mj.io import workers
from swarm_mj.io.machine import usable_cores

if TYPE_CHECKING:
    import xarray as xr

    from swarm_mj.figures.run_figures import Compose
    from swarm_mj.flight.observe import ObservationResult
    from swarm_mj.flight.plan import Plan

Progress = Callable[[float], None]

#: Figures that not every flight has something for, and whether one has; the others are always drawn.
OPTIONAL: dict[str, Callable[[xr.Dataset], bool]] = {
    "propulsion": lambda flown: "delta_v_m_s" in flown and bool((flown["delta_v_m_s"].values[-1] > 0.0).any()),
    "navigation": lambda flown: "r_BN_N_estimate" in flown,
    "formation": lambda flown: "formation_error" in flown,
}

#: More processes than these wait for the slowest figure, and each takes its memory.
MAX_WORKERS = 6
#: What takes longest is begun first, so that nobody waits for it in the end.
SLOWEST = ("footprints", "illumination", "operation", "ground_track", "pointing_error")
#: What processes that draw have loaded.
PRELOADED = ("swarm_mj.figures.preloaded",)


def figures_of(telemetry: xr.Dataset) -> tuple[str, ...]:
    """Stems of the figures that are drawn of a flight, in their order: those that would have nothing to show are not."""
    from swarm_mj.io.atomic import FIGURES

    return tuple(name for name in FIGURES["run"] if name not in OPTIONAL or OPTIONAL[name](telemetry))


def composers(telemetry: xr.Dataset) -> dict[str, Compose]:
    """What composes the figures of a flight, by file stem."""
    from swarm_mj.figures.run_figures import COMPOSERS

    return {name: COMPOSERS[name] for name in figures_of(telemetry)}


def prepare_drawing() -> None:
    """Begin to load, beside this process, what `draw_all` needs; with one core nothing is started."""
    if usable_cores() > 1:
        with suppress(OSError):  # figures are drawn here then
            workers.preload(PRELOADED)


def draw_all(
    folder: Path,
    plan: Plan,
    telemetry: xr.Dataset,
    result: ObservationResult,
    *,
    pdf: bool = False,
    progress: Progress | None = None,
) -> None:
    """Write the figures of a run into a folder as NAME.png: by processes on all cores; on one core here, one after another.

    With `pdf` NAME.pdf is written too; `progress` is told how many are done.

    Raises:
        SwarmError: A process that drew died.
    """
    names = figures_of(telemetry)
    for count, _ in enumerate(_drawn(names, (folder.resolve(), plan, telemetry, result, pdf))):
        if progress is not None:
            progress(count + 1)


def _drawn(names: tuple[str, ...], job: tuple[Any, ...]) -> Iterator[object]:
    processes = min(usable_cores(), MAX_WORKERS, len(names))
    pickled = _pickled(job) if processes > 1 else None
    if pickled is None:
        for name in names:
            _draw(job, name)
            yield name
        return
    slowest_first = sorted(names, key=lambda name: SLOWEST.index(name) if name in SLOWEST else len(SLOWEST))
    jobs = ((name, (name,)) for name in slowest_first)
    yield from workers.run_jobs(jobs, _draw, workers=processes, setup=_opened, arguments=(pickled,), modules=PRELOADED)


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
