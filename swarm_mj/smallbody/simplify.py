"""Meshes small enough for a page: vertices that share a box of a regular grid become one (Rossignac and Borrel 1993).

Positions in A [m]. Triangles that keep three distinct corners stay, so that what is known of each stays with it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from swarm_mj.typing import Array, Ints, Mask


class Simplified(NamedTuple):
    """A simplified mesh.

    Attributes:
        vertices: Shape (V, 3) [m].
        faces: Vertex indices, shape (F, 3).
        kept: Which face of the original each one is, shape (F,).
    """

    vertices: Array
    faces: Ints
    kept: Ints


def simplify(vertices: Array, faces: Ints, limit: int, fixed: Array | None = None) -> Simplified:
    """Merge vertices until at most `limit` faces remain; a mesh that is small enough stays as it is.

    Args:
        vertices: Shape (V, 3) [m].
        faces: Vertex indices, shape (F, 3).
        limit: Largest number of faces, positive.
        fixed: Positions that must not move, shape (n, 3) [m]: a seam with another mesh. Faces there may exceed the limit.
    """
    best = Simplified(np.asarray(vertices, float), np.asarray(faces, np.int64), np.arange(len(faces)))
    if len(faces) <= limit:
        return best
    held = _on(best.vertices, fixed)
    size = float(np.ptp(best.vertices, axis=0).max())
    boxes = np.sqrt(limit)  # about two faces a vertex, and the surface meets about boxes^2 of them
    while boxes >= 1.0:
        best = _cluster(np.asarray(vertices, float), np.asarray(faces, np.int64), held, size / boxes)
        if len(best.faces) <= limit:
            break
        boxes *= 0.85
    return best


def _on(vertices: Array, fixed: Array | None) -> Mask:
    """Which vertices lie at one of the fixed positions, to the millimetre."""
    if fixed is None:
        return np.zeros(len(vertices), bool)
    keys = {tuple(key) for key in np.round(fixed, 2)}
    return np.array([tuple(key) in keys for key in np.round(vertices, 2)], bool)


def _cluster(vertices: Array, faces: Ints, held: Mask, edge: float) -> Simplified:
    boxes = np.floor((vertices - vertices.min(axis=0)) / edge).astype(np.int64)
    labels = np.column_stack((boxes, np.where(held, np.arange(len(vertices)) + 1, 0)))
    _, cluster = np.unique(labels, axis=0, return_inverse=True)
    cluster = cluster.reshape(-1)
    count = np.bincount(cluster)
    centre = np.column_stack([np.bincount(cluster, weights=vertices[:, k]) / count for k in range(3)])
    corners = cluster[faces]
    proper = np.flatnonzero(
        (corners[:, 0] != corners[:, 1]) & (corners[:, 1] != corners[:, 2]) & (corners[:, 2] != corners[:, 0])
    )
    _, first = np.unique(np.sort(corners[proper], axis=1), axis=0, return_index=True)
    kept = proper[np.sort(first)]
    used, renumbered = np.unique(corners[kept], return_inverse=True)
    return Simplified(centre[used], renumbered.reshape(-1, 3), kept)
