"""Whole cells by geometry: against exact polygon clipping, whoever looks, and beside counted pixels."""

import numpy as np
import pytest

from swarm_mj.errors import MissionError
from swarm_mj.observation.camera import CameraModel, look_at
from swarm_mj.observation.capture import observe
from swarm_mj.observation.horizon import HorizonObserver
from swarm_mj.observation.horizon_kernels import make_scene
from swarm_mj.observation.observer import make_observer
from swarm_mj.observation.raycast import RayCastObserver

from .scenes import cell_oracle, eros_target, exact_view, ground_with_plate, on_ground, plain, random_views

WHOLE = plain(min_fraction=1.0)


@pytest.mark.parametrize("cell_size", [None, 600.0])
def test_cells_are_whole_where_exact_clipping_leaves_nothing_out_whoever_looks(cell_size):
    region, camera = eros_target(cell_size), CameraModel(half_angle_deg=5.0, resolution_px=64)
    oracle = cell_oracle(region)
    observers = [make_observer(region, camera, kind=kind) for kind in ("raycast", "raster")]
    views = random_views(6, 3, spread_deg=20.0, off_deg=4.0)
    cut = 0
    for pose in views:
        exact = oracle.visible_area(exact_view(pose, camera)) / region.area
        cut += ((exact > 0.95) & (exact < 1 - 1e-9)).sum()
        for observer in observers:
            assert np.array_equal(observe(observer, pose.r_A, pose.C_CA, WHOLE), exact > 1 - 1e-9)
    assert cut > 0  # there were cells that counted pixels take for whole ones, or nearly


def test_at_the_limb_nothing_whole_is_lost_and_little_hidden_is_taken_for_whole():
    region, camera = eros_target(600.0), CameraModel()
    oracle, observer = cell_oracle(region), RayCastObserver(region, camera)
    for pose in random_views(8, 5, spread_deg=95.0):
        exact = oracle.visible_area(exact_view(pose, camera)) / region.area
        seen = observe(observer, pose.r_A, pose.C_CA, WHOLE)
        assert seen[exact > 1 - 1e-9].all()
        assert exact[seen].min(initial=1.0) > 15 / 16


def test_a_plate_takes_away_every_cell_that_its_shadow_touches():
    region, pose = ground_with_plate(0.3), look_at([0.0, 7.0, 0.0], [0.0, 0.0, 0.0])
    camera = CameraModel(half_angle_deg=60.0)
    shares = RayCastObserver(region, camera).visible_fraction(pose.r_A, pose.C_CA)
    hidden, free = (
        observe(make_observer(region, camera, kind="raycast", occlusion=occlusion), pose.r_A, pose.C_CA, WHOLE)
        for occlusion in (True, False)
    )
    ground = on_ground(region)
    assert np.array_equal(hidden[ground], (shares == 1.0)[ground])
    assert free[ground].all() and not hidden[ground].all()


@pytest.mark.parametrize(("fraction", "whole"), [(0.5, False), (0.98, False), (0.99, True), (0.999, True), (1.0, True)])
def test_shares_that_counted_pixels_cannot_tell_from_all_ask_for_whole_cells(fraction, whole):
    assert plain(min_fraction=fraction).whole == whole
    assert not plain(min_fraction=fraction, any_pixel=True).whole


def test_compiled_maps_refuse_to_judge_whole_cells_by_sample_points():
    observer = HorizonObserver(eros_target(), CameraModel(), samples=1)
    with pytest.raises(MissionError, match="whole cells"):
        make_scene(observer, WHOLE)
