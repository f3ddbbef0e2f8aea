"""Readers of triangle meshes: Wavefront OBJ, NASA's plate tables (PDS .tab), STL, PLY, and SPICE's digital shape kernels.

OBJ and plate tables write `v x y z` for a vertex and `f i j k ...` for a face. OBJ counts vertices from 1, may decorate an
index (`7/2/3`) or count it from the end (`-1`), and goes on in the next line after a backslash; plate tables count from 0 or
from 1, which their lowest index tells, and may begin with the numbers of vertices and faces. STL, text or binary, is a heap of
triangles whose equal corners are welded into shared vertices. PLY is read by trimesh after the counts in its header were
compared with the file's size; DSK (type 2: plates, in km) by SpiceyPy.
"""

from __future__ import annotations

import re
from array import array
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, TextIO

import numpy as np

from swarm_mj.errors import ShapeError
from swarm_mj.io.spice import MAX_NAME, spice_errors, spiceypy
from swarm_mj.typing import Array, Ints

#: Longest line [characters]: a polygon of ten thousand corners; a file that is one line would be split into gigabytes.
MAX_LINE_CHARACTERS = 100_000
#: Reads one index of a face, given the number of vertices met so far.
IndexReader = Callable[[str, int], int]
STL_HEADER_BYTES = 84
#: One triangle of a binary file: normal, three corners, attribute.
STL_TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
#: Blanks of a line, not ends of lines: a pattern that may cross them takes hours on a file of empty lines.
_STL_VERTEX = re.compile(rb"^[ \t]*vertex[ \t]+(.*)$", re.MULTILINE | re.IGNORECASE)
_STL_END_OF_FACET = re.compile(rb"^[ \t]*endfacet", re.MULTILINE | re.IGNORECASE)
#: A header longer than this is not one [bytes].
MAX_PLY_HEADER_BYTES = 65_536
#: Vertices and faces: trimesh takes half a kilobyte for each.
MAX_PLY_ELEMENTS = 3_000_000
#: First words of the lines of a header; the parser behind understands others too, so that a count could pass unseen.
PLY_HEADER_WORDS = {b"ply", b"format", b"comment", b"obj_info", b"element", b"property"}
#: Bytes that a vertex and a plate take at least: more are promised than the file can hold where it is cut short.
VERTEX_BYTES, PLATE_BYTES = 24, 12


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
    """Lines with their numbers; where a backslash ends one and that has a meaning, with the next ones."""
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


def read_stl(path: Path) -> tuple[Array, Ints]:
    """Read vertices (V, 3) in the file's unit and triangles (F, 3); vertices stand in the order they are first met.

    Raises:
        ShapeError: neither form of STL, or cut short.
    """
    data = path.read_bytes()
    # Binary files may also begin with "solid"; only the size tells them apart.
    corners = _binary_corners(data) if _is_binary(data) else _text_corners(data, path)
    return weld(corners)


def weld(corners: Array) -> tuple[Array, Ints]:
    """Merge equal corners (3 F, 3), three a triangle: vertices (V, 3) in the order they are first met, and triangles (F, 3)."""
    positive_zeros = corners + 0.0
    _, first, inverse = np.unique(positive_zeros, axis=0, return_index=True, return_inverse=True)
    order = np.argsort(first)
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    return positive_zeros[first[order]], rank[inverse.ravel()].reshape(-1, 3)


def _is_binary(data: bytes) -> bool:
    if len(data) < STL_HEADER_BYTES:
        return False
    count = int.from_bytes(data[STL_HEADER_BYTES - 4 : STL_HEADER_BYTES], "little")
    return len(data) == STL_HEADER_BYTES + count * STL_TRIANGLE.itemsize


def _binary_corners(data: bytes) -> Array:
    triangles = np.frombuffer(data, dtype=STL_TRIANGLE, offset=STL_HEADER_BYTES)
    return triangles["corners"].reshape(-1, 3).astype(np.float64)


