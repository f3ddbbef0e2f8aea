"""Cutting and refining closed triangle meshes without opening them.

Every operation here splits edges, never single faces: both faces of an edge get the same new vertex, so that a closed
mesh stays closed and no pixel or ray can slip through a T-junction. Lengths are in metres; the frame is the mesh's own.
"""

from collections.abc import Callable

import numpy as np

from swarm_mj.errors import MissionError
from swarm_mj.typing import Array, Indices, Ints, Ints32, Mask

Vertices = Array
Faces = Ints32

#: A mesh of more faces than these takes longer to draw and judge than anybody waits.
MAX_FACES = 400_000
#: Distances to a cutting plane below this fraction of the mesh's radius count as zero, i.e. as rounding.
ON_PLANE = 1e-12


def cut_mesh(vertices: Vertices, faces: Faces, normals: Array) -> tuple[Vertices, Faces, Indices]:
    """Cut a mesh along planes through the origin, keeping all of it.

    Args:
        vertices: Mesh vertices [m], shape (V, 3).
        faces: Vertex indices, shape (F, 3).
        normals: Unit normals of the planes, shape (P, 3).

    Returns:
        Vertices (the given ones first), faces, none of which crosses a plane, and the given face that each came from.
    """
    parent = np.arange(len(faces))
    for normal in normals:
        distance = plane_distance(vertices, normal)
        vertices, faces, origin = _split_edges(vertices, faces, _crosses(distance), _crossing_point(distance))
        parent = parent[origin]
    return vertices, faces, parent


def refine_mesh(vertices: Vertices, faces: Faces, chosen: Mask, longest_edge: float) -> tuple[Vertices, Faces, Indices]:
    """Bisect the edges of chosen faces until none is longer than `longest_edge`.

    Args:
        vertices: Mesh vertices [m], shape (V, 3).
        faces: Vertex indices, shape (F, 3).
        chosen: Faces to refine, shape (F,); their neighbours are split along, as far as they share a bisected edge.
        longest_edge: Upper bound of the edge length of chosen faces [m], positive.

    Returns:
        Vertices, faces, and the given face that each came from.

    Raises:
        MissionError: The mesh would grow beyond `MAX_FACES`.
    """
    parent = np.arange(len(faces))
    while True:
        edges = _edges(faces[chosen[parent]]).reshape(-1, 2)
        long = edges[np.linalg.norm(vertices[edges[:, 0]] - vertices[edges[:, 1]], axis=1) > longest_edge]
        if not len(long):
            return vertices, faces, parent
        keys = np.unique(_edge_keys(long, len(vertices)))
        marked = _is_one_of(keys, len(vertices))
        vertices, faces, origin = _split_edges(vertices, faces, marked, _midpoint)
        parent = parent[origin]
        if len(faces) > MAX_FACES:
            raise MissionError(
                f"cells of {longest_edge:.3g} m would cut the mesh into more than {MAX_FACES:,} faces: set a larger "
                "target.cell_size_m (with 'auto' it follows the camera's half-angle), or null for whole faces"
            )


def plane_distance(points: Array, normal: Array) -> Array:
    """Signed distance [m], shape (n,), to a plane through the origin; mere rounding is returned as exactly zero."""
    distance = points @ normal
    distance[np.abs(distance) <= ON_PLANE * np.linalg.norm(points, axis=1).max(initial=0.0)] = 0.0
    return distance


_EdgeTest = Callable[[Ints32], Mask]
_EdgePoint = Callable[[Vertices, Ints32], Vertices]


def _crosses(distance: Array) -> _EdgeTest:
    sign = np.sign(distance)
    return lambda edges: sign[edges[:, 0]] * sign[edges[:, 1]] < 0


def _crossing_point(distance: Array) -> _EdgePoint:
    def point(vertices: Vertices, edges: Ints32) -> Vertices:
        start, end = edges.T
        share = (distance[start] / (distance[start] - distance[end]))[:, None]
        return vertices[start] + share * (vertices[end] - vertices[start])

    return point


