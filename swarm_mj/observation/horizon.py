"""The constant-time observer: horizon maps, computed once per target and kept on disk, up to a bound.

Seen from a point on the surface, the body hides the sky up to a horizon that depends on azimuth. Outside the body's bounding
sphere whether a camera sees the point is a matter of direction alone: it does where it stands above that horizon.
A look-up then answers in a time that does not depend on the number of faces. Inside the sphere, where a flyby can pass, a rise
beyond the camera must not count: what the map shows is seen for certain, what it hides is asked again with a ray.

The map of a cell holds the highest blocked elevation above the cell's own plane in each azimuth bin, at each of its sample
points, found with rays: a coarse scan from the zenith down, then bisection. Between two azimuths the higher horizon counts, so
that errors hide rather than show.
"""

from __future__ import annotations

from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swarm_mj.compilation import allocation_free, kernel
from swarm_mj.io.cache import cache_folder, hash_of, load_array, store_array
from swarm_mj.mission.target import TargetRegion
from swarm_mj.observation.camera import CameraModel, CameraPose, Optics, camera_pose, in_field_of_view
from swarm_mj.observation.raytracing import RayTracer
from swarm_mj.observation.sampling import barycentric_samples, hits_own_face
from swarm_mj.spacecraft.attitude.algebra import Vector, dot, vector
from swarm_mj.typing import Array, Array32, Mask

#: Azimuth bins of a map; the widest gap between two is 2.8 deg.
AZIMUTHS = 128
#: Elevations of the coarse scan, and bisections after it: 90 deg / 8 / 2^6 is 0.2 deg.
SCAN, BISECTIONS = 8, 6
#: Sample points per cell by number of cells: the product, and with it time and memory of the maps, stays bounded. Odd numbers,
#: because "half of them" is then neither met by less than half of the cell nor missed by more: no bias where half decides.
SAMPLES = ((3_000, 25), (12_000, 9), (10**9, 1))
#: Rays start this far above the surface, relative to the body's largest radius.
LIFT = 1e-7
#: Rays traced at once; bounds the memory.
BATCH = 400_000
#: Maps of all targets that are kept on disk together, those used last [bytes].
MAX_CACHE_BYTES = 512 * 2**20
#: Raise when the meaning of a stored map changes.
MAP_VERSION = 1
#: What a look at a sample point finds.
OUTSIDE, BLOCKED, SHOWN = 0, 1, 2


