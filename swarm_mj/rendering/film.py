"""A film of a recorded flight, or stills of it: which pictures, how fast, how large, and in what file.

Stills stand side by side, as Figure 11 of AAS 19-144 shows the operation.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from PIL import Image
from rich.progress import Progress

from swarm_mj.errors import OutputError
from swarm_mj.io import interruption
from swarm_mj.io.atomic import atomic_file
from swarm_mj.rendering.cameras import CHASE, OVERVIEW, SPLIT
from swarm_mj.rendering.picture import Drawing
from swarm_mj.rendering.replay import Replay
from swarm_mj.rendering.video import SUFFIXES, Film, check_film, film
from swarm_mj.scenarios.itinerary import last_arrival_s
from swarm_mj.typing import Array, Pixels

#: Begin and end of a part of a flight [s], each None for the flight's own; None: as suits the flight.
PartOfFlight: TypeAlias = tuple[float | None, float | None] | None
#: Length of a film whose speed is not given [s].
LENGTH_S = 30.0
#: Longest film, so that a slip in `--speed` does not fill the disk [pictures].
MAX_PICTURES = 200_000
#: Pictures from which the colours of a GIF are chosen.
SAMPLES = 6
#: Free pixels between two stills.
GAP = 8
#: Pictures' sizes where none is given [pixel].
DEFAULT_SIZE, DEFAULT_SPLIT_SIZE, DEFAULT_CAMERA_SIZE = (960, 540), (1280, 720), (720, 720)


class FilmFacts(NamedTuple):
    """A film that was made.

    Attributes:
        path: Its file.
        pictures: Their number.
        width: Of a picture [pixel].
        height: Of a picture [pixel].
        fps: Pictures per second.
        speed: Seconds of flight per second of film; of stills 0.
        part_s: Begin and end of the part of the flight that it shows [s]; None: all of it.
    """

    path: Path
    pictures: int
    width: int
    height: int
    fps: float
    speed: float
    part_s: tuple[float, float] | None = None

    def __str__(self) -> str:
        """One sentence."""
        if self.speed == 0.0:
            return f"{self.path}: {self.pictures} stills of {self.width} x {self.height}"
        part = (
            ", from t = {:g} to {:g} s (--start, --end show another part)".format(*self.part_s) if self.part_s else ""
        )
        return (
            f"{self.path}: {self.pictures} pictures of {self.width} x {self.height}, {self.pictures / self.fps:.1f} s at "
            f"{self.fps:g} a second, {self.speed:g} times as fast as the flight{part}"
        )


def make_film(
    replay: Replay,
    path: Path,
    *,
    camera: str = OVERVIEW,
    fps: float = 25.0,
    size: tuple[int, int] | None = None,
    speed: float | None = None,
    span_s: PartOfFlight = None,
    bars: Progress | None = None,
) -> FilmFacts:
    """Make a film of a flight, or stills of its arrival and end.

    Args:
        replay: The flight.
        path: File that ends in .mp4 or .gif, or in .png for stills.
        camera: `overview`, `chase`, `split`, or `sc1`, `sc2`, ...
        fps: Pictures per second of film.
        size: Width and height [pixel]; None: one that suits the camera.
        speed: Seconds of flight per second of film; None: so that the film lasts about half a minute.
        span_s: Begin and end of what is shown [s], each None for the flight's own; None: all of the flight, or the encounter
            where that is a small part of it, see `Replay.encounter`.
        bars: Where to show how far it is; None: nowhere.

    Raises:
        OutputError: The camera does not exist, or the film cannot be encoded or written.
        ObserverError: OpenGL cannot be loaded here.
    """
    width, height = size or _default_size(camera)
    part = span_s or replay.encounter()
    replay = replay if part is None else replay.between(*part)
    if path.suffix.lower() == ".png":
        write_stills(path, replay, camera=camera, width=width, height=height)
        return FilmFacts(path, 2, width, height, fps, 0.0)
    if path.suffix.lower() not in SUFFIXES:
        raise OutputError(f"--out {path}: must end in {' or '.join(SUFFIXES)}, or in .png for stills")
    check_film(path, width, height, fps)
    speed = speed if speed is not None else suitable_speed(replay.duration)
    times = picture_times(replay, fps, speed)
    look: dict[str, Any] = {"camera": camera, "width": width, "height": height, "note": f"{speed:g} x"}
    ends = (float(replay.times[0]), float(replay.times[-1]))
    with Drawing(replay.plan, replay.path_N, **look, span_s=ends) as drawing:
        with film(path, width=width, height=height, fps=fps, sample=_sample(drawing, replay, path)) as reel:
            _shoot(reel, drawing, replay, times, bars, camera)
    return FilmFacts(path, len(times), width, height, fps, speed, None if part is None else ends)


def _shoot(reel: Film, drawing: Drawing, replay: Replay, times: Array, bars: Progress | None, camera: str) -> None:
    """Take the pictures of a film while a bar, if there is one, shows how far it is."""
    label = f"{replay.plan.scenario.name}: video, {camera}"
    task = None if bars is None else bars.add_task(label, total=len(times))
    for t in times:
        reel.add(drawing.draw(replay.at(float(t))))
        interruption.check()
        if bars is not None and task is not None:
            bars.advance(task)


def _default_size(camera: str) -> tuple[int, int]:
    if camera == SPLIT:
        return DEFAULT_SPLIT_SIZE
    # A spacecraft's camera has a square picture.
    return DEFAULT_SIZE if camera in (OVERVIEW, CHASE) else DEFAULT_CAMERA_SIZE


def suitable_speed(duration: float) -> float:
    """A round speed at which a flight [s] lasts about half a minute: 1, 2, 3 or 5 times a power of ten, at least 1."""
    wanted = max(duration / LENGTH_S, 1.0)
    steps = [step * 10.0**power for power in range(9) for step in (1, 2, 3, 5)]
    return min(steps, key=lambda step: abs(np.log(step / wanted)))


def picture_times(replay: Replay, fps: float, speed: float) -> Array:
    """Times of the flight at which pictures are taken [s]; both its ends are among them.

    Raises:
        OutputError: The speed is not positive, or the film would be too long.
    """
    if not speed > 0.0 or not np.isfinite(speed):
        raise OutputError(f"speed {speed:g}: must be above 0 seconds of flight per second of film")
    count = round(replay.duration * fps / speed) + 1
    if count > MAX_PICTURES:
        raise OutputError(f"speed {speed:g}: the film would have {count} pictures; at most {MAX_PICTURES} are made")
    return np.asarray(np.linspace(replay.times[0], replay.times[-1], max(count, 2)))


def _sample(drawing: Drawing, replay: Replay, path: Path) -> Iterator[Pixels]:
    """Pictures from all over the flight, where the colours of a film have to be chosen beforehand."""
    if path.suffix.lower() == ".gif":
        for t in np.linspace(replay.times[0], replay.times[-1], SAMPLES):
            yield drawing.draw(replay.at(float(t)))


def write_stills(
    path: Path,
    replay: Replay,
    times: Sequence[float] | None = None,
    *,
    camera: str = OVERVIEW,
    width: int = 960,
    height: int = 720,
) -> None:
    """Write pictures of a flight beside each other as a PNG that appears whole; args and errors as of `make_film`.

    `times`: instants [s]; None: the arrival and the end, as in the paper. `width` and `height` are of one picture [pixel].
    """
    if times is None:
        times = (last_arrival_s(replay.plan.scenario), float(replay.times[-1]))
    span_s = (float(replay.times[0]), float(replay.times[-1]))
    with Drawing(replay.plan, replay.path_N, camera=camera, width=width, height=height, span_s=span_s) as drawing:
        pictures = [drawing.draw(replay.at(t)) for t in times]
    gap = np.full((height, GAP, 3), 255, np.uint8)
    strip = [part for picture in pictures for part in (gap, picture)][1:]
    with atomic_file(path) as partial:
        Image.fromarray(np.hstack(strip)).save(partial, format="PNG")
