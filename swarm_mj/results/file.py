"""A file that appears whole or not at all."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from swarm_mj.errors import OutputError
from swarm_mj.io.lock import reserved


@contextmanager
def atomic_file(path: Path) -> Iterator[Path]:
    """Give a temporary name beside `path` whose file takes that place when the block ends without an error.

    While the block runs, a second process that would write the same file is refused. What a killed one left behind is
    cleared by the next.

    Raises:
        OutputError: The file cannot be written, or another process is writing it.
    """
    with reserved(path, "file"):
        _clear_leftovers(path)
        partial = path.with_name(f".{path.name}.{os.getpid()}.partial")
        try:
            yield partial
            os.replace(partial, path)
        except OSError as error:
            raise OutputError(f"{path}: cannot be written ({error.strerror or error})") from error
        finally:
            with suppress(OSError):
                partial.unlink(missing_ok=True)


def _clear_leftovers(path: Path) -> None:
    """Remove what killed processes left half-written; the place is held, so none of them is at work."""
    ours = re.compile(rf"\.{re.escape(path.name)}\.\d+\.partial")
    with suppress(OSError):
        for leftover in path.parent.iterdir():
            if ours.fullmatch(leftover.name):
                leftover.unlink()
