"""The page on bodies and plug-ins of one's own: its files are written, its commands are typed, its plug-ins fly."""

import importlib
import json
import os
import shlex
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest

import swarm_mj as sm
from swarm_mj.cli.main import main
from swarm_mj.errors import PluginError, SwarmError
from swarm_mj.plugins import CONTROLLERS, find
from swarm_mj.records.findings import borrowed_findings
from swarm_mj.scenarios.loading import load_scenario
from swarm_mj.simulator.telemetry import MODES, read_telemetry

PAGE = (Path(__file__).parents[1] / "docs/how-to/body_and_plug_ins.md").read_text("utf-8")


def snippets(language):
    return [part.split("```")[0] for part in PAGE.split(f"```{language}\n")[1:]]


def install(folder, pyproject):
    """What `pip install -e .` leaves behind of a project that has modules and entry points."""
    project = tomllib.loads(pyproject)["project"]
    lines = [
        line
        for group, names in project["entry-points"].items()
        for line in (f"[{group}]", *(f"{name} = {place}" for name, place in names.items()))
    ]
    info = folder / f"{project['name'].replace('-', '_')}-{project['version']}.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {project['name']}\nVersion: {project['version']}\n")
    (info / "entry_points.txt").write_text("\n".join(lines) + "\n")


@pytest.fixture(scope="module")
def desk(tmp_path_factory):
    """A folder with the page's files in it, the current one, with its plug-ins installed."""
    folder = tmp_path_factory.mktemp("extending")
    mesh, module = snippets("python")
    (folder / "my_asteroid.yaml").write_text(snippets("yaml")[0])
    (folder / "my_flyby.py").write_text(module)
    install(folder, snippets("toml")[0])
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        patch.syspath_prepend(folder)
        exec(compile(mesh, "the page's mesh", "exec"), {})
        yield folder


def typed(text):
    for line in text.strip().replace("\\\n", " ").splitlines():
        assert (
            main([*shlex.split(line)[1:], *([] if line.split()[1] == "load-shape" else ["--quiet", "--no-figures"])])
            == 0
        ), line


def test_the_body_of_the_page_is_checked_flown_designed_for_and_flown_again(desk, capsys):
    typed(snippets("sh")[0])
    said = capsys.readouterr().out
    assert "radius up to 300 m" in said and "433 Eros" not in said and "does not hold" not in said
    results = desk / "results"
    first, last = (
        json.loads((results / name / "summary.json").read_text()) for name in ("my_asteroid", "my_asteroid-designed")
    )
    design = json.loads((results / "my_asteroid-design" / "design.json").read_text())
    assert last["visiting_points"] == design["visiting_points"] != first["visiting_points"] == [3, 9, 14]
    assert last["coverage_percent"] > 99.0 and first["coverage_percent"] > 0.0
    assert borrowed_findings(load_scenario(desk / "my_asteroid.yaml")) == []


def test_the_plug_ins_of_the_page_fly_and_do_what_they_say(desk):
    typed(snippets("sh")[1])
    telemetry = read_telemetry(desk / "results" / "plug-ins" / "telemetry.nc")
    times, mode = telemetry["time"].values, telemetry["mode"].values
    near = np.linalg.norm(telemetry["r_BN_N"].values, axis=2) < 4990.0
    before, after = near & (times < 690.0)[:, None], times > 710.0
    assert (
        before.any()
        and (mode[before] == MODES.index("asteroid_observation")).all()
        and (mode[after] == MODES.index("earth_tracking")).all()
    )
    error = telemetry["pointing_error"].values
    assert error[0].max() > 0.1 and error[-1].max() < 0.01


def test_the_gravity_of_the_page_is_that_of_its_two_masses(desk):
    field = importlib.import_module("my_flyby").TwoLobes(None, gm=8.0, distance_m=300.0)
    far = field.acceleration(np.array([[0.0, 0.0, 1e6]]))
    assert far[0] == pytest.approx([0.0, 0.0, -8.0 / 1e12], rel=1e-6)
    # On the x axis, 150 m beyond a lobe: GM/2 at 150 m and GM/2 at 450 m.
    near = field.acceleration(np.array([[300.0, 0.0, 0.0]]))
    assert near[0] == pytest.approx([-4.0 / 150.0**2 - 4.0 / 450.0**2, 0.0, 0.0])


