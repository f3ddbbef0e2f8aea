"""The ray-casting observer: sample points on every cell, one ray each. For machines without GL, and as a cross-check."""

from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from swarm_mj.mission.target import TargetRegion
from swarm_mj.observation.camera import CameraModel, camera_pose
from swarm_mj.observation.raytracing import RayTracer
from swarm_mj.observation.sampling import barycentric_samples, sampled_fraction
from swarm_mj.typing import Array


class RayCastObserver:
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

    @cached_property
    def tracer(self) -> RayTracer:
        """Ray tracer over the region's mesh, built at first use."""
        return RayTracer(self.region.vertices, self.region.faces)

    def visible_fraction(self, r_A: ArrayLike, C_CA: ArrayLike) -> Array:
        """Share of each cell in view, see `Observer.visible_fraction`."""
        pose = camera_pose(r_A, C_CA)
        tracer = self.tracer if self.occlusion else None
        return sampled_fraction(tracer, self.region, self._all, self.camera, pose, self.samples)

    def close(self) -> None:
        """Nothing to release."""
