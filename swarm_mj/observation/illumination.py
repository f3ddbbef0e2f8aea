"""Which cells the Sun lights, frame A. The Sun is a point at infinity; only the body itself casts shadows."""

import numpy as np
from numpy.typing import ArrayLike

from swarm_mj.errors import MissionError
from swarm_mj.mission.target import TargetRegion
from swarm_mj.observation.raytracing import RayTracer
from swarm_mj.observation.sampling import barycentric_samples
from swarm_mj.typing import Array, Mask

#: Shadow rays start this far off the surface, over the body's largest radius, so as not to meet the cell itself.
LIFT = 1e-5


def incidence(region: TargetRegion, sun_A: ArrayLike) -> Array:
    """Angle between each cell's normal and the direction to the Sun [rad], shape (n,).

    Args:
        region: The target.
        sun_A: Direction to the Sun in A, of any length, shape (3,).

    Raises:
        MissionError: The direction is not three finite numbers, or zero.
    """
    return np.arccos(np.clip(region.normal_A @ _unit(sun_A), -1.0, 1.0))


def lit(
    region: TargetRegion,
    sun_A: ArrayLike,
    *,
    max_incidence_deg: float = 90.0,
    tracer: RayTracer | None = None,
    samples: int = 16,
) -> Mask:
    """Tell which cells are lit, shape (n,).

    Args:
        region: The target.
        sun_A: Direction to the Sun in A, of any length, shape (3,).
        max_incidence_deg: Largest angle between normal and Sun at which a cell counts as lit [deg].
        tracer: Ray tracer over the region's mesh, to have shadows: a cell is lit when at least half of its sample
            points see the Sun. None ignores shadows.
        samples: Sample points per cell, a square number.

    Raises:
        MissionError: The direction is not three finite numbers, or zero; or `samples` is not a square number.
    """
    sun = _unit(sun_A)
    angle = incidence(region, sun)
    result = (angle < np.pi / 2.0) & (angle <= np.radians(max_incidence_deg))
    if tracer is None or not result.any():
        return result
    chosen = np.flatnonzero(result)
    lift = LIFT * region.mesh.max_radius * region.normal_A[chosen, None]
    points = (barycentric_samples(samples) @ region.corners_A[chosen] + lift).reshape(-1, 3)
    free = tracer.first_hit(points, np.broadcast_to(sun, points.shape)) < 0
    result[chosen] = free.reshape(len(chosen), samples).mean(axis=1) >= 0.5
    return result


def _unit(sun_A: ArrayLike) -> Array:
    sun = np.asarray(sun_A, dtype=np.float64)
    if sun.shape != (3,) or not np.isfinite(sun).all() or not sun.any():
        raise MissionError(f"direction to the Sun must be three finite numbers, not all zero, got {sun_A!r}")
    return sun / np.linalg.norm(sun)
