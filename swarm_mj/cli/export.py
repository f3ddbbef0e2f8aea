"""The command `export`."""

from __future__ import annotations

import argparse
from pathlib import Path

#: Those of `swarm_mj.interop.export`, which a test compares; written out so that help is quick.
FORMATS = ("oem", "aem", "spk", "ck", "dsk", "gltf", "csv")


def add(commands: argparse._SubParsersAction) -> None:
    """Add the command to the parser."""
    export = commands.add_parser(
        "export",
        help="write a run in the formats of other programs",
        description="Write a run as CCSDS messages, SPICE kernels, glTF or CSV.",
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
    export.set_defaults(command=_export)


def _export(arguments: argparse.Namespace) -> int:
    from swarm_mj.api.flight import read_flight

    run: Path = arguments.run
    out = arguments.out or run.with_name(f"{run.resolve().name}-export")
    files = read_flight(run).export(out, formats=arguments.formats, ccsds=arguments.ccsds)
    for path in files:
        print(path)
    return 0
