"""When pictures are taken, by whom and from where; and the rules of the criterion, in arrays and compiled alike."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from swarm_mj.compilation import kernel
from swarm_mj.mission.behaviors import TargetKind, looks_at_body
from swarm_mj.observation.camera import CameraModel, Optics, in_field_of_view, look_at
from swarm_mj.observation.capture import (
    PictureSchedule,
    causes,
    keeps_limits,
    limits_of,
    pictures,
    pixels_on,
    shows_enough,
    takes_picture,
    watching,
)
from swarm_mj.observation.coverage import Cause
from swarm_mj.observation.horizon import HorizonObserver
from swarm_mj.observation.horizon_kernels import make_scene
from swarm_mj.observation.observer import make_observer

from .scenes import eros_target, ground_with_plate, on_ground, plain

SCHEDULE = {"interval_s": 35.0, "arrivals_s": 600.0}


@pytest.mark.parametrize("period", [0.5, 1.0, 5.0])
def test_pictures_are_due_at_even_times_and_at_the_arrival_whatever_the_clock(period):
    schedule = PictureSchedule.by_clock(period, **SCHEDULE)
    times = period * schedule.ticks(round(1200 / period))
    assert sorted({*np.arange(0.0, 1201.0, 35.0), 600.0}) == times.tolist()
    only = PictureSchedule.by_clock(period, **SCHEDULE, arrival_only=True)
    assert (period * only.ticks(round(1200 / period))).tolist() == [600.0]
    assert all(schedule.due(int(tick)) for tick in schedule.ticks(300))


def test_fewer_spacecraft_than_observers_keep_their_own_arrivals():
    """Files of a flight need not be those of all observers of the scenario that judges them."""
    schedule = PictureSchedule(every=7, arrivals=(3, 5, 5))
    assert [schedule.takers(tick, 1).tolist() for tick in (3, 5, 7)] == [[True], [False], [True]]
    assert schedule.takers(5, 2).tolist() == [False, True]


def test_those_take_pictures_who_observe_the_body_with_a_camera_that_works():
    kind = np.array([list(TargetKind), list(TargetKind)[::-1]])
    expected = [[True, False, False, True, False], [False, True, False, False, True]]
    assert watching(5, kind).tolist() == expected
    assert watching(3, kind).tolist() == [[True, False, False, False, False], [False, True, False, False, False]]
    camera_on = np.array([[True] * 5, [True, False, True, True, True]])
    assert watching(5, kind, camera_on).tolist() == [expected[0], [False, False, False, False, True]]
    assert [kind for kind in TargetKind if looks_at_body(kind)] == [TargetKind.ASTEROID, TargetKind.SURFACE]


def test_a_picture_is_taken_from_where_the_spacecraft_is_as_it_is_turned():
    rng = np.random.default_rng(4)
    C_AN, C_BN = Rotation.random(random_state=1).as_matrix(), Rotation.random(5, random_state=2).as_matrix()
    r_BN_N, sun_N = rng.normal(size=(5, 3)) * 2e4, rng.normal(size=3) * 2e11
    who = np.array([True, False, True, True, False])
    taken = list(pictures(7.0, who, r_BN_N, C_BN, C_AN, sun_N))
    assert [picture.spacecraft for picture in taken] == [0, 2, 3] and {picture.t for picture in taken} == {7.0}
    for picture in taken:
        in_A = Rotation.from_matrix(C_AN).apply(r_BN_N[picture.spacecraft])
        assert np.allclose(picture.r_A, in_A, rtol=1e-14)
        # A point seen by the camera is where the spacecraft sees it from N.
        point_N = rng.normal(size=3) * 1e4
        in_camera = picture.pose.to_camera(Rotation.from_matrix(C_AN).apply(point_N))
        in_B = Rotation.from_matrix(C_BN[picture.spacecraft]).apply(point_N - r_BN_N[picture.spacecraft])
        assert np.allclose(in_camera, in_B, atol=1e-9)
        assert np.allclose(picture.sun_A, Rotation.from_matrix(C_AN).apply(sun_N), rtol=1e-14)


def test_rules_in_arrays_are_bit_for_bit_those_in_compiled_code():
    rng = np.random.default_rng(6)
    n = 20_000
    distance = rng.uniform(1e4, 2e4, n)
    height = distance * rng.uniform(-0.2, 1.0, n)
    criterion = plain(max_emission_deg=50.0, max_range_m=17e3, max_gsd_m=3.0, min_fraction=0.28, min_pixels=2000.0)
    limits = limits_of(criterion, CameraModel(half_angle_deg=2.5), eros_target())
    x, y, z = rng.normal(size=(3, n)) * [[1.0], [1.0], [3.0]]
    optics, share = Optics(0.3, True), rng.integers(0, 26, n) / 25
    kinds, camera_on = rng.integers(0, 5, n), rng.random(n) < 0.5

    @kernel
    def one_by_one(limits, optics):
        out = np.empty((5, n))
        for i in range(n):
            out[0, i] = keeps_limits(limits, distance[i], height[i])
            out[1, i] = shows_enough(limits, share[i])
            out[2, i] = pixels_on(limits, 3.0, distance[i], height[i])
            out[3, i] = in_field_of_view(optics, x[i], y[i], z[i])
            out[4, i] = takes_picture(i, n // 2, kinds[i], camera_on[i])
        return out

    arrays = [
        keeps_limits(limits, distance, height),
        shows_enough(limits, share),
        pixels_on(limits, 3.0, distance, height),
        in_field_of_view(optics, x, y, z),
        takes_picture(np.arange(n), n // 2, kinds, camera_on),
    ]
    assert np.array_equal(one_by_one.py_func(limits, optics), np.array(arrays, float))
    assert np.array_equal(one_by_one(limits, optics), np.array(arrays, float))
    assert all(0.01 < np.mean(rule) < 0.99 for k, rule in enumerate(arrays) if k != 2)


@pytest.mark.parametrize(
    ("criterion", "needed"),
    [
        ({"min_fraction": 0.28}, 7),  # 0.28 x 25 is 7.000000000000001 in double precision, but 7 / 25 is 0.28
        ({"min_fraction": 0.5}, 13),
        ({"min_fraction": 0.98}, 25),
        ({"min_fraction": 1e-12}, 1),
        ({"any_pixel": True}, 1),
    ],
)
def test_compiled_code_asks_for_as_many_sample_points_as_the_share_does(criterion, needed):
    observer = HorizonObserver(eros_target(), CameraModel(), samples=25)
    given = plain(**criterion)
    assert make_scene(observer, given).samples == needed
    enough = shows_enough(limits_of(given, observer.camera, eros_target()), np.arange(26) / 25)
    assert enough.tolist() == [False] * needed + [True] * (26 - needed)


@pytest.mark.parametrize("kind", ["horizon", "raster", "raycast"])
def test_what_the_edge_of_the_picture_cuts_is_out_of_view_and_what_stands_behind_something_is_hidden(kind):
    """Seen from 6 m above flat ground, a square plate 1 m up hides a square of 6/5 its side, turned as it is."""
    region, camera = ground_with_plate(0.3), CameraModel(half_angle_deg=14.0)
    maps = kind == "horizon"
    observer = HorizonObserver(region, camera, samples=9) if maps else make_observer(region, camera, kind=kind)
    pose = look_at([0.0, 8.0, 0.0], [1.2, 2.0, 0.3])
    why, ground = causes(observer, pose, plain(min_fraction=0.9)), on_ground(region)
    in_view = camera.contains(pose.to_camera(region.corners_A))
    x, z = region.corners_A[..., 0], region.corners_A[..., 2]
    c, s = np.cos(0.3), np.sin(0.3)
    across = np.stack((c * x + s * z, c * z - s * x, -c * x - s * z, s * x - c * z))
    under = (across < 0.6).all(axis=(0, 2)) & ground
    clear = (across > 0.7).all(axis=2).any(axis=0) & ground
    whole, cut = in_view.all(axis=1), in_view.any(axis=1) & ~in_view.all(axis=1)
    assert {Cause(k) for k in why[under & whole]} == {Cause.HIDDEN}
    assert {Cause(k) for k in why[clear & whole]} == {Cause.NONE}
    assert {Cause(k) for k in why[under & cut]} == {Cause.HIDDEN, Cause.OUT_OF_VIEW}
    assert {Cause(k) for k in why[clear & cut]} == {Cause.NONE, Cause.OUT_OF_VIEW}
