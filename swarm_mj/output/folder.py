"""A result folder that appears whole or not at all."""

from __future__ import annotations

import json
import os
import re
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from swarm_mj.errors import OutputError
from swarm_mj.output.place import reserved, unwritable

#: The file that every result has, and what such a folder may hold besides; anything else is somebody's and never replaced.
MARKER = "summary.json"
KINDS = {".json", ".yaml", ".nc", ".npz", ".png", ".pdf", ".html", ".mp4", ".gif"}


@contextmanager
def atomic_folder(destination: Path) -> Iterator[Path]:
    """Give a temporary folder beside `destination` that takes its place when the block ends without an error.

    An earlier result is replaced only then; anything else that stands there is never touched. While the block runs, a
    second run into the same place is refused. What a killed run left behind is cleared by the next one.

    Raises:
        OutputError: The place cannot be written, holds something that is not a result of this program, or another run is
            writing there.
    """
    destination = _resolved(destination)
    try:
        destination.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise unwritable(destination, error) from None
    with reserved(destination):
        _check_replaceable(destination)  # held: no other run is exchanging what stands there
        _clear_leftovers(destination)
        try:
            partial = Path(tempfile.mkdtemp(prefix=f".{destination.name}.", suffix=".partial", dir=destination.parent))
            partial.chmod(0o755)
        except OSError as error:
            raise unwritable(destination, error) from None
        try:
            yield partial
            _replace(partial, destination)
        except OSError as error:
            raise OutputError(
                f"{destination}: cannot be written ({error}); the earlier result, if any, is intact"
            ) from error
        finally:
            shutil.rmtree(partial, ignore_errors=True)


def _resolved(destination: Path) -> Path:
    try:
        return destination.resolve()
    except (OSError, RuntimeError, ValueError) as error:  # a loop of links, a NUL
        raise OutputError(
            f"{str(destination)!r}: is no place for a result ({error}); choose another with --out"
        ) from None


def _clear_leftovers(destination: Path) -> None:
    """Put an earlier result back that a killed run had moved aside, and remove what such runs left half-written."""
    ours = re.compile(rf"\.{re.escape(destination.name)}\.[a-z0-9_]{{8}}\.(partial|old)")
    with suppress(OSError):
        for leftover in sorted(destination.parent.iterdir()):
            if ours.fullmatch(leftover.name):
                if leftover.suffix == ".old" and not destination.exists():
                    leftover.rename(destination)
                else:
                    shutil.rmtree(leftover, ignore_errors=True)


def _check_replaceable(destination: Path) -> None:
    try:
        if not destination.exists():
            return
        if not destination.is_dir():
            raise OutputError(f"{destination}: is a file; --out must name a folder")
        if Path.cwd().is_relative_to(destination):
            raise OutputError(f"{destination}: is the folder you are in, or holds it; choose another folder with --out")
        entries = list(destination.iterdir())
        foreign = [p.name for p in entries if p.suffix not in KINDS or p.is_dir()]
        if entries and (foreign or not _is_result(destination)):
            what = f"holds {foreign[0]}" if foreign else f"has no {MARKER} of swarm-mj"
            raise OutputError(
                f"{destination}: exists and is not an earlier result ({what}); choose another folder with --out"
            )
    except OSError as error:
        raise OutputError(f"{destination}: cannot be read ({error.strerror})") from None


def _is_result(folder: Path) -> bool:
    try:
        summary = json.loads((folder / MARKER).read_text("utf-8"))
    except (OSError, ValueError, RecursionError):
        return False
    if not isinstance(summary, dict) or "scenario" not in summary:
        return False
    versions = summary.get("versions")
    return "swarm_mj" in summary or (isinstance(versions, dict) and "swarm_mj" in versions)


def _replace(partial: Path, destination: Path) -> None:
    if not destination.exists():
        partial.rename(destination)
        return
    old = partial.with_suffix(".old")
    destination.rename(old)
    try:
        partial.rename(destination)
    except OSError:
        old.rename(destination)
        raise
    shutil.rmtree(old, ignore_errors=True)


def write_text(path: Path, text: str) -> None:
    """Write a text file under a temporary name, then rename it."""
    partial = path.with_name(f".{path.name}.partial")
    partial.write_text(text, encoding="utf-8")
    os.replace(partial, path)
