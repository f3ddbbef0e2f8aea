"""Files of arrays, declared once and checked before anything of them is held in memory.

A declaration names the arrays of a kind of file: type, dimensions by name, what values may be. Dimensions of one name agree
in the whole file. Other arrays, as of another version, are not looked at.
"""

from __future__ import annotations

import io
import math
import zipfile
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from swarm_mj.errors import OutputError, SwarmError
from swarm_mj.io.records import reading, require_file

#: What the arrays of one file may take: more than the telemetry of the largest flight [bytes].
MAX_BYTES = 4 * 2**30
#: Text in an array of its own [bytes].
MAX_TEXT_BYTES = 1_000_000
#: Deflate shrinks zeros by 1,032 at most; what promises more lies.
MAX_RATIO = 1_100
#: The list of contents of an archive [bytes]; a file has some twenty members of about 100 bytes.
MAX_DIRECTORY_BYTES = 2**20
#: NumPy's own limit for the header of an array.
MAX_HEADER = 10_000


@dataclass(frozen=True)
class Declared:
    """An array that a file holds.

    Attributes:
        dtype: NumPy's short name, like `f8`; `U`: text of any length, `O`: names.
        dims: Its dimensions, by name or by size; the same name is the same size in the whole file.
        least: Smallest value.
        most: Largest value; the name of a dimension: below its size, as an index.
        gaps: Values that stand for none: NaN, or infinity for no limit.
        rising: Whether each value is larger than the one before.
        optional: Whether the file may lack it.
    """

    dtype: str
    dims: tuple[str | int, ...] = ()
    least: float = -math.inf
    most: float | str = math.inf
    gaps: str = ""
    rising: bool = False
    optional: bool = False

    def __str__(self) -> str:
        """The type in words of a message."""
        return {"U": "text", "O": "names"}.get(self.dtype) or np.dtype(self.dtype).name

    def fits(self, dtype: np.dtype[Any]) -> bool:
        """Whether values are of the declared type."""
        return dtype.kind == "U" if self.dtype == "U" else dtype == np.dtype(self.dtype)


Found = Mapping[str, tuple[np.dtype[Any], tuple[int, ...]]]


def check_shapes(
    found: Found,
    declared: Mapping[str, Declared],
    sizes: Mapping[str, int] | None = None,
    may_be_empty: Collection[str] = (),
    most: int = MAX_BYTES,
) -> dict[str, int]:
    """Check types, dimensions and memory of the arrays that a file promises; gives the sizes of its dimensions by name.

    `found`: type and shape of its arrays by name, of declared ones and others. `sizes`: of dimensions that are known elsewhere.
    `may_be_empty`: dimensions that may have the size zero. `most`: what all may take [bytes].

    Raises:
        ValueError: An array is missing or does not fit; the message names it, its shape and what it must be.
    """
    known = dict(sizes or {})
    for name, what in declared.items():
        if name not in found:
            if what.optional:
                continue
            raise ValueError(f"{name} is missing: damaged, or written by another version")
        dtype, shape = found[name]
        if not what.fits(dtype):
            raise ValueError(f"{name} is of type {dtype}, must be {what}")
        if len(shape) != len(what.dims):
            raise ValueError(f"{name} has the shape {shape}, must have {len(what.dims)} dimensions ({_named(what)})")
        for dim, size in zip(what.dims, shape, strict=True):
            must = dim if isinstance(dim, int) else known.setdefault(dim, size)
            if size != must:
                raise ValueError(f"{name} has the shape {shape}, must be ({_named(what, known)})")
            if size == 0 and dim not in may_be_empty:
                raise ValueError(f"{name} has the shape {shape}: it is empty, {dim} must be at least 1")
    _check_memory(found, most)
    return known


def _named(what: Declared, known: Mapping[str, int] | None = None) -> str:
    sizes: Mapping[Any, int] = known or {}
    return ", ".join(f"{dim} = {sizes[dim]}" if dim in sizes else str(dim) for dim in what.dims)


def _check_memory(found: Found, most: int) -> None:
    total = 0
    for name, (dtype, shape) in found.items():
        total += math.prod(shape) * dtype.itemsize
        if total > most:
            raise ValueError(f"{name} has the shape {shape}: the arrays would take more than {most} bytes")


