"""Face-ID observers, by OpenGL and by compiled code, against exact polygon clipping, closed forms and double-precision rays."""

from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from functools import partial

import numpy as np
import pytest

from swarm_mj.errors import MissionError, ObserverError
from swarm_mj.observation.camera import CameraModel, look_at
from swarm_mj.observation.faceid import FaceIdObserver
from swarm_mj.observation.raycast import RayCastObserver, RayTracer

from .scenes import (
    eros_target,
    exact_cell_shares,
    exact_seen_areas,
    ground_with_plate,
    on_ground,
    random_views,
)


@pytest.fixture(params=[pytest.param("opengl", marks=pytest.mark.gl), "compiled"])
def face_id(request):
    """The observer, drawn in one of its two ways."""
    return partial(FaceIdObserver, drawing=request.param)


def errors_percent(observer, *views, seen_from=0.5, **how):
    """Seen area minus exact area, of the target's area [%], picture by picture."""
    area = observer.region.area
    fractions = [observer.visible_fraction(pose.r_A, pose.C_CA) for pose in random_views(*views, **how)]
    seen = np.array([area[fraction >= seen_from].sum() for fraction in fractions])
    return 100 * (seen - exact_seen_areas(observer.camera, *views, **how)) / area.sum()


def rms(values):
    return np.sqrt(np.mean(np.square(values)))


@pytest.mark.parametrize("crop", [True, False])
def test_seen_area_agrees_with_the_oracle_over_thirty_random_views(crop, face_id):
    with closing(face_id(eros_target(), CameraModel(resolution_px=512), crop=crop)) as observer:
        error = errors_percent(observer, 30, seed=1)
    assert rms(error) < 1.0
    assert np.abs(error).max() < 4.0


@pytest.mark.parametrize("shape", ["square", "cone"])
def test_seen_area_agrees_with_the_oracle_where_the_field_of_view_cuts_the_target(shape, face_id):
    with closing(face_id(eros_target(600.0), CameraModel(shape=shape))) as observer:
        error = errors_percent(observer, 30, seed=2, off_deg=25.0)
    assert rms(error) < 0.5
    assert np.abs(error).max() < 2.0


def test_any_pixel_overstates_and_half_the_pixels_does_not(face_id):
    views = dict(seed=2, off_deg=25.0)
    with closing(face_id(eros_target(), CameraModel())) as observer:
        any_pixel = errors_percent(observer, 30, seen_from=1e-12, **views)
        half = errors_percent(observer, 30, **views)
    assert any_pixel.min() > -1e-6
    assert any_pixel.mean() > 2.0
    assert abs(half.mean()) < 0.5


@pytest.mark.parametrize("cell_size", [None, 600.0])
@pytest.mark.parametrize("views", [dict(seed=1), dict(seed=5, spread_deg=95.0), dict(seed=2, off_deg=25.0)], ids=str)
def test_no_hidden_cell_is_ever_seen_and_no_wholly_visible_one_ever_lost(views, cell_size, face_id):
    region = eros_target(cell_size)
    camera = CameraModel(resolution_px=512)
    coarse = CameraModel(resolution_px=100)
    observers = [face_id(region, camera), face_id(region, coarse, crop=False)]
    hidden_cells = whole_cells = 0
    for pose, exact in zip(random_views(8, **views), exact_cell_shares(cell_size, camera, 8, **views), strict=True):
        hidden, whole = exact < 1e-9, exact > 1 - 1e-9
        hidden_cells, whole_cells = hidden_cells + hidden.sum(), whole_cells + whole.sum()
        for observer in observers:
            fraction = observer.visible_fraction(pose.r_A, pose.C_CA)
            assert not (fraction[hidden] > 0).any()
            assert (fraction[whole] >= 0.5).all()
    assert hidden_cells > 100
    assert whole_cells > 100


def test_slivers_of_the_clipping_are_smaller_than_a_pixel_and_still_seen(face_id):
    region, camera = eros_target(), CameraModel(resolution_px=128)
    pose = look_at([0.0, 21e3, 0.0], [0.0, 0.0, 0.0])
    pixel = (15e3 * camera.pixel_angle) ** 2
    with closing(face_id(region, camera, crop=False)) as observer:
        fraction = observer.visible_fraction(pose.r_A, pose.C_CA)
    assert (region.area < 0.5 * pixel).sum() > 10
    assert (fraction >= 0.5).all()


