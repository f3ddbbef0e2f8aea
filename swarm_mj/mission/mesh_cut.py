"""Cutting and refining closed triangle meshes without opening them.

Every operation here splits edges, never single faces: both faces of an edge get the same new vertex, so that a closed
mesh stays closed and no pixel or ray can slip through a T-junction. Lengths are in metres; the frame is the mesh's own.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree

from swarm_mj.errors import MissionError
from swarm_mj.smallbody.shape import directed_edges
from swarm_mj.typing import Array, Indices, Ints, Ints32, Mask

Vertices = Array
Faces = Ints32

#: A mesh of more faces than these takes longer to draw and judge than anybody waits.
MAX_FACES = 400_000
#: Distances to a cutting plane below this fraction of the mesh's radius count as zero, i.e. as rounding.
ON_PLANE = 1e-12


@dataclass(frozen=True, eq=False)
class Cuts:
    """Planes through the origin along which a mesh is cut, all around or along arcs."""

    normal: Array  #: of each plane, of unit length, shape (P, 3)
    middle: Array | None = None  #: unit vector to the middle of the arc in each plane, shape (P, 3); None: all around
    reach: Array | None = None  #: half of the arc's angle, below a right angle, shape (P,) [rad]


def cut_mesh(vertices: Vertices, faces: Faces, cuts: Cuts) -> tuple[Vertices, Faces, Indices]:
    """Cut a mesh along planes through the origin, keeping all of it.

    A plane that is meant along an arc cuts every face that the arc meets, all across; then no face crosses the arc.

    Args:
        vertices: Mesh vertices [m], shape (V, 3).
        faces: Vertex indices, shape (F, 3).
        cuts: The planes.

    Returns:
        Vertices (the given ones first), faces, none of which crosses a plane, and the given face that each came from.
    """
    parent = np.arange(len(faces))
    far = _far_from_arcs(vertices, faces, cuts)
    apart, faces, parent = (faces[far], parent[far]), faces[~far], parent[~far]
    for k, normal in enumerate(cuts.normal):
        distance, edges = plane_distance(vertices, normal), _edges(faces)
        sign = np.sign(distance)
        crossing = sign[edges[:, 0]] * sign[edges[:, 1]] < 0
        if cuts.middle is not None and cuts.reach is not None:
            meets = np.zeros(len(faces), np.bool_)
            some = np.flatnonzero(crossing.reshape(-1, 3).any(axis=1))
            axes = np.array([cuts.middle[k], np.cross(normal, cuts.middle[k])])
            meets[some] = _meets_arc(vertices, faces[some], distance, axes, float(cuts.reach[k]))
            keys = _edge_keys(edges, len(vertices))
            crossing &= np.isin(keys, keys[crossing & np.repeat(meets, 3)])
        start, end = edges[crossing].T
        share = (distance[start] / (distance[start] - distance[end]))[:, None]
        points = vertices[start] + share * (vertices[end] - vertices[start])
        vertices, faces, origin = _split_edges(vertices, faces, edges, crossing, points)
        parent = parent[origin]
    return vertices, np.vstack((faces, apart[0])), np.append(parent, apart[1])


def _far_from_arcs(vertices: Vertices, faces: Faces, cuts: Cuts) -> Mask:
    """Faces that no arc comes near, nor an edge that an arc's plane may split, shape (F,); none where planes go all around."""
    far = np.zeros(len(faces), np.bool_)
    if cuts.middle is None or cuts.reach is None or not len(cuts.reach):
        return far
    corners = vertices[faces] / np.linalg.norm(vertices[faces], axis=2, keepdims=True)
    middle = corners.mean(axis=1)
    middle /= np.linalg.norm(middle, axis=1, keepdims=True)
    wide = np.linalg.norm(corners - middle[:, None], axis=2).max()
    reached = KDTree(middle).query_ball_point(cuts.middle, np.minimum(2.0, cuts.reach + 4.0 * wide))
    far[:] = True
    far[np.unique(np.concatenate(reached).astype(np.int64))] = False
    return far


