"""Observation limits against closed forms, the coverage map by hand, and a whole flight against the oracle."""

from functools import cache

import numpy as np
import pytest

from swarm_mj.errors import MissionError
from swarm_mj.mission.target import automatic_cell_size, build_target
from swarm_mj.observation.camera import CameraModel, look_at
from swarm_mj.observation.capture import observe
from swarm_mj.observation.coverage import CoverageMap, KeptPictures, Shown, percent_text, rounded_up_digits
from swarm_mj.observation.observer import make_observer
from swarm_mj.observation.raycast import RayCastObserver
from swarm_mj.smallbody.geodesic import geodesic_icosahedron
from swarm_mj.smallbody.shape import ShapeModel

from .scenes import eros_oracle, eros_target, exact_view, flyby, ground_with_plate, on_ground, plain

RADIUS = 1000.0


@cache
def ball():
    """Most of the hemisphere y > 0 of a sphere of 1 km."""
    directions, faces = geodesic_icosahedron(60)
    shape = ShapeModel(RADIUS * directions, faces, "ball")
    return build_target(shape, latitude_deg=0, longitude_deg=90, half_angle_deg=75, edges="side")


def seen_area(region, r_A, criterion, sun_A=None, half_angle=80.0, aim=(0.0, 0.0, 0.0)):
    pose = look_at(r_A, aim)
    observer = RayCastObserver(region, CameraModel(half_angle_deg=half_angle, resolution_px=500))
    seen = observe(observer, pose.r_A, pose.C_CA, criterion, sun_A)
    return region.area[seen].sum()


def cap(angle):
    return 2 * np.pi * RADIUS**2 * (1 - np.cos(angle))


def test_the_emission_limit_leaves_a_cap_of_the_sphere():
    limit = np.radians(40.0)
    central = limit - np.arcsin(RADIUS * np.sin(limit) / 3000.0)
    area = seen_area(ball(), [0.0, 3000.0, 0.0], plain(max_emission_deg=40.0))
    assert area == pytest.approx(cap(central), rel=0.02)


def test_the_range_limit_leaves_a_cap_of_the_sphere():
    # Law of cosines: 2200^2 = 1000^2 + 3000^2 - 2 1000 3000 cos(central)
    central = np.arccos((RADIUS**2 + 3000.0**2 - 2200.0**2) / (2 * RADIUS * 3000.0))
    area = seen_area(ball(), [0.0, 3000.0, 0.0], plain(max_range_m=2200.0))
    assert area == pytest.approx(cap(central), rel=0.02)


def test_the_incidence_limit_leaves_a_cap_around_the_sun():
    sun = np.array([0.3, 1.0, 0.2])
    criterion = plain(light="sunlit", max_incidence_deg=25.0)
    assert seen_area(ball(), [0.0, 3000.0, 0.0], criterion, sun) == pytest.approx(cap(np.radians(25.0)), rel=0.02)


def test_without_limits_the_horizon_bounds_the_view():
    area = seen_area(ball(), [0.0, 1500.0, 0.0], plain())
    assert area == pytest.approx(cap(np.arccos(RADIUS / 1500.0)), rel=0.02)


def test_the_ground_sampling_distance_grows_with_the_square_of_the_secant_on_a_plane():
    region = ground_with_plate()
    camera = CameraModel(half_angle_deg=80.0, resolution_px=500)
    height, edge = 0.8, 1.2  # camera beside the plate, below its level: nothing hides the ground
    limit = height * camera.pixel_angle * (1 + (edge / height) ** 2)
    area = seen_area(region, [1.75, 2.8, 1.75], plain(max_gsd_m=limit), aim=(1.75, 0.0, 1.75))
    assert area == pytest.approx(np.pi * edge**2, rel=0.02)