def test_each_pixel_shows_the_face_that_a_double_precision_ray_hits(face_id):
    region, camera = eros_target(), CameraModel(resolution_px=64)
    tracer = RayTracer(region.vertices, region.faces, use_embree=False)
    pose = random_views(3, seed=9, off_deg=10.0)[1]
    x = (np.arange(64) + 0.5) / 32 - 1
    u, v = np.meshgrid(x, -x)  # bottom row first, y down
    rays = np.column_stack([u.ravel(), v.ravel(), np.full(64 * 64, 1 / camera.tan_half_angle)]) @ pose.C_CA
    with closing(face_id(region, camera)) as observer:
        drawn = observer.face_ids(pose).astype(int).ravel() - 1
    hit = tracer.first_hit(pose.r_A, rays)
    assert (hit >= 0).mean() > 0.1
    assert (drawn != hit).mean() < 2e-3


@pytest.mark.parametrize("altitude", [60.0, 500.0, 4e3, 300e3])
def test_depth_is_resolved_from_close_by_and_from_far_away(altitude, face_id):
    region, camera = eros_target(245.0), CameraModel(half_angle_deg=30.0)
    ground = region.centroid_A[np.argmin(np.linalg.norm(region.centroid_A - [0, 6e3, 500.0], axis=1))]
    up = ground / np.linalg.norm(ground)
    pose = look_at(ground + altitude * up, ground + [300.0, 0.0, 100.0])
    rays = RayCastObserver(region, camera, samples=64).visible_fraction(pose.r_A, pose.C_CA)
    with closing(face_id(region, camera)) as observer:
        drawn = observer.visible_fraction(pose.r_A, pose.C_CA)
    assert rays.max() > 0.0
    assert np.abs(drawn - rays) @ region.area < 0.05 * (rays @ region.area)


def test_a_cone_sees_pi_quarters_of_the_square(face_id):
    region = ground_with_plate()
    pose = look_at([0.3, -20.0, 0.2], [0.3, 0.0, 0.2])  # from below: bare, flat ground would hide the plate
    below = RayCastObserver(region, CameraModel()).visible_fraction(pose.r_A, pose.C_CA)
    assert not below.any()
    pose = look_at([1.7, 4.0, 1.7], [1.7, 0.0, 1.7])  # beside the plate, 2 above the ground
    seen = []
    for shape in ("square", "cone"):
        with closing(face_id(region, CameraModel(half_angle_deg=25.0, shape=shape))) as observer:
            seen.append(region.area @ (observer.visible_fraction(pose.r_A, pose.C_CA) >= 0.5))
    side = 2 * 2 * np.tan(np.radians(25))
    assert seen == pytest.approx([side**2, np.pi / 4 * side**2], rel=0.01)


def test_a_plate_hides_its_central_projection(face_id):
    region = ground_with_plate()
    pose = look_at([0.0, 7.0, 0.0], [0.0, 0.0, 0.0], roll=0.3)
    with closing(face_id(region, CameraModel(half_angle_deg=60.0, resolution_px=1024))) as observer:
        fraction = observer.visible_fraction(pose.r_A, pose.C_CA)
    hidden = region.area @ (on_ground(region) & (fraction < 0.5))
    assert hidden == pytest.approx((5 / 4) ** 2, rel=0.02)


def test_a_target_outside_the_picture_or_behind_the_camera_is_not_seen(face_id):
    with closing(face_id(eros_target(), CameraModel())) as observer:
        away = look_at([0.0, 21e3, 0.0], [0.0, 42e3, 0.0])
        beside = look_at([0.0, 21e3, 0.0], [60e3, 0.0, 0.0])
        far_side = look_at([0.0, -21e3, 0.0], [0.0, 0.0, 0.0])
        for pose in (away, beside, far_side):
            assert not observer.visible_fraction(pose.r_A, pose.C_CA).any()


