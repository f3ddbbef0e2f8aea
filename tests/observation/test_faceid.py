"""The face-ID observer against exact polygon clipping, closed forms and double-precision rays."""

import numpy as np
import pytest

from swarm_mj.errors import MissionError, ObserverError
from swarm_mj.observation.camera import CameraModel, look_at
from swarm_mj.observation.faceid import FaceIdObserver
from swarm_mj.observation.raycast import RayCastObserver
from swarm_mj.observation.raytracing import RayTracer

from .scenes import (
    cell_oracle,
    eros_target,
    exact_seen_areas,
    exact_view,
    ground_with_plate,
    on_ground,
    random_views,
)

pytestmark = pytest.mark.gl


def errors_percent(observer, *views, seen_from=0.5, **how):
    """Seen area minus exact area, of the target's area [%], picture by picture."""
    area = observer.region.area
    fractions = [observer.visible_fraction(pose.r_A, pose.C_CA) for pose in random_views(*views, **how)]
    seen = np.array([area[fraction >= seen_from].sum() for fraction in fractions])
    return 100 * (seen - exact_seen_areas(observer.camera, *views, **how)) / area.sum()


def rms(values):
    return np.sqrt(np.mean(np.square(values)))


@pytest.mark.parametrize("crop", [True, False])
def test_seen_area_agrees_with_the_oracle_over_sixty_random_views(crop):
    with FaceIdObserver(eros_target(), CameraModel(resolution_px=512), crop=crop) as observer:
        error = errors_percent(observer, 60, seed=1)
    assert rms(error) < 1.0
    assert np.abs(error).max() < 4.0


@pytest.mark.parametrize("shape", ["square", "cone"])
def test_seen_area_agrees_with_the_oracle_where_the_field_of_view_cuts_the_target(shape):
    with FaceIdObserver(eros_target(600.0), CameraModel(shape=shape)) as observer:
        error = errors_percent(observer, 30, seed=2, off_deg=25.0)
    assert rms(error) < 0.5
    assert np.abs(error).max() < 2.0


def test_any_pixel_overstates_and_half_the_pixels_does_not():
    views = dict(seed=2, off_deg=25.0)
    with FaceIdObserver(eros_target(), CameraModel()) as observer:
        any_pixel = errors_percent(observer, 30, seen_from=1e-12, **views)
        half = errors_percent(observer, 30, **views)
    assert any_pixel.min() > -1e-6
    assert any_pixel.mean() > 2.0
    assert abs(half.mean()) < 0.5


@pytest.mark.parametrize("cell_size", [None, 600.0])
@pytest.mark.parametrize("views", [dict(seed=1), dict(seed=5, spread_deg=95.0), dict(seed=2, off_deg=25.0)], ids=str)
def test_no_hidden_cell_is_ever_seen_and_no_wholly_visible_one_ever_lost(views, cell_size):
    region = eros_target(cell_size)
    oracle, camera = cell_oracle(region), CameraModel(resolution_px=512)
    coarse = CameraModel(resolution_px=100)
    observers = [FaceIdObserver(region, camera), FaceIdObserver(region, coarse, crop=False)]
    hidden_cells = whole_cells = 0
    for pose in random_views(12, **views):
        exact = oracle.visible_area(exact_view(pose, camera)) / region.area
        hidden, whole = exact < 1e-9, exact > 1 - 1e-9
        hidden_cells, whole_cells = hidden_cells + hidden.sum(), whole_cells + whole.sum()
        for observer in observers:
            fraction = observer.visible_fraction(pose.r_A, pose.C_CA)
            assert not (fraction[hidden] > 0).any()
            assert (fraction[whole] >= 0.5).all()
    assert hidden_cells > 100
    assert whole_cells > 100


def test_slivers_of_the_clipping_are_smaller_than_a_pixel_and_still_seen():
    region, camera = eros_target(), CameraModel(resolution_px=128)
    pose = look_at([0.0, 21e3, 0.0], [0.0, 0.0, 0.0])
    pixel = (15e3 * camera.pixel_angle) ** 2
    with FaceIdObserver(region, camera, crop=False) as observer:
        fraction = observer.visible_fraction(pose.r_A, pose.C_CA)
    assert (region.area < 0.5 * pixel).sum() > 10
    assert (fraction >= 0.5).all()


