"""Stills: pictures of a flight at chosen instants side by side, as Figure 11 of AAS 19-144 shows the operation."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from PIL import Image

from swarm_mj.io.atomic import atomic_file
from swarm_mj.rendering.cameras import OVERVIEW
from swarm_mj.rendering.picture import Drawing
from swarm_mj.rendering.replay import Replay
from swarm_mj.scenarios.itinerary import last_visit_s

#: Free pixels between two pictures.
GAP = 8


def write_stills(
    path: Path,
    replay: Replay,
    times: Sequence[float] | None = None,
    *,
    camera: str = OVERVIEW,
    width: int = 960,
    height: int = 720,
) -> None:
    """Write pictures of a flight beside each other as a PNG, under a temporary name that is then changed.

    Args:
        path: Where.
        replay: The flight.
        times: Instants [s]; None: the visit and the end, as in the paper.
        camera: `overview`, `chase`, `split`, or `sc1`, `sc2`, ...
        width: Of one picture [pixel].
        height: Of one picture [pixel].

    Raises:
        OutputError: There is no camera of that name, the size is out of range, or the file cannot be written.
        ObserverError: OpenGL cannot be loaded here.
    """
    if times is None:
        times = (last_visit_s(replay.plan.scenario), float(replay.times[-1]))
    span_s = (float(replay.times[0]), float(replay.times[-1]))
    with Drawing(replay.plan, replay.path_N, camera=camera, width=width, height=height, span_s=span_s) as drawing:
        pictures = [drawing.draw(replay.at(t)) for t in times]
    gap = np.full((height, GAP, 3), 255, np.uint8)
    strip = [part for picture in pictures for part in (gap, picture)][1:]
    with atomic_file(path) as partial:
        Image.fromarray(np.hstack(strip)).save(partial, format="PNG")
