"""SPICE through SpiceyPy: kernels that are furnished for as long as a block lasts, and its errors in one line.

SPICE keeps what it has loaded in one pool per process and is not made for threads. A block of `furnished` has a pool of its
own: what the caller had furnished is put aside and given back, and nothing of the block is left.
"""

from __future__ import annotations

import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from types import ModuleType
from typing import Any

from swarm_mj.errors import InteropError, SwarmError
from swarm_mj.io.records import bytes_of, one_line, reading, require_file

#: SPICE takes no longer name of a file [characters].
MAX_NAME = 255
#: Of a text kernel, which is read whole, and of a binary one, which is not [bytes].
MAX_TEXT_BYTES, MAX_BINARY_BYTES = 16_000_000, 2**35
#: How kernels in binary form begin.
BINARY = (b"DAF/", b"DAS/", b"NAIF/DA")

_WHOLE = "give a SPICE kernel: text, or SPK, CK, PCK, DSK in binary form, whole"
_POOL = threading.RLock()


def spiceypy() -> Any:
    """The library.

    Raises:
        InteropError: It is not installed.
    """
    try:
        import spiceypy
    except ImportError:
        missing = "SPICE kernels need spiceypy, which is not installed: pip install 'swarm_mj[spice]'"
        raise InteropError(missing) from None
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

    They are loaded in this order; of what several say, the last one counts. `key`: what named them, for messages.

    Raises:
        SwarmError: As `error`: a file, one that a meta-kernel names included, is missing, no kernel or too large.
    """
    spice = spiceypy()
    with _POOL:
        earlier = _loaded(spice)
        spice.kclear()
        try:
            # All are looked at before one is opened for good: what a meta-kernel names, SPICE opens whatever it is.
            waiting, seen = [(str(kernel), "") for kernel in reversed(kernels)], set[str]()
            while waiting:
                name, named_by = waiting.pop()
                if name not in seen:
                    seen.add(name)
                    waiting += [(named, name) for named in _named_in(spice, name, key, named_by, error)]
            for kernel in kernels:
                with spice_errors(f"{key} = {one_line(kernel)}", _WHOLE, error):
                    spice.furnsh(str(kernel))
            yield spice
        finally:
            spice.reset()  # an error that SPICE still holds would end the next call
            spice.kclear()
            for kernel in earlier:
                spice.furnsh(kernel)


def _named_in(spice: Any, name: str, key: str, named_by: str, error: type[SwarmError]) -> list[str]:
    """Files that a kernel names to be loaded with it; none but for meta-kernels.

    `key`, and `named_by`, the meta-kernel that named it, if one did: for messages.

    Raises:
        SwarmError: As `error`: it is missing, no kernel or too large.
    """
    what, kernel = f"{key} = {f'{one_line(named_by)} names ' if named_by else ''}{one_line(name)}", Path(name)
    remedy = (
        "what a meta-kernel names is looked for from the current folder: run in its folder, or set its PATH_VALUES"
        if named_by
        else "give the path of a SPICE kernel"
    )
    with reading(what, remedy, error):
        require_file(kernel, MAX_BINARY_BYTES)
        with kernel.open("rb") as file:
            binary = file.read(8).startswith(BINARY)
        lines = [] if binary else bytes_of(kernel, MAX_TEXT_BYTES).splitlines()
    if len(name) > MAX_NAME or not name.isascii():
        raise error(f"{what}: SPICE takes names of at most {MAX_NAME} ASCII characters; move the file")
    if binary:
        return []
    if not any(line.strip() == b"\\begindata" for line in lines):
        raise error(f"{what}: is no SPICE kernel (a text kernel has a line \\begindata); give another file")
    with spice_errors(what, _WHOLE, error):
        spice.ldpool(name)
        paths = dict(zip(_texts(spice, "PATH_SYMBOLS"), _texts(spice, "PATH_VALUES"), strict=False))
        named = [_with_paths(text, paths) for text in _texts(spice, "KERNELS_TO_LOAD")]
        spice.kclear()
    return named


def _texts(spice: Any, variable: str) -> list[str]:
    """Values of a kernel variable, of which a `+` at the end goes on with the next."""
    found: list[str] = []
    with suppress(spice.NotFoundError):
        while True:
            found.append(str(spice.stpool(variable, len(found), "+", 1000)[0]))
    return found


def _with_paths(text: str, paths: dict[str, str]) -> str:
    for symbol in sorted(paths, key=len, reverse=True):
        text = text.replace(f"${symbol}", paths[symbol])
    return text


def _loaded(spice: Any) -> list[str]:
    """What the caller furnished itself; what meta-kernels name comes with them."""
    found = [spice.kdata(k, "ALL") for k in range(spice.ktotal("ALL"))]
    return [name for name, _, source, _ in (entry[:4] for entry in found) if not source]
