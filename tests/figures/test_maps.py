"""Maps by latitude and longitude, against closed forms on a cube and ray casting on Eros."""

import numpy as np
import pytest
from matplotlib.figure import Figure

from swarm_mj.figures import map_figures
from swarm_mj.figures.map_figures import mark_interval, union_margin, view_margin
from swarm_mj.figures.maps import (
    MapExtent,
    draw_track,
    latitude_longitude,
    name_map,
    survey,
    target_outlines,
    whole_body,
)
from swarm_mj.flight.observe import flight_pictures
from swarm_mj.mission.target import directions
from swarm_mj.observation.camera import CameraModel, look_at
from swarm_mj.observation.raycast import RayTracer
from swarm_mj.spacecraft.attitude.mrp import dcm

FRONT = MapExtent(west=-40.0, east=40.0, south=-40.0, north=40.0)


def test_directions_and_their_places_are_inverse():
    latitude, longitude = np.array([-70.0, 0.0, 35.0]), np.array([10.0, 179.0, -120.0])
    back = latitude_longitude(5.0 * directions(latitude, longitude))
    assert back[0] == pytest.approx(latitude)
    assert back[1] == pytest.approx(longitude)
    assert directions(np.array(0.0), np.array(90.0)) == pytest.approx([0.0, 1.0, 0.0])


@pytest.mark.parametrize("centre", [-170.0, 0.0, 90.0, 300.0])
def test_longitudes_stay_within_half_a_turn_of_the_maps_centre(centre):
    longitude = np.linspace(-360.0, 360.0, 145)
    found = latitude_longitude(directions(np.zeros(145), longitude), centre)[1]
    assert (np.abs(found - centre) <= 180.0 + 1e-9).all()
    assert np.cos(np.radians(found - longitude)) == pytest.approx(1.0)


def test_ground_of_a_cube_lies_on_its_sides(cube):
    ground = survey(cube, FRONT, 40)
    assert ground.points_A.shape == (40, 40, 3)
    assert np.abs(ground.points_A).max(axis=-1) == pytest.approx(1.0, abs=1e-6)
    east = np.degrees(np.arctan2(ground.points_A[..., 1], ground.points_A[..., 0]))
    assert east == pytest.approx(np.broadcast_to(ground.longitudes, (40, 40)), abs=1e-6)
    # Southernmost and westernmost first, each in the middle of its row or column.
    assert (ground.latitudes[0], ground.longitudes[0]) == pytest.approx((-39.0, -39.0))


def test_places_without_ground_are_not_numbers(cube):
    moved = type(cube)(cube.vertices + [5.0, 0.0, 0.0], cube.faces, "elsewhere")
    ground = survey(moved, whole_body(0.0), 36)
    missing = np.isnan(ground.points_A).any(axis=-1)
    assert (missing == (ground.face < 0)).all()
    assert 0.5 < missing.mean() < 1.0


def test_outline_of_the_target_lies_on_the_pyramids_sides(quick_plan):
    region = quick_plan.region
    east, north, up = (target_outlines(region)[0] @ region.axes_A.T).T
    assert np.maximum(np.abs(east), np.abs(north)) / up == pytest.approx(np.tan(region.side_half_angle))
    assert (east[0], north[0]) == pytest.approx((east[-1], north[-1]))


def test_footprint_on_a_flat_side_is_the_square_of_the_pinhole(cube):
    camera, height = CameraModel(half_angle_deg=5.0), 4.0
    ground = survey(cube, FRONT, 120)
    margin = view_margin(camera, look_at([1.0 + height, 0.0, 0.0], [0.0, 0.0, 0.0]), ground, cube)
    half = height * np.tan(np.radians(5.0))
    y, z = ground.points_A[..., 1], ground.points_A[..., 2]
    assert ((margin > 0.0) == (np.maximum(np.abs(y), np.abs(z)) < half)).all()
    assert (margin > 0.0).any()


def test_round_field_of_view_leaves_a_round_footprint(cube):
    camera = CameraModel(half_angle_deg=6.0, shape="cone")
    ground = survey(cube, FRONT, 120)
    margin = view_margin(camera, look_at([5.0, 0.0, 0.0], [0.0, 0.0, 0.0]), ground, cube)
    distance = np.hypot(ground.points_A[..., 1], ground.points_A[..., 2])
    assert ((margin > 0.0) == (distance < 4.0 * np.tan(np.radians(6.0)))).all()


def test_footprint_ends_at_the_horizon(cube):
    ground = survey(cube, whole_body(0.0), 90)
    margin = view_margin(CameraModel(half_angle_deg=60.0), look_at([9.0, 0.0, 0.0], [0.0, 0.0, 0.0]), ground, cube)
    assert ((margin > 0.0) == (cube.face_normals[ground.face][..., 0] > 0.5)).all()


def test_margin_falls_to_zero_with_the_cosine_of_emission(cube):
    ground = survey(cube, FRONT, 40)
    pose = look_at([1.2, 0.0, 0.0], [0.0, 0.0, 0.0])
    margin = view_margin(CameraModel(half_angle_deg=89.0), pose, ground, cube)
    distance = np.linalg.norm(ground.points_A - pose.r_A, axis=-1)
    x, y, z = np.moveaxis(ground.points_A, -1, 0)
    oblique = (x > 1.0 - 1e-6) & (np.hypot(y, z) > 0.3)
    assert oblique.any()
    assert margin[oblique] == pytest.approx(0.2 / distance[oblique])


