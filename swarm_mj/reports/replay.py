"""The flight in the body-fixed frame A at the instants that the replay shows, ready for the page's script.

Positions in kilometres. With the rotations from N to A the script draws it in inertial axes as well.
"""

from __future__ import annotations

import base64
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarm_mj.figures.units import shown_spacecraft
from swarm_mj.flight.environment import companion_from
from swarm_mj.flight.fly import asteroid_attitudes
from swarm_mj.flight.observe import camera_from, flown_cameras, watching_in
from swarm_mj.mission.behaviors import TargetKind
from swarm_mj.observation.camera import CameraModel
from swarm_mj.observation.capture import watching
from swarm_mj.observation.coverage import CoverageMap
from swarm_mj.observation.raycast import RayTracer
from swarm_mj.records.modes import LOST
from swarm_mj.records.passage import encounter
from swarm_mj.records.run_record import RunRecord
from swarm_mj.scenarios.itinerary import last_arrival_s
from swarm_mj.smallbody.simplify import simplify
from swarm_mj.spacecraft.attitude.mrp import dcm
from swarm_mj.spacecraft.properties import RPM
from swarm_mj.typing import Array, Indices, Ints, Mask

KM = 1e3
#: Length of a line of sight that ends at nothing near, over the distance of the farthest spacecraft.
FREE_AXIS = 0.6
#: Rays along one side of a picture's border.
RAYS_PER_SIDE = 5


@dataclass(frozen=True, kw_only=True)
class Limits:
    """How much of a run a page shows."""

    samples: int = 1_500  # instants
    values: int = 80_000  # instants times spacecraft
    spacecraft: int = 800
    faces: int = 16_000  # of the body, and cells of the target
    rays: int = 400_000  # instants times rays of the pictures' borders


@dataclass(frozen=True, kw_only=True)
class Replay:
    """What the replay shows of a run.

    Attributes:
        samples: Numbers of the telemetry's samples, shape (K,).
        times: Their times, shape (K,) [s].
        shown: Numbers of the spacecraft, shape (n,).
        pointing_deg: Pointing error, NaN once lost or while aboard, shape (K, n) [deg].
        wheel_rpm: Speed of the fastest wheel, shape (K, n) [rpm].
        pointing_peak_deg: The largest of all samples since the instant before, the same, shape (K, n) [deg].
        wheel_peak_rpm: The same of the wheels, shape (K, n) [rpm].
        mode: What +z tracks, or that the spacecraft is lost, as `modes_shown` tells, shape (K, n).
        link: Whether the link is closed, shape (K, n).
        percent: Observed share of the target by the scenario's criterion, shape (K,) [%].
        percent_passage: The same over the whole passage, shape (K,) [%].
        percent_by: The share that each spacecraft observed by the scenario's criterion, shape (K, n) [%].
        percent_by_passage: The same over the whole passage, shape (K, n) [%].
        scene: Arrays of the 3-D picture by name.
    """

    samples: Indices
    times: Array
    shown: Indices
    pointing_deg: Array
    wheel_rpm: Array
    pointing_peak_deg: Array
    wheel_peak_rpm: Array
    mode: NDArray[np.int8]
    link: NDArray[np.int8]
    percent: Array
    percent_passage: Array
    percent_by: Array
    percent_by_passage: Array
    scene: dict[str, Any]

    @property
    def rows(self) -> Indices:
        """Places in `shown` of the spacecraft that tables and plots have a row for, those of the figures, shape (r,)."""
        return shown_spacecraft(len(self.shown))


