"""The command `video`."""

from __future__ import annotations

import argparse
from pathlib import Path

from swarm_mj.errors import OutputError


def add(commands: argparse._SubParsersAction) -> None:
    """Add the command to the parser."""
    video = commands.add_parser(
        "video",
        help="make a film of a run",
        description="Render a finished run offscreen to H.264 MP4 or GIF.",
    )
    video.add_argument("run", type=Path, metavar="RUN_DIR", help="result folder of `swarm-mj fly`")
    video.add_argument(
        "--camera",
        default="overview",
        metavar="NAME",
        help="overview (default), chase, split, or sc1, sc2, ... beside an overview",
    )
    video.add_argument("--fps", type=float, default=25.0, metavar="N", help="pictures per second of film (default 25)")
    video.add_argument(
        "--size", metavar="WIDTHxHEIGHT", help="of the picture (default 960x540, split 1280x720, sc1, sc2, ... 720x720)"
    )
    video.add_argument(
        "--speed",
        type=float,
        metavar="X",
        help="seconds of flight per second of film (default: so that it lasts about half a minute)",
    )
    video.add_argument(
        "--out",
        type=Path,
        metavar="FILE",
        help=".mp4 or .gif, or .png for stills of the visit and the end (default: RUN_DIR/CAMERA.mp4)",
    )
    for name, which in (("start", "first"), ("end", "last")):
        video.add_argument(
            f"--{name}",
            type=float,
            metavar="T",
            help=f"{which} time that is shown [s] (default: all of the flight, or the encounter where that is a small part)",
        )
    video.add_argument("--quiet", action="store_true", help="no progress bar")
    video.set_defaults(command=_video)


def _video(arguments: argparse.Namespace) -> int:
    from rich.console import Console

    from swarm_mj.io.progress import progress_bars
    from swarm_mj.rendering.film import make_film
    from swarm_mj.rendering.replay import load_replay

    console, path = Console(), arguments.out or arguments.run / f"{arguments.camera}.mp4"
    size = None if arguments.size is None else parse_size(arguments.size)
    with progress_bars(console, arguments.quiet) as bars:
        film = make_film(
            load_replay(arguments.run),
            path,
            camera=arguments.camera,
            fps=arguments.fps,
            size=size,
            speed=arguments.speed,
            span_s=None if arguments.start is arguments.end is None else (arguments.start, arguments.end),
            bars=bars,
        )
    console.print(str(film), soft_wrap=True, highlight=False, markup=False)
    return 0


def parse_size(text: str) -> tuple[int, int]:
    """Width and height from WIDTHxHEIGHT.

    Raises:
        OutputError: It is not of that form.
    """
    parts = text.lower().split("x")
    if len(parts) != 2 or not all(part.isascii() and part.isdigit() for part in parts):
        raise OutputError(f"size {text!r}: give WIDTHxHEIGHT in pixels, e.g. 640x480")
    return int(parts[0]), int(parts[1])
