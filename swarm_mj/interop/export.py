"""A flight written in the formats of other programs, into one folder."""

from __future__ import annotations

import json
import os
import shutil
import tempfile
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path, PurePosixPath
from typing import Final, get_args

from swarm_mj import __version__
from swarm_mj.errors import InteropError, OutputError
from swarm_mj.interop import ccsds_out, gltf, kernels, tables
from swarm_mj.interop.ccsds_out import Generation
from swarm_mj.interop.states import FlightStates
from swarm_mj.io.atomic import write_text
from swarm_mj.io.lock import reserved, unwritable
from swarm_mj.io.records import read_record
from swarm_mj.io.spice import spiceypy

#: What lists the files of an export; only a folder that has it is written again.
MANIFEST: Final = "export.json"
#: Formats that are SPICE kernels.
KERNELS: Final = ("spk", "ck", "dsk")


def export_flight(states: FlightStates, folder: Path, formats: Iterable[str], generation: Generation = 2) -> list[Path]:
    """Write a flight in formats of `FORMATS`, or `all`, into a folder that is made if need be; gives the files, in order.

    An earlier export is replaced, other files in the folder are kept.

    Raises:
        InteropError: A format is unknown, or needs a package that is not installed.
        OutputError: The folder cannot be written or holds something else.
    """
    chosen = chosen_formats(formats)
    if generation not in get_args(Generation):
        raise InteropError(f"ccsds = {generation!r}: must be 2 (OEM 2.0, AEM 1.0) or 3 (OEM 3.0, AEM 2.0)")
    if set(chosen) & set(KERNELS):
        spiceypy()  # what is missing is said before anything is written
    with written_into(folder, MANIFEST) as (partial, files):
        for each in chosen:
            FORMATS[each](states, partial, generation)
        write_text(partial / MANIFEST, _manifest(states, partial, chosen))
    return files


@contextmanager
def written_into(folder: Path, manifest: str) -> Iterator[tuple[Path, list[Path]]]:
    """Give a temporary folder whose files are moved into `folder` when the block ends, and a list that they are then put into.

    Files of an earlier export, which its manifest lists, are replaced; other files in the folder are kept.

    Raises:
        OutputError: The folder cannot be written or holds something else.
    """
    folder = Path(folder)
    earlier, files = _earlier(folder, manifest), list[Path]()
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        with reserved(folder), tempfile.TemporaryDirectory(prefix=f".{folder.name}.", dir=folder.parent) as name:
            yield Path(name), files
            files += _moved(Path(name), folder, earlier, manifest)
    except OSError as error:
        raise unwritable(folder, error) from None


def chosen_formats(formats: Iterable[str], known: Iterable[str] | None = None) -> list[str]:
    """Of known formats, None: `FORMATS`, those asked for in their order, each once; refused are unknown ones and none."""
    known = list(FORMATS if known is None else known)
    asked = [formats] if isinstance(formats, str) else list(formats)
    for name in asked:
        if name not in (*known, "all"):
            raise InteropError(f"format {name!r} is unknown; allowed are {', '.join(known)}, or all")
    if not asked:
        raise InteropError(f"formats = []: name at least one of {', '.join(known)}, or all")
    return [name for name in known if name in asked or "all" in asked]


def _messages(write: Callable[[FlightStates, int, Generation], str], kind: str) -> Callable[..., None]:
    def write_all(states: FlightStates, folder: Path, generation: Generation) -> None:
        for j, name in enumerate(states.plan.names):
            _put(folder / kind / f"{name}.{kind}", write(states, j, generation))

    return write_all


#: Text kernels that belong to every binary one.
TEXT_KERNELS: Final = {
    "leapseconds.tls": kernels.leapseconds,
    "swarm.tsc": kernels.clock,
    "body.tpc": kernels.body_constants,
    "swarm.tf": kernels.frames,
    "cameras.ti": kernels.cameras,
}


