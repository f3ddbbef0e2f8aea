"""Observation: the observers against each other, exact polygons, a sphere's closed form and Embree pixel by pixel."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import closing
from functools import partial

import numpy as np

from swarm_mj.mission.target import TargetRegion, build_target
from swarm_mj.observation.camera import CameraModel, CameraPose, look_at
from swarm_mj.observation.faceid import Drawing, FaceIdObserver
from swarm_mj.observation.gl_context import gl_available
from swarm_mj.observation.horizon import HorizonObserver
from swarm_mj.observation.observer import Observer
from swarm_mj.observation.raycast import RayCastObserver, tracer_of
from swarm_mj.typing import Array
from swarm_mj.verification.experiment import Bench, NotRun, experiment
from swarm_mj.verification.flights import ball
from swarm_mj.verification.gravity import eros_shape
from swarm_mj.verification.polygons import visible_areas
from swarm_mj.verification.target import eros_target

#: Gives the area seen of each cell in every view, shape (views, n) [m^2].
Areas = Callable[[Bench], Array]

HALF_ANGLE_DEG, RESOLUTION_PX, VIEWS = 10.0, 512, 6
BALL_RADIUS_M, BALL_FREQUENCY, BALL_DISTANCE_M, BALL_HALF_ANGLE_DEG = 8e3, 30, 20e3, 10.0


def camera() -> CameraModel:
    """A square camera whose picture cuts the target."""
    return CameraModel(half_angle_deg=HALF_ANGLE_DEG, resolution_px=RESOLUTION_PX)


def views(bench: Bench) -> list[CameraPose]:
    """Poses 19 to 24 km from the centre, up to 40 deg off the target's axis, aimed beside the centre, any roll."""
    rng = np.random.default_rng(6)
    poses = []
    for _ in range(VIEWS):
        tilt, azimuth = np.radians(rng.uniform(10.0, 40.0)), rng.uniform(0.0, 2.0 * np.pi)
        out = np.array([np.sin(tilt) * np.cos(azimuth), np.cos(tilt), np.sin(tilt) * np.sin(azimuth)])
        aim = rng.uniform(-3e3, 3e3, 3)
        poses.append(look_at(rng.uniform(19e3, 24e3) * out, aim, roll=rng.uniform(0.0, 6.28)))
    return poses


def draw_with(drawing: Drawing, region: TargetRegion, camera: CameraModel) -> FaceIdObserver:
    """Make a face-ID observer, or give up where OpenGL shall draw and cannot."""
    available, reason = gl_available() if drawing == "opengl" else (True, "")
    if not available:
        raise NotRun(f"no OpenGL here ({reason})")
    return FaceIdObserver(region, camera, drawing=drawing)


def ray_areas(bench: Bench) -> Array:
    """Area seen of each cell by ray casting, shape (views, n) [m^2]."""
    return _areas(RayCastObserver(bench.once(eros_target), camera(), samples=64), bench)


def drawn_areas(drawing: Drawing, bench: Bench) -> Array:
    """The same of face-ID buffers."""
    with closing(draw_with(drawing, bench.once(eros_target), camera())) as observer:
        return _areas(observer, bench)


def horizon_areas(bench: Bench) -> Array:
    """The same of horizon maps."""
    return _areas(HorizonObserver(bench.once(eros_target), camera()), bench)


def _areas(observer: Observer, bench: Bench) -> Array:
    poses = bench.once(views)
    return np.array([observer.visible_fraction(p.r_A, p.C_CA) * observer.region.area for p in poses])


def polygon_areas(bench: Bench) -> Array:
    """Exact area of each cell in view, shape (views, n) [m^2]."""
    region, shape = bench.once(eros_target), bench.once(eros_shape)
    mesh = shape.vertices[shape.faces]
    return np.array([visible_areas(region.corners_A, mesh, p.r_A, p.C_CA, HALF_ANGLE_DEG) for p in bench.once(views)])


def areas_differ(first: Areas, second: Areas, bench: Bench) -> float:
    """Largest area that two observers judge differently in a picture, over the target's area [%]."""
    # The sum of the cells' differences, so that an error of place cannot hide behind a right total.
    differing = np.abs(bench.once(first) - bench.once(second)).sum(axis=1)
    return 100.0 * float(differing.max()) / bench.once(eros_target).total_area


