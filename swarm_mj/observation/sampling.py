"""Sample points on cells, and the share of them that a camera sees.

Each triangle is divided into k^2 similar triangles of equal area, sampled at their centroids: a share of samples is a
share of area.
"""

from functools import lru_cache
from math import isqrt

import numpy as np

from swarm_mj.compilation import kernel
from swarm_mj.errors import MissionError
from swarm_mj.mission.target import TargetRegion
from swarm_mj.observation.camera import CameraModel, CameraPose, Optics, in_field_of_view
from swarm_mj.observation.raytracing import RayTracer
from swarm_mj.spacecraft.attitude.algebra import times, vector
from swarm_mj.typing import Array, Indices, Mask

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

    Args:
        tracer: Over the region's mesh; None: nothing hides a cell but its own back.
        region: The target.
        camera: The camera; its resolution plays no part.
        pose: Where it is and how it is turned.
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
    """Rays [m] from the camera to those samples that `CameraModel.contains`, and the cell of each.

    Args:
        weights: Barycentric coordinates of the samples, shape (samples, 3).
        corners_A: Of all cells in A [m], shape (n, 3, 3).
        cells: Those to sample.
        r_A: Camera position in A [m], shape (3,).
        C_CA: Rotation from A to C, shape (3, 3).
        optics: The field of view.
    """
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
