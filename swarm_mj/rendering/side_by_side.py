"""Two flights in one film, side by side and at the same times: what one class of swarm does where another does not."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from rich.progress import Progress

from swarm_mj.errors import OutputError
from swarm_mj.io import interruption
from swarm_mj.rendering.cameras import OVERVIEW
from swarm_mj.rendering.film import FilmFacts, picture_times, suitable_speed
from swarm_mj.rendering.picture import Drawing
from swarm_mj.rendering.replay import Replay
from swarm_mj.rendering.video import SUFFIXES, check_film, film
from swarm_mj.typing import Array, Pixels

#: Size of each half where none is given [pixel].
HALF_SIZE = (640, 540)
#: Pictures from which the colours of a GIF are chosen.
SAMPLES = 6


def make_side_by_side(
    left: Replay,
    right: Replay,
    path: Path,
    *,
    notes: tuple[str, str] = ("", ""),
    camera: str = OVERVIEW,
    size: tuple[int, int] = HALF_SIZE,
    speed: float | None = None,
    bars: Progress | None = None,
) -> FilmFacts:
    """Make a film of two flights beside each other; the shorter one holds its end.

    Args:
        left: One flight.
        right: The other.
        path: File that ends in .mp4 or .gif.
        notes: What stands beside the time of each.
        camera: Of both, see `make_film`.
        size: Width and height of each half [pixel].
        speed: Seconds of flight per second of film; None: so that the longer one lasts about half a minute.
        bars: Where to show how far it is; None: nowhere.

    Raises:
        OutputError: The camera does not exist, or the film cannot be encoded or written.
        ObserverError: OpenGL cannot be loaded here.
    """
    (width, height), fps = size, 25.0 if path.suffix.lower() == ".mp4" else 10.0
    if path.suffix.lower() not in SUFFIXES:
        raise OutputError(f"{path}: must end in {' or '.join(SUFFIXES)}")
    check_film(path, 2 * width, height, fps)
    longer = left if left.duration >= right.duration else right
    speed = speed if speed is not None else suitable_speed(longer.duration)
    times = picture_times(longer, fps, speed)
    halves = [_half(replay, times, camera, size, note, bars) for replay, note in zip((left, right), notes, strict=True)]
    sample = [np.hstack([half[k] for half in halves]) for k in np.linspace(0, len(times) - 1, SAMPLES).astype(int)]
    with film(path, width=2 * width, height=height, fps=fps, sample=sample) as reel:
        for one, other in zip(*halves, strict=True):
            reel.add(np.ascontiguousarray(np.hstack([one, other])))
            interruption.check()
    return FilmFacts(path, len(times), 2 * width, height, fps, speed)


def _half(
    replay: Replay, times: Array, camera: str, size: tuple[int, int], note: str, bars: Progress | None
) -> list[Pixels]:
    """All pictures of one flight; one after the other, since a process has one OpenGL context."""
    width, height = size
    task = None if bars is None else bars.add_task(f"{replay.plan.scenario.name}: video, {note}", total=len(times))
    found = []
    with Drawing(replay.plan, replay.path_N, camera=camera, width=width, height=height, note=note) as drawing:
        for t in times:
            found.append(drawing.draw(replay.at(float(t))).copy())
            interruption.check()
            if bars is not None and task is not None:
                bars.advance(task)
    return found
