"""The shape of a small body: a closed triangle mesh in the body-fixed frame A, in metres.

Areas, volume and centroid follow from the divergence theorem over the faces, so they are exact for the polyhedron.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swarm_mj.errors import ShapeError
from swarm_mj.typing import Array, Ints32

T = TypeVar("T", bound=np.generic)


@dataclass(frozen=True, eq=False)
class ShapeModel:
    """A triangle mesh. The constructor only converts and freezes; `check_shape` says whether it bounds a body.

    Attributes:
        vertices: positions in A [m], shape (V, 3), float64, read-only.
        faces: vertex indices from 0, shape (F, 3), int32, counter-clockwise seen from outside, read-only.
        name: what messages call this body.
    """

    vertices: Array
    faces: Ints32
    name: str = "shape"

    def __post_init__(self) -> None:
        """Copy the arrays and make them read-only."""
        object.__setattr__(self, "vertices", frozen(as_rows(self.vertices, np.float64, f"{self.name}: vertices")))
        object.__setattr__(self, "faces", frozen(as_rows(self.faces, np.int32, f"{self.name}: faces")))

    @cached_property
    def _area_vectors(self) -> Array:
        """Outward normal of each face times its area [m^2], shape (F, 3)."""
        a, b, c = (self.vertices[self.faces[:, k]] for k in range(3))
        return 0.5 * np.cross(b - a, c - a)

    @cached_property
    def face_areas(self) -> Array:
        """Area of each face [m^2], shape (F,)."""
        return frozen(np.linalg.norm(self._area_vectors, axis=1))

    @cached_property
    def face_normals(self) -> Array:
        """Outward unit normal of each face in A, shape (F, 3)."""
        return frozen(self._area_vectors / self.face_areas[:, None])

    @cached_property
    def face_centroids(self) -> Array:
        """Centroid of each face in A [m], shape (F, 3)."""
        return frozen(self.vertices[self.faces].mean(axis=1))

    @cached_property
    def vertex_normals(self) -> Array:
        """Outward unit normal at each vertex in A: area-weighted mean of its faces, shape (V, 3)."""
        normals = np.zeros_like(self.vertices)
        for corner in range(3):
            np.add.at(normals, self.faces[:, corner], self._area_vectors)
        return frozen(normals / np.linalg.norm(normals, axis=1, keepdims=True))

    @cached_property
    def edges(self) -> Ints32:
        """Unique undirected edges as vertex index pairs (low, high), sorted, shape (E, 2)."""
        return frozen(np.unique(np.sort(directed_edges(self.faces), axis=1), axis=0))

    @cached_property
    def vertex_reach(self) -> float:
        """How far the surface can lie from its nearest vertex [m]: at most the longest edge over the square root of 3."""
        start, end = self.vertices[self.edges].swapaxes(0, 1)
        return float(np.linalg.norm(end - start, axis=1).max() / np.sqrt(3.0))

    @cached_property
    def surface_area(self) -> float:
        """Area of the whole surface [m^2]."""
        return float(self.face_areas.sum())

    @cached_property
    def _cones(self) -> tuple[Array, Array, Array]:
        """Apex near the body, signed volumes of the cones face-to-apex (F,) and their centroids (F, 3)."""
        apex = self.vertices.mean(axis=0)
        volumes = np.einsum("ij,ij->i", self._area_vectors, self.face_centroids - apex) / 3.0
        return apex, volumes, apex + 0.75 * (self.face_centroids - apex)

    @cached_property
    def volume(self) -> float:
        """Enclosed volume [m^3]; negative when the faces point inwards."""
        return float(self._cones[1].sum())

    @cached_property
    def centroid(self) -> Array:
        """Centroid of the enclosed volume in A [m], shape (3,)."""
        apex, volumes, centroids = self._cones
        return frozen(apex + volumes @ (centroids - apex) / volumes.sum())

    @cached_property
    def max_radius(self) -> float:
        """Distance of the farthest vertex from the origin of A [m]: radius of the Brillouin sphere."""
        return float(np.linalg.norm(self.vertices, axis=1).max())


def directed_edges(faces: Ints32) -> Ints32:
    """Edges of each face in its own direction, shape (3 F, 2); rows 3 f, 3 f + 1, 3 f + 2 belong to face f."""
    return faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)


def as_rows(values: ArrayLike, dtype: type[T], what: str) -> NDArray[T]:
    """Copy into a C-contiguous (n, 3) array of one type, or say what was passed instead.

    Raises:
        ShapeError: the values do not form a table of three columns.
    """
    try:
        raw = np.asarray(values)
        if raw.size and np.issubdtype(dtype, np.integer) and not np.issubdtype(raw.dtype, np.integer):
            raise TypeError("indices must be whole numbers")
        rows = np.array(raw, dtype=dtype, order="C")
    except (TypeError, ValueError, OverflowError) as error:
        raise ShapeError(f"{what} must be numbers in three columns: {error}") from error
    if rows.ndim != 2 or rows.shape[1] != 3:
        raise ShapeError(f"{what} must have shape (n, 3), got {rows.shape}")
    return rows


def frozen(array: NDArray[T]) -> NDArray[T]:
    """Make an array read-only and return it."""
    array.setflags(write=False)
    return array
