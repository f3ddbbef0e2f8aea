"""The command `swarm-mj fly` as a user meets it: files, numbers, and bad input without partial output."""

import json
import os
import subprocess
import sys
import time

import numpy as np
import pytest
import xarray as xr

from swarm_mj.cli.main import main
from swarm_mj.io.atomic import FIGURES

QUICK = ["fly", "eros-quick", "--quiet", "--no-figures"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    out = tmp_path_factory.mktemp("runs") / "quick"
    assert main(["fly", "eros-quick", "--quiet", "--out", str(out)]) == 0
    return out


@pytest.fixture(scope="module")
def summary(folder):
    return json.loads((folder / "summary.json").read_text())


def test_a_run_writes_summary_telemetry_coverage_scenario_and_figures(folder):
    names = {p.name for p in folder.iterdir()}
    assert {"summary.json", "telemetry.nc", "coverage.npz", "scenario.yaml"} <= names
    drawn = {*FIGURES["run"]} - {"formation", "navigation", "propulsion"}  # of which this flight has nothing
    assert {name for name in names if name.endswith(".png")} == {f"{stem}.png" for stem in drawn}
    assert not [name for name in names if name.startswith(".")]


def test_the_summary_holds_the_agreed_keys(summary):
    agreed = {
        "scenario": str, "seed": int, "spacecraft": int, "observers": int, "duration_s": float, "target_vertices": int,
        "target_faces": int, "coverage_percent": float, "coverage_percent_passage": float, "pointing_error_deg_final": dict,
        "pointing_error_deg_before_switch": dict, "max_wheel_speed_fraction": float, "wall_s": dict,
    }  # fmt: skip
    for key, kind in agreed.items():
        assert isinstance(summary[key], kind), key
    assert set(summary["wall_s"]) == {"design", "simulate", "coverage", "delivery", "figures"}
    assert summary["target_vertices"] == 51
    assert summary["spacecraft"] == summary["observers"] == 2


def test_every_telemetry_variable_has_units_frame_and_long_name(folder):
    with xr.open_dataset(folder / "telemetry.nc", engine="h5netcdf") as telemetry:
        required = {
            "r_BN_N", "v_BN_N", "sigma_BN", "omega_BN_B", "sigma_BR", "pointing_error", "mode", "wheel_speed", "wheel_torque",
            "coverage_percent", "link_closed", "sigma_AN",
        }  # fmt: skip
        assert required <= set(telemetry.data_vars)
        assert {"time", "spacecraft", "xyz", "wheel"} <= set(telemetry.sizes)
        for name in telemetry.data_vars:
            assert {"units", "frame", "long_name"} <= set(telemetry[name].attrs), name
        assert telemetry["mode"].attrs["flag_meanings"].split()[0] == "asteroid_observation"
        assert telemetry.attrs["mass_kg"] == 8.0
        assert telemetry["spacecraft"].values.tolist() == ["sc1", "sc2"]
        assert telemetry["time"].attrs["units"] == "s"


def test_a_stranger_can_check_momentum_from_the_file_alone(folder):
    from scipy.spatial.transform import Rotation

    with xr.open_dataset(folder / "telemetry.nc", engine="h5netcdf") as telemetry:
        sigma = telemetry["sigma_BN"].values
        norm2 = (sigma**2).sum(-1, keepdims=True)
        quaternion = np.concatenate((1 - norm2, 2 * sigma), -1) / (1 + norm2)
        inertia = telemetry.attrs["inertia_B_kg_m2"].reshape(3, 3)
        axes = telemetry.attrs["wheel_axes_B"].reshape(3, 3)
        wheel = telemetry.attrs["wheel_spin_inertia_kg_m2"] * telemetry["wheel_speed"].values @ axes
        momentum_B = telemetry["omega_BN_B"].values @ inertia.T + wheel
        rotation = Rotation.from_quat(quaternion.reshape(-1, 4), scalar_first=True)
        momentum_N = rotation.apply(momentum_B.reshape(-1, 3)).reshape(momentum_B.shape)
    drift = np.linalg.norm(momentum_N - momentum_N[0], axis=-1).max()
    assert np.abs(wheel).max() > 1e-3
    assert drift < 1e-6 * np.abs(wheel).max()


def test_pointing_errors_at_the_pictures_are_those_of_the_telemetry(folder, summary):
    with xr.open_dataset(folder / "telemetry.nc", engine="h5netcdf") as telemetry:
        error = np.degrees(telemetry["pointing_error"].values)
        knowledge = np.degrees(telemetry["attitude_knowledge_error"].values)
        looking = np.isin(telemetry["mode"].values, (0, 3))
        times = telemetry["time"].values
    arrival = int(np.flatnonzero(times == 600.0)[0])
    assert summary["sensors"] == "cubesat" and 0.001 < knowledge[arrival].max() < 0.1
    for j, name in enumerate(("sc1", "sc2")):
        assert summary["pointing_error_deg_arrival"][name] == pytest.approx(error[arrival, j], abs=1e-9)
        assert summary["attitude_knowledge_error_deg_arrival"][name] == pytest.approx(knowledge[arrival, j], abs=1e-9)
        at = [k for k in range(len(times)) if looking[k, j] and (times[k] % 60.0 == 0.0 or k == arrival)]
        assert summary["pointing_error_deg_pictures_median"][name] == pytest.approx(np.median(error[at, j]), abs=1e-9)


def test_coverage_file_and_summary_agree(folder, summary):
    with np.load(folder / "coverage.npz") as coverage:
        corners = coverage["vertices"][coverage["faces"]]
        area = 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
        assert np.allclose(area, coverage["area"], rtol=1e-9)
        assert len(area) == summary["target_faces"]
        assert area.sum() / 1e6 == pytest.approx(summary["target_area_km2"], abs=1e-6)
        share = 100 * area[coverage["seen"]].sum() / area.sum()
        assert share == pytest.approx(summary["coverage_percent"], abs=1e-6)
        assert coverage["seen_by"].shape == (2, len(area))
        assert np.array_equal(coverage["seen"], coverage["seen_by"].any(axis=0))
        assert np.array_equal(np.isnan(coverage["first_seen_s"]), ~coverage["seen"])


def test_the_written_scenario_flies_the_same_again(folder, tmp_path, summary):
    assert main(["fly", str(folder / "scenario.yaml"), *QUICK[2:], "--out", str(tmp_path / "again")]) == 0
    again = json.loads((tmp_path / "again" / "summary.json").read_text())
    for key in ("coverage_percent", "pointing_error_deg_final", "max_wheel_speed_fraction", "mode_switches"):
        assert again[key] == summary[key]
    assert (tmp_path / "again" / "telemetry.nc").read_bytes()
    with xr.open_dataset(folder / "telemetry.nc", engine="h5netcdf") as a:
        with xr.open_dataset(tmp_path / "again" / "telemetry.nc", engine="h5netcdf") as b:
            assert all(np.array_equal(a[name].values, b[name].values, equal_nan=True) for name in a.data_vars)


def test_the_arrival_alone_sees_less_than_the_passage(tmp_path):
    out = tmp_path / "arrival"
    narrow = ["--set", "observation.criterion=arrival", "--set", "camera.half_angle_deg=6"]
    assert main([*QUICK, "--out", str(out), *narrow]) == 0
    summary = json.loads((out / "summary.json").read_text())
    assert summary["criterion"] == "arrival"
    assert 0 < summary["coverage_percent"] < summary["coverage_percent_passage"] < 100


def test_without_gl_the_job_completes_on_compiled_drawing_and_says_so(tmp_path, capsys, monkeypatch):
    from swarm_mj.errors import ObserverError
    from swarm_mj.observation import faceid

    def broken(*args, **keys):
        raise ObserverError("no libEGL.so.1 here")

    monkeypatch.setattr(faceid.OpenGlFaces, "__init__", broken)
    assert main([*QUICK, "--out", str(tmp_path / "run")]) == 0
    summary = json.loads((tmp_path / "run" / "summary.json").read_text())
    assert summary["observer"] == "raster"
    assert summary["coverage_percent"] == pytest.approx(100.0, abs=0.1)
    assert "no libEGL.so.1 here" in capsys.readouterr().out


def test_where_egl_finds_no_driver_the_job_completes_on_compiled_drawing(tmp_path):
    environment = {**os.environ, "__EGL_VENDOR_LIBRARY_FILENAMES": "/nonexistent", "LIBGL_DRIVERS_PATH": "/nonexistent"}
    environment.pop("MUJOCO_GL", None)
    command = [sys.executable, "-m", "swarm_mj.cli.main", *QUICK, "--out", str(tmp_path / "run")]
    done = subprocess.run(command, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert json.loads((tmp_path / "run" / "summary.json").read_text())["observer"] == "raster"
    assert "drawn by compiled code" in done.stdout


def test_the_arrival_is_found_at_times_that_rounding_disturbs(tmp_path):
    fine = ["control.period_s=0.1", "physics.timestep_s=0.1", "telemetry.interval_s=0.1", "design.time_of_flight_s=600.3",
            "observation.interval_s=60", "duration_s=660", "observation.criterion=arrival"]  # fmt: skip
    arguments = [part for override in fine for part in ("--set", override)]
    assert main([*QUICK, "--out", str(tmp_path / "run"), *arguments]) == 0
    assert json.loads((tmp_path / "run" / "summary.json").read_text())["coverage_percent"] > 50


@pytest.mark.parametrize(("scenario", "begun"), [("eros-config1", ".run.*"), ("eros-quick", ".run.*/*.png")])
def test_a_polite_end_leaves_nothing_half_written(tmp_path, scenario, begun):
    """At the start, and while the figures are drawn."""
    command = [sys.executable, "-m", "swarm_mj.cli.main", "fly", scenario, "--quiet", "--out", str(tmp_path / "run")]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
    while process.poll() is None and not list(tmp_path.glob(begun)):
        time.sleep(0.02)
    process.terminate()
    assert process.wait(60) == 130
    assert "interrupted" in process.stderr.read()  # to its end: whoever else could write there has ended too
    assert not list(tmp_path.iterdir())


def test_pointing_that_did_not_settle_and_wheel_limits_are_remarked(tmp_path, capsys):
    weak = ["--set", "spacecraft.wheel.max_torque_n_m=0.00001"]
    assert main([*QUICK, "--out", str(tmp_path / "run"), *weak]) == 0
    output = capsys.readouterr().out
    assert "pointing had not settled" in output
    assert "wheel limits cut" in output


@pytest.mark.gl
@pytest.mark.parametrize("name", ["eros-config1", "eros-config2", "eros-literal"])
def test_the_papers_missions_see_the_whole_target(name, tmp_path):
    out = tmp_path / name
    assert main(["fly", name, "--quiet", "--no-figures", "--out", str(out)]) == 0
    summary = json.loads((out / "summary.json").read_text())
    assert summary["coverage_percent"] == pytest.approx(100.0, abs=0.1)
    assert summary["coverage_percent_passage"] == pytest.approx(100.0, abs=0.1)
    assert max(summary["pointing_error_deg_before_switch"].values()) < 0.1
    assert max(summary["pointing_error_deg_final"].values()) < 0.1
    assert summary["max_wheel_speed_fraction"] <= 1.0


def test_both_observers_agree_on_the_accumulated_area_of_a_narrow_camera(tmp_path):
    shares = {}
    for kind in ("raycast", "auto"):
        out = tmp_path / kind
        narrow = ["--set", f"observation.observer={kind}", "--set", "camera.half_angle_deg=4"]
        assert main([*QUICK, "--out", str(out), *narrow]) == 0
        shares[kind] = json.loads((out / "summary.json").read_text())["coverage_percent"]
    assert shares["raycast"] == pytest.approx(shares["auto"], abs=1.0)
    assert 5 < shares["raycast"] < 95


TETRAHEDRON = "v -9000 -9000 -9000\nv 9000 0 0\nv 0 9000 0\nv 0 0 9000\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
SHIFTED = "v 90000 90000 90000\nv 99000 90000 90000\nv 90000 99000 90000\nv 90000 90000 99000\n" + TETRAHEDRON[-32:]
KILOMETRES = "v -9 -9 -9\nv 9 0 0\nv 0 9 0\nv 0 0 9\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"


@pytest.mark.parametrize(
    ("overrides", "mesh", "words"),
    [
        (["target.half_angle_deg=0.05"], None, ["target"]),
        (["control.parameters={slop: 3}"], None, ["mrp_sliding_mode", "slop"]),
        (["control.parameters={slope: -1}"], None, ["slope", "-1"]),
        (["design.visiting_points=[7, 99]"], None, ["design.visiting_points", "99", "1 to 51"]),
        (["body.shape=/nowhere/mesh.obj"], None, ["/nowhere/mesh.obj"]),
        (["mothership.position_A_m=[0, 0, 0]"], None, ["mothership.position_A_m", "inside"]),
        (["mothership.position_A_m=[0, 0, -1e300]"], None, ["mothership.position_A_m", "1000000000"]),
        (["mothership.velocity=[1e300, 0, 0]"], None, ["mothership.velocity", "1e+300"]),
        (["spacecraft.wheel.spin_inertia_kg_m2=1e-300"], None, ["MuJoCo", "inertia"]),
        (["camera.half_angle_deg=0.02"], None, ["target.cell_size_m"]),
        (["target.cell_size_m=0.05"], None, ["target.cell_size_m"]),
        (["body.gravity.parameters={coefficients: [[100000, 0, 0, 0]]}"], None, ["100000", "360"]),
        (["body.gravity.parameters={coefficients: [[2, 0, 1, 0], [2, 0, 1, 0]]}"], None, ["twice"]),
        (["body.gravity.parameters={coefficients: [[2]]}"], None, ["[n, m, C, S]"]),
        (["body.gravity={model: polyhedron, parameters: {gm: 1, density_kg_m3: 1}}"], None, ["gm", "density_kg_m3"]),
        (["link.hemispherical_boresight_B=[0, 0, 0]"], None, ["link.hemispherical_boresight_B", "zero"]),
        (["body.radius_range_m=[2, 1]"], None, ["body.radius_range_m", "smaller one first"]),
        (["body.rotation.w_rate_deg_per_day=1e15"], None, ["w_rate_deg_per_day", "1000000"]),
        ([], TETRAHEDRON, ["body.gravity.parameters", "Eros"]),
        (["body.gravity={model: point_mass, parameters: {gm: 4e5}}"], SHIFTED, ["mesh.obj"]),
        ([], KILOMETRES, ["mesh.obj", "kilometres"]),
    ],
)
def test_bad_input_ends_in_a_clear_error_and_no_output(tmp_path, capsys, overrides, mesh, words):
    out = tmp_path / "out"
    if mesh:
        (tmp_path / "mesh.obj").write_text(mesh)
        overrides = [*overrides, f"body.shape={tmp_path / 'mesh.obj'}"]
    arguments = [part for override in overrides for part in ("--set", override)]
    assert main([*QUICK, "--out", str(out), *arguments]) == 2
    message = capsys.readouterr().err
    assert message.startswith("swarm-mj: error:")
    assert "Traceback" not in message
    for word in words:
        assert word in message
    assert not out.exists()
    assert not [p for p in tmp_path.iterdir() if p.name != "mesh.obj"]


def test_a_missing_scenario_and_an_unwritable_folder_are_clear_errors(tmp_path, capsys):
    assert main(["fly", str(tmp_path / "none.yaml")]) == 2
    assert "cannot be read" in capsys.readouterr().err
    assert main([*QUICK, "--out", "/proc/nowhere/run"]) == 2
    assert "/proc/nowhere/run" in capsys.readouterr().err


def test_help_and_import_load_no_heavy_module():
    heavy = "print({'numpy', 'mujoco', 'numba', 'pydantic'} & set(sys.modules) or [])"
    code = f"import sys, swarm_mj.cli.main as command_line; command_line._parser(); {heavy}"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout.strip() == "[]"


@pytest.mark.parametrize("command", ["available", "explain", "explain camera"])
def test_lists_and_explanations_load_no_heavy_module(command):
    heavy = "{'pandas', 'scipy', 'mujoco', 'numba', 'gymnasium'}"
    code = f"""import sys
from swarm_mj.cli.main import main
main({command.split()})
print({heavy} & set(sys.modules) or [])"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    *listed, loaded = done.stdout.splitlines()
    assert len(listed) > 5 and loaded == "[]", done.stderr


def test_several_scenarios_go_into_folders_of_their_own(tmp_path):
    (tmp_path / "second.yaml").write_text("name: second\nduration_s: 600\nphysics: {timestep_s: 0.5}\n"
                                          "design: {visiting_points: [3]}\nbehavior: {name: adaptable_roles}\n")  # fmt: skip
    assert main([*QUICK[:2], str(tmp_path / "second.yaml"), *QUICK[2:], "--out", str(tmp_path / "o")]) == 0
    assert {p.name for p in (tmp_path / "o").iterdir()} == {"eros-quick", "second"}