def check_values(
    arrays: Mapping[str, NDArray[Any]], declared: Mapping[str, Declared], sizes: Mapping[str, int]
) -> None:
    """Check that values are what they may be, given the sizes of their dimensions from `check_shapes`.

    Raises:
        ValueError: One is not; the message names the array, the place, the value and what is allowed.
    """
    for name, what in declared.items():
        if name not in arrays or what.dtype in ("U", "O"):
            continue
        values = arrays[name]
        if not what.fits(values.dtype):
            raise ValueError(f"{name} is of type {values.dtype}, must be {what}")
        most = sizes[what.most] - 1 if isinstance(what.most, str) else what.most
        bad = _outside(values, what, most)
        if bad.any():
            place = tuple(int(k) for k in np.argwhere(bad)[0])
            raise ValueError(f"{name}{list(place)} = {values[place]}: must be {_allowed(what, most)}")
        if what.rising and not (np.diff(values) > 0).all():
            raise ValueError(f"{name} must rise from value to value")


def _outside(values: NDArray[Any], what: Declared, most: float) -> NDArray[np.bool_]:
    with np.errstate(invalid="ignore"):
        bad = np.asarray((values < what.least) | (values > most))
    if values.dtype.kind == "f":
        bad |= (np.isnan(values) & (what.gaps != "nan")) | (np.isinf(values) & (what.gaps != "inf"))
    if values.dtype.kind == "b":  # a byte that is neither 0 nor 1 is no truth value
        bad |= values.view(np.uint8) > 1
    return bad


def _allowed(what: Declared, most: float) -> str:
    kind = {"f": "a finite number", "b": "true or false"}.get(np.dtype(what.dtype).kind, "a whole number")
    kind = {"nan": "a number or NaN", "inf": "a number"}.get(what.gaps, kind)
    parts = [f"at least {what.least:g}"] * (what.least > -math.inf) + [f"at most {most:g}"] * (most < math.inf)
    return " ".join([kind, " and ".join(parts)]).strip()


def read_arrays(
    path: Path,
    declared: Mapping[str, Declared],
    remedy: str,
    *,
    sizes: Mapping[str, int] | None = None,
    may_be_empty: Collection[str] = (),
    error: type[SwarmError] = OutputError,
) -> dict[str, NDArray[Any]]:
    """Read the declared arrays of an .npz file; nothing is unpacked before all of them are found to fit.

    `remedy`: what to do about a file that does not fit. `sizes` and `may_be_empty` as of `check_shapes`.

    Raises:
        SwarmError: As `error`: it cannot be read or does not fit; one line names file, array, value and what is allowed.
    """
    with reading(path, remedy, error):
        return arrays_in(path, declared, sizes, may_be_empty)


def arrays_in(
    path: Path,
    declared: Mapping[str, Declared],
    sizes: Mapping[str, int] | None = None,
    may_be_empty: Collection[str] = (),
    most: int = MAX_BYTES,
) -> dict[str, NDArray[Any]]:
    """As `read_arrays`, but what is raised is left to whoever reads more of the file; `most` bytes may they take.

    Raises:
        Exception: Of zipfile, zlib, NumPy, or ValueError for what does not fit; see `reading`.
    """
    require_file(path, most)
    with _InPieces(path) as file, zipfile.ZipFile(file) as archive:
        members = _members(archive, declared)
        found = {name: _header(archive, info) for name, info in members.items()}
        known = check_shapes(found, declared, sizes, may_be_empty, most)
        arrays = {name: _array(archive, info) for name, info in members.items()}
    check_values(arrays, declared, known)
    return arrays


def check_archive(path: Path, most: int) -> None:
    """See that a zip, and those that lie in it, unpack to at most so many bytes, before another program unpacks them.

    Raises:
        Exception: Of zipfile, or ValueError for what is too large; see `reading`.
    """
    require_file(path, most)
    with _InPieces(path) as file, zipfile.ZipFile(file) as archive:
        _check_unpacked(archive, most)
    with zipfile.ZipFile(path) as archive:
        for info in archive.infolist():
            with archive.open(info) as member:
                if zipfile.is_zipfile(member):
                    _check_unpacked(zipfile.ZipFile(member), most)