def test_ground_in_front_hides_what_lies_behind(cube):
    tower = cube.vertices * [0.2, 0.2, 0.2] + [1.1, 0.6, 0.0]
    both = type(cube)(np.vstack((cube.vertices, tower)), np.vstack((cube.faces, cube.faces + 8)), "with a tower")
    ground = survey(both, FRONT, 80)
    pose = look_at([4.0, 6.0, 0.0], [1.0, 0.0, 0.0])
    margin = view_margin(CameraModel(half_angle_deg=40.0), pose, ground, both)
    floor = (ground.points_A[..., 0] < 1.0 + 1e-6) & (np.abs(ground.points_A[..., 2]) < 0.1)
    shadow = floor & (ground.points_A[..., 1] < 0.35) & (ground.points_A[..., 1] > 0.2)
    free = floor & (ground.points_A[..., 1] < -0.3)
    assert shadow.any() and free.any()
    assert (margin[shadow] < 0.0).all()
    assert (margin[free] > 0.0).all()


def test_cells_that_a_picture_shows_lie_in_its_footprint(flown):
    plan, telemetry, _ = flown
    region, arrival = plan.region, 120
    sample = telemetry.isel(time=arrival)
    C_AN = dcm(sample["sigma_AN"].values)
    pose = look_at(C_AN @ sample["r_BN_N"].values[0], region.centroid_A.mean(axis=0))
    camera = CameraModel(half_angle_deg=3.0)
    rays = RayTracer(region.mesh.vertices, region.mesh.faces)
    ground = survey(region.mesh, MapExtent(west=70.0, east=110.0, south=-20.0, north=20.0), 200)
    held = view_margin(camera, pose, ground, region.mesh) > 0.0
    hit = rays.first_hit(pose.r_A, region.centroid_A - pose.r_A)
    shown = camera.contains(pose.to_camera(region.centroid_A)) & (hit == region.target)
    latitude, longitude = latitude_longitude(region.centroid_A, 90.0)
    row = np.abs(ground.latitudes[:, None] - latitude).argmin(axis=0)
    column = np.abs(ground.longitudes[:, None] - longitude).argmin(axis=0)
    assert 0 < shown.sum() < region.n_cells
    assert (held[row, column] == shown).mean() > 0.97  # cells at the edge fall to one side or the other


@pytest.mark.parametrize("shape", ["square", "cone"])
def test_the_union_of_many_pictures_holds_what_any_of_them_holds(cube, shape):
    camera, ground = CameraModel(half_angle_deg=3.0, shape=shape), survey(cube, FRONT, 120)
    rng = np.random.default_rng(5)
    poses = [look_at([4.0, *rng.uniform(-2, 2, 2)], [1.0, *rng.uniform(-1, 1, 2)]) for _ in range(150)]
    held = np.any([view_margin(camera, pose, ground, cube) > 0.0 for pose in poses], axis=0)
    assert ((union_margin(camera, poses, ground, cube) > 0.0) == held).all()
    assert 0.3 < held.mean() < 1.0


def test_the_outline_of_a_passage_is_of_all_its_pictures(flown, monkeypatch):
    found: list[int] = []
    monkeypatch.setattr(
        map_figures, "union_margin", lambda camera, poses, ground, body: found.append(len(poses)) or ground.face
    )
    map_figures.compose_footprints(*flown)
    assert found == [len(list(flight_pictures(*flown[:2])))]


def test_track_is_broken_at_the_sides_of_the_map_and_at_the_poles():
    ax = Figure().subplots()
    draw_track(ax, directions(np.zeros(41), np.linspace(100.0, 300.0, 41)), 0.0)
    longitude = ax.lines[0].get_xdata()
    assert np.isnan(longitude).sum() == 1
    assert np.nanmax(np.abs(np.diff(longitude))) < 10.0
    draw_track(ax, directions(np.array([80.0, 89.9, 80.0]), np.array([0.0, 0.0, 180.0])), 90.0)
    assert np.isnan(ax.lines[1].get_ydata()).any()


def test_longitudes_are_named_from_0_to_360():
    ax = Figure().subplots()
    name_map(ax, whole_body(90.0))
    ax.figure.draw_without_rendering()
    names = {place: text.get_text() for place, text in zip(ax.get_xticks(), ax.get_xticklabels(), strict=True)}
    assert {-60.0: "300", 0.0: "0", 240.0: "240"}.items() <= names.items()


def test_marks_on_a_track_are_round_numbers_apart():
    assert mark_interval(1200.0) == 120.0
    assert mark_interval(100.0) == 10.0
    assert mark_interval(86_400.0) == 5 * 3600.0


def test_ground_track_marks_the_places_below_the_spacecraft(flown, composed):
    plan, telemetry, _ = flown
    ax = composed["ground_track"].axes[0]
    C_AN = dcm(telemetry["sigma_AN"].values)
    times = telemetry["time"].values
    for j in range(plan.n):
        dots = [line for line in ax.lines if line.get_marker() == "."][j]
        chosen = np.isin(times, np.arange(0.0, 1200.0, 120.0))
        r_A = np.einsum("kij,kj->ki", C_AN[chosen], telemetry["r_BN_N"].values[chosen, j])
        drawn = directions(dots.get_ydata(), dots.get_xdata())
        away = ~np.isnan(drawn).any(axis=1)  # deployed above the south pole, where a longitude says nothing
        assert away.sum() == 9
        assert drawn[away] == pytest.approx((r_A / np.linalg.norm(r_A, axis=1, keepdims=True))[away], abs=1e-9)
