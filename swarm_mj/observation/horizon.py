"""The constant-time observer: horizon maps, computed once per target and kept on disk, up to a bound.

Seen from a point on the surface, the body hides the sky up to a horizon that depends on azimuth. Outside the body's bounding
sphere whether a camera sees the point is a matter of direction alone: it does where it stands above that horizon.
A look-up then answers in a time that does not depend on the number of faces. Inside the sphere, where a flyby can pass, a rise
beyond the camera must not count: what the map shows is seen for certain, what it hides is asked again with a ray.

The map of a cell holds the highest blocked elevation above the cell's own plane in each azimuth bin, at each of its sample
points: what the half plane of that azimuth cuts off a face stands highest at an edge, or overhead where the face lies above the
point. It is rounded up to a level, so that the last bits of a machine decide nothing, and between two azimuths the higher
horizon counts, so that errors hide rather than show.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swarm_mj.compilation import allocation_free, kernel
from swarm_mj.io import interruption
from swarm_mj.io.cache import cache_folder, hash_of, load_array, store_array
from swarm_mj.mission.target import TargetRegion
from swarm_mj.observation.camera import CameraModel, CameraPose, Optics, camera_pose, in_field_of_view
from swarm_mj.observation.raycast import MeshObserver, barycentric_samples, hits_own_face
from swarm_mj.smallbody.shape import directed_edges
from swarm_mj.spacecraft.attitude.algebra import Vector, dot, vector
from swarm_mj.typing import Array, Array32, Ints, Ints32, Mask

#: Azimuth bins of a map; the widest gap between two is 2.8 deg.
AZIMUTHS = 128
#: Levels of elevation above the lowest, at `LOWEST` of the first of `SCAN` parts of 90 deg; 90 deg / 8 / 64 is 0.2 deg.
SCAN, LEVELS, LOWEST = 8, 64, 0.02
#: Sample points per cell by number of cells: the product, and with it time and memory of the maps, stays bounded. Odd numbers,
#: because "half of them" is then neither met by less than half of the cell nor missed by more: no bias where half decides.
SAMPLES = ((3_000, 25), (12_000, 9), (10**9, 1))
#: Sample points are this far above the surface, relative to the body's largest radius.
LIFT = 1e-7
#: Maps of all targets that are kept on disk together, those used last [bytes].
MAX_CACHE_BYTES = 512 * 2**20
#: Raise when the meaning of a stored map changes.
MAP_VERSION = 2
#: What a look at a sample point finds.
OUTSIDE, BLOCKED, SHOWN = 0, 1, 2


class HorizonMap:
    """The horizon of every sample point of a target.

    Args:
        region: The target.
        samples: Points per cell, a square number.

    Attributes:
        region: The target.
        points: Sample points in A, shape (n, samples, 3) [m].
        axes: Two tangents and the normal of every cell in A, as rows, shape (n, 3, 3).
        sine: Sine of the horizon's elevation by azimuth, shape (n, samples, azimuths + 1); the last repeats the first.
        highest: The largest of those, shape (n, samples).
    """

    def __init__(self, region: TargetRegion, *, samples: int = 16) -> None:
        self.region = region
        self.points = np.ascontiguousarray(barycentric_samples(samples) @ region.corners_A)
        self.axes = _local_axes(region.normal_A)
        self.sine = np.ascontiguousarray(self._sine())
        self.highest = self.sine.max(axis=2)

    def _sine(self) -> Array32:
        """Compute `sine`, or find it on disk."""
        region, shape = self.region, (*self.points.shape[:2], AZIMUTHS + 1)
        key = hash_of(f"{MAP_VERSION} {AZIMUTHS} {SCAN} {LEVELS} {LOWEST}", self.points, region.vertices, region.faces)
        file = cache_folder() / "horizons" / f"{key}.npy"
        kept = load_array(file, shape)
        if kept is not None:
            return kept
        sine, lift = np.empty(shape, np.float32), LIFT * region.mesh.max_radius
        skyline = _Skyline(region.vertices, region.faces)
        for cell, points, axes in zip(sine, self.points, self.axes, strict=True):
            interruption.check()
            cell[:, :AZIMUTHS] = _sine_of_level(skyline.slopes(points, axes, lift))
        sine[..., AZIMUTHS] = sine[..., 0]
        store_array(file, sine, folder_bytes=MAX_CACHE_BYTES)
        return sine

    @property
    def samples(self) -> int:
        """Sample points of a cell."""
        return self.points.shape[1]

    @property
    def arrays(self) -> Horizon:
        """For kernels."""
        return Horizon(self.points, self.axes, self.sine, self.highest)


class HorizonObserver(MeshObserver):
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
        self.horizon = HorizonMap(region, samples=samples)

    @property
    def samples(self) -> int:
        """Sample points of each cell."""
        return self.horizon.samples

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


class _Skyline:
    """What stands above planes of a triangle mesh in A [m], by azimuth."""

    def __init__(self, vertices: Array, faces: Ints32) -> None:
        self._vertices, self._faces = vertices, faces
        self._edges, which = np.unique(np.sort(directed_edges(faces), axis=1), axis=0, return_inverse=True)
        order = np.argsort(which.ravel(), kind="stable")  # puts the sides of an edge beside each other, one or two
        first = np.searchsorted(which.ravel()[order], np.arange(len(self._edges)))
        last = np.append(first[1:], len(order)) - 1
        face = np.repeat(np.arange(len(faces)), 3)[order]
        self._beside = np.stack((face[first], np.where(last > first, face[last], -1)), axis=1)

    def slopes(self, points: Array, axes: Array, lift: float) -> Array:
        """Tangents of the highest blocked elevation by azimuth, 0 where nothing is, shape (samples, azimuths).

        Args:
            points: In A, all in the plane of the cell, shape (samples, 3) [m].
            axes: Two tangents and the normal of the cell as rows, shape (3, 3).
            lift: Height above the plane from which it is looked [m].
        """
        local = (self._vertices - points[0]) @ axes.T - (0.0, 0.0, lift)
        above, found = local[:, 2] > 0.0, np.zeros((len(points), AZIMUTHS))
        high = np.flatnonzero(above[self._faces].any(axis=1))
        borders = np.flatnonzero(above[self._edges].any(axis=1))
        front = np.zeros(len(self._faces), np.bool_)
        mesh = (self._faces, self._edges, self._beside, high, borders, front)
        _raise_slopes((points - points[0]) @ axes[:2].T, local, *mesh, found)
        return found


@kernel
def _raise_slopes(
    points: Array,
    local: Array,
    faces: Ints32,
    edges: Ints32,
    beside: Ints,
    high: Ints,
    borders: Ints,
    front: Mask,
    slope: Array,
) -> None:
    """Raise tangents of elevation, shape (samples, azimuths), around points (samples, 2) of the plane z = 0 by faces above it.

    Only edges between a face that turns its front to the point and one that does not are looked at: elsewhere the mesh goes on
    higher up.
    """
    for s in range(points.shape[0]):
        x, y = points[s, 0], points[s, 1]
        for f in high:
            volume, overhead = _seen_from(local, faces[f], x, y)
            front[f] = volume < 0.0
            if overhead:
                slope[s, :] = np.inf
        for e in borders:
            one, other = beside[e, 0], beside[e, 1]
            if other < 0 or front[one] != front[other]:
                a, b = edges[e, 0], edges[e, 1]
                start = (local[a, 0] - x, local[a, 1] - y, local[a, 2])
                _raise_by_edge(start, (local[b, 0] - x, local[b, 1] - y, local[b, 2]), slope[s])


@allocation_free
def _raise_by_edge(a: Vector, b: Vector, slope: Array) -> None:
    """Raise tangents of elevation by azimuth to those of an edge from `a` to `b`, seen from the origin with z upwards."""
    turn = a[0] * b[1] - a[1] * b[0]
    if turn < 0.0:
        a, b, turn = b, a, -turn
    if turn == 0.0:
        return
    # Counter-clockwise from a to b, by less than half a turn.
    first = np.arctan2(a[1], a[0]) / (2.0 * np.pi) * AZIMUTHS
    last = np.arctan2(b[1], b[0]) / (2.0 * np.pi) * AZIMUTHS
    if last < first:
        last += AZIMUTHS
    for k in range(int(np.ceil(first)), int(np.floor(last)) + 1):
        c, s = np.cos(2.0 * np.pi * k / AZIMUTHS), np.sin(2.0 * np.pi * k / AZIMUTHS)
        # Weights of the ends where the half plane cuts the edge; its distance times their sum is `turn`.
        to_a, to_b = b[1] * c - b[0] * s, a[0] * s - a[1] * c
        height = to_a * a[2] + to_b * b[2]
        slope[k % AZIMUTHS] = max(slope[k % AZIMUTHS], height / turn)


@allocation_free
def _seen_from(local: Array, face: Ints32, x: float, y: float) -> tuple[float, bool]:
    """The determinant of a face's corners seen from a point of the plane z = 0, and whether the face stands above it."""
    volume, least, most = 0.0, np.inf, -np.inf
    for k in range(3):
        a, b, c = face[k], face[(k + 1) % 3], face[(k + 2) % 3]
        weight = (local[b, 0] - x) * (local[c, 1] - y) - (local[b, 1] - y) * (local[c, 0] - x)
        least, most = min(least, weight), max(most, weight)
        volume += weight * local[a, 2]
    return volume, least >= 0.0 and volume > 0.0 or most <= 0.0 and volume < 0.0


def _sine_of_level(slope: Array) -> Array32:
    """Sines of elevations rounded up to levels, 0 below the lowest, of tangents (...,)."""
    part = np.arctan(slope) / (0.5 * np.pi) * SCAN - LOWEST
    low = np.clip(np.floor(part), 0, SCAN - 1)
    high = np.where(low < SCAN - 1, low + 1.0, SCAN - LOWEST)
    level = low + (high - low) * np.ceil((part - low) / (high - low) * LEVELS) / LEVELS + LOWEST
    return np.where(part > 0.0, np.sin(0.5 * np.pi / SCAN * level), 0.0).astype(np.float32)


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
    """Whether a direction of some height above 0 stands above a horizon; between two azimuths the higher one counts.

    The highest sine of the horizon's elevation spares the azimuth where the direction stands higher.
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
