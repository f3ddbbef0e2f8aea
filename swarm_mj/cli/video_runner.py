"""The command `swarm-mj video`: a film of a recorded flight."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.progress import Progress

from swarm_mj.errors import OutputError
from swarm_mj.io.progress import progress_bars
from swarm_mj.rendering.cameras import CHASE, OVERVIEW, SPLIT
from swarm_mj.rendering.picture import Drawing
from swarm_mj.rendering.replay import Replay, load_replay
from swarm_mj.rendering.stills import write_stills
from swarm_mj.rendering.video import SUFFIXES, Film, check_film, film
from swarm_mj.typing import Array, Pixels

#: Length of a film whose speed is not given [s].
LENGTH_S = 30.0
#: Longest film, so that a slip in `--speed` does not fill the disk [pictures].
MAX_PICTURES = 200_000
#: Pictures from which the colours of a GIF are chosen.
SAMPLES = 6
#: Pictures' sizes where none is given [pixel].
DEFAULT_SIZE, DEFAULT_SPLIT_SIZE, DEFAULT_CAMERA_SIZE = (960, 540), (1280, 720), (720, 720)


def run_video(
    folder: Path,
    *,
    camera: str = OVERVIEW,
    fps: float = 25.0,
    size: str | None = None,
    speed: float | None = None,
    out: Path | None = None,
    quiet: bool = False,
) -> Path:
    """Make a film of a run with a progress bar; returns where it lies.

    Args:
        folder: Result folder of a run.
        camera: `overview`, `chase`, `split`, or `sc1`, `sc2`, ...
        fps: Pictures per second of film.
        size: WIDTHxHEIGHT [pixel]; None: one that suits the camera.
        speed: Seconds of flight per second of film; None: so that the film lasts about half a minute.
        out: File that ends in .mp4 or .gif, or in .png for stills of the visit and the end; None: CAMERA.mp4 in the
            run's folder.
        quiet: No progress bar.

    Raises:
        OutputError: The folder is no run's, the camera does not exist, or the film cannot be encoded or written.
        ObserverError: OpenGL cannot be loaded here.
    """
    path = out or folder / f"{camera}.mp4"
    width, height = parse_size(size) if size else _default_size(camera)
    if path.suffix.lower() == ".png":
        write_stills(path, load_replay(folder), camera=camera, width=width, height=height)
        return path
    if path.suffix.lower() not in SUFFIXES:
        raise OutputError(f"--out {path}: must end in {' or '.join(SUFFIXES)}, or in .png for stills")
    check_film(path, width, height, fps)
    replay = load_replay(folder)
    speed = speed if speed is not None else suitable_speed(replay.duration)
    times, console = picture_times(replay, fps, speed), Console()
    with Drawing(replay.plan, replay.path_N, camera=camera, width=width, height=height, note=f"{speed:g} x") as drawing:
        with film(path, width=width, height=height, fps=fps, sample=_sample(drawing, replay, path)) as reel:
            _shoot(reel, drawing, replay, times, progress_bars(console, quiet), camera)
    console.print(
        f"{path}: {len(times)} pictures of {width} x {height}, {len(times) / fps:.1f} s at {fps:g} a second, "
        f"{speed:g} times as fast as the flight",
        soft_wrap=True,
        highlight=False,
        markup=False,
    )
    return path


def _shoot(reel: Film, drawing: Drawing, replay: Replay, times: Array, progress: Progress, camera: str) -> None:
    """Take the pictures of a film while a bar shows how far it is."""
    with progress:
        task = progress.add_task(f"{replay.plan.scenario.name}: video, {camera}", total=len(times))
        for t in times:
            reel.add(drawing.draw(replay.at(float(t))))
            progress.advance(task)


def _default_size(camera: str) -> tuple[int, int]:
    if camera == SPLIT:
        return DEFAULT_SPLIT_SIZE
    # A spacecraft's camera has a square picture.
    return DEFAULT_SIZE if camera in (OVERVIEW, CHASE) else DEFAULT_CAMERA_SIZE


def parse_size(text: str) -> tuple[int, int]:
    """Width and height from WIDTHxHEIGHT.

    Raises:
        OutputError: It is not of that form.
    """
    parts = text.lower().split("x")
    if len(parts) != 2 or not all(part.isascii() and part.isdigit() for part in parts):
        raise OutputError(f"size {text!r}: give WIDTHxHEIGHT in pixels, e.g. 640x480")
    return int(parts[0]), int(parts[1])


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
