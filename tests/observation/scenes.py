"""Bodies, targets and views that the observation tests share."""

from functools import cache

import numpy as np

from swarm_mj.mission.mesh_cut import refine_mesh
from swarm_mj.mission.target import build_target
from swarm_mj.observation.camera import look_at
from swarm_mj.scenarios.schema_imaging import Observation
from swarm_mj.smallbody.shape import ShapeModel
from swarm_mj.smallbody.shape_harmonics import build_shape

from .oracle import Oracle, Patch, View, clip_to_pyramid, cone, rectangle


@cache
def eros():
    return build_shape()


@cache
def eros_target(cell_size=None):
    """The paper's target with all that the exact one has, slivers at its sides included."""
    return build_target(
        eros(), latitude_deg=0, longitude_deg=90, half_angle_deg=20, cell_size_m=cell_size, least_part=0.0
    )


def plain(**limits):
    """A criterion without light and limits but those given."""
    return Observation(**({"light": "ignored", "max_emission_deg": 90.0, "min_pixels": 0.0} | limits))


@cache
def eros_oracle():
    """Exact target of the paper on Eros, clipped without help of the library."""
    axes = np.array([[-1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0]])
    patches = clip_to_pyramid(eros().vertices, eros().faces, axes, np.tan(np.radians(20)) / np.sqrt(2))
    return Oracle(eros().vertices, eros().faces, patches)


@cache
def exact_seen_areas(camera, *views, **how):
    """Exactly visible area of the target [m^2] in each of the random views that the other arguments describe."""
    return np.array([eros_oracle().visible_area(exact_view(p, camera)).sum() for p in random_views(*views, **how)])


@cache
def exact_cell_shares(cell_size, camera, *views, **how):
    """Exactly visible share of each cell of `eros_target(cell_size)` in each of the random views, shape (views, cells)."""
    region = eros_target(cell_size)
    oracle = cell_oracle(region)
    return np.array([oracle.visible_area(exact_view(p, camera)) / region.area for p in random_views(*views, **how)])


def cell_oracle(region):
    """Exact visibility of each cell of a target on Eros."""
    patches = [
        Patch(int(region.parent[face]), corners) for face, corners in zip(region.target, region.corners_A, strict=True)
    ]
    return Oracle(eros().vertices, eros().faces, patches)


def exact_view(pose, camera):
    field = cone(camera.half_angle_deg) if camera.shape == "cone" else rectangle(camera.half_angle_deg, camera.sides)
    return View(pose.r_A, pose.C_CA, field)


@cache
def random_views(n, seed, *, spread_deg=60.0, off_deg=0.0, distance=21e3):
    """Poses around the target's axis (+y) with random roll, aimed at the centre or up to `off_deg` beside it."""
    rng = np.random.default_rng(seed)
    views = []
    for _ in range(n):
        tilt, azimuth = np.radians(spread_deg) * np.sqrt(rng.random()), 2 * np.pi * rng.random()
        out = np.array([np.sin(tilt) * np.cos(azimuth), np.cos(tilt), np.sin(tilt) * np.sin(azimuth)])
        aside = rng.normal(size=3)
        aside *= distance * np.tan(np.radians(off_deg * rng.random())) / np.linalg.norm(aside)
        views.append(look_at(distance * out, aside, roll=2 * np.pi * rng.random()))
    return tuple(views)


def flyby(seed, passes, speed=50.0):
    """Straight passes over random visiting points at 14 km, looking at the centre, a picture each 10 s: (t, j, pose)."""
    rng = np.random.default_rng(seed)
    points = eros_target().visiting_points_A(14e3)
    frames = []
    for j, point in enumerate(points[rng.choice(len(points), passes, replace=False)]):
        heading = np.cross(point, rng.normal(size=3))
        heading *= speed / np.linalg.norm(heading)
        frames += [(t, j, look_at(point + heading * t, [0, 0, 0])) for t in np.arange(-200.0, 201.0, 10.0)]
    return frames


def box(low, high):
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=float)
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))])
    return np.array(low) + corners * (np.array(high) - low), faces


@cache
def ground_with_plate(cell=0.08):
    """Flat ground, the square |x|, |z| < 3 at y = 2, and above it at y = 3 a thin square plate of side 1, turned aside."""
    vertices, faces = box([-5.0, -2.0, -5.0], [5.0, 2.0, 5.0])
    plate, plate_faces = box([-0.5, 3.0, -0.5], [0.5, 3.0 + 1e-6, 0.5])
    c, s = np.cos(0.3), np.sin(0.3)
    plate = plate @ np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
    vertices, faces, _ = refine_mesh(vertices, faces, np.full(12, True), 2.0)
    shape = ShapeModel(np.vstack([vertices, plate]), np.vstack([faces, plate_faces + len(vertices)]), "plate")
    return build_target(
        shape,
        latitude_deg=0,
        longitude_deg=90,
        half_angle_deg=np.degrees(np.arctan(1.5)),
        edges="side",
        cell_size_m=cell,
    )


def on_ground(region):
    return np.abs(region.centroid_A[:, 1] - 2.0) < 1e-9
