"""Horizon maps: against exact polygons, against rays, inside the bounding sphere."""

import numpy as np
import pytest

from swarm_mj.observation.camera import CameraModel, look_at
from swarm_mj.observation.capture import observe
from swarm_mj.observation.horizon import AZIMUTHS, SHOWN, HorizonObserver, look_at_all
from swarm_mj.observation.observer import make_observer
from swarm_mj.observation.raycast import RayCastObserver

from .scenes import eros_target, exact_cell_shares, exact_seen_areas, ground_with_plate, on_ground, plain, random_views


@pytest.fixture(scope="module", autouse=True)
def own_cache(tmp_path_factory):
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("SWARM_MJ_CACHE", str(tmp_path_factory.mktemp("cache")))
        yield


@pytest.fixture(scope="module")
def observer():
    return HorizonObserver(eros_target(), CameraModel())


def test_seen_area_agrees_with_the_oracle_over_thirty_random_views(observer):
    region = observer.region
    error, share_error = [], []
    exact_areas = exact_seen_areas(observer.camera, 30, seed=1)
    for pose, exact in zip(random_views(30, seed=1), exact_areas, strict=True):
        fraction = observer.visible_fraction(pose.r_A, pose.C_CA)
        error.append((region.area[fraction >= 0.5].sum() - exact) / region.total_area)
        share_error.append((region.area @ fraction - exact) / region.total_area)
    assert np.sqrt(np.mean(np.square(error))) < 0.01
    assert np.abs(error).max() < 0.04
    assert np.sqrt(np.mean(np.square(share_error))) < 0.005


@pytest.mark.parametrize("views", [dict(seed=5, spread_deg=95.0), dict(seed=2, off_deg=25.0)], ids=str)
def test_no_hidden_cell_is_ever_seen(observer, views):
    for pose, exact in zip(random_views(8, **views), exact_cell_shares(None, observer.camera, 8, **views), strict=True):
        assert not observer.visible_fraction(pose.r_A, pose.C_CA)[exact < 1e-9].any()


@pytest.mark.parametrize("altitude", [300.0, 1500.0])
def test_inside_the_bounding_sphere_a_rise_beyond_the_camera_does_not_count(observer, altitude):
    # Low over the target and looking sideways: for some cells a lobe of Eros stands behind the camera.
    region = observer.region
    rays = RayCastObserver(region, observer.camera)
    rng = np.random.default_rng(3)
    differ = saved = 0
    for _ in range(25):
        above, aim = rng.choice(region.n_cells, 2, replace=False)
        pose = look_at(region.centroid_A[above] + altitude * region.normal_A[above], region.centroid_A[aim])
        ours, theirs = (o.visible_fraction(pose.r_A, pose.C_CA) for o in (observer, rays))
        differ += int((np.abs(ours - theirs) > 0.13).sum())
        answer, _, inside = look_at_all(
            observer.horizon.arrays, pose.r_A, pose.C_CA, observer.camera.optics, region.mesh.max_radius
        )
        assert inside
        by_map = answer == SHOWN
        saved += int((by_map.mean(axis=1) < ours).sum())
    assert differ < 0.02 * 25 * region.n_cells
    assert saved > 0


def test_field_of_view_and_facing_are_those_of_the_ray_caster():
    region = eros_target()
    for camera in (CameraModel(half_angle_deg=4.0), CameraModel(half_angle_deg=4.0, shape="cone")):
        maps = HorizonObserver(region, camera)
        rays = RayCastObserver(region, camera, samples=maps.horizon.points.shape[1])  # the same points
        for pose in random_views(12, seed=8, spread_deg=30.0, off_deg=6.0):
            ours, theirs = (o.visible_fraction(pose.r_A, pose.C_CA) for o in (maps, rays))
            assert (np.abs(ours - theirs) > 0.05).mean() < 0.02


def test_the_plate_hides_the_ground_beneath_it():
    region = ground_with_plate(0.3)
    pose = look_at([0.0, 7.0, 0.0], [0.0, 0.0, 0.0])
    seen = HorizonObserver(region, CameraModel(half_angle_deg=60.0), samples=4).visible_fraction(pose.r_A, pose.C_CA)
    hidden = on_ground(region) @ (region.area * (1 - seen))
    assert hidden == pytest.approx((5 / 4) ** 2, rel=0.1)


def test_rays_are_blocked_below_the_horizon_and_free_above_it(observer):
    maps, region, rng = observer.horizon, observer.region, np.random.default_rng(6)
    cell, sample = rng.integers(region.n_cells, size=20_000), rng.integers(maps.samples, size=20_000)
    azimuth = rng.integers(AZIMUTHS, size=20_000)
    sine = maps.sine[cell, sample, azimuth].astype(float)
    first, second, normal = np.moveaxis(maps.axes[cell], 1, 0)
    angle = 2.0 * np.pi * azimuth[:, None] / AZIMUTHS
    start = maps.points[cell, sample] + 1e-7 * region.mesh.max_radius * normal

    def free(elevation):
        level = np.cos(angle) * first + np.sin(angle) * second
        way = np.cos(elevation)[:, None] * level + np.sin(elevation)[:, None] * normal
        return observer.tracer.first_hit(start, way) < 0

    raised = (sine > 0.0) & (sine < 0.95)
    assert raised.sum() > 1000
    assert free(np.arcsin(sine) + np.radians(0.01))[(sine > 0.0) & (sine < 1.0)].mean() > 0.999
    assert free(np.arcsin(sine) - np.radians(0.19))[raised].mean() < 0.001
    assert free(np.full(len(sine), np.radians(0.3)))[sine == 0.0].mean() > 0.999


def test_maps_are_kept_and_read_back(observer):
    again = HorizonObserver(observer.region, observer.camera)
    assert np.array_equal(again.horizon.sine, observer.horizon.sine)


def test_the_observer_is_chosen_by_name_and_serves_the_criterion():
    observer = make_observer(eros_target(), CameraModel(), kind="horizon")
    pose = look_at([0.0, 21e3, 0.0], [0.0, 0.0, 0.0])
    seen = observe(observer, pose.r_A, pose.C_CA, plain(light="sunlit", max_incidence_deg=90.0), sun_A=[0.6, 1.0, 0.2])
    assert observer.name == "horizon"
    assert 0 < seen.sum() <= observer.region.n_cells
