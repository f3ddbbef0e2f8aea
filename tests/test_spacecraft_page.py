"""The page on a spacecraft of one's own: its files are written, its command is typed, its lines are run."""

import json
import shlex
from pathlib import Path

import mujoco
import numpy as np
import pytest

from swarm_mj.cli.main import main
from swarm_mj.figures import drawing
from swarm_mj.simulator.telemetry import read_telemetry

PAGE = (Path(__file__).parents[1] / "docs/how-to/spacecraft.md").read_text("utf-8")


def snippet(language):
    (found,) = [part.split("```")[0] for part in PAGE.split(f"```{language}\n")[1:]]
    return found


@pytest.fixture(scope="module")
def desk(tmp_path_factory):
    """A folder with the page's files in it, the current one, in which its command has been typed."""
    folder = tmp_path_factory.mktemp("spacecraft")
    (folder / "my_cubesat.xml").write_text(snippet("xml"))
    (folder / "my_flight.yaml").write_text(snippet("yaml"))
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        patch.setattr(drawing, "usable_cores", lambda: 1)  # figures are drawn here, where everything is loaded
        assert main([*shlex.split(snippet("sh"))[1:], "--quiet", "--no-report"]) == 0
        yield folder


def test_the_file_of_the_page_opens_in_mujoco_itself(desk):
    model = mujoco.MjModel.from_xml_path(str(desk / "my_cubesat.xml"))
    assert model.nq == 13 and model.body_subtreemass[1] == pytest.approx(9 + 3 * 0.13 + 2 * 0.4 + 0.8)


def test_the_flight_of_the_page_settles_with_panels_and_fuel_at_rest(desk):
    summary = json.loads((desk / "results/my_flight/summary.json").read_text())
    assert summary["stepper"] == "mujoco"
    assert summary["spacecraft_file"] == str(desk / "my_cubesat.xml")
    assert any("centre of mass stands" in note for note in summary["spacecraft_notes"])
    assert summary["coverage_percent"] > 99.0
    assert max(summary["pointing_error_deg_final"].values()) < 1e-2
    telemetry = read_telemetry(desk / "results/my_flight/telemetry.nc")
    for joint in ("left", "right", "slosh"):
        moved = np.abs(telemetry[f"joint_{joint}_position"].values)
        assert moved[:60].max() > 1e-3 and moved[700:800].max() < 1e-3 * moved[:60].max()
    assert np.allclose(telemetry["imu_rate"], telemetry["omega_BN_B"], atol=1e-14)
    # In free fall an accelerometer feels the slow turn alone, and not the pull of the body.
    pull = 4.46e5 / (telemetry["r_CN_N"].values[700:800] ** 2).sum(axis=-1)
    assert np.abs(telemetry["imu_acceleration"].values[700:800]).max() < 1e-2 * pull.min()


def test_the_figures_of_an_own_spacecraft_are_drawn(desk):
    assert len(list((desk / "results/my_flight").glob("*.png"))) > 10


def test_the_lines_of_the_page_print_what_they_say(desk, capsys):
    exec(compile(snippet("python"), "the page's lines", "exec"), {})
    panel, felt = capsys.readouterr().out.splitlines()
    assert panel.startswith("left panel: 2.9 deg at the start, 0.0000")
    assert felt.startswith("accelerometer: ") and "m s-2 at the start" in felt
