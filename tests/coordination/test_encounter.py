"""The table of an encounter: pictures show what the criterion counts, motion blur and releases included."""

from functools import cache

import numpy as np
import pytest

from swarm_mj.coordination import encounter
from swarm_mj.coordination.encounter import Track, aim_points, following, reach_of, shown_cells
from swarm_mj.mission.target import build_target, whole_body
from swarm_mj.observation.camera import CameraModel, look_at, motion_blur_px
from swarm_mj.observation.capture import observe
from swarm_mj.observation.horizon import HorizonObserver
from swarm_mj.scenarios.schema_imaging import Observation
from swarm_mj.smallbody.shape import ShapeModel
from swarm_mj.smallbody.shape_harmonics import build_ellipsoid
from tests.sample_missions.flights import dumbbell

CAMERA = CameraModel(half_angle_deg=3.0, shape="cone", exposure_s=0.01)
ANY = Observation(light="ignored", max_emission_deg=90.0, min_pixels=0.0)
LIMITED = Observation(max_gsd_m=0.35, max_emission_deg=60.0, max_incidence_deg=80.0, max_motion_blur_px=1.0)


@pytest.fixture(autouse=True)
def own_cache(tmp_path, monkeypatch):
    monkeypatch.setenv("SWARM_MJ_CACHE", str(tmp_path))


@cache
def target():
    shape = build_ellipsoid((600.0, 500.0, 400.0), "ball", frequency=12)
    return build_target(shape, latitude_deg=0, longitude_deg=90, half_angle_deg=35)


def track(free=None):
    """Three spacecraft that pass by in a row, four slots; the last is too far away for the resolution."""
    k = np.arange(4)[:, None]
    r_A = np.stack(
        [300.0 * (k - 1.5) + 150.0 * np.arange(3), 1500.0 + 800.0 * np.arange(3) + 0 * k, 0 * k + [0, 60, 0]], 2
    )
    v_A = np.broadcast_to([30.0, 0.0, 0.0], r_A.shape)
    return Track(r_A, v_A, np.ones((4, 3), bool) if free is None else free, np.tile([1.0, 1.0, 0.2], (4, 1)))


def aims_of(criterion, there):
    return aim_points(target(), CAMERA, reach_of(target(), criterion, CAMERA, there))[0]


@pytest.mark.parametrize("criterion", [ANY, LIMITED], ids=["any", "limited"])
def test_a_picture_shows_what_counts_in_it_and_the_kept_table_is_the_same(criterion):
    observer, aims_A, there = HorizonObserver(target(), CAMERA), aims_of(criterion, track()), track()
    shows = shown_cells(observer, criterion, aims_A, there)
    for a, m, k in np.ndindex(shows.shape[:3]):
        pose = look_at(there.r_A[k, a], aims_A[m])
        motion = following(aims_A[m] - pose.r_A, there.v_A[k, a], pose.C_CA)
        seen = observe(observer, pose.r_A, pose.C_CA, criterion, there.sun_A[k], motion)
        np.testing.assert_array_equal(shows[a, m, k], seen)
    assert shows[0].any()
    assert criterion is not LIMITED or (not shows[2].any() and shows[0].any(axis=2).mean() < 1.0)
    np.testing.assert_array_equal(shown_cells(observer, criterion, aims_A, there), shows)


@pytest.mark.parametrize("narrow", [3.0, 8.0])
def test_aims_have_in_view_whatever_any_picture_of_a_whole_body_can_show(narrow):
    # Overhangs: two balls and a neck, seen from all around.
    mesh = dumbbell()
    region = whole_body(ShapeModel(np.array(mesh.vertices), np.array(mesh.faces), "dumb-bell"))
    camera, turn = CameraModel(half_angle_deg=narrow, shape="cone"), np.radians(np.arange(0, 360, 45))
    r_A = 4000.0 * np.stack([np.cos(turn), np.sin(turn), 0.5 * np.sin(2.0 * turn)], 1)[:, None]
    there = Track(r_A, np.zeros_like(r_A), np.ones((8, 1), bool), np.tile([1.0, 0.0, 0.0], (8, 1)))
    reach = reach_of(region, ANY, camera, there)
    aims_A, spacing = aim_points(region, camera, reach)
    observer = HorizonObserver(region, camera)
    shown = shown_cells(observer, ANY, aims_A, there, reach).any(axis=(0, 1, 2))
    can = np.zeros(region.n_cells, bool)
    for place in r_A[:, 0]:
        for cell in np.flatnonzero(region.normal_A @ place > 0.0)[::3]:
            pose = look_at(place, region.centroid_A[cell])
            can[cell] |= observe(observer, pose.r_A, pose.C_CA, ANY)[cell]
    assert spacing == 1.0 and len(aims_A) < region.n_cells / 4
    assert can.sum() > 100 and shown[can].all()


def test_a_table_that_would_be_too_large_has_fewer_aims_and_says_how_far_apart(monkeypatch):
    reach = reach_of(target(), ANY, CAMERA, track())
    many, near = aim_points(target(), CAMERA, reach)
    monkeypatch.setattr(encounter, "MOST_PICTURES", 12 * len(many) // 4)
    few, far = aim_points(target(), CAMERA, reach)
    assert near == 1.0 < far and len(few) <= len(many) // 4


def test_who_is_still_aboard_the_mothership_shows_nothing():
    observer, aims_A = HorizonObserver(target(), CAMERA), aims_of(ANY, track())
    free = np.arange(4)[:, None] >= np.array([0, 2, 0])
    held, all_free = (shown_cells(observer, ANY, aims_A, track(f)) for f in (free, None))
    assert all_free[1, :, :2].any() and not held[1, :, :2].any()
    np.testing.assert_array_equal(held[1, :, 2:], all_free[1, :, 2:])
    np.testing.assert_array_equal(held[[0, 2]], all_free[[0, 2]])


def test_a_camera_that_follows_its_aim_does_not_blur_it():
    region, pose = target(), look_at([300.0, 1500.0, 100.0], target().centroid_A[7])
    v_A = np.array([100.0, -20.0, 30.0])
    still = following(region.centroid_A[7] - pose.r_A, v_A, pose.C_CA)
    motion_blur = motion_blur_px(region, CAMERA, pose.r_A, pose.C_CA, still)
    fixed = motion_blur_px(region, CAMERA, pose.r_A, pose.C_CA, still._replace(omega_C=np.zeros(3)))
    assert motion_blur[7] < 1e-9 < 1.0 < fixed[7]