def make_replay(run: RunRecord, limits: Limits) -> Replay:
    """Pick what a page shows of a run."""
    shown = shown_spacecraft(run.n, limits.spacecraft)
    samples = choose_samples(run, min(limits.samples, max(60, limits.values // len(shown))))
    telemetry, times = run.telemetry, run.times[samples]
    mode = run.mode[np.ix_(samples, shown)]
    pointing_deg = np.degrees(telemetry["pointing_error"].values[:, shown])
    wheel_rpm = np.abs(telemetry["wheel_speed"].values[:, shown] / RPM).max(axis=2)
    area = run.weighted_area
    by, by_passage = (run.coverage[name] for name in ("first_seen_by_s", "first_seen_by_s_passage"))
    swarm, passage = _coverage(area, by), _coverage(area, by_passage)
    return Replay(
        samples=samples,
        times=times,
        shown=shown,
        pointing_deg=np.where(mode >= LOST, np.nan, pointing_deg[samples]),
        wheel_rpm=wheel_rpm[samples],
        pointing_peak_deg=np.where(mode >= LOST, np.nan, _peaks(pointing_deg, samples)),
        wheel_peak_rpm=_peaks(wheel_rpm, samples),
        mode=mode,
        link=telemetry["link_closed"].values[np.ix_(samples, shown)].astype(np.int8),
        percent=swarm.percent_over_time(times),
        percent_passage=passage.percent_over_time(times),
        percent_by=_shares(area, by[shown], times),
        percent_by_passage=_shares(area, by_passage[shown], times),
        scene=_scene(run, samples, shown, mode, limits),
    )


def choose_samples(run: RunRecord, count: int) -> Indices:
    """Numbers of at most about `count` samples, evenly spaced, with the arrival and the last one among them.

    Where the body is passed in a small part of the flight, half of them lie there.
    """
    total, near = len(run.times), _encounter(run)
    arrival = int(np.argmin(np.abs(run.times - last_arrival_s(run.scenario))))
    parts = [slice(0, total)] if near is None else [slice(0, total), near]
    even = [
        k for part in parts for k in range(part.start, part.stop, -(-len(parts) * (part.stop - part.start) // count))
    ]
    return np.unique([*even, arrival, total - 1]).astype(np.intp)


def _encounter(run: RunRecord) -> slice | None:
    corners = np.vstack((run.coverage["body_vertices"], run.coverage["vertices"]))
    radius = float(np.linalg.norm(corners, axis=1).max())
    return encounter(run.times, run.telemetry["r_BN_N"].values, last_arrival_s(run.scenario), radius)


def _coverage(area: Array, first_seen_by_s: Array) -> CoverageMap:
    coverage = CoverageMap(area, len(first_seen_by_s))
    coverage.first_seen_by_s = first_seen_by_s
    return coverage


def _shares(area: Array, first_seen_by_s: Array, times: Array) -> Array:
    """Share of the target that each spacecraft has observed by each time, shape (K, n) [%]."""
    return np.column_stack([_coverage(area, row[None]).percent_over_time(times) for row in first_seen_by_s])


def _peaks(values: Array, samples: Indices) -> Array:
    """Largest value since the chosen sample before, so that thinning hides no peak."""
    starts = np.append(0, samples[:-1] + 1)
    return np.asarray(np.maximum.reduceat(values, starts, axis=0))


def _scene(run: RunRecord, samples: Indices, shown: Indices, mode: NDArray[np.int8], limits: Limits) -> dict[str, Any]:
    """Meshes, positions, attitudes, line lengths and directions to Sun and Earth, all in A."""
    coverage, telemetry = run.coverage, run.telemetry.isel(time=samples)
    target = simplify(coverage["vertices"], coverage["faces"], limits.faces)
    seam = target.vertices if len(target.kept) == len(coverage["faces"]) else None
    body = simplify(coverage["body_vertices"], coverage["body_faces"], limits.faces, fixed=seam)
    vertices = np.vstack((body.vertices, target.vertices))
    faces = np.vstack((body.faces, target.faces + len(body.vertices)))
    C_AN = asteroid_attitudes(telemetry)
    r_A = np.einsum("kij,knj->kni", C_AN, telemetry["r_BN_N"].values)
    C_NA = np.swapaxes(C_AN, 1, 2)
    C_BA = dcm(telemetry["sigma_BN"].values[:, shown]) @ C_NA[:, None]
    C_CA = C_BA
    if not run.scenario.camera.as_the_body:  # a gimbal's angle hangs on all samples before
        C_CA = flown_cameras(run.scenario, run.telemetry)[0][np.ix_(samples, shown)] @ C_NA[:, None]
    # The camera looks at the body; +z at all else.
    looks = watching(run.n, mode, turns=run.scenario.camera.gimbal is not None)
    z_A = np.where(looks[..., None], C_CA[..., 2, :], C_BA[..., 2, :])
    reach = np.maximum(np.linalg.norm(r_A, axis=2).max(axis=1), np.linalg.norm(vertices, axis=1).max())
    ground = _Ground(vertices, faces)
    # First and last of the instants shown that are near the body; of all where it is passed in no small part of the flight.
    passed = _encounter(run) or slice(0, len(run.times))
    near = np.flatnonzero((samples >= passed.start) & (samples < passed.stop))
    tracked = telemetry["tracked_spacecraft"].values[:, shown]
    length = _lengths(ground, r_A, shown, z_A, looks, mode, tracked, FREE_AXIS * reach[:, None])
    scene = {
        "body_vertices": f32(body.vertices / KM),
        "body_faces": packed(body.faces.astype(np.int32)),
        "target_vertices": f32(target.vertices / KM),
        "target_faces": packed(target.faces.astype(np.int32)),
        "target_kept": target.kept,
        "r": f32(r_A[:, shown] / KM),
        "z": f32(z_A),
        "length": f32(length / KM),
        "sun": f32(_directions(C_AN, run.telemetry.attrs["sun_N_m"])),
        "earth": f32(_directions(C_AN, run.telemetry.attrs["earth_N_m"])),
        "C_AN": f32(C_AN),
        "near": [int(near[0]), int(near[-1])],
    }
    companion = companion_from(run.scenario)
    if companion is not None:
        at = run.times[samples].tolist()
        scene["companion_vertices"] = f32(companion.shape.vertices / KM)
        scene["companion_faces"] = packed(companion.shape.faces.astype(np.int32))
        scene["companion_r"] = f32(np.array([C @ companion.position(t) for C, t in zip(C_AN, at, strict=True)]) / KM)
        # To components in A of those in A2.
        scene["companion_C"] = f32(np.array([(companion.C_AN(t) @ C).T for C, t in zip(C_NA, at, strict=True)]))
    observers = shown[shown < run.n_observers]
    rays = border_rays(camera_from(run.scenario))
    if len(samples) * len(observers) * len(rays) <= limits.rays:
        scene["C"] = f32(C_CA[:, observers])
        scene["rays"] = f32(rays)
        taken = watching_in(run.scenario, telemetry, run.n_observers)[:, observers]
        scene["ray_length"] = f32(_border_lengths(ground, r_A[:, observers], C_CA[:, observers], rays, taken) / KM)
    return scene


class _Ground:
    """The drawn body, for finding where lines of sight end."""

    def __init__(self, vertices: Array, faces: Ints) -> None:
        self._tracer = RayTracer(vertices, faces.astype(np.int32))
        self._origin = vertices[faces[:, 0]]
        edges = vertices[faces[:, 1]] - self._origin, vertices[faces[:, 2]] - self._origin
        self._normal = np.cross(*edges)

    def distance(self, origins: Array, directions: Array) -> Array:
        """Distance along unit directions (n, 3) to the ground, infinite where they miss it, shape (n,) [m]."""
        face = self._tracer.first_hit(origins, directions)
        normal = self._normal[face]
        ahead = np.einsum("ij,ij->i", self._origin[face] - origins, normal)
        return np.where(face >= 0, ahead / np.einsum("ij,ij->i", directions, normal), np.inf)


def _lengths(
    ground: _Ground,
    r_A: Array,
    shown: Indices,
    z_A: Array,
    looks: Mask,
    mode: NDArray[np.int8],
    tracked: NDArray[Any],
    free: Array,
) -> Array:
    """How far to draw each line of sight: to the ground, as far as the spacecraft tracked, or `free` (K, 1) [m], shape (K, n).

    Those of lost spacecraft have no length.
    """
    r = r_A[:, shown]
    length = np.where(mode >= LOST, 0.0, free)
    distance = ground.distance(r[looks], z_A[looks])
    length[looks] = np.where(np.isfinite(distance), distance, np.linalg.norm(r[looks], axis=-1))
    sample, j = np.nonzero((mode == TargetKind.SPACECRAFT) & (tracked >= 0))
    length[sample, j] = np.linalg.norm(r[sample, j] - r_A[sample, tracked[sample, j]], axis=-1)
    return length


def border_rays(camera: CameraModel) -> Array:
    """Unit vectors in C along the border of a picture, in order, the corners at every RAYS_PER_SIDE-th, shape (n, 3)."""
    across = camera.outline(RAYS_PER_SIDE)
    rays = np.column_stack((across, np.ones(len(across))))
    return rays / np.linalg.norm(rays, axis=1, keepdims=True)


def _border_lengths(ground: _Ground, r_A: Array, C_CA: Array, rays: Array, taken: Mask) -> Array:
    """Length of every ray of the borders of pictures that are taken, else or where it misses NaN, shape (K, n, rays) [m]."""
    length = np.full((*r_A.shape[:2], len(rays)), np.nan)
    directions = np.einsum("rb,mba->mra", rays, C_CA[taken]).reshape(-1, 3)
    origins = np.repeat(r_A[taken], len(rays), axis=0)
    distance = ground.distance(origins, directions).reshape(-1, len(rays))
    length[taken] = np.where(np.isfinite(distance), distance, np.nan)
    return length


def _directions(C_AN: Array, position_N: Any) -> Array:
    """Unit vector in A to a body that is so far that the flight does not change where it stands, shape (K, 3)."""
    position = np.asarray(position_N, float)
    return C_AN @ (position / np.linalg.norm(position))


def f32(values: Any) -> dict[str, Any]:
    """An array in single precision for the page's script."""
    return packed(np.asarray(values, np.float32))


def packed(values: NDArray[Any]) -> dict[str, Any]:
    """An array for the page's script: type, shape and base64 of its bytes."""
    little = np.ascontiguousarray(values, dtype=values.dtype.newbyteorder("<"))
    return {
        "type": values.dtype.kind + str(values.dtype.itemsize),
        "shape": list(values.shape),
        "data": base64.b64encode(little.tobytes()).decode("ascii"),
    }