def _is_one_of(keys: Ints, n_vertices: int) -> _EdgeTest:
    return lambda edges: np.isin(_edge_keys(edges, n_vertices), keys)


def _midpoint(vertices: Vertices, edges: Ints32) -> Vertices:
    return 0.5 * (vertices[edges[:, 0]] + vertices[edges[:, 1]])


def _edges(faces: Faces) -> Ints32:
    """Edge k of a face runs from its vertex k to the next; shape (F, 3, 2), each edge with the lower index first."""
    return np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=2), axis=2)


def _edge_keys(edges: Ints32, n_vertices: int) -> Ints:
    return edges[:, 0].astype(np.int64) * n_vertices + edges[:, 1]


def _split_edges(
    vertices: Vertices, faces: Faces, marked: _EdgeTest, point: _EdgePoint
) -> tuple[Vertices, Faces, Indices]:
    """Insert one vertex on each marked edge and split the faces at it; also returns the face each came from."""
    edges = _edges(faces).reshape(-1, 2)
    chosen = marked(edges)
    if not chosen.any():
        return vertices, faces, np.arange(len(faces))
    _, first, which = np.unique(_edge_keys(edges[chosen], len(vertices)), return_index=True, return_inverse=True)
    inserted = np.full(len(edges), -1, dtype=np.int32)
    inserted[chosen] = len(vertices) + which
    vertices = np.vstack([vertices, point(vertices, edges[chosen][first])])
    return vertices, *_split_faces(vertices, faces, inserted.reshape(-1, 3))


def _split_faces(vertices: Vertices, faces: Faces, inserted: Faces) -> tuple[Faces, Indices]:
    """Split each face at the vertices inserted on its edges (-1: none), without changing its orientation."""
    count = (inserted >= 0).sum(axis=1)
    whole = np.flatnonzero(count == 0)
    pieces, origins = [faces[whole]], [whole]
    for number, split in ((1, _split_at_one), (2, _split_at_two), (3, _split_at_three)):
        index = np.flatnonzero(count == number)
        parts = split(vertices, *_turned(faces[index], inserted[index]))
        pieces += parts
        origins += [index] * len(parts)
    face, origin = np.vstack(pieces), np.concatenate(origins)
    order = np.argsort(origin, kind="stable")
    return face[order].astype(np.int32), origin[order]


def _turned(faces: Faces, inserted: Faces) -> tuple[Faces, Faces]:
    """Renumber each face so that its split edges come first, going round."""
    split = inserted >= 0
    start = np.argmax(split & ~np.roll(split, 1, axis=1), axis=1)
    turn = (start[:, None] + np.arange(3)) % 3
    return np.take_along_axis(faces, turn, axis=1), np.take_along_axis(inserted, turn, axis=1)


def _split_at_one(vertices: Vertices, faces: Faces, inserted: Faces) -> list[Faces]:
    a, b, c = faces.T
    m = inserted[:, 0]
    return [np.column_stack(t) for t in ((a, m, c), (m, b, c))]


def _split_at_two(vertices: Vertices, faces: Faces, inserted: Faces) -> list[Faces]:
    a, b, c = faces.T
    m, n = inserted[:, 0], inserted[:, 1]
    # The corner b is cut off; the rest is the quadrilateral a m n c, split along its shorter diagonal.
    across = np.linalg.norm(vertices[a] - vertices[n], axis=1) <= np.linalg.norm(vertices[m] - vertices[c], axis=1)
    third, fourth = np.where(across, n, c), np.where(across, a, m)
    return [np.column_stack(t) for t in ((m, b, n), (a, m, third), (fourth, n, c))]


def _split_at_three(vertices: Vertices, faces: Faces, inserted: Faces) -> list[Faces]:
    a, b, c = faces.T
    m, n, o = inserted.T
    return [np.column_stack(t) for t in ((a, m, o), (m, b, n), (o, n, c), (m, n, o))]
