"""One picture by face-ID buffers and by rays to the target, against Embree per pixel: how long it takes, how true it is.

The peer traces one ray through the centre of every pixel of the same picture and counts the pixels of every face: once with
embreex alone, whose rays are ready in single precision before the clock starts, and once through trimesh, the usual way to
embreex in Python. The face-ID observers, drawn by OpenGL and by compiled code, draw the whole picture (no cropping), so that
all fill the same pixels; the share of pixels in which they agree is reported. Faces that are too small for their pixels to tell
anything, which on fine meshes are nearly all, they sample by rays: the picture alone, drawn and its pixels counted as the peer
counts them, is timed apart. The ray observer sends 16 rays to each face of the target and needs no picture. In every round each
of them takes the same pictures in turn, as many at a stretch as a spacecraft takes in a minute, fewer on the finest mesh.
Building meshes, buffers and scenes is not counted. All run on one core but OpenGL, which draws on the GPU or with Mesa's
threads. Beside the time of each stands its error of the seen share of the target, see `seen_share`: that of pixels is the
same whoever finds the face under them.
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

from benchmarks.measure import Row, in_turn, row
from benchmarks.performance.seen_share import (
    counted_percent,
    judged,
    reference,
    rms_error_percent,
    shares_by_pixels,
)
from swarm_mj.mission.target import TargetRegion, build_target
from swarm_mj.observation.camera import CameraModel, CameraPose, look_at
from swarm_mj.observation.faceid import Drawing, FaceIdObserver
from swarm_mj.observation.gl_context import gl_available
from swarm_mj.observation.horizon import HorizonObserver
from swarm_mj.observation.observer import Observer
from swarm_mj.observation.raycast import RayCastObserver
from swarm_mj.smallbody.shape_harmonics import build_shape

#: Frequencies of the geodesic mesh: 8, 32, 72, 200 and 1,004 thousand faces.
FREQUENCIES = (20, 40, 60, 100, 224)
#: Rounds and pictures in a round, and those of a mesh of this frequency or finer.
ROUNDS, PICTURES = 7, 6
FINEST, ROUNDS_FINEST, PICTURES_FINEST = 200, 3, 3
#: embreex per pixel over face-ID, on the mesh that the paper's swarm is flown with.
TARGET = ">= 25"
#: How the ways of drawing are called.
DRAWINGS: dict[Drawing, str] = {"opengl": "OpenGL", "compiled": "compiled code"}
RESOLUTION_PX, HALF_ANGLE_DEG = 512, 21.5


def rows(quick: bool) -> Iterator[Row]:
    """All of it, and the constant-time observer on a swarm's pictures of one instant."""
    for frequency in FREQUENCIES[:1] if quick else FREQUENCIES:
        fine = frequency >= FINEST
        rounds, pictures = (ROUNDS_FINEST, PICTURES_FINEST) if fine else (3 if quick else ROUNDS, PICTURES)
        yield from _picture_rows(frequency, rounds, pictures)
    yield _instant_row(5 if quick else 15)


def _picture_rows(frequency: int, rounds: int, pictures: int) -> Iterator[Row]:
    found = measure(frequency, rounds, pictures)
    mesh = f"{len(found.region.faces):,} faces"
    target = TARGET if frequency == FREQUENCIES[0] else ""
    times = found.times_ms
    drawn = {drawing: f"face-ID by {DRAWINGS[drawing]}" for drawing in found.agree_percent}
    names = drawn | {alone(d): f"picture alone by {DRAWINGS[d]}" for d in drawn}
    names |= {"rays": "16 rays a face", "embreex": "embreex per pixel"}
    for method, name in names.items():
        note = f"seen share {found.error_percent[method]:.2g} % off, rms, {found.against}"
        if method in drawn:
            note += f"; {found.counted_percent:.0f} % of the faces by their pixels, others by rays"
        yield row("observers", f"{name}, {mesh}", times[method], "ms", note=note)
    for drawing, name in drawn.items():
        by = gl_available()[1] if drawing == "opengl" else "one core"
        note = f"{by}; same pixel in {found.agree_percent[drawing]:.2f} %"
        yield row(
            "observers", f"embreex per pixel / {name}, {mesh}", times["embreex"] / times[drawing], "ratio", target, note
        )
        ratio = times["embreex"] / times[alone(drawing)]
        yield row("observers", f"embreex per pixel / {names[alone(drawing)]}, {mesh}", ratio, "ratio")
        yield row("observers", f"embreex through trimesh / {name}, {mesh}", times["trimesh"] / times[drawing], "ratio")
    yield row("observers", f"embreex per pixel / 16 rays a face, {mesh}", times["embreex"] / times["rays"], "ratio")


def _instant_row(rounds: int) -> Row:
    """A target-only observation by the fastest observer with occlusion: 72 faces, 6 spacecraft."""
    region = build_target(
        build_shape("eros", FREQUENCIES[0]), latitude_deg=0.0, longitude_deg=90.0, half_angle_deg=12.5
    )
    observer = HorizonObserver(region, CameraModel(half_angle_deg=HALF_ANGLE_DEG, resolution_px=RESOLUTION_PX))
    poses = next(rounds_of_poses(1, PICTURES))

    def look() -> None:
        for pose in poses:
            observer.visible_fraction(pose.r_A, pose.C_CA)

    times = in_turn({"look": look}, rounds, warm_up=2)["look"]
    name = f"horizon maps, {region.n_cells} target faces, {len(poses)} spacecraft"
    return row("observers", name, 1e3 * times, "ms", "<= 1")


