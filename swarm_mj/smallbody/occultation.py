"""What the body hides: segments against the mesh, compiled. Frame A, metres."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from swarm_mj.compilation import jittable, kernel
from swarm_mj.smallbody.shape import ShapeModel
from swarm_mj.typing import Array, Ints32, Mask

#: Hits closer than this to a segment's ends do not count, relative to its length: a spacecraft does not hide itself.
_END_MARGIN = 1e-9


class Occluder(NamedTuple):
    """A body as compiled code asks what it hides.

    Attributes:
        vertices: The mesh, shape (V, 3) [m].
        faces: Shape (F, 3).
        box: Least and largest coordinates of the mesh, shape (2, 3) [m].
        max_radius: Of the vertices [m].
    """

    vertices: Array
    faces: Ints32
    box: Array
    max_radius: float


def occluder_of(shape: ShapeModel) -> Occluder:
    """The body of that shape."""
    box = np.array([shape.vertices.min(axis=0), shape.vertices.max(axis=0)])
    return Occluder(shape.vertices, shape.faces, box, float(shape.max_radius))


def segments_blocked(start_A: Array, end_A: Array, vertices: Array, faces: Ints32, radius: float) -> Mask:
    """Whether the body stands between the ends of segments.

    Args:
        start_A: Shape (m, 3) [m].
        end_A: Shape (m, 3) [m].
        vertices: The mesh, shape (V, 3) [m].
        faces: Shape (F, 3).
        radius: Largest vertex radius [m]; segments that stay outside are not tested face by face.

    Returns:
        Shape (m,), True where some face is hit strictly between the ends.
    """
    blocked = _distance_to_origin(start_A, end_A) < radius
    if blocked.any():  # else nothing need be compiled
        blocked[blocked] = _hit(np.array(start_A[blocked]), np.array(end_A[blocked]), vertices, faces)
    return blocked


def _distance_to_origin(a: Array, b: Array) -> Array:
    """Least distance of segments from the origin, shape (m,) [m]."""
    d = b - a
    whole = np.einsum("ij,ij->i", d, d)
    share = np.clip(-np.einsum("ij,ij->i", a, d) / np.where(whole > 0.0, whole, 1.0), 0.0, 1.0)
    return np.asarray(np.linalg.norm(a + share[:, None] * d, axis=1))


@kernel
def _hit(start_A: Array, end_A: Array, vertices: Array, faces: Ints32) -> Mask:
    hit = np.empty(start_A.shape[0], np.bool_)
    for i in range(start_A.shape[0]):
        start = (start_A[i, 0], start_A[i, 1], start_A[i, 2])
        way = (end_A[i, 0] - start[0], end_A[i, 1] - start[1], end_A[i, 2] - start[2])
        hit[i] = _hits_any(start, way, vertices, faces)
    return hit


@jittable
def way_blocked(start_A: Any, end_A: Any, body: Occluder) -> bool:
    """The same for one segment, in compiled code; most miss the box around the mesh."""
    box, first, last = body.box, 0.0, 1.0
    for k in range(3):
        step = end_A[k] - start_A[k]
        if step == 0.0:
            if start_A[k] < box[0, k] or start_A[k] > box[1, k]:
                return False
            continue
        one, other = (box[0, k] - start_A[k]) / step, (box[1, k] - start_A[k]) / step
        first, last = max(first, min(one, other)), min(last, max(one, other))
    way = (end_A[0] - start_A[0], end_A[1] - start_A[1], end_A[2] - start_A[2])
    return first <= last and _hits_any(start_A, way, body.vertices, body.faces)


@kernel
def _hits_any(o: Any, d: Any, vertices: Array, faces: Ints32) -> bool:
    for f in range(faces.shape[0]):
        s = ray_to_triangle(o, d, vertices[faces[f, 0]], vertices[faces[f, 1]], vertices[faces[f, 2]])
        if _END_MARGIN < s < 1.0 - _END_MARGIN:
            return True
    return False


@jittable
def ray_to_triangle(o: Any, d: Any, a: Any, b: Any, c: Any) -> float:
    """Where a ray from o along d meets a triangle, from either side, in lengths of d; -inf: nowhere (Moeller and Trumbore)."""
    ux, uy, uz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    wx, wy, wz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    px, py, pz = d[1] * wz - d[2] * wy, d[2] * wx - d[0] * wz, d[0] * wy - d[1] * wx
    det = ux * px + uy * py + uz * pz
    if det == 0.0:
        return -np.inf
    tx, ty, tz = o[0] - a[0], o[1] - a[1], o[2] - a[2]
    u = (tx * px + ty * py + tz * pz) / det
    if u < 0.0 or u > 1.0:
        return -np.inf
    qx, qy, qz = ty * uz - tz * uy, tz * ux - tx * uz, tx * uy - ty * ux
    v = (d[0] * qx + d[1] * qy + d[2] * qz) / det
    if v < 0.0 or u + v > 1.0:
        return -np.inf
    return (wx * qx + wy * qy + wz * qz) / det
