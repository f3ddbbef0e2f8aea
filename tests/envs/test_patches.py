"""The patches of the target: a partition, and points that lie on the surface where their tangents say."""

import numpy as np
import pytest
import trimesh
from swarm_mj.envs.observe.patches import make_patches, surface_points, tangents

from swarm_mj.mission.target import build_target
from swarm_mj.observation.raytracing import RayTracer


@pytest.fixture(scope="module")
def region(eros):
    return build_target(eros, latitude_deg=0.0, longitude_deg=90.0, half_angle_deg=20.0, cell_size_m=600.0)


@pytest.mark.parametrize("count", [1, 4, 16, 25])
def test_patches_divide_the_target_without_loss(region, count):
    patches = make_patches(region, count)
    assert patches.count == count
    assert patches.area.sum() == pytest.approx(region.total_area, rel=1e-12)
    assert patches.seen_fraction(np.ones(region.n_cells, bool)) == pytest.approx(1.0)
    assert not patches.seen_fraction(np.zeros(region.n_cells, bool)).any()


def test_patches_are_numbered_from_the_south_west_corner_west_to_east(region):
    patches = make_patches(region, 16)
    latitude = np.degrees(np.arcsin(patches.centre_A[:, 2] / np.linalg.norm(patches.centre_A, axis=1)))
    longitude = np.degrees(np.arctan2(patches.centre_A[:, 1], patches.centre_A[:, 0]))
    assert (np.diff(latitude.reshape(4, 4), axis=0) > 2.0).all()
    assert (np.diff(longitude.reshape(4, 4), axis=1) > 2.0).all()


def test_seeing_one_patch_fills_only_that_patch(region):
    patches = make_patches(region, 9)
    fraction = patches.seen_fraction(patches.of_cell == 4)
    assert fraction[4] == pytest.approx(1.0) and np.delete(fraction, 4) == pytest.approx(0.0)


@pytest.mark.parametrize("use_embree", [True, False])
def test_surface_points_lie_on_the_surface_under_their_tangents(region, use_embree):
    asked = np.random.default_rng(0).uniform(-1, 1, (30, 2))
    points = surface_points(region, RayTracer(region.vertices, region.faces, use_embree=use_embree), asked)
    assert np.allclose(tangents(region, points), asked, atol=1e-12)
    body = trimesh.Trimesh(region.vertices, region.faces, process=False)
    for point in points:
        # Some face holds the point: its plane is less than a millimetre away, and the coordinates on it are not negative.
        corners = body.triangles
        beside = np.abs(((point - corners[:, 0]) * body.face_normals).sum(1)) < 1e-3
        shares = trimesh.triangles.points_to_barycentric(corners[beside], np.tile(point, (beside.sum(), 1)))
        assert (shares > -1e-6).all(axis=1).any()


def test_the_centre_of_a_patch_is_the_mean_of_its_surface_however_uneven_the_cells(region):
    patches = make_patches(region, 9)
    for k in range(9):
        inside = patches.of_cell == k
        mean = np.average(region.centroid_A[inside], axis=0, weights=region.area[inside])
        assert patches.centre_A[k] == pytest.approx(mean, rel=1e-12, abs=1e-6)
    assert region.area.std() > 0.1 * region.area.mean()
