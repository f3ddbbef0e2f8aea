"""One picture by face-ID buffers and by rays to the target, against Embree per pixel: python -m benchmarks.coverage.

The peer traces one ray through the centre of every pixel of the same picture and counts the pixels of every face: once with
embreex alone, whose rays are ready in single precision before the clock starts, and once through trimesh, the usual way to
embreex in Python. The face-ID observer draws the whole picture (no cropping), so that all three fill the same pixels; the
share of pixels in which they agree is reported. The ray observer sends 16 rays to each face of the target and needs no
picture. In every round each of them takes the same pictures in turn, as many at a stretch as a spacecraft takes in a minute.
Building meshes, buffers and scenes is not counted. All but the face-ID observer, which draws with Mesa's threads where there
is no GPU, run on one core.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import time
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from trimesh.ray.ray_pyembree import RayMeshIntersector

from swarm_mj.mission.target import TargetRegion, build_target
from swarm_mj.observation.camera import CameraModel, CameraPose, look_at
from swarm_mj.observation.faceid import FaceIdObserver
from swarm_mj.observation.gl_context import gl_available
from swarm_mj.observation.raycast import RayCastObserver
from swarm_mj.smallbody.shape_harmonics import build_eros

RESULTS = Path(__file__).parent / "results" / "coverage.json"
#: Frequencies of the geodesic mesh: 8, 32, 72 and 200 thousand faces.
FREQUENCIES = (20, 40, 60, 100)
ROUNDS, PICTURES, RESOLUTION_PX, HALF_ANGLE_DEG = 7, 6, 512, 21.5


def main() -> None:
    """Measure every mesh, print a table and write the results."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("frequencies", nargs="*", type=int, default=FREQUENCIES, help="meshes of 20 f^2 faces")
    parser.add_argument("--rounds", type=int, default=ROUNDS)
    parser.add_argument("--out", type=Path, default=RESULTS, help="JSON file (default: %(default)s)")
    arguments = parser.parse_args()
    available, renderer = gl_available()
    if not available:
        parser.exit(1, f"face-ID buffers cannot be drawn here: {renderer}\n")
    print("                    milliseconds per picture                    ratios")
    print(
        "   faces target   face-ID    rays  embreex  trimesh   embreex/face-ID  trimesh/face-ID  embreex/rays   agree [%]"
    )
    rows = []
    for frequency in arguments.frequencies:
        rows.append(measure(frequency, arguments.rounds))
        print(
            "{faces:8d} {target_faces:6d} {face_id_ms:9.2f} {rays_ms:7.2f} {embreex_per_pixel_ms:8.1f} "
            "{trimesh_per_pixel_ms:8.1f} {embreex_over_face_id:17.1f} {trimesh_over_face_id:16.1f} "
            "{embreex_over_rays:13.1f} {pixels_agree_percent:11.3f}".format(**rows[-1]),
            flush=True,
        )
    content = {
        "resolution_px": RESOLUTION_PX,
        "rounds": arguments.rounds,
        "pictures": PICTURES,
        "machine": machine(renderer),
        "rows": rows,
    }
    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    arguments.out.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")
    print(f"wrote {arguments.out}")


def measure(frequency: int, rounds: int) -> dict[str, Any]:
    """Medians [ms] and medians of the rounds' ratios for one mesh."""
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
    face_id_ms, rays_ms, embreex_ms, trimesh_ms = np.median(timed, axis=0)
    return {
        "faces": len(region.faces),
        "target_faces": region.n_cells,
        "face_id_ms": float(face_id_ms),
        "rays_ms": float(rays_ms),
        "embreex_per_pixel_ms": float(embreex_ms),
        "trimesh_per_pixel_ms": float(trimesh_ms),
        "embreex_over_face_id": float(np.median(timed[:, 2] / timed[:, 0])),
        "trimesh_over_face_id": float(np.median(timed[:, 3] / timed[:, 0])),
        "embreex_over_rays": float(np.median(timed[:, 2] / timed[:, 1])),
        "pixels_agree_percent": 100.0 * float(np.mean(agree)),
    }


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


def machine(renderer: str) -> dict[str, Any]:
    """What the numbers were measured on."""
    return {
        "processor": processor(),
        "cores": os.cpu_count(),
        "opengl": renderer,
        "python": platform.python_version(),
        **{name: version(name) for name in ("numpy", "moderngl", "embreex", "trimesh", "swarm_mj")},
    }


def processor() -> str:
    """Name of the processor, where the system tells it."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor()
    return next((line.split(":")[1].strip() for line in lines if line.startswith("model name")), platform.processor())


if __name__ == "__main__":
    main()