def _text_corners(data: bytes, path: Path) -> Array:
    if data.lstrip()[:5].lower() != b"solid" or b"\0" in data:
        raise ShapeError(f"{path}: not STL, or a binary STL cut short or with bytes added; export or download it again")
    rows = [row.split() for row in _STL_VERTEX.findall(data)]
    if len(rows) % 3 or len(rows) != 3 * len(_STL_END_OF_FACET.findall(data)):
        raise ShapeError(
            f"{path}: the last facet, {len(rows) // 3}, is incomplete: the file is cut short, export it again"
        )
    try:
        return np.array(rows, dtype=np.float64).reshape(-1, 3)
    except ValueError as error:
        raise ShapeError(
            f"{path}: a line 'vertex x y z' does not hold three numbers ({error}); export it again"
        ) from error


def read_ply(path: Path) -> tuple[Array, Ints]:
    """Read vertices (V, 3) in the file's unit and triangles (F, 3) counted from 0.

    Raises:
        ShapeError: not PLY, or without a mesh.
        Exception: whatever trimesh trips over.
    """
    import trimesh  # takes as long to import as a body to be read, and few bodies come as PLY

    _check_ply_header(path)
    mesh = trimesh.load_mesh(path, file_type="ply", process=False, skip_materials=True)
    return np.asarray(mesh.vertices, dtype=np.float64), np.asarray(mesh.faces, dtype=np.int64)


def _check_ply_header(path: Path) -> None:
    with open(path, "rb") as file:
        header, end, body = file.read(MAX_PLY_HEADER_BYTES).partition(b"end_header")
    if not header.startswith(b"ply") or not end:
        raise ShapeError(f"{path}: does not begin with a PLY header; export or download it again")
    for line in header.splitlines():
        if line.split()[:1] and line.split()[0] not in PLY_HEADER_WORDS:
            raise ShapeError(f"{path}: header line {line[:60]!r} is no statement of PLY; export or download it again")
    available = path.stat().st_size - len(header) - len(end)
    # Of an endless number its first digits say enough: they promise more than any file holds.
    found = re.findall(rb"^[ \t]*element\s+(\S+)\s+(\d+)", header, re.MULTILINE)
    elements = {kind.decode(errors="replace"): int(count[:18]) for kind, count in found}
    for kind in ("vertex", "face"):
        if elements.get(kind, 0) == 0:
            raise ShapeError(f"{path}: holds no {kind} elements; export it as a triangle mesh")
    for kind, count in elements.items():
        # Every element takes at least a byte: a count beyond that would only exhaust the memory.
        if count > available:
            raise ShapeError(f"{path}: promises {count} {kind} elements in {available} bytes: it is cut short")
        if count > MAX_PLY_ELEMENTS:
            raise ShapeError(
                f"{path}: {count} {kind} elements, at most {MAX_PLY_ELEMENTS} (MAX_PLY_ELEMENTS); reduce it"
            )


def read_dsk(path: Path) -> tuple[Array, Ints]:
    """Read vertices (V, 3) in km and triangles (F, 3) counted from 0, of a file with one segment of plates.

    Raises:
        ShapeError: It is no DSK, is broken, or holds another number or type of segments.
    """
    spice, name = spiceypy(), str(path)
    if len(name) > MAX_NAME or not name.isascii():
        raise ShapeError(f"{path}: SPICE takes names of at most {MAX_NAME} ASCII characters; move the file")
    with spice_errors(f"{path}", "give a DSK with one segment of type 2, whole", ShapeError):
        handle = spice.dasopr(name)
        try:
            segment = spice.dlabfs(handle)
            if _has_another(spice, handle, segment) or spice.dskgd(handle, segment).dtype != 2:
                raise ShapeError(
                    f"{path}: has several segments, or one that is not of type 2 (plates); write one with MKDSK"
                )
            vertices, plates = spice.dskz02(handle, segment)
            if vertices * VERTEX_BYTES + plates * PLATE_BYTES > path.stat().st_size:
                raise ShapeError(
                    f"{path}: promises {vertices} vertices and {plates} plates, more than it holds; get it again"
                )
            corners = np.asarray(spice.dskv02(handle, segment, 1, vertices), np.float64)
            return corners, np.asarray(spice.dskp02(handle, segment, 1, plates), np.int64) - 1
        finally:
            spice.reset()
            spice.dascls(handle)


def _has_another(spice: Any, handle: int, segment: Any) -> bool:
    """Whether another segment follows."""
    try:
        spice.dlafns(handle, segment)
    except spice.NotFoundError:
        return False
    return True
