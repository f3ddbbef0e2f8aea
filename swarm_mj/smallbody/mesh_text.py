"""Meshes as lines of text: Wavefront OBJ and the plate tables (.tab) of NASA's Planetary Data System.

Both write `v x y z` for a vertex and `f i j k ...` for a face. OBJ counts vertices from 1, may decorate an index (`7/2/3`) or
count it from the end (`-1`), and goes on in the next line after a backslash; plate tables count from 0 or from 1, which their
lowest index tells, and may begin with the numbers of vertices and faces.
"""

from __future__ import annotations

from array import array
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TextIO

import numpy as np

from swarm_mj.errors import ShapeError
from swarm_mj.typing import Array, Ints

#: Longest line [characters]: a polygon of ten thousand corners; a file that is one line would be split into gigabytes.
MAX_LINE_CHARACTERS = 100_000
#: Reads one index of a face, given the number of vertices met so far.
IndexReader = Callable[[str, int], int]


def read_obj(path: Path) -> tuple[Array, Ints]:
    """Read vertices (V, 3) in the file's unit and triangles (F, 3) counted from 0; other OBJ statements are skipped.

    Raises:
        ShapeError: a line that is not understood.
        UnicodeDecodeError: the file is not UTF-8.
    """
    return _read_lines(path, _obj_index, wavefront=True)


def read_tab(path: Path) -> tuple[Array, Ints]:
    """Read a PDS plate table, in which every line is a vertex, a face, a comment or, at first, their numbers; as `read_obj`."""
    vertices, faces = _read_lines(path, lambda word, count: int(word), wavefront=False)
    first = 1 if faces.size and faces.min() >= 1 else 0
    return vertices, faces - first


def _read_lines(path: Path, read_index: IndexReader, *, wavefront: bool) -> tuple[Array, Ints]:
    # Flat typed arrays hold a large mesh in a tenth of the memory of Python lists of numbers.
    vertices, faces = array("d"), array("q")
    promised: tuple[int, ...] | None = None
    statements = 0
    with open(path, encoding="utf-8-sig") as file:  # some programs begin a text with a mark of byte order
        for number, line in _logical_lines(path, file, wavefront):
            words = line.partition("#")[0].split()
            if not words or (wavefront and words[0] not in ("v", "f")):
                continue
            try:
                if words[0] in ("v", "f"):
                    statements += 1
                    _read_statement(words, vertices, faces, read_index)
                elif promised is None and not statements and len(words) == 2 and _is_count(*words):
                    promised = tuple(map(int, words))
                else:
                    raise ValueError("neither a vertex (v x y z) nor a face (f i j k)")
            except (ValueError, OverflowError) as error:
                raise ShapeError(f"{path}: line {number}, {line.strip()[:60]!r}: {error}; correct this line") from error
    if not statements:
        raise ShapeError(f"{path}: no vertices (lines v x y z) and no faces (f i j k), so this is no shape model")
    corners, triangles = np.frombuffer(vertices, dtype=np.float64), np.frombuffer(faces, dtype=np.int64)
    held = (len(corners) // 3, statements - len(corners) // 3)
    if promised is not None and promised != held:
        raise ShapeError(
            f"{path}: promises {promised[0]} vertices and {promised[1]} faces, but holds {held[0]} and {held[1]}; "
            "the file is cut short or was changed, download it again"
        )
    return corners.reshape(-1, 3), triangles.reshape(-1, 3)


def _is_count(*words: str) -> bool:
    return all(word.isdecimal() and len(word) < 12 for word in words)


def _logical_lines(path: Path, file: TextIO, continued: bool) -> Iterator[tuple[int, str]]:
    """Lines with their numbers; where a backslash ends one and that has a meaning, with the next ones.

    Raises:
        ShapeError: One is too long.
    """
    text, first = "", 1
    for number, line in enumerate(iter(lambda: file.readline(MAX_LINE_CHARACTERS + 1), ""), start=1):
        text, first = (text + line, first) if text else (line, number)
        if len(text) > MAX_LINE_CHARACTERS:
            raise ShapeError(
                f"{path}: line {first} is longer than {MAX_LINE_CHARACTERS} characters (MAX_LINE_CHARACTERS); "
                "cut its polygon into triangles"
            )
        if continued and text.endswith("\\\n"):
            text = f"{text[:-2]} "
            continue
        yield first, text
        text = ""
    if text:
        yield first, text


def _read_statement(words: list[str], vertices: array[float], faces: array[int], read_index: IndexReader) -> None:
    if words[0] == "v":
        if len(words) < 4:
            raise ValueError(f"a vertex needs three coordinates, this one has {len(words) - 1}")
        vertices.extend([float(word) for word in words[1:4]])
        return
    if len(words) < 4:
        raise ValueError(f"a face needs at least three vertices, this one has {len(words) - 1}")
    count = len(vertices) // 3
    first, *rest = [read_index(word, count) for word in words[1:]]
    for second, third in zip(rest, rest[1:], strict=False):
        faces.extend((first, second, third))


def _obj_index(word: str, count: int) -> int:
    index = int(word.partition("/")[0])
    if index == 0:
        raise ValueError("OBJ counts vertices from 1, so index 0 does not exist")
    return index - 1 if index > 0 else count + index
