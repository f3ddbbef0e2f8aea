"""MJCF that is looked at before MuJoCo opens it: regular files, and amounts that any spacecraft can do with.

MuJoCo takes the memory that a model asks for, by a height field of 50,000 x 50,000 or a body replicated a billion times, until
the system ends the program.
"""

from __future__ import annotations

import math
import os
import re
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from itertools import product
from pathlib import Path
from xml.etree.ElementTree import Element, ParseError, XMLParser, fromstring

from swarm_mj.io.records import bytes_of, require_file

#: MJCF is text of this size at most; meshes and textures, all together, belong into files of their own [bytes].
MAX_XML_BYTES, MAX_FILES_BYTES = 10_000_000, 64_000_000
#: Elements with all copies of them, and numbers that they ask for: cells of height fields, texels, user data.
MAX_ELEMENTS, MAX_VALUES = 20_000, 2**25
#: Folders of files, that of the model included.
MAX_FOLDERS = 5
#: Attributes that say how many elements and how many numbers there are.
COPIES = {"count", "cellcount", "nkey"}
AMOUNTS = {
    "nrow", "ncol", "width", "height", "resolution", "dim", "num", "nsample", "actdim", "nuserdata", "njmax", "nconmax",
    "nstack", "memory",
}  # fmt: skip
_NUMBER = re.compile(r"(\d+\.?\d*(?:[eE]\+?\d+)?)([KMGTPE]?)")
#: Where a PNG says its width and height.
_PNG = re.compile(rb"\x89PNG.{12}(....)(....)", re.DOTALL)


def check_model(path: Path) -> None:
    """See that a model, with all files that it names, asks for nothing that MuJoCo would choke on.

    Args:
        path: The MJCF file.

    Raises:
        OSError, ValueError: It does, is no XML, or cannot be read; the message names the file or the amount, and the limit.
    """
    elements = values = attached = in_models = per_element = 0.0
    folders, files = {""}, []
    for element, copies, in_model in _elements(path):
        elements += copies * _product(element, COPIES)
        in_models += in_model
        attached += copies * (element.tag == "attach")
        values += copies * _values(element)
        per_element += sum(_product(element, {name}) for name in element.keys() if name.startswith("nuser_"))
        folders |= {found for name, found in element.items() if name in ("assetdir", "meshdir", "texturedir")}
        if element.tag in ("include", "model"):
            folders.add(os.path.dirname(element.get("file", "")))
        files += [name for key, name in element.items() if key.startswith("file")]
        # While it is read, so that files that include many others come to an end.
        _at_most(elements + attached * in_models, MAX_ELEMENTS, "elements, copies included", "MAX_ELEMENTS")
    _at_most(values + per_element * elements, MAX_VALUES, "numbers", "MAX_VALUES")
    _at_most(len(folders), MAX_FOLDERS, "folders", "MAX_FOLDERS")
    _check_files(path.parent, folders, files)


def _at_most(asked: float, most: int, what: str, name: str) -> None:
    if asked > most:
        raise ValueError(f"asks for {asked:.3g} {what}, at most {most} ({name}): ask for less")


def _elements(path: Path) -> Iterator[tuple[Element, float, bool]]:
    """Every element of a file and of those that it includes, how often it stands there, and whether in a model to attach."""
    seen = {path.resolve()}
    waiting = [(_parsed(path), 1.0, False)]
    while waiting:
        element, copies, in_model = waiting.pop()
        yield element, copies, in_model
        if element.tag == "replicate":
            copies *= _product(element, {"count"})
        waiting += [(child, copies, in_model) for child in element]
        if element.tag in ("include", "model"):
            for file in _candidates(path.parent, {""}, element.get("file", "")):
                if file.resolve() not in seen:  # MuJoCo includes no file twice
                    seen.add(file.resolve())
                    waiting.append((_parsed(file), copies, in_model or element.tag == "model"))


def _parsed(path: Path) -> Element:
    with _named(path):
        raw = bytes_of(path, MAX_XML_BYTES)
        if b"<!DOCTYPE" in raw:  # MuJoCo reads what stands in one in another way
            raise ValueError("has a DOCTYPE, which MJCF does not need: remove it")
        return fromstring(raw, XMLParser(encoding="utf-8"))


@contextmanager
def _named(path: Path) -> Iterator[None]:
    """Say of which file it is that something is wrong."""
    try:
        yield
    except (OSError, ValueError, ParseError) as error:
        reason = getattr(error, "strerror", None) or (f"is no XML: {error}" if isinstance(error, ParseError) else error)
        raise ValueError(f"{path.name} {reason}") from None


def _values(element: Element) -> float:
    """How many numbers an element asks for."""
    if element.tag == "mesh":  # a built-in one: vertices along two directions, each with its part of the hull
        return 200.0 * sum(_numbers(element, "params")) ** 2
    if element.tag == "size":
        return max(_product(element, {name}) for name in AMOUNTS)
    return _product(element, AMOUNTS | ({"size"} if element.tag == "numeric" else set()))


def _product(element: Element, names: set[str]) -> float:
    return math.prod(max(1.0, number) for name in names for number in _numbers(element, name))


def _numbers(element: Element, name: str) -> list[float]:
    """Those of an attribute; with a unit it is of bytes, of which a number takes eight."""
    found = _NUMBER.findall(element.get(name, ""))
    return [float(number) * (1024.0 ** " KMGTPE".index(unit) / 8.0 if unit else 1.0) for number, unit in found]


def _candidates(base: Path, folders: set[str], name: str) -> Iterator[Path]:
    """Files that MuJoCo may take a name for."""
    for outer, inner, end in product(folders, folders, {name, os.path.basename(name)}):
        file = base / outer / inner / end
        with suppress(OSError, ValueError):  # too long, or with a NUL: no name of a file
            if end and file.exists():
                yield file


def _check_files(base: Path, folders: set[str], names: list[str]) -> None:
    left = MAX_FILES_BYTES
    for file in {file for name in names for file in _candidates(base, folders, name)}:
        with _named(file):
            left -= require_file(file, left)
            with file.open("rb") as opened:
                png = _PNG.match(opened.read(24))
            if png:
                _at_most(math.prod(map(int.from_bytes, png.groups())), MAX_VALUES, "pixels", "MAX_VALUES")
