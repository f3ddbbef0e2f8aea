"""Meshes as lines of text: Wavefront OBJ and the plate tables (.tab) of NASA's Planetary Data System.

Both write `v x y z` for a vertex and `f i j k ...` for a face. OBJ counts vertices from 1 and may decorate an index
(`7/2/3`) or count it from the end (`-1`); plate tables count from 0 or from 1, which their lowest index tells.
"""

from __future__ import annotations

from array import array
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from swarm_mj.errors import ShapeError

#: Longest line [characters]: a polygon of ten thousand corners; a file that is one line would be split into gigabytes.
MAX_LINE_CHARACTERS = 100_000
#: Reads one index of a face, given the number of vertices met so far.
IndexReader = Callable[[str, int], int]


def read_obj(path: Path) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Read vertices (V, 3) in the file's unit and triangles (F, 3) counted from 0; other OBJ statements are skipped.

    Raises:
        ShapeError: a line that is not understood.
        UnicodeDecodeError: the file is not UTF-8.
    """
    return _read_lines(path, _obj_index)


def read_tab(path: Path) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Read a PDS plate table; results and errors as `read_obj`."""
    vertices, faces = _read_lines(path, lambda word, count: int(word))
    first = 1 if faces.size and faces.min() >= 1 else 0
    return vertices, faces - first


def _read_lines(path: Path, read_index: IndexReader) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    # Flat typed arrays hold a large mesh in a tenth of the memory of Python lists of numbers.
    vertices, faces = array("d"), array("q")
    with open(path, encoding="utf-8") as file:
        for number, line in enumerate(iter(lambda: file.readline(MAX_LINE_CHARACTERS + 1), ""), start=1):
            if len(line) > MAX_LINE_CHARACTERS:
                raise ShapeError(
                    f"{path}: line {number} is longer than {MAX_LINE_CHARACTERS} characters (MAX_LINE_CHARACTERS); "
                    "cut its polygon into triangles"
                )
            words = line.partition("#")[0].split()
            if words and words[0] in ("v", "f"):
                try:
                    _read_statement(words, vertices, faces, read_index)
                except (ValueError, OverflowError) as error:
                    raise ShapeError(
                        f"{path}: line {number}, {line.strip()[:60]!r}: {error}; correct this line"
                    ) from error
    return np.frombuffer(vertices, dtype=np.float64).reshape(-1, 3), np.frombuffer(faces, dtype=np.int64).reshape(-1, 3)


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