OWN_LAW = """
from dataclasses import dataclass


@dataclass
class Damper:
    stiffness: float = 1e-3
    damping: float = 2e-2

    def torque(self, inputs, memory):
        return -self.stiffness * inputs.sigma_BR - self.damping * inputs.omega_BR_B, memory
"""


@pytest.fixture
def with_files(tmp_path):
    """A scenario in a folder of its own that names a law beside it, and the flight's shortest form."""
    (tmp_path / "laws").mkdir()
    (tmp_path / "laws" / "own_law.py").write_text(OWN_LAW)
    (tmp_path / "own.yaml").write_text(
        "name: own\nduration_s: 40\ncontrol: {controller: 'laws/own_law.py:Damper', parameters: {stiffness: 2.0e-3}}\n"
        "design: {visiting_points: [5], time_of_flight_s: 30}\nbehavior: {name: adaptable_roles}\nphysics: {stepper: kernel}\n"
        "telemetry: {interval_s: 10}\nobservation: {interval_s: 10}\n"
    )
    return tmp_path


def test_a_law_in_a_file_flies_as_the_same_law_by_name_does(with_files, desk):
    own = sm.fly(with_files / "own.yaml")
    named = sm.fly(with_files / "own.yaml", {"control.controller": "damper"})
    assert own.scenario.control.controller == f"{with_files / 'laws' / 'own_law.py'}:Damper"
    assert np.array_equal(own.telemetry["sigma_BN"].values, named.telemetry["sigma_BN"].values)
    assert not any(name.endswith("laws") for name in sys.path)


def test_a_campaign_flies_a_law_in_a_file_in_its_workers_and_refuses_to_go_on_with_another(with_files, tmp_path):
    rows = sm.campaign(with_files / "own.yaml", runs=2, workers=2, out=tmp_path / "out")
    assert len(rows) == 2 and (rows["coverage_percent"] >= 0.0).all() and not rows["error"].any()
    (with_files / "laws" / "own_law.py").write_text(OWN_LAW.replace("2e-2", "3e-2"))
    with pytest.raises(SwarmError, match="own_law.py"):
        sm.campaign(with_files / "own.yaml", runs=2, out=tmp_path / "out", resume=True)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (
            None,
            r"control.controller = '.*own_law.py:Damper': .*own_law.py: cannot be read \(No such file or directory\)",
        ),
        ("Other = 1\nclass Another: pass\n", r"own_law.py has no class 'Damper'; it has Another"),
        ("x = 1\ny = x / 0\n", r"own_law.py, line 2: ZeroDivisionError: division by zero"),
        ("def f(:\n", r"own_law.py.*SyntaxError"),
        ("open('/nowhere')\n", r"own_law.py, line 1: FileNotFoundError"),
        (
            "from swarm_mj.plugins import find\nfind('g', 'n')\n",
            r"own_law.py, line 2: PluginError: 'n': unknown plug-in",
        ),
        ("class Damper: pass\n", r"has no torque, which every one of them must have"),
    ],
)
def test_what_is_wrong_with_a_file_names_file_and_class(with_files, text, words):
    law = with_files / "laws" / "own_law.py"
    law.unlink() if text is None else law.write_text(text)
    with pytest.raises(PluginError, match=words):
        sm.fly(with_files / "own.yaml", {"control.parameters": {}, "control.controller": f"{law}:Damper"})


def test_a_file_is_one_class_however_it_is_named_and_keeps_its_name_where_it_is_a_link(with_files):
    laws = with_files / "laws"
    (laws / "own_law.py").rename(laws / "text")
    (laws / "own_law.py").symlink_to("text")
    scenario = sm.load(with_files / "own.yaml")
    assert scenario.control.controller == f"{laws / 'own_law.py'}:Damper"
    (with_files / "elsewhere").symlink_to(laws)
    spelt = ("laws/own_law.py", "laws/../laws/own_law.py", "elsewhere/own_law.py", "elsewhere/../laws/own_law.py")
    assert len({find(CONTROLLERS, f"{with_files}/{name}:Damper") for name in spelt}) == 1


def test_a_plug_in_is_read_from_regular_files_alone(tmp_path):
    os.mkfifo(tmp_path / "pipe.py")
    (tmp_path / "endless.py").symlink_to("/dev/zero")
    for name in ("pipe.py", "endless.py"):
        with pytest.raises(PluginError, match=f"{name}: is no regular file"):
            find(CONTROLLERS, f"{tmp_path / name}:Damper")
