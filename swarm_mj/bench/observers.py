"""One picture by face-ID buffers and by rays to the target, against Embree per pixel.

The peer traces one ray through the centre of every pixel of the same picture and counts the pixels of every face: once with
embreex alone, whose rays are ready in single precision before the clock starts, and once through trimesh, the usual way to
embreex in Python. The face-ID observers, drawn by OpenGL and by compiled code, draw the whole picture (no cropping), so that
all fill the same pixels; the share of pixels in which they agree is reported. The ray observer sends 16 rays to each face of
the target and needs no picture. In every round each of them takes the same pictures in turn, as many at a stretch as a
spacecraft takes in a minute. Building meshes, buffers and scenes is not counted. All run on one core but OpenGL, which draws
on the GPU or with Mesa's threads.
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
from swarm_mj.observation.faceid import Drawing, FaceIdObserver
from swarm_mj.observation.gl_context import gl_available
from swarm_mj.observation.horizon import HorizonObserver
from swarm_mj.observation.observer import Observer
from swarm_mj.observation.raycast import RayCastObserver
from swarm_mj.smallbody.shape_harmonics import build_eros

#: Frequencies of the geodesic mesh: 8, 32, 72 and 200 thousand faces.
FREQUENCIES = (20, 40, 60, 100)
#: embreex per pixel over face-ID, on the mesh that the paper's swarm is flown with.
TARGET = ">= 25"
#: How the ways of drawing are called.
DRAWINGS: dict[Drawing, str] = {"opengl": "OpenGL", "compiled": "compiled code"}
ROUNDS, PICTURES, RESOLUTION_PX, HALF_ANGLE_DEG = 7, 6, 512, 21.5


def rows(quick: bool) -> Iterator[Row]:
    """All of it, and the constant-time observer on a swarm's pictures of one instant."""
    for frequency in FREQUENCIES[:1] if quick else FREQUENCIES:
        yield from _picture_rows(frequency, 3 if quick else ROUNDS)
    yield _instant_row(5 if quick else 15)


def _picture_rows(frequency: int, rounds: int) -> Iterator[Row]:
    found = measure(frequency, rounds)
    mesh = f"{len(found.region.faces):,} faces"
    target = TARGET if frequency == FREQUENCIES[0] else ""
    times = found.times_ms
    for drawing, agree_percent in found.agree_percent.items():
        name = f"face-ID by {DRAWINGS[drawing]}"
        by = gl_available()[1] if drawing == "opengl" else "one core"
        note = f"{by}; same pixel in {agree_percent:.2f} %"
        yield row("observers", f"{name}, {mesh}", times[drawing], "ms")
        yield row(
            "observers", f"embreex per pixel / {name}, {mesh}", times["embreex"] / times[drawing], "ratio", target, note
        )
        yield row("observers", f"embreex through trimesh / {name}, {mesh}", times["trimesh"] / times[drawing], "ratio")
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
    """Milliseconds of one picture in each round by method, the target, and how many pixels agree by drawing [%]."""

    times_ms: dict[str, np.ndarray]
    region: TargetRegion
    agree_percent: dict[Drawing, float]


def measure(frequency: int, rounds: int) -> Measured:
    """One mesh."""
    shape = build_eros(frequency)
    region = build_target(shape, latitude_deg=0.0, longitude_deg=90.0, half_angle_deg=20.0)
    camera = CameraModel(half_angle_deg=HALF_ANGLE_DEG, resolution_px=RESOLUTION_PX)
    drawings: list[Drawing] = ["opengl", "compiled"] if gl_available()[0] else ["compiled"]
    drawn = {d: FaceIdObserver(region, camera, crop=False, drawing=d) for d in drawings}
    observers: dict[str, Observer] = {"rays": RayCastObserver(region, camera)}
    observers.update({drawing: drawn[drawing] for drawing in drawings})
    scene = embree_scene(region)
    usual = RayMeshIntersector(trimesh.Trimesh(region.vertices, region.faces, process=False))
    times: dict[str, list[float]] = {name: [] for name in (*observers, "embreex", "trimesh")}
    agree: dict[Drawing, list[float]] = {drawing: [] for drawing in drawings}
    for chosen in rounds_of_poses(rounds + 1):
        pixels = [pixel_rays(pose, camera) for pose in chosen]
        for name, observer in observers.items():
            times[name].append(milliseconds([partial(observer.visible_fraction, p.r_A, p.C_CA) for p in chosen]))
        for name, cast in (("embreex", scene.run), ("trimesh", usual.intersects_first)):
            times[name].append(milliseconds([partial(count_pixels, cast, *each, region) for each in pixels]))
        hit = scene.run(*pixels[0]).astype(np.int64) + 1
        for drawing, observer in drawn.items():
            agree[drawing].append(float(np.mean(observer.face_ids(chosen[0]).ravel() == hit)))
    for observer in observers.values():
        observer.close()
    # The first round warms up.
    return Measured(
        {name: np.array(found[1:]) for name, found in times.items()},
        region,
        {drawing: 100.0 * float(np.mean(found)) for drawing, found in agree.items()},
    )


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