def test_the_plate_throws_its_shadow_on_the_ground():
    region = ground_with_plate()
    camera = CameraModel(half_angle_deg=80.0)
    observer = RayCastObserver(region, camera)
    sun = np.array([-1.2, 1.0, 0.0])
    pose = look_at([2.4, 2.9, 0.0], [2.4, 0.0, 0.0])
    lit, day = (
        observe(observer, pose.r_A, pose.C_CA, plain(light=light, max_incidence_deg=90.0), sun)
        for light in ("sunlit", "ignored")
    )
    shadow = day & ~lit & on_ground(region)
    assert region.area[shadow].sum() == pytest.approx(1.0, rel=0.03)
    centre = region.area[shadow] @ region.centroid_A[shadow] / region.area[shadow].sum()
    assert centre == pytest.approx([1.2, 2.0, 0.0], abs=0.02)


def test_night_hides_everything():
    assert seen_area(ball(), [0.0, 3000.0, 0.0], plain(light="sunlit", max_incidence_deg=90.0), [0.0, -1.0, 0.0]) == 0.0


def test_a_criterion_with_light_needs_the_sun():
    with pytest.raises(MissionError, match="sun_A"):
        seen_area(ball(), [0.0, 3000.0, 0.0], plain(light="sunlit", max_incidence_deg=90.0))
    with pytest.raises(MissionError, match="not all zero"):
        seen_area(ball(), [0.0, 3000.0, 0.0], plain(light="sunlit", max_incidence_deg=90.0), [0.0, 0.0, 0.0])


def test_any_pixel_takes_cells_that_the_half_rule_leaves():
    region = eros_target()
    observer = RayCastObserver(region, CameraModel(half_angle_deg=3.0))
    pose = look_at([0.0, 20e3, 0.0], [0.0, 0.0, 0.0])
    half, whole, some = (
        observe(observer, pose.r_A, pose.C_CA, criterion)
        for criterion in (
            plain(),
            plain(min_fraction=1.0),
            plain(any_pixel=True),
        )
    )
    assert whole.sum() < half.sum() < some.sum()
    assert (half >= whole).all()
    assert (some >= half).all()


def test_the_coverage_map_unites_spacecraft_and_keeps_first_times():
    seen = CoverageMap(np.array([1.0, 2.0, 3.0, 4.0]), n_spacecraft=2)
    seen.add(20.0, 0, np.array([True, True, False, False]))
    seen.add(10.0, 1, np.array([False, True, True, False]))
    seen.add(30.0, 0, np.array([False, False, True, False]))
    assert seen.percent == pytest.approx(60.0)
    assert seen.percent_by_spacecraft == pytest.approx([60.0, 50.0])
    assert seen.first_seen_s == pytest.approx([20.0, 10.0, 10.0, np.nan], nan_ok=True)
    assert seen.seen.tolist() == [True, True, True, False]
    assert seen.seen_by.tolist() == [[True, True, True, False], [False, True, True, False]]
    assert seen.percent_over_time([0.0, 10.0, 15.0, 20.0, 99.0]) == pytest.approx([0, 50, 50, 60, 60])


def test_a_target_seen_whole_is_exactly_100_percent_and_an_unseen_one_exactly_0():
    region = eros_target()
    seen = CoverageMap(region.area, n_spacecraft=1)
    assert seen.percent == 0.0
    assert np.isnan(seen.first_seen_s).all()
    seen.add(1.0, 0, np.full(region.n_cells, True))
    assert seen.percent == 100.0
    assert seen.percent_over_time(2.0) == 100.0


@pytest.mark.parametrize(("spacecraft", "cells"), [(2, 4), (-1, 4), (0, 3)])
def test_a_picture_that_does_not_fit_the_map_is_refused(spacecraft, cells):
    with pytest.raises(MissionError, match="picture|spacecraft"):
        CoverageMap(np.ones(4), n_spacecraft=2).add(0.0, spacecraft, np.full(cells, True))


