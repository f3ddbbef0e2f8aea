"""The patches of the target: a partition."""

import numpy as np
import pytest
from swarm_mj.envs.observe.patches import make_patches

from swarm_mj.mission.target import build_target


@pytest.fixture(scope="module")
def region(eros):
    return build_target(eros, latitude_deg=0.0, longitude_deg=90.0, half_angle_deg=20.0, cell_size_m=600.0)


@pytest.mark.parametrize("count", [1, 4, 16, 25])
def test_patches_divide_the_target_without_loss(region, count):
    patches = make_patches(region, count)
    assert patches.count == count
    assert patches.area.sum() == pytest.approx(region.total_area, rel=1e-12)


def test_patches_are_numbered_from_the_south_west_corner_west_to_east(region):
    patches = make_patches(region, 16)
    latitude = np.degrees(np.arcsin(patches.centre_A[:, 2] / np.linalg.norm(patches.centre_A, axis=1)))
    longitude = np.degrees(np.arctan2(patches.centre_A[:, 1], patches.centre_A[:, 0]))
    assert (np.diff(latitude.reshape(4, 4), axis=0) > 2.0).all()
    assert (np.diff(longitude.reshape(4, 4), axis=1) > 2.0).all()


def test_the_centre_of_a_patch_is_the_mean_of_its_surface_however_uneven_the_cells(region):
    patches = make_patches(region, 9)
    for k in range(9):
        inside = patches.of_cell == k
        mean = np.average(region.centroid_A[inside], axis=0, weights=region.area[inside])
        assert patches.centre_A[k] == pytest.approx(mean, rel=1e-12, abs=1e-6)
    assert region.area.std() > 0.1 * region.area.mean()
