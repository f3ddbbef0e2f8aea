"""Small good meshes in every format, and ways to spoil them."""

import struct

import numpy as np
from hypothesis import strategies as st

from swarm_mj.smallbody.geodesic import geodesic_icosahedron


def ball(frequency=1, radius=500.0):
    directions, faces = geodesic_icosahedron(frequency)
    return radius * directions, faces


def as_obj(vertices, faces, first=1):
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in vertices.tolist()]
    return "\n".join([*lines, *(f"f {i} {j} {k}" for i, j, k in (faces + first).tolist())]).encode() + b"\n"


def as_tab(vertices, faces):
    return as_obj(vertices / 1e3, faces, 0)


def as_stl(vertices, faces):
    body = b"".join(
        struct.pack("<12fH", 0, 0, 0, *corners.ravel(), 0) for corners in vertices[faces].astype(np.float32)
    )
    return b"\0" * 80 + struct.pack("<I", len(faces)) + body


def as_text_stl(vertices, faces):
    def facet(corners):
        rows = "".join(f"   vertex {x!r} {y!r} {z!r}\n" for x, y, z in corners.tolist())
        return f" facet normal 0 0 0\n  outer loop\n{rows}  endloop\n endfacet\n"

    return ("solid ball\n" + "".join(map(facet, vertices[faces])) + "endsolid ball\n").encode()


def _ply_header(form, vertices, faces):
    axes = "".join(f"property double {axis}\n" for axis in "xyz")
    return (
        f"ply\nformat {form} 1.0\ncomment a ball\nelement vertex {len(vertices)}\n{axes}"
        f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    ).encode()


def as_ply(vertices, faces):
    rows = b"".join(struct.pack("<B3i", 3, *face) for face in faces.tolist())
    return _ply_header("binary_little_endian", vertices, faces) + vertices.astype("<f8").tobytes() + rows


def as_text_ply(vertices, faces):
    rows = [" ".join(map(repr, row)) for row in vertices.tolist()] + [f"3 {i} {j} {k}" for i, j, k in faces.tolist()]
    return _ply_header("ascii", vertices, faces) + "\n".join(rows).encode() + b"\n"


#: Ending and bytes of the same ball in every form.
FORMS = {
    "obj": ("obj", as_obj(*ball())),
    "tab": ("tab", as_tab(*ball())),
    "stl": ("stl", as_stl(*ball())),
    "text stl": ("stl", as_text_stl(*ball())),
    "ply": ("ply", as_ply(*ball())),
    "text ply": ("ply", as_text_ply(*ball())),
}

#: What stands in place of a number, a word or a stretch of bytes.
WORDS = [
    b"nan", b"inf", b"-1", b"0", b"1e400", b"-1e308", b"1e-320", b"9" * 400, b"9" * 5000, b"99999999999", b"4294967295",
    b"", b" ", b"\n", b"\r", b"\0", b"\xff", b"\xef\xbb\xbf", b"\xd9\xa1", b"v", b"f", b"f 1", b"vertex", b"endfacet",
    b"end_header",
    b"element vertex 4000000000\n", b"element face 4000000000\n", b"property list double double x\n", b"property double x\n",
    b"comment TextureFile ../../secret.png\n", b"format binary_big_endian 1.0\n", b"list uchar int", b"\n" * 3000, b" " * 3000,
]  # fmt: skip


@st.composite
def spoiled(draw, content):
    """Bytes of a file after one to four accidents or attacks."""
    data = bytearray(content)
    for _ in range(draw(st.integers(1, 4))):
        start = draw(st.integers(0, max(0, len(data) - 1)))
        length = draw(st.sampled_from([0, 1, 2, 4, 8, 40]))
        how = draw(st.sampled_from(["cut", "put", "put", "word", "word", "twice", "flip"]))
        if how == "cut":
            del data[start:]
        elif how == "put":
            data[start : start + length] = draw(st.sampled_from(WORDS))
        elif how == "word":
            _replace_word(data, start, draw(st.sampled_from(WORDS)))
        elif how == "twice":
            data[start:start] = data[start : start + 40 * length]
        elif data:
            data[start] ^= 1 << draw(st.integers(0, 7))
    return bytes(data)


def _replace_word(data, start, word):
    """Put a word in place of the next one, so that the lines around it stay right."""
    text = bytes(data)
    begin = next((k for k in range(start, len(text)) if not text[k : k + 1].isspace()), len(text))
    end = next((k for k in range(begin, len(text)) if text[k : k + 1].isspace()), len(text))
    data[begin:end] = word
