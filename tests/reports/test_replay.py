"""What the replay shows agrees with the flight: positions, lines of sight, borders of pictures, thinning, small meshes."""

import base64
import dataclasses

import numpy as np
import pytest
import trimesh
import xarray as xr

from swarm_mj.observation.camera import CameraModel
from swarm_mj.records.run_record import read_run
from swarm_mj.reports.plots import FLOOR, plot_run
from swarm_mj.reports.replay import Limits, border_rays, choose_samples, make_replay
from swarm_mj.reports.scene import scene_figure
from swarm_mj.smallbody.geodesic import geodesic_icosahedron
from swarm_mj.smallbody.simplify import simplify
from swarm_mj.smallbody.solid_angle import points_inside

KM = 1e3


def unpacked(array):
    return np.frombuffer(base64.b64decode(array["data"]), array["type"]).reshape(array["shape"]).astype(float)


@pytest.fixture(scope="module")
def run(folder):
    return read_run(folder)


@pytest.fixture(scope="module")
def replay(run):
    return make_replay(run, Limits())


@pytest.fixture(scope="module")
def body(replay):
    scene = replay.scene
    ground, target = (unpacked(scene[f"{part}_vertices"]) for part in ("body", "target"))
    faces = np.vstack((unpacked(scene["body_faces"]), unpacked(scene["target_faces"]) + len(ground))).astype(int)
    return trimesh.Trimesh(np.vstack((ground, target)), faces, process=False)


def assert_on_the_ground(body, points, directions):
    """Five metres before a point there is space, five metres after it rock, but where a ray only grazes an edge."""
    step = 0.005 * directions / np.linalg.norm(directions, axis=1, keepdims=True)
    assert points_inside(points - step, body.vertices, body.faces).mean() < 0.02
    assert points_inside(points + step, body.vertices, body.faces).mean() > 0.98


def test_the_drawn_body_is_closed_and_has_the_volume_of_eros(body, eros):
    merged = trimesh.Trimesh(body.vertices.round(4), body.faces, process=True)
    assert merged.is_watertight
    assert merged.volume == pytest.approx(eros.volume / KM**3, rel=1e-4)


def test_distances_from_the_centre_do_not_depend_on_the_frame(run, replay):
    there = np.linalg.norm(run.telemetry["r_BN_N"].values[replay.samples], axis=2) / KM
    assert np.allclose(np.linalg.norm(unpacked(replay.scene["r"]), axis=2), there, rtol=1e-6)


def test_lines_of_sight_end_on_the_ground_or_at_the_spacecraft_tracked(run, replay, body):
    r, z, length = (unpacked(replay.scene[name]) for name in ("r", "z", "length"))
    tip = r + length[..., None] * z
    mode = replay.mode
    down = (mode == 0) & (replay.pointing_deg < 1e-3)
    assert down.sum() > 100
    assert_on_the_ground(body, tip[down][::7], z[down][::7])
    tracked = run.telemetry["tracked_spacecraft"].values[replay.samples]
    sample, j = np.nonzero((mode == 1) & (replay.pointing_deg < 1e-3))
    assert len(sample) > 10
    assert np.allclose(tip[sample, j], r[sample, tracked[sample, j]], atol=0.01)


def test_the_line_of_sight_leads_to_the_centre_once_the_pointing_has_settled(replay):
    r, z = unpacked(replay.scene["r"]), unpacked(replay.scene["z"])
    settled = (replay.mode == 0) & (replay.pointing_deg < 1e-3)
    inward = -r[settled] / np.linalg.norm(r[settled], axis=1, keepdims=True)
    assert settled.sum() > 100
    assert np.allclose(z[settled], inward, atol=np.radians(1e-3) + 1e-6)