def pixels_differ(drawing: Drawing, bench: Bench) -> float:
    """Share of the pixels in which a face-ID picture and a ray through the pixel's centre show another face [%]."""
    region, wrong = bench.once(eros_target), []
    tracer = tracer_of(region.mesh)
    across = camera().tan_half_angle * ((np.arange(RESOLUTION_PX) + 0.5) * 2.0 / RESOLUTION_PX - 1.0)
    right, up = np.meshgrid(across, across)
    rays_C = np.stack([right, -up, np.ones_like(up)], axis=-1).reshape(-1, 3)
    with closing(draw_with(drawing, region, camera())) as observer:
        for pose in bench.once(views)[:2]:
            expected = tracer.first_hit(pose.r_A, rays_C @ pose.C_CA) + 1
            wrong.append(float(np.mean(observer.face_ids(pose).ravel() != expected)))
    return 100.0 * max(wrong)


def footprint_error(observer: str, bench: Bench) -> float:
    """Relative error of the area that a conical camera sees of a sphere, looking straight down."""
    shape = ball(BALL_RADIUS_M, BALL_FREQUENCY)
    region = build_target(shape, latitude_deg=30.0, longitude_deg=50.0, half_angle_deg=40.0, edges="side")
    cone = CameraModel(half_angle_deg=BALL_HALF_ANGLE_DEG, shape="cone", resolution_px=1024)
    pose = look_at(BALL_DISTANCE_M * region.axes_A[2], [0.0, 0.0, 0.0])
    if observer == "rays":
        fraction = RayCastObserver(region, cone, samples=64).visible_fraction(pose.r_A, pose.C_CA)
    else:
        with closing(draw_with("opengl" if observer == "faceid" else "compiled", region, cone)) as buffers:
            fraction = buffers.visible_fraction(pose.r_A, pose.C_CA)
    half = np.radians(BALL_HALF_ANGLE_DEG)
    cap = np.arcsin(BALL_DISTANCE_M / BALL_RADIUS_M * np.sin(half)) - half
    expected = 2.0 * np.pi * BALL_RADIUS_M**2 * (1.0 - np.cos(cap))
    return abs(float(fraction @ region.area) / expected - 1.0)


@experiment("coverage-limb", "closed form of the cap above the horizon", 2e-3)
def horizon_error(bench: Bench) -> float:
    """Area of a sphere in view from half a radius above, relative."""
    shape = ball(BALL_RADIUS_M, BALL_FREQUENCY)
    region = build_target(shape, latitude_deg=-20.0, longitude_deg=200.0, half_angle_deg=75.0, edges="side")
    wide = CameraModel(half_angle_deg=60.0)
    pose = look_at(1.5 * BALL_RADIUS_M * region.axes_A[2], [0.0, 0.0, 0.0])
    fraction = RayCastObserver(region, wide).visible_fraction(pose.r_A, pose.C_CA)
    return abs(float(fraction @ region.area) / (2.0 * np.pi * BALL_RADIUS_M**2 * (1.0 - 1.0 / 1.5)) - 1.0)


#: Area that each observer sees, by the last word of the checks' names, and what it is called in them.
OBSERVERS: dict[str, tuple[Areas, str]] = {
    "rays": (ray_areas, "ray casting"),
    "faceid": (partial(drawn_areas, "opengl"), "face-ID buffers of OpenGL"),
    "raster": (partial(drawn_areas, "compiled"), "face-ID buffers of compiled code"),
    "horizon": (horizon_areas, "horizon maps"),
}
_JUDGED = f"Share of the target's area judged differently, worst of {VIEWS} pictures"


def _compare_pixels(name: str, pictures: str, tolerance: float, drawing: Drawing) -> None:
    what = f"Pixels of {pictures} with another face, {RESOLUTION_PX} px"
    add = experiment(name, "a ray through every pixel's centre, Embree", tolerance, "%", what=what, package="embreex")
    add(partial(pixels_differ, drawing))


_compare_pixels("coverage-pixels", "OpenGL's face-ID pictures", 0.05, "opengl")
_compare_pixels("coverage-pixels-raster", "compiled face-ID pictures", 0.01, "compiled")
experiment("coverage-observers", "ray casting, 64 rays to each face", 1.0, "%", what=f"{_JUDGED}, face-ID buffers")(
    partial(areas_differ, OBSERVERS["faceid"][0], ray_areas)
)
for _name, (_seen, _words) in OBSERVERS.items():
    if _name != "horizon":  # whose cameras are square
        experiment(
            f"coverage-footprint-{_name}",
            "closed form of the cap in the field of view",
            5e-3,
            what=f"Area in a conical picture of a sphere by {_words}, relative",
        )(partial(footprint_error, _name))
    experiment(
        f"coverage-polygons-{_name}",
        "exact polygon clipping with shapely",
        1.0,
        "%",
        what=f"{_JUDGED}, {_words}",
        package="shapely",
    )(partial(areas_differ, _seen, polygon_areas))
