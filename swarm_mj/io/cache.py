"""Where computed things are kept between runs, and how: keyed by a hash of what they depend on, written whole or not at all.

A folder may be bounded: what was used longest ago then makes room for what is new. Any number of processes may do so at once,
since a file that one removes while another reads it stays whole for the reader, and is computed again when it is missed.
"""

from __future__ import annotations

import hashlib
import math
import os
import time
from collections.abc import Callable, Collection, Mapping
from contextlib import suppress
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from swarm_mj.io.arrays import MAX_HEADER, Declared, arrays_in
from swarm_mj.io.atomic import replacing
from swarm_mj.io.records import require_file

#: Arrays by name.
Arrays = dict[str, NDArray[Any]]
#: Half-written files of this age [s] belong to processes that were killed.
ABANDONED_S = 3600.0


def cache_folder() -> Path:
    """The folder for kept results: $SWARM_MJ_CACHE, else `swarm_mj` in the user's cache folder; without a home, nowhere."""
    base = os.environ.get("SWARM_MJ_CACHE")
    if base:
        return Path(base)
    caches = Path(os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache"))
    return (caches if caches.is_absolute() else Path(os.devnull)) / "swarm_mj"


def hash_of(*parts: NDArray[Any] | str) -> str:
    """A short hash of arrays and texts."""
    digest = hashlib.sha256()
    for part in parts:
        array = np.frombuffer(part.encode(), np.uint8) if isinstance(part, str) else part
        digest.update(f"{array.dtype} {array.shape}".encode())
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()[:32]


def load_array(file: Path, shape: tuple[int, ...], dtype: type[np.floating[Any]] = np.float32) -> NDArray[Any] | None:
    """A kept array, or None if it is missing, damaged, or of another shape or type."""
    try:
        require_file(file, math.prod(shape) * np.dtype(dtype).itemsize + MAX_HEADER)
        with file.open("rb") as kept:
            array = np.lib.format.read_array(kept, allow_pickle=False)
    except (OSError, ValueError, EOFError, MemoryError):  # MemoryError: a header that promises terabytes
        return None
    if array.shape != shape or array.dtype != dtype:
        return None
    with suppress(OSError):  # a cache that only others may write
        os.utime(file)  # used now, whatever the file system does about times of access
    return array


def load_arrays(file: Path, declared: Mapping[str, Declared], may_be_empty: Collection[str] = ()) -> Arrays | None:
    """Kept arrays by name, or None if they are missing, damaged, or not as declared."""
    try:
        arrays = arrays_in(file, declared, may_be_empty=may_be_empty)
    except Exception:  # zipfile, zlib and NumPy each have their own for a broken file
        return None
    with suppress(OSError):
        os.utime(file)
    return arrays


def store_array(file: Path, array: NDArray[Any], *, folder_bytes: int | None = None) -> None:
    """Keep an array; a cache that cannot be written only costs time.

    Of all files in its folder together those used longest ago, never this one, make room beyond `folder_bytes`; None: none.
    """
    _store(file, lambda out: np.save(out, array), folder_bytes)


def store_arrays(file: Path, arrays: Arrays, *, folder_bytes: int | None = None) -> None:
    """Keep arrays by name in one file, otherwise as `store_array`."""
    _store(file, lambda out: np.savez(out, **arrays), folder_bytes)  # type: ignore[arg-type]


def _store(file: Path, write: Callable[[IO[bytes]], object], folder_bytes: int | None) -> None:
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        with replacing(file) as partial, partial.open("wb") as out:
            write(out)
    except OSError:
        return
    if folder_bytes is not None:
        with suppress(OSError):  # the folder itself may be cleared meanwhile
            _make_room(file, folder_bytes)


def _make_room(newest: Path, limit: int) -> None:
    """Remove arrays beside `newest`, those used longest ago first, until all together hold at most `limit` bytes."""
    kept: list[tuple[float, int, Path]] = []
    for path in newest.parent.iterdir():
        with suppress(OSError):  # another process was faster
            state = path.stat()
            if path.suffix in (".npy", ".npz"):
                kept.append((state.st_mtime, state.st_size, path))
            elif path.suffix == ".partial" and time.time() - state.st_mtime > ABANDONED_S:
                path.unlink()
    excess = sum(size for _, size, _ in kept) - limit
    for _, size, path in sorted(kept):
        if excess <= 0:
            return
        if path != newest:
            with suppress(OSError):
                path.unlink(missing_ok=True)
            excess -= size