def test_the_same_picture_twice_is_bit_equal(face_id):
    pose = random_views(1, seed=3)[0]
    with closing(face_id(eros_target(600.0), CameraModel())) as observer:
        first = observer.visible_fraction(pose.r_A, pose.C_CA)
        observer.visible_fraction(-pose.r_A, pose.C_CA)
        assert (observer.visible_fraction(pose.r_A, pose.C_CA) == first).all()


def test_a_closed_observer_says_so_and_closing_twice_is_harmless(face_id):
    observer = face_id(eros_target(), CameraModel(resolution_px=32))
    observer.close()
    observer.close()
    pose = random_views(1, seed=3)[0]
    with pytest.raises(ObserverError, match="was closed"):
        observer.visible_fraction(pose.r_A, pose.C_CA)


@pytest.mark.parametrize("matrix", [np.eye(3) * 1.1, np.diag([1.0, 1.0, -1.0]), np.eye(2)])
def test_an_attitude_that_is_no_rotation_is_refused(matrix, face_id):
    with (
        closing(face_id(eros_target(), CameraModel(resolution_px=32))) as observer,
        pytest.raises(MissionError, match="C_CA"),
    ):
        observer.visible_fraction([0.0, 21e3, 0.0], matrix)


@pytest.mark.gl
def test_both_ways_of_drawing_show_the_same_faces():
    region = eros_target()
    with (
        closing(FaceIdObserver(region, CameraModel(shape="cone"))) as by_opengl,
        closing(FaceIdObserver(region, CameraModel(shape="cone"), drawing="compiled")) as compiled,
    ):
        for pose in random_views(4, seed=8, off_deg=10.0):
            assert np.mean(by_opengl.face_ids(pose) != compiled.face_ids(pose)) < 1e-3
            assert compiled.face_ids(pose).any()


def test_compiled_drawing_loses_no_pixel_between_faces_and_shows_what_rays_hit():
    region, camera = eros_target(245.0), CameraModel(resolution_px=96)
    tracer = RayTracer(region.vertices, region.faces, use_embree=False)
    x = (np.arange(96) + 0.5) / 48 - 1
    u, v = np.meshgrid(x, -x)
    observer = FaceIdObserver(region, camera, drawing="compiled")
    for pose in random_views(1, seed=4, off_deg=12.0):
        rays = np.column_stack([u.ravel(), v.ravel(), np.full(96 * 96, 1 / camera.tan_half_angle)]) @ pose.C_CA
        hit = tracer.first_hit(pose.r_A, rays)
        drawn = observer.face_ids(pose).astype(int).ravel() - 1
        assert ((drawn < 0) == (hit < 0)).all()
        assert (drawn != hit).mean() < 1e-4


def test_a_face_that_reaches_behind_the_camera_is_drawn_as_far_as_it_lies_before_it():
    region, camera = ground_with_plate(), CameraModel(half_angle_deg=40.0, resolution_px=96)
    pose = look_at([0.3, 3.6, -1.7], [0.5, 2.0, 1.5])  # low above ground and plate, which go on behind the camera
    ahead = pose.to_camera(region.vertices[region.faces])[..., 2] > 0
    assert (ahead.any(axis=1) & ~ahead.all(axis=1)).any()
    x = (np.arange(96) + 0.5) / 48 - 1
    u, v = np.meshgrid(x, -x)
    rays = np.column_stack([u.ravel(), v.ravel(), np.full(96 * 96, 1 / camera.tan_half_angle)]) @ pose.C_CA
    hit = RayTracer(region.vertices, region.faces, use_embree=False).first_hit(pose.r_A, rays)
    drawn = FaceIdObserver(region, camera, drawing="compiled").face_ids(pose).astype(int).ravel() - 1
    assert (drawn != hit).mean() < 1e-4
    assert (hit >= 0).mean() > 0.3


def test_compiled_drawing_works_in_any_thread():
    region, pose = eros_target(), look_at([0.0, 21e3, 0.0], [0.0, 0.0, 0.0])

    def look(_):
        with closing(FaceIdObserver(region, CameraModel(), drawing="compiled")) as observer:
            return observer.visible_fraction(pose.r_A, pose.C_CA)

    with ThreadPoolExecutor(4) as pool:
        found = list(pool.map(look, range(8)))
    assert all((fraction == found[0]).all() for fraction in found)