@pytest.mark.parametrize("kind", ["raycast", pytest.param("faceid", marks=pytest.mark.gl)])
@pytest.mark.parametrize(("seed", "passes"), [(2, 5), (7, 2)])
def test_accumulated_coverage_of_a_flight_with_a_narrow_camera_agrees_with_the_oracle(kind, seed, passes):
    camera = CameraModel(half_angle_deg=3.0)
    frames = flyby(seed, passes)
    exact = exact_coverage(seed, passes)
    region = eros_target(automatic_cell_size(14e3, camera.half_angle_deg))
    observer, seen = make_observer(region, camera, kind=kind), CoverageMap(region.area, passes)
    for t, spacecraft, pose in frames:
        seen.add(t, spacecraft, observe(observer, pose.r_A, pose.C_CA, plain()))
    assert 30.0 < exact < 90.0
    assert seen.percent == pytest.approx(exact, abs=1.0)


@cache
def exact_coverage(seed, passes):
    views = [exact_view(pose, CameraModel(half_angle_deg=3.0)) for _, _, pose in flyby(seed, passes)]
    oracle = eros_oracle()
    return 100 * oracle.united_area(views).sum() / oracle.area.sum()


def test_pictures_added_in_any_order_leave_the_first_time_of_each_cell():
    coverage = CoverageMap(np.array([1.0, 2.0, 3.0]), 1)
    for t, seen in ((30.0, [1, 1, 0]), (10.0, [1, 0, 0]), (20.0, [1, 1, 0])):
        coverage.add(t, 0, np.array(seen, bool))
    assert coverage.first_seen_s[:2].tolist() == [10.0, 20.0] and np.isnan(coverage.first_seen_s[2])
    assert coverage.percent_over_time([5.0, 10.0, 20.0]) == pytest.approx([0.0, 100 / 6, 50.0])


def kept_by(rule, *pictures):
    """Kept pictures of one spacecraft with two cells: time, ground sampling distances; the arrival is at 50 s."""
    kept = KeptPictures(2, 1, rule)
    for t, *gsd_m in pictures:
        cells = np.flatnonzero(np.isfinite(gsd_m))
        kept.add(Shown(t, 0, cells), np.array(gsd_m)[cells], np.array([10.0, 20.0])[cells], 50.0)
    return kept


def test_a_cell_is_kept_by_its_finest_picture_and_of_equals_by_the_one_nearest_to_the_arrival():
    pictures = (10.0, 9.0, np.nan), (40.0, 5.0, 5.2), (60.0, 5.05, 7.0), (90.0, 5.01, 5.21)
    best, first, every = (kept_by(rule, *pictures) for rule in ("best", "first", "all"))
    assert best.taken_s.tolist() == [[40.0, 40.0]] and best.gsd_m.tolist() == [[5.0, 5.2]]
    assert [(shown.t, shown.cells.tolist()) for shown in best.pictures()] == [(40.0, [0, 1])]
    assert first.taken_s.tolist() == [[10.0, 40.0]] and first.gsd_m.tolist() == [[9.0, 5.2]]
    assert every.gsd_m.tolist() == best.gsd_m.tolist()
    assert [shown.cells.tolist() for shown in every.pictures()] == [[0], [0, 1], [0, 1], [0, 1]]
    assert best.by_best(best.incidence_deg).tolist() == [10.0, 20.0]


def test_what_is_written_as_observed_and_as_missing_adds_up_to_all():
    written = [
        (percent_text(share), rounded_up_digits(100.0 - share)) for share in (97.3176, 7.7081, 100.0 - 1e-12, 0.0)
    ]
    assert written == [("97.31 %", "2.69"), ("7.70 %", "92.30"), ("100.00 %", "0.00"), ("0.00 %", "100.00")]


def test_only_what_was_all_observed_reads_100_percent():
    assert [percent_text(share) for share in (100.0, 100.0 - 1e-12, 99.9999, 99.989, 0.0)] == [
        "100.00 %",
        "100.00 %",
        "99.99 %",
        "99.98 %",
        "0.00 %",
    ]
