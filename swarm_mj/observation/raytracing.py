"""First hits of rays on a triangle mesh: Intel Embree where its wheel exists, else a compiled loop over all faces.

Frame A, metres. Embree works in single precision: 1 to 2 mm at the size of Eros.
"""

from typing import Any

import numpy as np

from swarm_mj.compilation import kernel
from swarm_mj.smallbody.occultation import ray_to_triangle
from swarm_mj.typing import Array, Indices, Ints32


class RayTracer:
    """Answers which face a ray meets first; immutable once built.

    Args:
        vertices: Mesh vertices in A [m], shape (V, 3).
        faces: Vertex indices, shape (F, 3).
        use_embree: False forces the compiled loop; True falls back to it when embreex is not installed.
    """

    def __init__(self, vertices: Array, faces: Ints32, *, use_embree: bool = True) -> None:
        self._corners = np.ascontiguousarray(vertices[faces])
        self._scene = _embree_scene(self._corners) if use_embree else None

    @property
    def engine(self) -> str:
        """`embree` or `numba`."""
        return "numba" if self._scene is None else "embree"

    def first_hit(self, origins_A: Array, directions_A: Array) -> Indices:
        """Face that each ray meets first, -1 for none; either side of a face stops a ray.

        Args:
            origins_A: Where the rays start [m], shape (n, 3) or (3,) for all.
            directions_A: Where they go, of any length, shape (n, 3).
        """
        origins = np.broadcast_to(origins_A, directions_A.shape)
        if self._scene is None:
            return _first_hits(self._corners, np.ascontiguousarray(origins), np.ascontiguousarray(directions_A))
        hits = self._scene.run(origins.astype(np.float32), directions_A.astype(np.float32))
        return np.asarray(hits, dtype=np.intp)


def _embree_scene(corners: Array) -> Any:
    try:
        from embreex.mesh_construction import TriangleMesh
        from embreex.rtcore_scene import EmbreeScene
    except ImportError:
        return None
    scene = EmbreeScene()
    TriangleMesh(scene, corners.astype(np.float32))
    return scene


@kernel
def _first_hits(corners: Array, origins: Array, directions: Array) -> Indices:
    """By every face, in double precision."""
    hits = np.full(len(origins), -1, dtype=np.intp)
    for i in range(len(origins)):
        nearest = np.inf
        for f in range(len(corners)):
            t = ray_to_triangle(origins[i], directions[i], corners[f, 0], corners[f, 1], corners[f, 2])
            if 0.0 < t < nearest:
                nearest, hits[i] = t, f
    return hits