def _kernels(binary: dict[str, Callable[[Path, FlightStates], None]]) -> Callable[..., None]:
    """Writer of binary kernels, by the names of their files, with the text kernels that belong to them."""

    def write_all(states: FlightStates, folder: Path, generation: Generation) -> None:
        place = folder / "spice"
        for name, write in TEXT_KERNELS.items():
            _put(place / name, write(states))
        for name, write_binary in binary.items():
            write_binary(place / name, states)
        written = sorted(p.name for p in place.iterdir() if p.suffix in (".bsp", ".bc", ".bds"))
        _put(place / "swarm.tm", kernels.meta_kernel(states, [*TEXT_KERNELS, *written]))

    return write_all


def _gltf(states: FlightStates, folder: Path, generation: Generation) -> None:
    _put(folder / "gltf" / "scene.glb", gltf.write_scene(states))


def _csv(states: FlightStates, folder: Path, generation: Generation) -> None:
    described = {}
    for j, name in enumerate(states.plan.names):
        table, described[f"{name}.csv"] = tables.spacecraft_table(states, j)
        _put(folder / "csv" / f"{name}.csv", table.to_csv(index=False, float_format="%.17g"))
    _put(folder / "csv" / "datapackage.json", tables.data_package(states, described))


#: Writers by format.
FORMATS: Final[dict[str, Callable[[FlightStates, Path, Generation], None]]] = {
    "oem": _messages(ccsds_out.write_oem, "oem"),
    "aem": _messages(ccsds_out.write_aem, "aem"),
    "spk": _kernels({"swarm.bsp": kernels.write_spk, "sun_earth.bsp": kernels.write_sun_and_earth}),
    "ck": _kernels({"swarm.bc": kernels.write_ck}),
    "dsk": _kernels({"body.bds": kernels.write_dsk}),
    "gltf": _gltf,
    "csv": _csv,
}


def _put(path: Path, content: str | bytes) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content.encode() if isinstance(content, str) else content)


def files_in(folder: Path) -> list[str]:
    """All files below a folder, relative to it, in order."""
    return sorted(p.relative_to(folder).as_posix() for p in folder.rglob("*") if p.is_file())


def _manifest(states: FlightStates, folder: Path, chosen: list[str]) -> str:
    contents = {
        "program": f"swarm_mj {__version__}",
        "scenario": states.plan.scenario.name,
        "formats": chosen,
        "centre": f"{states.body.name}, NAIF {states.body.code}",
        "frames": {
            "oem, aem": "EME2000",
            "spk, ck, csv": "ECLIPJ2000, which is N",
            "dsk, csv (A)": f"{states.body.frame}, which is A",
            "gltf": "N, its z axis up (y of glTF)",
        },
        "time": "TDB",
        "comments": states.comments,
        "files": files_in(folder),
    }
    return json.dumps(contents, indent=2) + "\n"


def _earlier(folder: Path, manifest: str) -> list[str]:
    """Files of the export that stands in a folder, which may hold nothing else; none where there is no folder."""
    if not folder.exists() or (folder.is_dir() and not any(folder.iterdir())):
        return []
    remedy = "choose another folder with --out"
    if not (folder / manifest).is_file():
        raise OutputError(f"{folder}: exists and is no earlier export (it has no {manifest}); {remedy}")
    listed = read_record(folder / manifest, dict[str, object], remedy).get("files")
    names = [name for name in listed if isinstance(name, str)] if isinstance(listed, list) else []
    return [name for name in names if not PurePosixPath(name).is_absolute() and ".." not in PurePosixPath(name).parts]


def _moved(partial: Path, folder: Path, earlier: list[str], manifest: str) -> list[Path]:
    """Put new files into their places, the list of them last, and remove those of an earlier export that have no successor."""
    names = files_in(partial)
    for name in sorted(names, key=lambda name: name == manifest):
        place = folder / name
        place.parent.mkdir(parents=True, exist_ok=True)
        if place.is_dir():
            shutil.rmtree(place)
        os.replace(partial / name, place)
    for name in set(earlier) - set(names):
        (folder / name).unlink(missing_ok=True)
    return [folder / name for name in names]
