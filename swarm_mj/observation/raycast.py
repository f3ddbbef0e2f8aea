"""Ray casting: first hits of rays on a mesh, sample points on cells, and the observer that sends one ray to each of them.

Rays are traced by Intel Embree where its wheel exists, in single precision (1 to 2 mm at the size of Eros), else by a compiled
loop over all faces. Frame A, metres. Each cell is divided into k^2 similar triangles of equal area, sampled at their centroids:
a share of samples is a share of area.
"""

from functools import cached_property, lru_cache
from math import isqrt
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from swarm_mj.compilation import kernel
from swarm_mj.errors import MissionError
from swarm_mj.mission.target import TargetRegion
from swarm_mj.observation.camera import CameraModel, CameraPose, Optics, camera_pose, in_field_of_view
from swarm_mj.smallbody.occultation import ray_to_triangle
from swarm_mj.smallbody.shape import ShapeModel
from swarm_mj.spacecraft.attitude.algebra import times, vector
from swarm_mj.typing import Array, Indices, Ints32, Mask


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


@lru_cache(maxsize=8)
def tracer_of(shape: ShapeModel) -> RayTracer:
    """Rays against a mesh, which all that ask share."""
    return RayTracer(shape.vertices, shape.faces)


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


#: Rays to each cell that is asked for whole.
WHOLE_SAMPLES = 16


@lru_cache(maxsize=8)
def barycentric_samples(samples: int) -> Array:
    """Barycentric coordinates of the samples of a triangle, shape (samples, 3), rows summing to one.

    Raises:
        MissionError: `samples` is not a square number.
    """
    k = isqrt(max(samples, 0))
    if k < 1 or k * k != samples:
        raise MissionError(f"{samples} samples per cell cannot be spread evenly: use a square number such as 16")
    upright = [(i + 1 / 3, j + 1 / 3) for i in range(k) for j in range(k - i)]
    inverted = [(i + 2 / 3, j + 2 / 3) for i in range(k) for j in range(k - i - 1)]
    ij = np.array(upright + inverted) / k
    return np.column_stack([1.0 - ij.sum(axis=1), ij])


def sampled_fraction(
    tracer: RayTracer | None,
    region: TargetRegion,
    cells: Indices,
    camera: CameraModel,
    pose: CameraPose,
    samples: int,
) -> Array:
    """Share of each given cell in view, 0 to 1, shape (len(cells),); no cell may be given twice.

    A sample counts when it lies in the field of view and nothing is hit before the original mesh face under it; the
    original face, because a sample on a sliver is within rounding of the other pieces of the same flat face. Cells that
    face away count as hidden, so that no rounding at the limb can show them. Without a tracer nothing hides a cell but its
    own back: culling and clipping.
    """
    seen = cells[faces_camera(region, pose)[cells]]
    weights, C_CA = barycentric_samples(samples), np.ascontiguousarray(pose.C_CA)
    rays, of = _rays_in_view(weights, region.corners_A, seen, pose.r_A, C_CA, camera.optics)
    if tracer is not None and len(of):
        of = of[hits_own_face(region, tracer.first_hit(pose.r_A, rays), of)]
    return np.bincount(of, minlength=region.n_cells)[cells] / samples


def shown_whole(tracer: RayTracer | None, region: TargetRegion, camera: CameraModel, pose: CameraPose) -> Mask:
    """Which cells are seen whole, shape (n,): their corners lie in the field of view, which is convex; nothing hides a sample.

    Without a tracer nothing hides a cell but its own back; the camera's resolution plays no part.
    """
    whole = np.asarray(camera.contains(pose.to_camera(region.corners_A)).all(axis=-1))
    cells = np.flatnonzero(whole)
    whole[cells] = sampled_fraction(tracer, region, cells, camera, pose, WHOLE_SAMPLES) == 1.0
    return whole


def hits_own_face(region: TargetRegion, hit: Indices, cells: Indices) -> Mask:
    """Whether rays to these cells first hit, by `RayTracer.first_hit`, the original face that the cell is a part of."""
    return np.asarray((hit >= 0) & (region.parent[hit] == region.parent[region.target[cells]]))


def faces_camera(region: TargetRegion, pose: CameraPose) -> Mask:
    """Tell which cells turn their outer side to the camera, shape (n,)."""
    return _turned_to(pose.r_A, region.centroid_A, region.normal_A)


@kernel
def _turned_to(r_A: Array, centroid_A: Array, normal_A: Array) -> Mask:
    turned = np.empty(len(centroid_A), np.bool_)
    for i in range(len(centroid_A)):
        out = 0.0
        for axis in range(3):
            out += (r_A[axis] - centroid_A[i, axis]) * normal_A[i, axis]
        turned[i] = out > 0.0
    return turned


@kernel
def _rays_in_view(
    weights: Array, corners_A: Array, cells: Indices, r_A: Array, C_CA: Array, optics: Optics
) -> tuple[Array, Indices]:
    """Rays [m] from the camera to those samples of some cells that `CameraModel.contains`, and the cell of each."""
    most = len(cells) * len(weights)
    rays, of, count = np.empty((most, 3)), np.empty(most, np.intp), 0
    for cell in cells:
        for sample in range(len(weights)):
            a, b, c = weights[sample]
            for axis in range(3):
                point = a * corners_A[cell, 0, axis] + b * corners_A[cell, 1, axis] + c * corners_A[cell, 2, axis]
                rays[count, axis] = point - r_A[axis]
            of[count] = cell
            x, y, z = times(C_CA, vector(rays, count))
            # A sample that is out of view is overwritten by the next one.
            count += in_field_of_view(optics, x, y, z)
    return rays[:count], of[:count]


class MeshObserver:
    """What observers of a region's cells share."""

    region: TargetRegion

    @cached_property
    def tracer(self) -> RayTracer:
        """Ray tracer over the region's mesh, built at first use."""
        return tracer_of(self.region.mesh)

    def close(self) -> None:
        """Nothing to release."""


class RayCastObserver(MeshObserver):
    """Share of each cell in view, by rays from the camera to points spread evenly over the cell.

    Args:
        region: The target.
        camera: The camera; its resolution plays no part here.
        samples: Points per cell, a square number.
        occlusion: Whether the body hides cells behind it; without it, culling and clipping decide alone, as in the paper.
        note: Why this observer was chosen.

    Raises:
        MissionError: `samples` is not a square number.
    """

    name = "raycast"
    counts_pixels = False

    def __init__(
        self,
        region: TargetRegion,
        camera: CameraModel,
        *,
        samples: int = 16,
        occlusion: bool = True,
        note: str = "ray casting, as asked",
    ) -> None:
        self.samples, self.occlusion = len(barycentric_samples(samples)), occlusion
        self.region, self.camera, self.note = region, camera, note
        self._all = np.arange(region.n_cells)

    def visible_fraction(self, r_A: ArrayLike, C_CA: ArrayLike) -> Array:
        """Share of each cell in view, see `Observer.visible_fraction`."""
        pose = camera_pose(r_A, C_CA)
        tracer = self.tracer if self.occlusion else None
        return sampled_fraction(tracer, self.region, self._all, self.camera, pose, self.samples)
