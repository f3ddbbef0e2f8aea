"""Rectangular fields of view: every observer against exact clipping, and a point at each edge."""

from contextlib import closing

import numpy as np
import pytest

from swarm_mj.errors import MissionError
from swarm_mj.observation.camera import CameraModel
from swarm_mj.observation.observer import make_observer

from .scenes import eros_target, exact_seen_areas, random_views

#: 2048 x 1088, and the same upright.
WIDE, HIGH = (1.0, 1088 / 2048), (1088 / 2048, 1.0)


@pytest.mark.parametrize("sides", [WIDE, HIGH])
@pytest.mark.parametrize("kind", ["raster", "raycast", "horizon"])
def test_every_observer_sees_in_a_rectangle_what_exact_clipping_finds(kind, sides):
    region, camera, views = eros_target(600.0), CameraModel(sides=sides), dict(seed=2, off_deg=25.0)
    with closing(make_observer(region, camera, kind=kind)) as observer:
        fractions = [observer.visible_fraction(pose.r_A, pose.C_CA) for pose in random_views(8, **views)]
    seen = np.array([region.area[fraction >= 0.5].sum() for fraction in fractions])
    error = 100.0 * (seen - exact_seen_areas(camera, 8, **views)) / region.area.sum()
    assert np.abs(error).max() < 2.0


@pytest.mark.parametrize(
    ("x", "y", "inside"), [(0.999, 0.5, True), (1.001, 0, False), (0, 0.531, True), (0.9, 0.532, False)]
)
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_point_just_within_each_edge_is_in_the_picture_and_one_just_beyond_is_not(x, y, inside, sign):
    camera = CameraModel(half_angle_deg=4.57, sides=WIDE)
    point = np.array([sign * x * camera.tan_half_angle, -sign * y * camera.tan_half_angle, 1.0])
    assert camera.contains(1e4 * point) == inside


def test_the_outline_bounds_what_the_camera_contains():
    for camera in (CameraModel(sides=WIDE), CameraModel(sides=HIGH), CameraModel(shape="cone")):
        edge = np.column_stack((camera.outline(3), np.ones(12)))
        assert (
            camera.contains(edge * (0.999, 0.999, 1.0)).all() and not camera.contains(edge * (1.001, 1.001, 1.0)).any()
        )
        assert camera.contains([[0.999 * camera.inscribed_cone.tan_half_angle, 0.0, 1.0]]).all()
        assert camera.contains([[0.0, 0.999 * camera.inscribed_cone.tan_half_angle, 1.0]]).all()


@pytest.mark.parametrize("sides", [(0.5, 0.5), (1.0, 0.0), (2.0, 1.0)])
def test_sides_that_cannot_be_are_refused(sides):
    with pytest.raises(MissionError, match="sides"):
        CameraModel(sides=sides)