class HorizonMap:
    """The horizon of every sample point of a target.

    Args:
        region: The target.
        samples: Points per cell, a square number.
        tracer: Ray tracer over the region's mesh.

    Attributes:
        region: The target.
        points: Sample points in A, shape (n, samples, 3) [m].
        axes: Two tangents and the normal of every cell in A, as rows, shape (n, 3, 3).
        sine: Sine of the horizon's elevation by azimuth, shape (n, samples, azimuths + 1); the last repeats the first.
        highest: The largest of those, shape (n, samples).
    """

    def __init__(self, region: TargetRegion, *, samples: int = 16, tracer: RayTracer) -> None:
        self.region, self.tracer = region, tracer
        self.points = np.ascontiguousarray(barycentric_samples(samples) @ region.corners_A)
        self.axes = _local_axes(region.normal_A)
        self.sine = np.ascontiguousarray(self._sine())
        self.highest = self.sine.max(axis=2)

    def _sine(self) -> Array32:
        """Trace `sine`, or find it on disk."""
        region, shape = self.region, (*self.points.shape[:2], AZIMUTHS + 1)
        key = hash_of(f"{MAP_VERSION} {AZIMUTHS} {SCAN} {BISECTIONS}", self.points, region.vertices, region.faces)
        file = cache_folder() / "horizons" / f"{key}.npy"
        kept = load_array(file, shape)
        if kept is not None:
            return kept
        sine = np.empty(shape, np.float32)
        cells = max(1, BATCH // (shape[1] * AZIMUTHS))
        for start in range(0, shape[0], cells):
            part = slice(start, min(start + cells, shape[0]))
            sine[part, :, :AZIMUTHS] = self._trace(part)
        sine[..., AZIMUTHS] = sine[..., 0]
        store_array(file, sine, folder_bytes=MAX_CACHE_BYTES)
        return sine

    def _trace(self, part: slice) -> Array:
        axes, points = self.axes[part], self.points[part]
        azimuth = 2.0 * np.pi * np.arange(AZIMUTHS) / AZIMUTHS
        level = np.cos(azimuth)[None, :, None] * axes[:, None, 0] + np.sin(azimuth)[None, :, None] * axes[:, None, 1]
        start = points + LIFT * self.region.mesh.max_radius * axes[:, None, 2]
        shape = (len(points), points.shape[1], AZIMUTHS)
        origin = np.broadcast_to(start[:, :, None], (*shape, 3))
        flat = np.broadcast_to(level[:, None], (*shape, 3))
        zenith = np.broadcast_to(axes[:, None, None, 2], (*shape, 3))

        def blocked(elevation: Array, where: Mask) -> Mask:
            e = elevation[where][:, None]
            return self.tracer.first_hit(origin[where], np.cos(e) * flat[where] + np.sin(e) * zenith[where]) >= 0

        # From the zenith down to the first blocked level; what is open all the way has its horizon at the cell's own plane.
        low, high = np.zeros(shape), np.full(shape, 0.5 * np.pi)
        searching = np.ones(shape, np.bool_)
        for k in range(SCAN - 1, -1, -1):
            elevation = np.full(shape, 0.5 * np.pi * (k + 0.02) / SCAN)
            hit = np.zeros(shape, np.bool_)
            hit[searching] = blocked(elevation, searching)
            low[hit] = elevation[hit]
            searching &= ~hit
            high[searching] = elevation[searching]
        found = ~searching
        for _ in range(BISECTIONS):
            middle = 0.5 * (low + high)
            hit = np.zeros(shape, np.bool_)
            hit[found] = blocked(middle, found)
            low[hit] = middle[hit]
            high[found & ~hit] = middle[found & ~hit]
        return np.where(found, np.sin(high), 0.0)

    @property
    def samples(self) -> int:
        """Sample points of a cell."""
        return self.points.shape[1]

    @property
    def arrays(self) -> Horizon:
        """For kernels."""
        return Horizon(self.points, self.axes, self.sine, self.highest)


class HorizonObserver:
    """Share of each cell in view, by horizon maps.

    Args:
        region: The target.
        camera: The camera; its resolution plays no part here.
        samples: Points per cell, a square number; None takes 25, and fewer where the cells are many and therefore small.
    """

    name = "horizon"
    note = "horizon maps, constant time per picture"
    occlusion = True
    counts_pixels = False

    def __init__(self, region: TargetRegion, camera: CameraModel, *, samples: int | None = None) -> None:
        self.region, self.camera = region, camera
        if samples is None:
            samples = next(samples for limit, samples in SAMPLES if region.n_cells <= limit)
        self.horizon = HorizonMap(region, samples=samples, tracer=self.tracer)

    @property
    def samples(self) -> int:
        """Sample points of each cell."""
        return self.horizon.samples

    @cached_property
    def tracer(self) -> RayTracer:
        """Ray tracer over the region's mesh, built at first use."""
        return RayTracer(self.region.vertices, self.region.faces)

    def visible_fraction(self, r_A: ArrayLike, C_CA: ArrayLike) -> Array:
        """Share of each cell in view, see `Observer.visible_fraction`."""
        pose, maps = camera_pose(r_A, C_CA), self.horizon
        answer, share, inside = look_at_all(
            maps.arrays, pose.r_A, pose.C_CA, self.camera.optics, self.region.mesh.max_radius
        )
        if not inside:
            return np.asarray(share)
        seen, doubtful = answer == SHOWN, answer == BLOCKED
        if doubtful.any():
            seen[doubtful] = self._reached(pose, doubtful)
        return np.asarray(seen.mean(axis=1))

    def _reached(self, pose: CameraPose, doubtful: Mask) -> Mask:
        """Whether rays from the camera reach sample points that the map would hide."""
        hit = self.tracer.first_hit(pose.r_A, self.horizon.points[doubtful] - pose.r_A)
        return hits_own_face(self.region, hit, np.nonzero(doubtful)[0])

    def close(self) -> None:
        """Nothing to release."""


def _local_axes(normal_A: Array) -> Array:
    """Two tangents and the normal of every cell, as rows, shape (n, 3, 3)."""
    helper = np.where(np.abs(normal_A[:, 2:]) < 0.9, [[0.0, 0.0, 1.0]], [[1.0, 0.0, 0.0]])
    first = np.cross(helper, normal_A)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return np.ascontiguousarray(np.stack((first, np.cross(normal_A, first), normal_A), axis=1))


class Horizon(NamedTuple):
    """A `HorizonMap` for kernels; its attributes say what each member is."""

    points: Array
    axes: Array
    sine: Array32
    highest: Array32


class Sight(NamedTuple):
    """A camera at its place.

    Attributes:
        r_A: Position [m].
        right: To the right in the picture, in A.
        down: Down in the picture, in A.
        ahead: Along the line of sight, in A.
        optics: The field of view.
        inside: Whether it is inside the body's bounding sphere, where the maps may hide what is in view.
    """

    r_A: Vector
    right: Vector
    down: Vector
    ahead: Vector
    optics: Optics
    inside: bool


@allocation_free
def sight_of(r_A: Array, C_CA: Array, optics: Optics, radius: float) -> Sight:
    """A camera at `r_A` [m], shape (3,), turned by `C_CA`, shape (3, 3), by a body within `radius` of its centre [m]."""
    r = (r_A[0], r_A[1], r_A[2])
    return Sight(r, vector(C_CA, 0), vector(C_CA, 1), vector(C_CA, 2), optics, dot(r, r) < radius * radius)


@allocation_free
def look_at_cell(horizon: Horizon, camera: Sight, i: int, needed: int, answer: NDArray[np.int8]) -> tuple[int, int]:
    """Look at the sample points of a cell one after another.

    Args:
        horizon: The maps.
        camera: Who looks.
        i: The cell.
        needed: Stop when so many are in view, or can no longer be; -1: never.
        answer: Receives `SHOWN`, `BLOCKED` by what the map holds, or `OUTSIDE` the picture, of the points looked at, shape
            (samples,).

    Returns:
        How many are shown and how many are blocked.
    """
    points, axes, sine, highest = horizon
    (x, y, z), samples, shown, blocked, possible = camera.r_A, points.shape[1], 0, 0, points.shape[1]
    for s in range(samples):
        way = (x - points[i, s, 0], y - points[i, s, 1], z - points[i, s, 2])
        height = axes[i, 2, 0] * way[0] + axes[i, 2, 1] * way[1] + axes[i, 2, 2] * way[2]
        u, v, w = dot(camera.right, way), dot(camera.down, way), dot(camera.ahead, way)
        if height <= 0.0 or not in_field_of_view(camera.optics, -u, -v, -w):
            answer[s] = OUTSIDE
            possible -= 1
        elif _stands_clear(axes[i], way, height, sine[i, s], highest[i, s]):
            answer[s] = SHOWN
            shown += 1
        else:
            answer[s] = BLOCKED
            blocked += 1
            possible -= 0 if camera.inside else 1
        # Return, not break: Numba then counts no references to the arrays, which would take a tenth of the time.
        if shown == needed or possible < needed:
            return shown, blocked
    return shown, blocked


@allocation_free
def _stands_clear(axes: Array, way: Vector, height: float, sine: Array32, highest: float) -> bool:
    """Whether a direction stands above a horizon; between two azimuths the higher one counts.

    Args:
        axes: Tangents and normal of the cell as rows, shape (3, 3).
        way: The direction in A, of any length.
        height: Its component along the normal, above 0.
        sine: Sine of the horizon's elevation by azimuth, shape (azimuths + 1,).
        highest: The largest of those, which spares the azimuth where the direction stands higher.
    """
    length = np.sqrt(dot(way, way))
    if height > highest * length:
        return True
    x = axes[0, 0] * way[0] + axes[0, 1] * way[1] + axes[0, 2] * way[2]
    y = axes[1, 0] * way[0] + axes[1, 1] * way[1] + axes[1, 2] * way[2]
    azimuth = np.arctan2(y, x) / (2.0 * np.pi) * AZIMUTHS
    if azimuth < 0.0:
        azimuth += AZIMUTHS
    k = min(int(azimuth), AZIMUTHS - 1)
    return bool(height > max(sine[k], sine[k + 1]) * length)


@kernel
def look_at_all(
    horizon: Horizon, r_A: Array, C_CA: Array, optics: Optics, radius: float
) -> tuple[NDArray[np.int8], Array, bool]:
    """Look at all cells; see `sight_of` for the arguments.

    Returns:
        What `look_at_cell` answers of every sample point, shape (n, samples), the share of each cell that is shown, shape (n,),
        and whether the camera is `inside`.
    """
    camera, cells, samples = sight_of(r_A, C_CA, optics, radius), horizon.sine.shape[0], horizon.sine.shape[1]
    answer, share = np.empty((cells, samples), np.int8), np.empty(cells)
    for i in range(cells):
        share[i] = look_at_cell(horizon, camera, i, -1, answer[i])[0] / samples
    return answer, share, camera.inside
