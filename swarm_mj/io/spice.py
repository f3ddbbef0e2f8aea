"""SPICE through SpiceyPy: kernels that are furnished for as long as a block lasts, and its errors in one line.

SPICE keeps what it has loaded in one pool per process and is not made for threads. A block of `furnished` has a pool of its
own: what the caller had furnished is put aside and given back, and nothing of the block is left.
"""

from __future__ import annotations

import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType
from typing import Any

from swarm_mj.errors import InteropError, SwarmError
from swarm_mj.io.records import one_line, require_file

#: SPICE takes no longer name of a file [characters].
MAX_NAME = 255

_POOL = threading.RLock()


def spiceypy() -> Any:
    """The library.

    Raises:
        InteropError: It is not installed.
    """
    try:
        import spiceypy
    except ImportError:
        raise InteropError(
            "SPICE kernels need spiceypy, which is not installed: pip install 'swarm_mj[spice]'"
        ) from None
    return spiceypy


@contextmanager
def spice_errors(what: str, remedy: str, error: type[SwarmError] = InteropError) -> Iterator[None]:
    """Turn what SPICE complains of into one line that says what was tried and the remedy.

    Raises:
        SwarmError: As `error`.
    """
    spice = spiceypy()
    try:
        yield
    except spice.exceptions.SpiceyError as reason:
        short = getattr(reason, "short", "") or type(reason).__name__
        long = getattr(reason, "long", "") or str(reason)
        raise error(f"{what}: SPICE says {one_line(f'{short} {long}')}; {remedy}") from None


@contextmanager
def furnished(kernels: Sequence[str | Path], key: str, error: type[SwarmError] = InteropError) -> Iterator[ModuleType]:
    """Have these kernels and no others in the pool while the block runs; gives SpiceyPy.

    Args:
        kernels: Files, loaded in this order; of what several say, the last one counts.
        key: What named them, for messages.
        error: What to raise.

    Raises:
        SwarmError: As `error`: a file is missing or no kernel.
    """
    spice = spiceypy()
    with _POOL:
        earlier = _loaded(spice)
        spice.kclear()
        try:
            for kernel in kernels:
                _furnish(spice, Path(kernel), key, error)
            yield spice
        finally:
            spice.reset()  # an error that SPICE still holds would end the next call
            spice.kclear()
            for kernel in earlier:
                spice.furnsh(kernel)


def _furnish(spice: Any, kernel: Path, key: str, error: type[SwarmError]) -> None:
    what, name = f"{key} = {one_line(kernel)}", str(kernel)
    try:
        require_file(kernel)
        kernel.open("rb").close()
    except (OSError, ValueError) as reason:
        why = getattr(reason, "strerror", None) or reason
        raise error(f"{what}: {why}; give the path of a SPICE kernel") from None
    if len(name) > MAX_NAME or not name.isascii():
        raise error(f"{what}: SPICE takes names of at most {MAX_NAME} ASCII characters; move the file")
    with spice_errors(what, "give a SPICE kernel: text, or SPK, CK, PCK, DSK in binary form, whole", error):
        spice.furnsh(name)
        if spice.kdata(spice.ktotal("ALL") - 1, "ALL")[1] == "TEXT" and not _is_text_kernel(kernel):
            raise error(f"{what}: is no SPICE kernel (a text kernel has a line \\begindata); give another file")


def _is_text_kernel(kernel: Path) -> bool:
    with kernel.open("rb") as file:
        return any(line.strip() == b"\\begindata" for line in file)


def _loaded(spice: Any) -> list[str]:
    """What the caller furnished itself; what meta-kernels name comes with them."""
    found = [spice.kdata(k, "ALL") for k in range(spice.ktotal("ALL"))]
    return [name for name, _, source, _ in (entry[:4] for entry in found) if not source]
