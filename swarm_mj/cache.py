"""Where computed things are kept between runs, and how: keyed by a hash of what they depend on, written whole or not at all."""

from __future__ import annotations

import hashlib
import os
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray


def cache_folder() -> Path:
    """The folder for kept results: $SWARM_MJ_CACHE, else `swarm_mj` in the user's cache folder."""
    base = os.environ.get("SWARM_MJ_CACHE")
    if base:
        return Path(base)
    return Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "swarm_mj"


def hash_of(*parts: NDArray[Any] | str) -> str:
    """A short hash of arrays and texts."""
    digest = hashlib.sha256()
    for part in parts:
        array = np.frombuffer(part.encode(), np.uint8) if isinstance(part, str) else part
        digest.update(f"{array.dtype} {array.shape}".encode())
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()[:32]


def load_array(file: Path, shape: tuple[int, ...]) -> NDArray[np.float32] | None:
    """A kept array, or None if it is missing, damaged or of another shape."""
    try:
        with file.open("rb") as kept:
            array = np.lib.format.read_array(kept, allow_pickle=False)
    except (OSError, ValueError, EOFError, MemoryError):  # MemoryError: a header that promises terabytes
        return None
    return array if array.shape == shape and array.dtype == np.float32 else None


def store_array(file: Path, array: NDArray[np.float32]) -> None:
    """Keep an array; a cache that cannot be written only costs time."""
    partial = file.with_name(f".{file.name}.{os.getpid()}.partial")
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        with partial.open("wb") as out:
            np.save(out, array)
        os.replace(partial, file)
    except OSError:
        partial.unlink(missing_ok=True)