def _meets_arc(vertices: Vertices, faces: Faces, distance: Array, axes: Array, reach: float) -> Mask:
    """Which of faces that cross a plane meet an arc in it, shape (F,).

    Args:
        vertices: Mesh vertices [m], shape (V, 3).
        faces: Vertex indices, shape (F, 3).
        distance: Of the vertices from the plane [m], shape (V,).
        axes: Unit vectors in the plane to the arc's middle and along it, as rows, shape (2, 3).
        reach: Half of the arc's angle [rad].
    """
    away, other = distance[faces], distance[np.roll(faces, -1, axis=1)]
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.where(away * other < 0.0, away / (away - other), 0.0)[..., None]
    a, b = vertices[faces], vertices[np.roll(faces, -1, axis=1)]
    ahead, along = np.moveaxis((a + share * (b - a)) @ axes.T, -1, 0)
    angle = np.where((away == 0.0) | (away * other < 0.0), np.arctan2(along, ahead), np.nan)
    low, high = np.nanmin(angle, axis=1), np.nanmax(angle, axis=1)
    return np.asarray((high - low < np.pi) & (low <= reach + ON_PLANE) & (high >= -reach - ON_PLANE))


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
        edges = _edges(faces)
        start, end = vertices[edges].swapaxes(0, 1)
        long = (np.linalg.norm(start - end, axis=1) > longest_edge) & np.repeat(chosen[parent], 3)
        if not long.any():
            return vertices, faces, parent
        keys = _edge_keys(edges, len(vertices))
        long = np.isin(keys, keys[long])  # the neighbours' sides of the same edges, too
        points = 0.5 * (start[long] + end[long])
        vertices, faces, origin = _split_edges(vertices, faces, edges, long, points)
        parent = parent[origin]
        if len(faces) > MAX_FACES:
            raise MissionError(
                f"cells of {longest_edge:.3g} m would cut the mesh into more than {MAX_FACES:,} faces: set a larger "
                "target.cell_size_m (with 'auto' it follows altitude [m] and half-angle of the camera), or null for whole faces"
            )


def plane_distance(points: Array, normal: Array) -> Array:
    """Signed distance [m], shape (n,), to a plane through the origin; mere rounding is returned as exactly zero."""
    distance = points @ normal
    distance[np.abs(distance) <= ON_PLANE * np.linalg.norm(points, axis=1).max(initial=0.0)] = 0.0
    return distance


def _edges(faces: Faces) -> Ints32:
    """Edge 3 f + k of face f runs from its vertex k to the next; shape (3 F, 2), each edge with the lower index first."""
    return np.sort(directed_edges(faces), axis=1)


def _edge_keys(edges: Ints32, n_vertices: int) -> Ints:
    return edges[:, 0].astype(np.int64) * n_vertices + edges[:, 1]


def _split_edges(
    vertices: Vertices, faces: Faces, edges: Ints32, chosen: Mask, points: Vertices
) -> tuple[Vertices, Faces, Indices]:
    """Insert one vertex on each chosen edge and split the faces at it; also returns the face each came from."""
    if not chosen.any():
        return vertices, faces, np.arange(len(faces))
    _, first, which = np.unique(_edge_keys(edges[chosen], len(vertices)), return_index=True, return_inverse=True)
    inserted = np.full(len(edges), -1, dtype=np.int32)
    inserted[chosen] = len(vertices) + which
    vertices = np.vstack([vertices, points[first]])
    return vertices, *_split_faces(vertices, faces, inserted.reshape(-1, 3))


def _split_faces(vertices: Vertices, faces: Faces, inserted: Faces) -> tuple[Faces, Indices]:
    """Split each face at the vertices inserted on its edges (-1: none), without changing its orientation."""
    count = (inserted >= 0).sum(axis=1)
    whole = np.flatnonzero(count == 0)
    pieces, origins = [faces[whole]], [whole]
    for number in (1, 2, 3):
        index = np.flatnonzero(count == number)
        parts = _pieces(vertices, *_turned(faces[index], inserted[index]), number)
        pieces += [np.column_stack(part) for part in parts]
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


def _pieces(vertices: Vertices, faces: Faces, inserted: Faces, number: int) -> tuple[tuple[Ints32, ...], ...]:
    """Corners of the pieces of faces a b c with m between a and b, of two or three also n after b, of three also o after c."""
    (a, b, c), (m, n, o) = faces.T, inserted.T
    if number == 1:
        return (a, m, c), (m, b, c)
    if number == 3:
        return (a, m, o), (m, b, n), (o, n, c), (m, n, o)
    # The corner b is cut off; the rest is the quadrilateral a m n c, split along its shorter diagonal.
    across = np.linalg.norm(vertices[a] - vertices[n], axis=1) <= np.linalg.norm(vertices[m] - vertices[c], axis=1)
    third, fourth = np.where(across, n, c), np.where(across, a, m)
    return (m, b, n), (a, m, third), (fourth, n, c)
