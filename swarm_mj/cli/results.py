"""The commands on a finished run: `video`, `report`, `export`, `products` and `images`."""

from __future__ import annotations

import argparse
from pathlib import Path

from swarm_mj.cli.common import add_command, add_quiet, bars_for, tell
from swarm_mj.errors import OutputError

#: Those of `swarm_mj.interop.export`, which a test compares; written out so that help is quick.
FORMATS = ("oem", "aem", "spk", "ck", "dsk", "gltf", "csv")
#: The same of `swarm_mj.products.write`.
PRODUCTS = ("parquet", "geotiff", "ply", "obj", "dsk", "png")
#: The same of `swarm_mj.products.images`.
IMAGES = ("png", "fits")


def add(commands: argparse._SubParsersAction) -> None:
    """Add the commands to the parser."""
    _add_video(commands)
    _add_report(commands)
    _add_export(commands)
    _add_products(commands)
    _add_images(commands)


def _add_video(commands: argparse._SubParsersAction) -> None:
    what = "Render a finished run offscreen to H.264 MP4 or GIF."
    video = add_command(commands, "video", _video, "make a film of a run", what)
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
        help=".mp4 or .gif, or .png for stills of the arrival and the end (default: RUN_DIR/CAMERA.mp4)",
    )
    for name, which in (("start", "first"), ("end", "last")):
        video.add_argument(
            f"--{name}",
            type=float,
            metavar="T",
            help=f"{which} time that is shown [s] (default: all of the flight, or the encounter where that is a small part)",
        )
    add_quiet(video)


def _video(arguments: argparse.Namespace) -> int:
    from swarm_mj.rendering.film import make_film
    from swarm_mj.rendering.replay import load_replay

    path = arguments.out or arguments.run / f"{arguments.camera}.mp4"
    size = None if arguments.size is None else parse_size(arguments.size)
    with bars_for(arguments) as bars:
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
    tell(bars.console, str(film))
    return 0


def parse_size(text: str) -> tuple[int, int]:
    """Width and height from WIDTHxHEIGHT."""
    parts = text.lower().split("x")
    if len(parts) != 2 or not all(part.isascii() and part.isdigit() for part in parts):
        raise OutputError(f"size {text!r}: give WIDTHxHEIGHT in pixels, e.g. 640x480")
    return int(parts[0]), int(parts[1])


def _add_report(commands: argparse._SubParsersAction) -> None:
    words = "write the report of a run, or of two side by side"
    what = "Write one HTML file that opens in any browser without a network."
    report = add_command(commands, "report", _report, words, what)
    report.add_argument(
        "runs", nargs="+", type=Path, metavar="RUN_DIR", help="one or two result folders of `swarm-mj fly`"
    )
    report.add_argument(
        "--out",
        type=Path,
        metavar="FILE",
        help="default: report.html in the folder, or comparison.html in the first of two",
    )


def _report(arguments: argparse.Namespace) -> int:
    from swarm_mj.api.results import report

    print(f"wrote {report(arguments.runs, arguments.out)}")
    return 0


def _add_export(commands: argparse._SubParsersAction) -> None:
    words = "write a run in the formats of other programs"
    export = add_command(
        commands, "export", _export, words, "Write a run as CCSDS messages, SPICE kernels, glTF or CSV."
    )
    export.add_argument("run", type=Path, metavar="RUN_DIR", help="result folder of `swarm-mj fly`")
    export.add_argument(
        "--format",
        nargs="+",
        required=True,
        choices=(*FORMATS, "all"),
        dest="formats",
        metavar="FORMAT",
        help=f"{' '.join(FORMATS)}, or all; SPICE kernels need the extra `spice`",
    )
    export.add_argument(
        "--ccsds",
        type=int,
        choices=(2, 3),
        default=2,
        help="version of the messages: 2 (OEM 2.0, AEM 1.0; default) or 3 (OEM 3.0, AEM 2.0)",
    )
    export.add_argument("--out", type=Path, metavar="DIR", help="default: beside the run, RUN_DIR-export")


def _export(arguments: argparse.Namespace) -> int:
    from swarm_mj.api.results import open

    run: Path = arguments.run
    out = arguments.out or run.with_name(f"{run.resolve().name}-export")
    files = open(run).export(out, formats=arguments.formats, ccsds=arguments.ccsds)
    for path in files:
        print(path)
    return 0


def _add_products(commands: argparse._SubParsersAction) -> None:
    what = "Write maps of a run's target: a table of cells, GeoTIFF, meshes with attributes, a shape kernel, panels."
    products = add_command(commands, "products", _products, "write maps of a run for other programs", what)
    products.add_argument("run", type=Path, metavar="RUN_DIR", help="result folder of `swarm-mj fly`")
    products.add_argument(
        "--format",
        nargs="+",
        default=["all"],
        choices=(*PRODUCTS, "all"),
        dest="formats",
        metavar="FORMAT",
        help=f"{' '.join(PRODUCTS)}, or all (default); parquet and geotiff need the extra `products`, dsk the extra `spice`",
    )
    products.add_argument(
        "--pixel-m", type=float, metavar="M", help="side of a pixel of the GeoTIFFs [m] (default: a third of a cell)"
    )
    products.add_argument("--out", type=Path, metavar="DIR", help="default: beside the run, RUN_DIR-products")


def _products(arguments: argparse.Namespace) -> int:
    from swarm_mj.api.results import open

    run: Path = arguments.run
    out = arguments.out or run.with_name(f"{run.resolve().name}-products")
    for path in open(run).products(out, arguments.formats, pixel_m=arguments.pixel_m):
        print(path)
    return 0


def _add_images(commands: argparse._SubParsersAction) -> None:
    what = "Write the pictures of a run as its detectors read them out: true light, shadows, noise; and labels of every pixel."
    images = add_command(commands, "images", _images, "write the pictures of a run, with labels", what)
    images.add_argument("run", type=Path, metavar="RUN_DIR", help="result folder of `swarm-mj fly`")
    images.add_argument(
        "--format",
        nargs="+",
        default=["png"],
        choices=(*IMAGES, "all"),
        dest="formats",
        metavar="FORMAT",
        help="png (default), fits, or all; fits needs the extra `fits`",
    )
    images.add_argument(
        "--every",
        type=float,
        metavar="S",
        help="pictures of the whole passage, at least S seconds apart (default: those by which the criterion judges)",
    )
    images.add_argument("--spacecraft", type=int, nargs="+", metavar="J", help="of these alone, from 1 (default: all)")
    images.add_argument("--no-labels", action="store_true", help="write no labels")
    images.add_argument("--out", type=Path, metavar="DIR", help="default: beside the run, RUN_DIR-images")
    add_quiet(images)


def _images(arguments: argparse.Namespace) -> int:
    from swarm_mj.api.results import open

    run: Path = arguments.run
    out = arguments.out or run.with_name(f"{run.resolve().name}-images")
    with bars_for(arguments) as bars:
        files = open(run).images(
            out,
            arguments.formats,
            labels=not arguments.no_labels,
            every_s=arguments.every,
            spacecraft=arguments.spacecraft,
            progress=bars,
        )
    tell(bars.console, f"{len(files)} files in {out}; {out / 'README.md'} says what they hold")
    return 0
