"""One picture by face-ID buffers and by rays to the target, against Embree per pixel.

The peer traces one ray through the centre of every pixel of the same picture and counts the pixels of every face: once with
embreex alone, whose rays are ready in single precision before the clock starts, and once through trimesh, the usual way to
embreex in Python. The face-ID observer draws the whole picture (no cropping), so that all three fill the same pixels; the
share of pixels in which they agree is reported. The ray observer sends 16 rays to each face of the target and needs no
picture. In every round each of them takes the same pictures in turn, as many at a stretch as a spacecraft takes in a minute.
Building meshes, buffers and scenes is not counted. All but the face-ID observer, which draws with Mesa's threads where there
is no GPU, run on one core.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
import trimesh
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from trimesh.ray.ray_pyembree import RayMeshIntersector

from swarm_mj.bench.measure import Row, in_turn, row
from swarm_mj.mission.target import TargetRegion, build_target
from swarm_mj.observation.camera import CameraModel, CameraPose, look_at
from swarm_mj.observation.faceid import FaceIdObserver
from swarm_mj.observation.gl_context import gl_available
from swarm_mj.observation.horizon import HorizonObserver
from swarm_mj.observation.raycast import RayCastObserver
from swarm_mj.smallbody.shape_harmonics import build_eros

#: Frequencies of the geodesic mesh: 8, 32, 72 and 200 thousand faces.
FREQUENCIES = (20, 40, 60, 100)
#: embreex per pixel over face-ID, on the mesh that the paper's swarm is flown with.
TARGET = ">= 25"
ROUNDS, PICTURES, RESOLUTION_PX, HALF_ANGLE_DEG = 7, 6, 512, 21.5


def rows(quick: bool) -> Iterator[Row]:
    """All of it, and the constant-time observer on a swarm's pictures of one instant."""
    available, renderer = gl_available()
    if available:
        for frequency in FREQUENCIES[:1] if quick else FREQUENCIES:
            yield from _picture_rows(frequency, 3 if quick else ROUNDS, renderer)
    yield _instant_row(5 if quick else 15)


def _picture_rows(frequency: int, rounds: int, renderer: str) -> Iterator[Row]:
    found = measure(frequency, rounds)
    mesh = f"{len(found.region.faces):,} faces"
    note = f"{renderer}; same pixel in {found.agree_percent:.2f} %"
    target = TARGET if frequency == FREQUENCIES[0] else ""
    times = found.times_ms
    yield row("observers", f"face-ID picture, {mesh}", times["face-ID"], "ms")
    yield row(
        "observers", f"embreex per pixel / face-ID, {mesh}", times["embreex"] / times["face-ID"], "ratio", target, note
    )
    yield row("observers", f"embreex through trimesh / face-ID, {mesh}", times["trimesh"] / times["face-ID"], "ratio")
    yield row("observers", f"embreex per pixel / 16 rays a face, {mesh}", times["embreex"] / times["rays"], "ratio")


def _instant_row(rounds: int) -> Row:
    """A target-only observation by the fastest observer with occlusion: 72 faces, 6 spacecraft."""
    region = build_target(build_eros(FREQUENCIES[0]), latitude_deg=0.0, longitude_deg=90.0, half_angle_deg=12.5)
    observer = HorizonObserver(region, CameraModel(half_angle_deg=HALF_ANGLE_DEG, resolution_px=RESOLUTION_PX))
    poses = next(rounds_of_poses(1))

    def look() -> None:
        for pose in poses:
            observer.visible_fraction(pose.r_A, pose.C_CA)

    times = in_turn({"look": look}, rounds, warm_up=2)["look"]
    name = f"horizon maps, {region.n_cells} target faces, {len(poses)} spacecraft"
    return row("observers", name, 1e3 * times, "ms", "<= 1")


@dataclass(frozen=True)
class Measured:
    """Milliseconds of one picture in each round by method, the target, and how many pixels agree [%]."""

    times_ms: dict[str, np.ndarray]
    region: TargetRegion
    agree_percent: float


