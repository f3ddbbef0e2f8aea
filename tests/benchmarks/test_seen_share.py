"""The seen share of the target, by which the benchmarked observers are judged."""

import sys
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from swarm_mj.mission.target import build_target
from swarm_mj.observation.camera import CameraModel
from swarm_mj.observation.faceid import FaceIdObserver
from swarm_mj.observation.raycast import RayCastObserver
from swarm_mj.smallbody.shape_harmonics import build_shape

sys.path.append(str(Path(__file__).parents[2]))  # the benchmarks are no part of the installed package

from benchmarks.performance import seen_share  # noqa: E402
from benchmarks.performance.observers import (  # noqa: E402
    count_drawn,
    count_pixels,
    embree_scene,
    pixel_rays,
    rounds_of_poses,
)

CAMERA = CameraModel(half_angle_deg=21.5, resolution_px=512)


@pytest.fixture(scope="module")
def shape():
    return build_shape("eros", 8)


@pytest.fixture(scope="module")
def region(shape):
    return build_target(shape, latitude_deg=0.0, longitude_deg=90.0, half_angle_deg=20.0)


@pytest.fixture(scope="module")
def poses():
    return next(rounds_of_poses(1, 4))


def test_polygons_and_rays_find_the_same_share(shape, region, poses, monkeypatch):
    pytest.importorskip("shapely")
    exact, by_polygons = seen_share.reference(shape, region, CAMERA, poses)
    monkeypatch.setattr(seen_share, "find_spec", lambda name: None)
    sampled, by_rays = seen_share.reference(shape, region, CAMERA, poses)
    assert "polygon" in by_polygons and by_rays == "from 256 rays a face"
    assert np.all((exact > 0.2) & (exact <= 1.0 + 1e-12))
    assert seen_share.rms_error_percent(sampled, exact) < 0.1


def test_a_mesh_too_fine_for_polygons_is_judged_by_rays(shape, region, poses, monkeypatch):
    monkeypatch.setattr(seen_share, "CLIPPED_FACES", 0)
    monkeypatch.setattr(seen_share, "RAYS", ((1, 256), (10**9, 64)))
    assert seen_share.reference(shape, region, CAMERA, poses[:1])[1] == "from 64 rays a face"


def test_pixels_tell_the_same_share_whoever_finds_the_faces(shape, region, poses):
    truth = seen_share.judged(RayCastObserver(region, CAMERA, samples=256), poses)
    scene = embree_scene(region)
    with closing(FaceIdObserver(region, CAMERA, crop=False, drawing="compiled")) as observer:
        drawn = [count_drawn(observer, pose, region) for pose in poses]
    traced = [count_pixels(scene.run, *pixel_rays(pose, CAMERA), region) for pose in poses]
    by_drawing, by_peer = (seen_share.shares_by_pixels(counts, region, CAMERA, poses) for counts in (drawn, traced))
    assert seen_share.rms_error_percent(by_drawing, by_peer) < 0.02
    assert seen_share.rms_error_percent(by_drawing, truth) < 1.0


def test_errors_are_root_mean_squares_in_percent():
    assert seen_share.rms_error_percent(np.array([0.5, 0.53]), np.array([0.5, 0.5])) == pytest.approx(
        100 * 0.03 / 2**0.5
    )


def test_small_faces_are_not_counted_in_pixels(shape, region, poses):
    coarse = CameraModel(half_angle_deg=21.5, resolution_px=16)
    assert seen_share.counted_percent(region, coarse, poses) < 10.0 < seen_share.counted_percent(region, CAMERA, poses)
