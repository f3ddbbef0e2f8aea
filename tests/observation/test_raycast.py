import numpy as np
import pytest

from swarm_mj.errors import MissionError
from swarm_mj.observation.camera import CameraModel, look_at
from swarm_mj.observation.raycast import RayCastObserver, RayTracer, barycentric_samples

from .scenes import eros_target, exact_cell_shares, exact_seen_areas, ground_with_plate, on_ground, random_views


def test_seen_area_agrees_with_the_oracle_over_thirty_random_views():
    region, camera = eros_target(), CameraModel()
    observer = RayCastObserver(region, camera)
    error, share_error = [], []
    exact_areas = exact_seen_areas(camera, 30, seed=1)
    for pose, exact in zip(random_views(30, seed=1), exact_areas, strict=True):
        fraction = observer.visible_fraction(pose.r_A, pose.C_CA)
        error.append((region.area[fraction >= 0.5].sum() - exact) / region.total_area)
        share_error.append((region.area @ fraction - exact) / region.total_area)
    assert np.sqrt(np.mean(np.square(error))) < 0.01
    assert np.abs(error).max() < 0.04
    assert np.sqrt(np.mean(np.square(share_error))) < 0.002


@pytest.mark.parametrize("views", [dict(seed=1), dict(seed=5, spread_deg=95.0), dict(seed=2, off_deg=25.0)], ids=str)
def test_no_hidden_cell_is_ever_seen_and_no_wholly_visible_one_ever_lost(views):
    region, camera = eros_target(600.0), CameraModel()
    observer = RayCastObserver(region, camera)
    for pose, exact in zip(random_views(8, **views), exact_cell_shares(600.0, camera, 8, **views), strict=True):
        fraction = observer.visible_fraction(pose.r_A, pose.C_CA)
        assert not fraction[exact < 1e-9].any()
        assert (fraction[exact > 1 - 1e-9] >= 0.5).all()


def test_a_plate_hides_its_central_projection():
    region = ground_with_plate()
    pose = look_at([0.0, 7.0, 0.0], [0.0, 0.0, 0.0])
    fraction = RayCastObserver(region, CameraModel(half_angle_deg=60.0)).visible_fraction(pose.r_A, pose.C_CA)
    assert on_ground(region) @ (region.area * (1 - fraction)) == pytest.approx((5 / 4) ** 2, rel=0.02)


def test_the_compiled_loop_and_embree_hit_the_same_faces():
    region = eros_target()
    compiled = RayTracer(region.vertices, region.faces, use_embree=False)
    embree = RayTracer(region.vertices, region.faces)
    if embree.engine != "embree":
        pytest.skip("embreex is not installed")
    rng = np.random.default_rng(4)
    origins = 25e3 * rng.normal(size=(1500, 3))
    rays = 6e3 * rng.normal(size=(1500, 3)) - origins
    a, b = compiled.first_hit(origins, rays), embree.first_hit(origins, rays)
    assert (a >= 0).mean() > 0.3
    assert (a != b).mean() < 2e-3


def test_the_compiled_loop_takes_the_nearest_face_ahead_and_nothing_behind():
    region = ground_with_plate()
    tracer = RayTracer(region.vertices, region.faces, use_embree=False)
    start = np.array([[0.1, 9.0, 0.2], [0.1, 2.5, 0.2], [0.1, 9.0, 0.2], [20.0, 9.0, 0.0]])
    ray = np.array([[0.0, -1, 0], [0, -1, 0], [0, 1, 0], [0, -1, 0]])
    hit = tracer.first_hit(start, ray)
    assert region.mesh.face_centroids[hit[:2], 1] == pytest.approx([3.0, 2.0], abs=1e-5)
    assert hit[2:].tolist() == [-1, -1]


@pytest.mark.parametrize("samples", [1, 4, 16, 49])
def test_samples_are_spread_evenly(samples):
    points = barycentric_samples(samples)
    assert points.shape == (samples, 3)
    assert points.min() > 0
    assert points.sum(axis=1) == pytest.approx(1.0)
    assert points.mean(axis=0) == pytest.approx(1 / 3)
    # Variance of one barycentric coordinate over a triangle is 1/18; midpoint sampling of k^2 parts misses 1/k^2 of it.
    assert points.var(axis=0) == pytest.approx((1 - 1 / samples) / 18)


@pytest.mark.parametrize("samples", [0, -4, 15])
def test_a_number_of_samples_that_is_no_square_is_refused(samples):
    with pytest.raises(MissionError, match="square number"):
        RayCastObserver(eros_target(), CameraModel(), samples=samples)


def test_without_occlusion_only_a_cells_own_back_and_the_field_of_view_hide_it():
    region = ground_with_plate()
    pose = look_at([0.0, 7.0, 0.0], [0.0, 0.0, 0.0])
    observer = RayCastObserver(region, CameraModel(half_angle_deg=60.0), occlusion=False)
    assert (observer.visible_fraction(pose.r_A, pose.C_CA)[on_ground(region)] == 1.0).all()
    narrow = RayCastObserver(region, CameraModel(half_angle_deg=10.0), occlusion=False)
    seen = on_ground(region) @ (region.area * narrow.visible_fraction(pose.r_A, pose.C_CA))
    assert seen == pytest.approx((2 * 5 * np.tan(np.radians(10))) ** 2, rel=0.02)
    beneath = look_at([0.0, 0.0, 0.0], [0.0, 3.0, 0.0])
    assert not observer.visible_fraction(beneath.r_A, beneath.C_CA)[on_ground(region)].any()