def measure(frequency: int, rounds: int) -> Measured:
    """One mesh."""
    shape = build_eros(frequency)
    region = build_target(shape, latitude_deg=0.0, longitude_deg=90.0, half_angle_deg=20.0)
    camera = CameraModel(half_angle_deg=HALF_ANGLE_DEG, resolution_px=RESOLUTION_PX)
    faceid, rays = FaceIdObserver(region, camera, crop=False), RayCastObserver(region, camera)
    scene = embree_scene(region)
    usual = RayMeshIntersector(trimesh.Trimesh(region.vertices, region.faces, process=False))
    times, agree = [], []
    for chosen in rounds_of_poses(rounds + 1):
        pixels = [pixel_rays(pose, camera) for pose in chosen]
        works = (
            [partial(faceid.visible_fraction, pose.r_A, pose.C_CA) for pose in chosen],
            [partial(rays.visible_fraction, pose.r_A, pose.C_CA) for pose in chosen],
            [partial(count_pixels, scene.run, *each, region) for each in pixels],
            [partial(count_pixels, usual.intersects_first, *each, region) for each in pixels],
        )
        times.append([milliseconds(work) for work in works])
        agree.append(np.mean(faceid.face_ids(chosen[0]).ravel() == scene.run(*pixels[0]).astype(np.int64) + 1))
    faceid.close()
    timed = np.array(times[1:])  # the first round warms up
    names = ("face-ID", "rays", "embreex", "trimesh")
    return Measured(dict(zip(names, timed.T, strict=True)), region, 100.0 * float(np.mean(agree)))


def rounds_of_poses(rounds: int) -> Iterator[list[CameraPose]]:
    """Cameras 19 to 24 km from the centre within 40 deg of the target's axis, looking at the centre."""
    rng = np.random.default_rng(0)
    for _ in range(rounds):
        poses = []
        for _ in range(PICTURES):
            tilt, azimuth = np.radians(40.0 * np.sqrt(rng.random())), 2.0 * np.pi * rng.random()
            out = np.array([np.sin(tilt) * np.cos(azimuth), np.cos(tilt), np.sin(tilt) * np.sin(azimuth)])
            poses.append(look_at(rng.uniform(19e3, 24e3) * out, [0.0, 0.0, 0.0], roll=2.0 * np.pi * rng.random()))
        yield poses


def embree_scene(region: TargetRegion) -> EmbreeScene:
    """The same mesh in Embree."""
    scene = EmbreeScene()
    TriangleMesh(scene, region.vertices[region.faces].astype(np.float32))
    return scene


def pixel_rays(pose: CameraPose, camera: CameraModel) -> tuple[np.ndarray, np.ndarray]:
    """Origins and directions of the rays through the centres of the pixels, bottom row first, single precision."""
    n = camera.resolution_px
    across = camera.tan_half_angle * ((np.arange(n) + 0.5) * 2.0 / n - 1.0)
    right, up = np.meshgrid(across, across)
    directions = np.stack([right, -up, np.ones_like(up)], axis=-1).reshape(-1, 3) @ pose.C_CA
    origins = np.broadcast_to(pose.r_A, directions.shape)
    return np.ascontiguousarray(origins, np.float32), np.ascontiguousarray(directions, np.float32)


def count_pixels(
    first_hit: Callable[[np.ndarray, np.ndarray], np.ndarray],
    origins: np.ndarray,
    directions: np.ndarray,
    region: TargetRegion,
) -> np.ndarray:
    """Pixels of each cell of the target."""
    hits = first_hit(origins, directions)
    return np.bincount(hits[hits >= 0], minlength=len(region.faces))[region.target]


def milliseconds(works: Sequence[Callable[[], object]]) -> float:
    """Mean wall-clock time of one call [ms]."""
    start = time.perf_counter()
    for work in works:
        work()
    return 1e3 * (time.perf_counter() - start) / len(works)