def _check_unpacked(archive: zipfile.ZipFile, most: int) -> None:
    size = sum(info.file_size for info in archive.infolist())
    if size > most:
        raise ValueError(f"unpacks to {size} bytes, larger than {most} bytes")


class _InPieces(io.FileIO):
    """A file that gives no large piece at once: zipfile asks for a whole list of contents, however long it says it is."""

    def read(self, size: int | None = -1, /) -> bytes:
        """As of any file, within the limit."""
        whole = size is None or not 0 <= size <= MAX_DIRECTORY_BYTES
        data = super().read(MAX_DIRECTORY_BYTES + 1 if whole else size)
        if len(data) > MAX_DIRECTORY_BYTES:
            raise ValueError(f"its list of contents is larger than {MAX_DIRECTORY_BYTES} bytes (MAX_DIRECTORY_BYTES)")
        return data


def _members(archive: zipfile.ZipFile, declared: Mapping[str, Declared]) -> dict[str, zipfile.ZipInfo]:
    """The declared arrays' entries in an archive."""
    found: dict[str, zipfile.ZipInfo] = {}
    for info in archive.infolist():
        name = info.filename.removesuffix(".npy")
        if name in found:
            raise ValueError(f"{name} is there twice")
        found[name] = info
    members = {name: found[name] for name in declared if name in found}
    for name, info in members.items():
        if info.flag_bits & 0x41:
            raise ValueError(f"{name} is encrypted")
        if info.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
            raise ValueError(f"{name} is compressed by method {info.compress_type}, must be 0 (stored) or 8 (deflated)")
        if info.file_size > MAX_RATIO * info.compress_size + MAX_HEADER:
            raise ValueError(
                f"{name} promises {info.file_size} bytes from {info.compress_size}: no archive holds so much"
            )
    return members


#: Readers of headers by the format's version; others are not written for the types that are declared.
_HEADERS: dict[tuple[int, int], Callable[..., tuple[tuple[int, ...], bool, np.dtype[Any]]]] = {
    (1, 0): np.lib.format.read_array_header_1_0,
    (2, 0): np.lib.format.read_array_header_2_0,
}


def _header(archive: zipfile.ZipFile, info: zipfile.ZipInfo) -> tuple[np.dtype[Any], tuple[int, ...]]:
    """Type and shape of an array in an archive, which takes exactly the bytes that it should."""
    name = info.filename
    with archive.open(info) as member:
        shape, dtype, begins = _read_header(name, member)
    if dtype.hasobject or dtype.names is not None or dtype.subdtype is not None:
        raise ValueError(f"{name} holds {dtype}, must hold numbers or text: pickles are not opened")
    if dtype.kind == "U" and dtype.itemsize > MAX_TEXT_BYTES:
        raise ValueError(f"{name} holds texts of {dtype.itemsize} bytes, at most {MAX_TEXT_BYTES} (MAX_TEXT_BYTES)")
    if any(size < 0 for size in shape):
        raise ValueError(f"{name} has the shape {shape}: a size is negative")
    promised = begins + math.prod(shape) * dtype.itemsize
    if promised != info.file_size:
        raise ValueError(f"{name} has the shape {shape} of {dtype}: {promised} bytes, but {info.file_size} are there")
    return dtype, shape


def _read_header(name: str, member: IO[bytes]) -> tuple[tuple[int, ...], np.dtype[Any], int]:
    """Shape, type, and where the values begin."""
    version = np.lib.format.read_magic(member)
    if version not in _HEADERS:
        raise ValueError(f"{name} has NumPy's format {version}, must be one of {', '.join(map(str, _HEADERS))}")
    shape, _, dtype = _HEADERS[version](member, max_header_size=MAX_HEADER)
    return shape, dtype, member.tell()


def _array(archive: zipfile.ZipFile, info: zipfile.ZipInfo) -> NDArray[Any]:
    with archive.open(info) as member:
        return np.asarray(np.lib.format.read_array(member, allow_pickle=False), order="C")
