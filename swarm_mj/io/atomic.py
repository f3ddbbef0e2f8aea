"""Files and result folders that appear whole or not at all, and take the place of no other result than their own."""

from __future__ import annotations

import os
import re
import secrets
import shutil
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, Literal, NamedTuple

from swarm_mj.errors import OutputError
from swarm_mj.io.interruption import check, held, remove, undone_by
from swarm_mj.io.lock import reserved, unwritable
from swarm_mj.io.records import read_record

#: The file that every result has, and what such a folder may hold besides; anything else is somebody's and never replaced.
MARKER = "summary.json"
KINDS = {".json", ".yaml", ".nc", ".npz", ".png", ".pdf", ".html", ".mp4", ".gif"}

#: What results are made of, by kind. Whatever else lies in their folder is kept when they are replaced.
FILES = {
    "run": (
        "summary.json",
        "scenario.yaml",
        "telemetry.nc",
        "coverage.npz",
        "delivery.npz",
        "design.json",
        "report.html",
    ),
    "design": ("summary.json", "scenario.yaml", "design.json", "sightings.npz", "pareto.json", "growth.json"),
}
#: Stems of their figures, each a PNG and perhaps a PDF.
FIGURES = {
    "run": ("behaviors", "trajectories", "target", "tracking_error", "pointing_error", "navigation", "operation", "coverage",
            "ground_track", "footprints", "illumination", "wheel_speed", "wheel_momentum", "propulsion", "links", "contacts",
            "data", "delivered_map", "formation"),
    "design": ("history", "gene_map", "cover", "pareto", "certainty"),
}  # fmt: skip


class Result(NamedTuple):
    """What a result folder holds: it is replaced only by a result of which the same can be said."""

    kind: Literal["run", "design"]
    scenario: str

    def __str__(self) -> str:
        return f"a {self.kind} of {self.scenario}"

    def owns(self, name: str) -> bool:
        """Whether a file of that name is part of such a result."""
        stem, _, suffix = name.rpartition(".")
        return name in FILES[self.kind] or (suffix in ("png", "pdf") and stem in FIGURES[self.kind])


@contextmanager
def atomic_folder(
    destination: Path, result: Result | None = None, say: Callable[[str], object] | None = None
) -> Iterator[Path]:
    """Give a temporary folder beside `destination` that takes its place when the block ends without an error.

    An earlier result is replaced only then; anything else that stands there is never touched. What lies in the folder besides
    the earlier result (films, comparisons, files of the user's own) is kept, unless the new result has a file of that name.
    While the block runs, a second run into the same place is refused. What a killed run left behind is cleared by the next.

    Args:
        destination: Where the result is to stand.
        result: What it is; None: whatever result stands there is replaced.
        say: Told which files were kept, if there are any, when all is in its place.

    Raises:
        OutputError: The place cannot be written, holds something that is not a result of this program or another one than
            `result`, or another run is writing there.
    """
    given, destination = destination, _resolved(destination)
    with _parents(destination), reserved(destination):
        _clear_leftovers(destination)
        _check_replaceable(destination, result)  # held: no other run is exchanging what stands there
        partial: Path | None = None
        try:
            with held():
                partial = _made_beside(destination)
            with undone_by(lambda: remove(partial)):
                yield partial
            check()
            with held():
                kept = _replace(partial, destination)
        except OSError as error:
            intact = "the earlier result, if any, is intact"
            raise OutputError(f"{destination}: cannot be written ({error}); {intact}") from error
        finally:
            if partial is not None:
                with held():
                    shutil.rmtree(partial, ignore_errors=True)
    if kept and result is not None and say is not None:
        say(f"kept in {given}, but of the earlier {result.kind}, not this one: {', '.join(kept)}")


def _made_beside(destination: Path) -> Path:
    try:
        partial = Path(tempfile.mkdtemp(prefix=f".{destination.name}.", suffix=".partial", dir=destination.parent))
        partial.chmod(0o755)
    except OSError as error:
        raise unwritable(destination, error) from None
    return partial


def check_place(destination: Path, result: Result) -> None:
    """See that a result may stand there, before any work is done for it.

    Raises:
        OutputError: Something stands there that it would not replace.
    """
    _check_replaceable(_resolved(destination), result)


def _resolved(destination: Path) -> Path:
    try:
        return destination.resolve()
    except (OSError, RuntimeError, ValueError) as error:  # a loop of links, a NUL
        what = f"is no place for a result ({error})"
        raise OutputError(f"{str(destination)!r}: {what}; choose another with --out") from None


@contextmanager
def _parents(destination: Path) -> Iterator[None]:
    """Make the folders that a place lies in; those that stay empty are removed again."""
    made: list[Path] = []
    try:
        try:
            made += [folder for folder in destination.parents if not folder.exists()]
            destination.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise unwritable(destination, error) from None
        with undone_by(lambda: _remove_empty(made)):
            yield
    finally:
        with held():
            _remove_empty(made)


def _remove_empty(folders: Sequence[Path]) -> None:
    for folder in folders:  # the innermost first
        with suppress(OSError):
            folder.rmdir()


