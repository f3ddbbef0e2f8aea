"""JSON files of results, read whole or refused: small enough, plain values, and what a model of pydantic asks for.

A model names the keys that readers rely on; other keys, as of another version, are kept and not looked at. What is read is
the plain mapping as it stands in the file.
"""

from __future__ import annotations

import json
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict, TypeAdapter, ValidationError

from swarm_mj.errors import OutputError, SwarmError
from swarm_mj.io.values import check_data, shortened, shown

#: Larger than the summary of the largest flight; what is larger is no record [bytes].
MAX_RECORD_BYTES = 64_000_000
#: Values of a record altogether: 20 turns of each of 5,000 spacecraft.
MAX_RECORD_VALUES = 1_000_000
#: What a path may lead to instead of a file, for messages.
_KINDS = {stat.S_IFDIR: "a folder", stat.S_IFIFO: "a named pipe", stat.S_IFSOCK: "a socket"}
#: Characters of a message that another library or a hostile file wrote.
MAX_REASON = 400


class Record(BaseModel):
    """What readers rely on in a record: no value stands for one of another type, no number is infinite or none."""

    model_config = ConfigDict(strict=True, extra="allow", allow_inf_nan=False, protected_namespaces=())


def one_line(text: object) -> str:
    """Text as one line of a message that any terminal can show; its beginning, if it is long."""
    line = " ".join(str(text).split())
    return shortened(line, MAX_REASON).encode("utf-8", "backslashreplace").decode()


@contextmanager
def reading(path: object, remedy: str, error: type[SwarmError] = OutputError) -> Iterator[None]:
    """Turn whatever the reading of a file raises into one line that names the file and the remedy.

    Raises:
        SwarmError: As `error`; one of that kind is passed on.
    """
    try:
        yield
    except error:
        raise
    except Exception as reason:  # HDF5, zipfile, zlib, NumPy and xarray each have their own for a broken file
        raise error(f"{one_line(path)}: cannot be read ({_why(reason)}); {remedy}") from None


@contextmanager
def writing(path: object, remedy: str, error: type[SwarmError] = OutputError) -> Iterator[None]:
    """Turn what the system says of a place that cannot be written into one line that names the place and the remedy.

    Raises:
        SwarmError: As `error`.
    """
    try:
        yield
    except (OSError, ValueError) as reason:  # ValueError: a name with a NUL, or none
        raise error(f"{one_line(path)}: cannot be written ({_why(reason)}); {remedy}") from None


def _why(reason: Exception) -> str:
    if isinstance(reason, UnicodeDecodeError):
        return f"byte {reason.start} is not UTF-8 text"
    return one_line(getattr(reason, "strerror", None) or str(reason) or type(reason).__name__)


def read_record(path: Path, model: Any, remedy: str, error: type[SwarmError] = OutputError) -> Any:
    """What a JSON file of a result holds, which must fit a model: a `Record`, a list of them, or what else pydantic knows.

    `remedy`: what to do about a file that does not fit.

    Raises:
        SwarmError: As `error`: it cannot be read or does not fit; one line names file, key, value and what is allowed.
    """
    with reading(path, remedy, error):
        return record_from(bytes_of(path), model)


def record_from(raw: bytes | str, model: Any) -> Any:
    """What a text of JSON holds.

    Raises:
        ValueError: It is no JSON, or does not fit the model; the message names the key, the value and what is allowed.
    """
    try:
        data = json.loads(raw)
    except (ValueError, RecursionError):
        raise ValueError("no JSON") from None
    try:
        check_data(data, most=MAX_RECORD_VALUES, what="record", refusal=ValueError)
        TypeAdapter(model).validate_python(data)
    except ValidationError as error:
        raise ValueError(_first_of(error)) from None
    return data


def bytes_of(path: Path, most: int = MAX_RECORD_BYTES) -> bytes:
    """What a file holds; args and errors as of `require_file`."""
    require_file(path, most)
    with path.open("rb") as file:
        raw = file.read(most + 1)
    if len(raw) > most:  # than the system says, or it grows
        raise ValueError(f"larger than {most} bytes")
    return raw


def require_file(path: Path, most: int) -> int:
    """See that a path leads to a regular file of at most so many bytes, before anybody opens it; gives its size [bytes].

    Anything else could be read for ever, wait for ever, or take all memory.

    Raises:
        OSError, ValueError: It cannot be asked, is none or larger; the message says what it is, and the limit.
    """
    try:
        status = path.stat()
    except FileNotFoundError:
        raise ValueError("no such file") from None
    if not stat.S_ISREG(status.st_mode):
        raise ValueError(f"is {_KINDS.get(stat.S_IFMT(status.st_mode), 'a device')}, no regular file")
    if status.st_size > most:
        raise ValueError(f"{status.st_size} bytes, larger than {most} bytes")
    return status.st_size


def _first_of(error: ValidationError) -> str:
    """The first mistake in words, and how many more there are."""
    first = error.errors(include_url=False)[0]
    key = ".".join(str(part) for part in first["loc"])
    if first["type"] == "missing":
        words = f"{key} is missing"
    elif first["type"] == "value_error" and not first["loc"]:
        words = first["msg"].removeprefix("Value error, ")
    else:
        must_be = first["msg"].replace("Input should be ", "must be ")
        words = f"{f'{key} =' if key else 'it holds'} {shown(first['input'])}: {must_be[0].lower()}{must_be[1:]}"
    more = error.error_count() - 1
    return f"{words}, and {more} more mistakes" if more else words
