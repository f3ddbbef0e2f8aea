"""Sample points on cells, and the share of them that a camera sees.

Each triangle is divided into k^2 similar triangles of equal area, sampled at their centroids: a share of samples is a
share of area.
"""

from functools import lru_cache
from math import isqrt

import numpy as np
from numpy.typing import NDArray

from swarm_mj.errors import MissionError
from swarm_mj.mission.target import TargetRegion
from swarm_mj.observation.camera import CameraModel, CameraPose
from swarm_mj.observation.raytracing import RayTracer


@lru_cache(maxsize=8)
def barycentric_samples(samples: int) -> NDArray[np.float64]:
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
    cells: NDArray[np.intp],
    camera: CameraModel,
    pose: CameraPose,
    samples: int,
) -> NDArray[np.float64]:
    """Share of each given cell in view, 0 to 1, shape (len(cells),).

    A sample counts when it lies in the field of view and nothing is hit before the original mesh face under it; the
    original face, because a sample on a sliver is within rounding of the other pieces of the same flat face. Cells that
    face away count as hidden, so that no rounding at the limb can show them. Without a tracer nothing hides a cell but its
    own back: culling and clipping.
    """
    fraction = np.zeros(len(cells))
    facing = np.flatnonzero(faces_camera(region, pose)[cells])
    points = barycentric_samples(samples) @ region.corners_A[cells[facing]]
    row, column = np.nonzero(camera.contains(pose.to_camera(points)))
    if not len(row):
        return fraction
    reached = np.ones(len(row), dtype=np.bool_)
    if tracer is not None:
        hit = tracer.first_hit(pose.r_A, points[row, column] - pose.r_A)
        wanted = region.parent[region.target[cells[facing[row]]]]
        reached = (hit >= 0) & (region.parent[hit] == wanted)
    fraction[facing] = np.bincount(row[reached], minlength=len(facing)) / samples
    return fraction


def faces_camera(region: TargetRegion, pose: CameraPose) -> NDArray[np.bool_]:
    """Tell which cells turn their outer side to the camera, shape (n,)."""
    return np.einsum("ij,ij->i", pose.r_A - region.centroid_A, region.normal_A) > 0.0