def test_rays_of_the_picture_border_end_on_the_ground_where_they_meet_it(replay, body):
    scene = replay.scene
    r, turn, rays, length = (unpacked(scene[name]) for name in ("r", "C", "rays", "ray_length"))
    end = r[:, :, None] + length[..., None] * np.einsum("kjba,rb->kjra", turn, rays)
    met = np.isfinite(length)
    assert met.any() and not met.all()
    every = max(1, met.sum() // 300)
    assert_on_the_ground(body, end[met][::every], (end - r[:, :, None])[met][::every])


def test_a_camera_that_is_off_takes_no_picture(run, replay):
    on = np.ones(run.telemetry["mode"].shape, np.int8)
    on[run.times >= 300.0, 0] = 0
    faulty = dataclasses.replace(run, telemetry=run.telemetry.assign(camera_on=(("time", "spacecraft"), on)))
    before, after = (unpacked(flight.scene["ray_length"]) for flight in (replay, make_replay(faulty, Limits())))
    off = replay.times >= 300.0
    assert np.isfinite(before[off, 0]).any() and np.isnan(after[off, 0]).all()
    assert np.array_equal(after[~off], before[~off], equal_nan=True)
    assert np.array_equal(after[:, 1], before[:, 1], equal_nan=True)


def test_corners_of_a_square_picture_and_the_rim_of_a_cone_are_as_wide_as_the_camera():
    half = np.radians(10.0)
    corners = np.degrees(np.arccos(border_rays(CameraModel(half_angle_deg=10.0))[::5, 2]))
    assert np.allclose(corners, np.degrees(np.arctan(np.sqrt(2.0) * np.tan(half))))
    assert np.allclose(np.degrees(np.arccos(border_rays(CameraModel(half_angle_deg=10.0, shape="cone"))[:, 2])), 10.0)


def test_sun_and_earth_stand_where_the_telemetry_says(run, replay):
    sun = unpacked(replay.scene["sun"])
    separation = np.dot(run.telemetry.attrs["sun_N_m"], run.telemetry.attrs["earth_N_m"])
    separation /= np.linalg.norm(run.telemetry.attrs["sun_N_m"]) * np.linalg.norm(run.telemetry.attrs["earth_N_m"])
    assert np.allclose(np.einsum("ki,ki->k", sun, unpacked(replay.scene["earth"])), separation, atol=1e-6)
    spin = np.linalg.norm(np.diff(sun, axis=0), axis=1) / np.diff(replay.times)
    distance_to_pole = np.sqrt(1.0 - sun[0, 2] ** 2)
    assert np.allclose(spin, run.telemetry.attrs["spin_rate_rad_s"] * distance_to_pole, rtol=1e-2)


def test_thinning_keeps_the_arrival_the_end_and_every_peak(run):
    thin = make_replay(run, Limits(samples=25))
    assert len(thin.times) < 30
    assert run.scenario.design.time_of_flight_s in thin.times
    assert thin.times[0] == 0.0 and thin.times[-1] == run.times[-1]
    error = np.degrees(run.telemetry["pointing_error"].values)
    assert np.allclose(
        thin.pointing_deg, error[thin.samples]
    )  # the numbers at the time shown, not the largest before it
    assert np.allclose(thin.pointing_peak_deg.max(axis=0), error.max(axis=0))
    after = slice(int(np.searchsorted(thin.times, 850.0)), None)
    late = run.times >= 850.0
    assert np.allclose(thin.pointing_peak_deg[after].max(axis=0), error[late].max(axis=0))
    assert not np.allclose(thin.pointing_peak_deg, thin.pointing_deg)


def test_half_of_the_instants_lie_in_a_short_encounter(run):
    short = np.abs(run.times - run.scenario.design.time_of_flight_s) <= 25.0
    far = np.where(short, 1.0, 100.0)[:, None, None] * run.telemetry["r_BN_N"]
    samples = choose_samples(dataclasses.replace(run, telemetry=run.telemetry.assign(r_BN_N=far)), 22)
    assert short[samples].sum() == short.sum() == 11 and 10 <= (~short[samples]).sum() <= 12


def test_few_samples_are_kept_as_they_are(run):
    assert np.array_equal(choose_samples(run, 10_000), np.arange(len(run.times)))


def test_the_timeline_adds_up_to_the_whole_flight(run, replay):
    figure = plot_run(run, replay)
    total = 0.0
    for trace in figure.data:
        if trace.name and ": " in trace.name:
            x = np.array([np.nan if v is None else v for v in trace.x], float).reshape(-1, 3)
            total += (x[:, 1] - x[:, 0]).sum()
    assert total == pytest.approx(run.n * run.times[-1] / 60.0)


def test_curves_are_those_of_the_telemetry(folder, run, replay):
    figure = plot_run(run, replay)
    curves = {(trace.name, trace.yaxis): np.asarray(trace.y) for trace in figure.data}
    with xr.open_dataset(folder / "telemetry.nc", engine="h5netcdf") as telemetry:
        error = np.degrees(telemetry["pointing_error"].sel(spacecraft="sc2").values)
        rpm = np.abs(telemetry["wheel_speed"].sel(spacecraft="sc2").values).max(axis=1) * 30.0 / np.pi
    assert np.allclose(curves["sc2", "y"], np.maximum(error, 10.0**FLOOR), rtol=1e-6)
    assert np.allclose(curves["sc2", "y2"], rpm, rtol=1e-6, atol=1e-3)


def test_a_simplified_sphere_stays_a_sphere():
    vertices, faces = geodesic_icosahedron(60)
    small = simplify(1000.0 * vertices, faces, 5000)
    assert 1500 < len(small.faces) <= 5000
    mesh = trimesh.Trimesh(small.vertices, small.faces, process=False)
    assert mesh.area == pytest.approx(4e6 * np.pi, rel=0.03)
    assert np.array_equal(small.kept, np.unique(small.kept))


def test_a_seam_does_not_move_when_a_mesh_is_simplified():
    vertices, faces = geodesic_icosahedron(40)
    seam = vertices[np.abs(vertices[:, 2]) < 0.05] * 1000.0
    small = simplify(1000.0 * vertices, faces, 4000, fixed=seam)
    gaps = np.linalg.norm(small.vertices[:, None] - seam[None], axis=2).min(axis=0)
    assert gaps.max() < 1e-9


def test_a_mesh_that_is_small_enough_is_left_alone():
    vertices, faces = geodesic_icosahedron(5)
    small = simplify(vertices, faces, len(faces))
    assert np.array_equal(small.vertices, vertices) and np.array_equal(small.faces, faces)


def test_ground_in_the_dark_stands_out_from_the_borders_of_pictures_and_from_the_target(run, replay):
    scales = {trace.meta: trace.colorscale for trace in scene_figure(run, replay).data if trace.type == "mesh3d"}
    body, unseen, seen = (
        np.array([int(part) for part in colour[4:-1].split(",")])
        for colour in (scales["body"][0][1], scales["target"][0][1], scales["target"][2][1])
    )
    assert body.min() > 75  # the ink of borders is 32 or less, or light
    assert min(abs(body - unseen).max(), abs(body - seen).max(), abs(unseen - seen).max()) > 60