def _clear_leftovers(destination: Path) -> None:
    """Put an earlier result back that a killed run had moved aside, and remove what such runs left half-written."""
    ours = re.compile(rf"\.{re.escape(destination.name)}\.[a-z0-9_]{{8}}\.(partial|old)")
    with suppress(OSError):
        for leftover in sorted(destination.parent.iterdir()):
            if not ours.fullmatch(leftover.name):
                continue
            if leftover.suffix == ".partial":
                shutil.rmtree(leftover, ignore_errors=True)
            elif not destination.exists():
                leftover.rename(destination)
            elif result_in(destination) is not None:
                _hand_over(leftover, destination)
                shutil.rmtree(leftover, ignore_errors=True)


def _check_replaceable(destination: Path, result: Result | None) -> None:
    try:
        if not destination.exists():
            return
        if not destination.is_dir():
            raise OutputError(f"{destination}: is a file; --out must name a folder")
        if Path.cwd().is_relative_to(destination):
            raise OutputError(f"{destination}: is the folder you are in, or holds it; choose another folder with --out")
        entries = list(destination.iterdir())
        foreign = [p.name for p in entries if p.suffix not in KINDS or p.is_dir()]
        there = result_in(destination)
        if entries and (foreign or there is None):
            why = f"holds {foreign[0]}" if foreign else f"has no {MARKER} of swarm-mj"
            what = f"exists and is not an earlier result ({why})"
            raise OutputError(f"{destination}: {what}; choose another folder with --out")
    except OSError as error:
        raise OutputError(f"{destination}: cannot be read ({error.strerror})") from None
    if None not in (there, result) and there != result:
        raise OutputError(
            f"{destination}: holds {there}, which {result} does not replace; choose another folder with --out, or remove "
            "this one"
        )


def result_in(folder: Path) -> Result | None:
    """Which result a folder holds; None: it holds none of this program."""
    try:
        summary = read_record(folder / MARKER, dict[str, Any], "")
    except OutputError:
        return None
    if "scenario" not in summary:
        return None
    versions = summary.get("versions")
    if "swarm_mj" not in summary and not (isinstance(versions, dict) and "swarm_mj" in versions):
        return None
    return Result("design" if "proof" in summary else "run", str(summary["scenario"]))


def _replace(partial: Path, destination: Path) -> list[str]:
    """Exchange two folders; gives the names of what was kept of the earlier one."""
    if not destination.exists():
        partial.rename(destination)
        return []
    kept = _to_keep(destination, partial)
    for path in kept:
        # With a second name in the new folder it is never out of sight; where files have one name only, it moves afterwards.
        with suppress(OSError):
            os.link(path, partial / path.name, follow_symlinks=False)
    old = partial.with_suffix(".old")
    try:
        destination.rename(old)
        partial.rename(destination)
    except BaseException:
        if old.exists() and not destination.exists():
            old.rename(destination)
        raise
    late = _hand_over(old, destination)
    shutil.rmtree(old, ignore_errors=True)
    return sorted({path.name for path in (*kept, *late)})


def _hand_over(old: Path, new: Path) -> list[Path]:
    """Move what is to be kept of a replaced result to where the new one stands."""
    moved = _to_keep(old, new)
    for path in moved:
        path.rename(new / path.name)
    return moved


def _to_keep(old: Path, new: Path) -> list[Path]:
    """What lies in a folder besides its result, and has no successor in the new one."""
    result = result_in(old)
    there = {path.name for path in new.iterdir()}
    return [p for p in old.iterdir() if p.name not in there and not (result and result.owns(p.name))]


def write_text(path: Path, text: str) -> None:
    """Write a text file under a temporary name, then rename it."""
    with replacing(path) as partial:
        partial.write_text(text, encoding="utf-8", newline="\n")


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Give an empty file beside `path` that takes its place when the block ends without an error.

    Nobody can guess its name, so that no link waits there that would lead what is written elsewhere.

    Raises:
        OSError: It cannot be made or moved.
    """
    partial = path.with_name(f".{path.name}.{secrets.token_hex(4)}.partial")
    partial.touch(exist_ok=False)
    try:
        with undone_by(lambda: remove(partial)):
            yield partial
        os.replace(partial, path)
    finally:
        with suppress(OSError):
            partial.unlink(missing_ok=True)


@contextmanager
def atomic_file(path: Path) -> Iterator[Path]:
    """Give a temporary name beside `path` whose file takes that place when the block ends without an error.

    While the block runs, a second process that would write the same file is refused. What a killed one left behind is
    cleared by the next.

    Raises:
        OutputError: The file cannot be written, or another process is writing it.
    """
    with reserved(path, "file"):
        _clear_partial_files(path)
        try:
            with replacing(path) as partial:
                yield partial
        except OSError as error:
            raise OutputError(f"{path}: cannot be written ({error.strerror or error})") from error


def _clear_partial_files(path: Path) -> None:
    """Remove what killed processes left half-written; the place is held, so none of them is at work."""
    ours = re.compile(rf"\.{re.escape(path.name)}\.[a-z0-9_]{{8}}\.partial")
    with suppress(OSError):
        for leftover in path.parent.iterdir():
            if ours.fullmatch(leftover.name):
                leftover.unlink()
