"""What a camera can show at most: never less than any observer shows, and little more than the geometry without the body."""

import numpy as np
import pytest
from shapely.geometry import Point, Polygon, box

from swarm_mj.observation.camera import CameraModel
from swarm_mj.observation.capture import observe
from swarm_mj.observation.observer import make_observer
from swarm_mj.observation.reach import cells_of, in_reach, reach_of

from .scenes import eros_target, plain, random_views

CRITERIA = [
    {},
    {"min_fraction": 0.05},
    {"min_fraction": 0.9},
    {"min_fraction": 1.0},
    {"any_pixel": True},
    {"max_emission_deg": 60.0},
    {"max_range_m": 20.5e3},
    {"max_gsd_m": 70.0},
    {"min_pixels": 10.0},
]


def reached(observer, criterion, *poses, light=None):
    r_A, C_CA = (np.ascontiguousarray(part) for part in zip(*((p.r_A, p.C_CA) for p in poses), strict=True))
    light = np.ones((1, observer.region.n_cells), dtype=np.bool_) if light is None else light
    return in_reach(cells_of(observer.region), reach_of(observer, criterion), r_A, C_CA, light)


@pytest.mark.parametrize("shape", ["cone", "square"])
@pytest.mark.parametrize("kind", ["raster", "raycast", "horizon"])
@pytest.mark.parametrize("criterion", CRITERIA, ids=str)
def test_no_observer_shows_what_is_out_of_reach(kind, shape, criterion):
    region, criterion = eros_target(), plain(**criterion)
    camera = CameraModel(half_angle_deg=5.0, shape=shape, resolution_px=64)
    observer, shown, beyond = make_observer(region, camera, kind=kind), 0, 0
    for pose in random_views(30, 3, off_deg=4.0):
        seen = observe(observer, pose.r_A, pose.C_CA, criterion)
        reach = reached(observer, criterion, pose)
        assert not (seen & ~reach).any()
        shown, beyond = shown + seen.sum(), beyond + (~reach).sum()
    assert shown > 15 and beyond > 1000


@pytest.mark.parametrize("shape", ["cone", "square"])
@pytest.mark.parametrize("share", [0.3, 0.5, 0.8])
def test_what_is_in_reach_has_its_share_in_the_picture_up_to_a_pixel(shape, share):
    region, camera = eros_target(), CameraModel(half_angle_deg=3.0, shape=shape, resolution_px=2048)
    observer = make_observer(region, camera, kind="raster")
    picture, tan = (Point(0, 0).buffer(1.0, 256) if shape == "cone" else box(-1, -1, 1, 1)), np.tan(np.radians(3.0))
    on_the_border = 0
    for pose in random_views(15, 4, off_deg=3.0):
        corners = pose.to_camera(region.corners_A)
        ahead = ((region.centroid_A - pose.r_A) * region.normal_A).sum(axis=1) < 0.0
        triangles = [Polygon(c[:, :2] / (c[:, 2:] * tan)) for c in corners]
        inside = np.array([t.intersection(picture).area / max(t.area, 1e-12) for t in triangles])
        reach = reached(observer, plain(min_fraction=share), pose)
        wide = np.array([2.0 * t.area / t.length for t in triangles]) > 40 * 2 / 2048
        assert not reach[(inside < share - 0.05) & wide].any() and reach[(inside > share + 0.001) & ahead].all()
        assert not reach[~ahead].any()
        on_the_border += ((inside > 0.0) & (inside < 1.0) & ahead & wide).sum()
    assert on_the_border > 30


def test_reach_is_what_any_of_the_pictures_reaches_in_its_light():
    region, criterion = eros_target(), plain()
    observer = make_observer(region, CameraModel(half_angle_deg=3.0), kind="raycast")
    views, rng = random_views(6, 5, off_deg=6.0), np.random.default_rng(0)
    light = rng.random((6, region.n_cells)) < 0.5
    one_by_one = [reached(observer, criterion, pose) for pose in views]
    assert np.array_equal(reached(observer, criterion, *views), np.any(one_by_one, axis=0))
    assert np.array_equal(reached(observer, criterion, *views, light=light), (one_by_one & light).any(axis=0))
    r_A, C_CA = np.empty((0, 3)), np.empty((0, 3, 3))
    assert not in_reach(cells_of(region), reach_of(observer, criterion), r_A, C_CA, light[:1]).any()