def test_each_pixel_shows_the_face_that_a_double_precision_ray_hits():
    region, camera = eros_target(), CameraModel(resolution_px=64)
    tracer = RayTracer(region.vertices, region.faces, use_embree=False)
    pose = random_views(3, seed=9, off_deg=10.0)[1]
    x = (np.arange(64) + 0.5) / 32 - 1
    u, v = np.meshgrid(x, -x)  # bottom row first, y down
    rays = np.column_stack([u.ravel(), v.ravel(), np.full(64 * 64, 1 / camera.tan_half_angle)]) @ pose.C_CA
    with FaceIdObserver(region, camera) as observer:
        drawn = observer.face_ids(pose).astype(int).ravel() - 1
    hit = tracer.first_hit(pose.r_A, rays)
    assert (hit >= 0).mean() > 0.1
    assert (drawn != hit).mean() < 2e-3


@pytest.mark.parametrize("altitude", [60.0, 500.0, 4e3, 300e3])
def test_depth_is_resolved_from_close_by_and_from_far_away(altitude):
    region, camera = eros_target(245.0), CameraModel(half_angle_deg=30.0)
    ground = region.centroid_A[np.argmin(np.linalg.norm(region.centroid_A - [0, 6e3, 500.0], axis=1))]
    up = ground / np.linalg.norm(ground)
    pose = look_at(ground + altitude * up, ground + [300.0, 0.0, 100.0])
    rays = RayCastObserver(region, camera, samples=64).visible_fraction(pose.r_A, pose.C_CA)
    with FaceIdObserver(region, camera) as observer:
        drawn = observer.visible_fraction(pose.r_A, pose.C_CA)
    assert rays.max() > 0.0
    assert np.abs(drawn - rays) @ region.area < 0.05 * (rays @ region.area)


def test_a_cone_sees_pi_quarters_of_the_square():
    region = ground_with_plate()
    pose = look_at([0.3, -20.0, 0.2], [0.3, 0.0, 0.2])  # from below: bare, flat ground would hide the plate
    below = RayCastObserver(region, CameraModel()).visible_fraction(pose.r_A, pose.C_CA)
    assert not below.any()
    pose = look_at([1.7, 4.0, 1.7], [1.7, 0.0, 1.7])  # beside the plate, 2 above the ground
    seen = []
    for shape in ("square", "cone"):
        with FaceIdObserver(region, CameraModel(half_angle_deg=25.0, shape=shape)) as observer:
            seen.append(region.area @ (observer.visible_fraction(pose.r_A, pose.C_CA) >= 0.5))
    side = 2 * 2 * np.tan(np.radians(25))
    assert seen == pytest.approx([side**2, np.pi / 4 * side**2], rel=0.01)


def test_a_plate_hides_its_central_projection():
    region = ground_with_plate()
    pose = look_at([0.0, 7.0, 0.0], [0.0, 0.0, 0.0], roll=0.3)
    with FaceIdObserver(region, CameraModel(half_angle_deg=60.0, resolution_px=1024)) as observer:
        fraction = observer.visible_fraction(pose.r_A, pose.C_CA)
    hidden = region.area @ (on_ground(region) & (fraction < 0.5))
    assert hidden == pytest.approx((5 / 4) ** 2, rel=0.02)


def test_a_target_outside_the_picture_or_behind_the_camera_is_not_seen():
    with FaceIdObserver(eros_target(), CameraModel()) as observer:
        away = look_at([0.0, 21e3, 0.0], [0.0, 42e3, 0.0])
        beside = look_at([0.0, 21e3, 0.0], [60e3, 0.0, 0.0])
        far_side = look_at([0.0, -21e3, 0.0], [0.0, 0.0, 0.0])
        for pose in (away, beside, far_side):
            assert not observer.visible_fraction(pose.r_A, pose.C_CA).any()


def test_the_same_picture_twice_is_bit_equal():
    pose = random_views(1, seed=3)[0]
    with FaceIdObserver(eros_target(600.0), CameraModel()) as observer:
        first = observer.visible_fraction(pose.r_A, pose.C_CA)
        observer.visible_fraction(-pose.r_A, pose.C_CA)
        assert (observer.visible_fraction(pose.r_A, pose.C_CA) == first).all()


def test_a_closed_observer_says_so_and_closing_twice_is_harmless():
    observer = FaceIdObserver(eros_target(), CameraModel(resolution_px=32))
    observer.close()
    observer.close()
    pose = random_views(1, seed=3)[0]
    with pytest.raises(ObserverError, match="was closed"):
        observer.visible_fraction(pose.r_A, pose.C_CA)


@pytest.mark.parametrize("matrix", [np.eye(3) * 1.1, np.diag([1.0, 1.0, -1.0]), np.eye(2)])
def test_an_attitude_that_is_no_rotation_is_refused(matrix):
    with (
        FaceIdObserver(eros_target(), CameraModel(resolution_px=32)) as observer,
        pytest.raises(MissionError, match="C_CA"),
    ):
        observer.visible_fraction([0.0, 21e3, 0.0], matrix)
