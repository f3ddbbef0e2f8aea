"""How true the seen share of the target is that each way of observing gives.

The seen share is the area in view over the area of the target. It is compared with exact polygon clipping, where shapely is
installed and the mesh is not too fine for it, else with many rays to every face.
"""

from __future__ import annotations

from collections.abc import Sequence
from importlib.util import find_spec

import numpy as np

from swarm_mj.mission.target import TargetRegion
from swarm_mj.observation.camera import CameraModel, CameraPose
from swarm_mj.observation.faceid import MIN_INRADIUS_PX
from swarm_mj.observation.observer import Observer
from swarm_mj.observation.projection import WHOLE_PICTURE, project
from swarm_mj.observation.raycast import RayCastObserver, faces_camera
from swarm_mj.smallbody.shape import ShapeModel
from swarm_mj.typing import Array, Ints
from swarm_mj.verification.polygons import visible_areas

#: Faces of a mesh that polygons are clipped on at most; it takes some seconds.
CLIPPED_FACES = 40_000
#: Rays to each face by number of cells, so that the product stays bounded.
RAYS = ((5_000, 256), (10**9, 64))


def judged(observer: Observer, poses: Sequence[CameraPose]) -> Array:
    """Seen share in each picture by an observer, shape (pictures,)."""
    region = observer.region
    return np.array([observer.visible_fraction(p.r_A, p.C_CA) @ region.area for p in poses]) / region.total_area


def shares_by_pixels(
    counts: Sequence[Ints], region: TargetRegion, camera: CameraModel, poses: Sequence[CameraPose]
) -> Array:
    """Seen share in each picture, shape (pictures,), by the pixels of each cell: they stand for their part of its projection.

    Unlike an observer, which caps the share of every cell at 1 to judge it, this keeps the surplus of some cells, which in the
    sum makes up for others: the best that pixels can tell of the sum.

    Args:
        counts: Pixels of each cell, by picture, each of shape (n,).
        region: The target.
        camera: The camera.
        poses: Where it was, by picture.
    """
    shares = []
    for count, pose in zip(counts, poses, strict=True):
        area, _ = project(pose.to_camera(region.corners_A), camera).pixels(WHOLE_PICTURE, camera.resolution_px)
        found = count > 0
        shares.append((count[found] / area[found]) @ region.area[found] / region.total_area)
    return np.array(shares)


def counted_percent(region: TargetRegion, camera: CameraModel, poses: Sequence[CameraPose]) -> float:
    """How many of the cells that may be in view a face-ID picture shows large enough to be judged by pixels [%]."""
    shown = large = 0
    for pose in poses:
        cells = project(pose.to_camera(region.corners_A), camera)
        candidate = cells.in_picture & faces_camera(region, pose)
        _, inradius = cells.pixels(WHOLE_PICTURE, camera.resolution_px)
        shown += int(candidate.sum())
        large += int((candidate & cells.ahead & (inradius >= MIN_INRADIUS_PX)).sum())
    return 100.0 * large / max(shown, 1)


def reference(
    shape: ShapeModel, region: TargetRegion, camera: CameraModel, poses: Sequence[CameraPose]
) -> tuple[Array, str]:
    """Seen share in each picture, shape (pictures,), and in words what it is found with."""
    if find_spec("shapely") is not None and len(shape.faces) <= CLIPPED_FACES:
        mesh = shape.vertices[shape.faces]
        areas = [visible_areas(region.corners_A, mesh, p.r_A, p.C_CA, camera.half_angle_deg).sum() for p in poses]
        return np.array(areas) / region.total_area, "from exact polygon clipping"
    samples = next(samples for limit, samples in RAYS if region.n_cells <= limit)
    return judged(RayCastObserver(region, camera, samples=samples), poses), f"from {samples} rays a face"


def rms_error_percent(shares: Array, truth: Array) -> float:
    """Root mean square of the pictures' errors [% of the target]."""
    return 100.0 * float(np.sqrt(np.mean((shares - truth) ** 2)))