@dataclass(frozen=True, kw_only=True)
class Measured:
    """What was found on one mesh.

    Attributes:
        times_ms: Milliseconds of one picture in each round by method.
        region: The target.
        agree_percent: How many pixels show the same face as the peer, by drawing [%].
        counted_percent: How many of the faces in view the face-ID observers judge by their pixels [%].
        error_percent: Of the seen share of the target by method, rms over the pictures of a round [% of the target].
        against: What that is an error from.
    """

    times_ms: dict[str, np.ndarray]
    region: TargetRegion
    agree_percent: dict[Drawing, float]
    counted_percent: float
    error_percent: dict[str, float]
    against: str


def measure(frequency: int, rounds: int, pictures: int = PICTURES) -> Measured:
    """One mesh."""
    shape = build_shape("eros", frequency)
    region = build_target(shape, latitude_deg=0.0, longitude_deg=90.0, half_angle_deg=20.0)
    camera = CameraModel(half_angle_deg=HALF_ANGLE_DEG, resolution_px=RESOLUTION_PX)
    drawings: list[Drawing] = ["opengl", "compiled"] if gl_available()[0] else ["compiled"]
    drawn = {d: FaceIdObserver(region, camera, crop=False, drawing=d) for d in drawings}
    observers: dict[str, Observer] = {"rays": RayCastObserver(region, camera)}
    observers.update({drawing: drawn[drawing] for drawing in drawings})
    scene = embree_scene(region)
    usual = RayMeshIntersector(trimesh.Trimesh(region.vertices, region.faces, process=False))
    casts = {"embreex": scene.run, "trimesh": usual.intersects_first}
    times: dict[str, list[float]] = {n: [] for n in (*observers, *map(alone, drawings), *casts)}
    agree: dict[Drawing, list[float]] = {drawing: [] for drawing in drawings}
    poses: list[CameraPose] = []
    for chosen in rounds_of_poses(rounds + 1, pictures):
        # The first round warms up, and accuracy is judged on its pictures.
        poses = poses or chosen
        rays = [pixel_rays(pose, camera) for pose in chosen]
        for name, observer in observers.items():
            times[name].append(milliseconds([partial(observer.visible_fraction, p.r_A, p.C_CA) for p in chosen]))
        for drawing, artist in drawn.items():
            times[alone(drawing)].append(milliseconds([partial(count_drawn, artist, p, region) for p in chosen]))
        for name, cast in casts.items():
            times[name].append(milliseconds([partial(count_pixels, cast, *each, region) for each in rays]))
        hit = scene.run(*rays[0]).astype(np.int64) + 1
        for drawing, artist in drawn.items():
            agree[drawing].append(float(np.mean(artist.face_ids(chosen[0]).ravel() == hit)))
    shares = {name: judged(observer, poses) for name, observer in observers.items()}
    for drawing, artist in drawn.items():
        shares[alone(drawing)] = shares_by_pixels(
            [count_drawn(artist, p, region) for p in poses], region, camera, poses
        )
    counts = [count_pixels(scene.run, *pixel_rays(pose, camera), region) for pose in poses]
    shares["embreex"] = shares_by_pixels(counts, region, camera, poses)
    truth, against = reference(shape, region, camera, poses)
    for observer in observers.values():
        observer.close()
    return Measured(
        times_ms={name: np.array(found[1:]) for name, found in times.items()},
        region=region,
        agree_percent={drawing: 100.0 * float(np.mean(found)) for drawing, found in agree.items()},
        counted_percent=counted_percent(region, camera, poses),
        error_percent={name: rms_error_percent(found, truth) for name, found in shares.items()},
        against=against,
    )


def rounds_of_poses(rounds: int, pictures: int) -> Iterator[list[CameraPose]]:
    """Cameras 19 to 24 km from the centre within 40 deg of the target's axis, looking at the centre."""
    rng = np.random.default_rng(0)
    for _ in range(rounds):
        poses = []
        for _ in range(pictures):
            tilt, azimuth = np.radians(40.0 * np.sqrt(rng.random())), 2.0 * np.pi * rng.random()
            out = np.array([np.sin(tilt) * np.cos(azimuth), np.cos(tilt), np.sin(tilt) * np.sin(azimuth)])
            poses.append(look_at(rng.uniform(19e3, 24e3) * out, [0.0, 0.0, 0.0], roll=2.0 * np.pi * rng.random()))
        yield poses


def alone(drawing: Drawing) -> str:
    """What the measurements of a picture without its observer are called."""
    return f"{drawing} alone"


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


def count_drawn(observer: FaceIdObserver, pose: CameraPose, region: TargetRegion) -> np.ndarray:
    """Pixels of each cell of the target in a face-ID buffer."""
    return np.bincount(observer.face_ids(pose).ravel(), minlength=len(region.faces) + 1)[1:][region.target]


def milliseconds(works: Sequence[Callable[[], object]]) -> float:
    """Mean wall-clock time of one call [ms]."""
    start = time.perf_counter()
    for work in works:
        work()
    return 1e3 * (time.perf_counter() - start) / len(works)
