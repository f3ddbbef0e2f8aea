"""The command `video`."""

from __future__ import annotations

import argparse
from pathlib import Path


def add(commands: argparse._SubParsersAction) -> None:
    """Add the command to the parser."""
    video = commands.add_parser(
        "video",
        help="make a film of a run",
        description="Render a finished run offscreen to H.264 MP4 or GIF.",
    )
    video.add_argument("run", type=Path, metavar="RUN_DIR", help="result folder of `swarm-mj run`")
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
    video.add_argument("--quiet", action="store_true", help="no progress bar")
    video.set_defaults(command=_video)


def _video(arguments: argparse.Namespace) -> int:
    from swarm_mj.cli.video_runner import run_video

    run_video(
        arguments.run,
        camera=arguments.camera,
        fps=arguments.fps,
        size=arguments.size,
        speed=arguments.speed,
        out=arguments.out,
        quiet=arguments.quiet,
    )
    return 0
