"""CCSDS messages as lines `KEY = value` (KVN): written, and read with distrust.

CCSDS 502.0-B (orbit data messages) and 504.0-B (attitude data messages). Reading keeps what the writers of OEM and AEM need:
header, metadata of each segment, and its lines of data with their numbers.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path

from swarm_mj.errors import InteropError
from swarm_mj.io.records import bytes_of, one_line, reading
from swarm_mj.io.values import shortened

#: A larger file, a longer line and more keys are mistakes or attacks.
MAX_BYTES, MAX_LINE, MAX_KEYS = 256 * 2**20, 1_000, 1_000
_PAIR = re.compile(r"([A-Z][A-Z0-9_]*)\s*=\s*(.*)", re.ASCII)


@dataclass
class Segment:
    """One stretch of a file: the line where its metadata begins, their keys, number and words of each line of data."""

    line: int
    meta: dict[str, str] = field(default_factory=dict)
    rows: list[tuple[int, list[str]]] = field(default_factory=list)


@dataclass(frozen=True)
class Message:
    """A file as read: where from, the version that its first key says, its segments in order."""

    path: Path
    version: str
    segments: list[Segment]

    def wanted(self, segment: Segment, key: str) -> str:
        """A key that a segment must have.

        Raises:
            InteropError: It has not.
        """
        if not segment.meta.get(key):
            raise self.wrong(segment.line, f"{key} is missing from the metadata", f"add the line {key} = ...")
        return segment.meta[key]

    def wrong(self, line: int, what: str, remedy: str) -> InteropError:
        """The error that says what is wrong in a line, and the remedy."""
        return InteropError(f"{one_line(self.path)}, line {line}: {one_line(what)}; {remedy}")


def write_message(
    kind: str, version: str, comments: Iterable[str], segments: Iterable[tuple[Mapping[str, object], Sequence[str]]]
) -> str:
    """Text of an OEM or AEM: version of the format, comments of the header, metadata and lines of data of each segment."""
    now = datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%S")
    lines = [f"CCSDS_{kind}_VERS = {version}", *(f"COMMENT {words}" for words in comments)]
    lines += [f"CREATION_DATE = {now}", "ORIGINATOR = SWARM_MJ", ""]
    begin, end = (["DATA_START"], ["DATA_STOP"]) if kind == "AEM" else ([], [])
    for meta, rows in segments:
        lines += ["META_START", *(f"{key} = {value}" for key, value in meta.items()), "META_STOP", ""]
        lines += [*begin, *rows, *end, ""]
    return "\n".join(lines)


def read_message(path: Path, kind: str, versions: Sequence[str]) -> Message:
    """Read a message, OEM or AEM, of one of the versions that are understood.

    Raises:
        InteropError: It is none, or broken; the message names file, line and remedy.
    """
    lines = _lines(path, kind)
    number, first = next(lines, (1, ""))
    found = _PAIR.fullmatch(first)
    if found is None or found[1] != f"CCSDS_{kind}_VERS":
        raise InteropError(
            f"{one_line(path)}, line {number}: {shortened(first, 60)!r} is not CCSDS_{kind}_VERS = ..., with which an {kind} "
            f"begins; give an {kind} in KVN"
        )
    message = Message(path, found[2].strip(), [])
    if message.version not in versions:
        raise message.wrong(
            number, f"CCSDS_{kind}_VERS = {message.version}", f"versions {', '.join(versions)} are read: convert it"
        )
    _fill(message, lines)
    if not message.segments:
        raise InteropError(f"{one_line(path)}: has no META_START, so no data; the file is cut short: export it again")
    return message


def _lines(path: Path, kind: str) -> Iterator[tuple[int, str]]:
    """Lines that say something, with their numbers."""
    with reading(path, f"give an {kind} as text (KVN), saved as UTF-8", InteropError):
        text = bytes_of(path, MAX_BYTES).decode("utf-8-sig")
    if text.lstrip().startswith("<"):
        raise InteropError(f"{one_line(path)}: is XML; convert it to KVN, e.g. with the package ccsds-ndm")
    for number, line in enumerate(text.splitlines(), start=1):
        if len(line) > MAX_LINE or "\0" in line:
            what = "holds a NUL" if "\0" in line else f"is longer than {MAX_LINE} characters"
            raise InteropError(f"{one_line(path)}, line {number}: {what}; give an {kind} in KVN")
        words = line.strip()
        if words and not words.startswith("COMMENT"):
            yield number, words


def _fill(message: Message, lines: Iterator[tuple[int, str]]) -> None:
    """Sort lines into segments."""
    inside, last, opened = "HEADER", 0, False
    for number, line in lines:
        last = number
        if line == "META_START":
            if inside == "META":
                raise message.wrong(number, "META_START inside metadata", "end the metadata with META_STOP")
            message.segments.append(Segment(number))
            inside = "META"
        elif line == "META_STOP" and inside == "META":
            inside = "DATA"
        elif line in ("COVARIANCE_START", "COVARIANCE_STOP"):
            inside = "COVARIANCE" if line.endswith("START") else "DATA"
        elif line in ("DATA_START", "DATA_STOP"):
            opened = line == "DATA_START"
        elif inside == "COVARIANCE":
            continue
        elif inside == "DATA":
            message.segments[-1].rows.append((number, line.split()))
        else:
            _add_key(message, inside, number, line)
    if inside == "META" or opened:
        where = "metadata" if inside == "META" else "data, without DATA_STOP"
        raise message.wrong(last, f"the file ends inside {where}", "it is cut short: export it again")


def _add_key(message: Message, inside: str, number: int, line: str) -> None:
    found = _PAIR.fullmatch(line)
    if found is None:
        raise message.wrong(number, f"{line[:60]!r} is no KEY = value", "correct this line")
    if inside != "META":
        return
    meta = message.segments[-1].meta
    if found[1] in meta or len(meta) >= MAX_KEYS:
        raise message.wrong(number, f"{found[1]} is given twice", "keep one of them")
    meta[found[1]] = found[2].strip()
