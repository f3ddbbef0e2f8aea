"""The page on the files of a run lists what a flight and a design really write."""

import json
import re
from inspect import getsource
from pathlib import Path

import numpy as np
import pytest

import swarm_mj as sm
from swarm_mj.records import design_files
from swarm_mj.records.propulsion import KEYS
from swarm_mj.scenarios.loading import parse_overrides
from swarm_mj.simulator.telemetry import read_telemetry

PAGE = (Path(__file__).parents[2] / "docs" / "reference" / "files.md").read_text("utf-8")
#: Faults, friction and thrusters, with sensors that err, so that every variable is there.
FAULTY = (
    "faults=[{kind: camera_off, spacecraft: sc1, at_s: 300}]",
    "dispersions={wheel_coulomb_n_m: 1.0e-5}",
    "spacecraft.thrusters={}",
    "observation.classes=[stereo]",
    "navigation.mode=optical",
    "navigation.optical.interval_share=1",
)


def section(title):
    return PAGE.split(f"## {title}\n")[1].split("\n## ")[0]


def names(text):
    """Names in code in the first column of the tables."""
    return [name for row in re.findall(r"^\| (`[^|]+) \|", text, re.MULTILINE) for name in re.findall(r"`(\w+)`", row)]


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    flight = sm.fly(sm.load("eros-quick", parse_overrides(FAULTY)))
    return flight.save(tmp_path_factory.mktemp("run") / "flight", figures=False, report=False)


def test_the_page_lists_every_key_of_the_summary(flown):
    written = set(json.loads((flown / "summary.json").read_text()))
    always, now_and_then = map(names, section("summary.json").split("Only where the scenario asks for it:"))
    assert set(always) <= written <= {*always, *now_and_then}
    assert len({*always, *now_and_then}) == len(always) + len(now_and_then)
    assert {key for key in now_and_then if key in written} == {*KEYS, "optical"}


def test_the_page_describes_every_variable_of_the_telemetry_as_the_file_does(flown):
    telemetry = read_telemetry(flown / "telemetry.nc")
    rows = [[cell.strip() for cell in row.split("|")[1:-1]] for row in section("telemetry.nc").splitlines()]
    listed = {row[0].strip("`"): row[1:] for row in rows if len(row) == 5 and row[0].startswith("`")}
    assert set(listed) == set(map(str, telemetry.data_vars))
    for name, (dims, units, frame, meaning) in listed.items():
        variable = telemetry[name]
        attrs = variable.attrs
        assert [dims, units, frame, meaning] == [
            ", ".join(map(str, variable.dims)), attrs["units"], attrs["frame"], attrs["long_name"]
        ]  # fmt: skip
    attributes = section("telemetry.nc").split("Attributes of the file:")[1]
    assert set(names(attributes)) == set(telemetry.attrs)


def test_the_page_lists_every_array_of_the_coverage(flown):
    files = [name.replace("mapped_stereo", "mapped_CLASS") for name in np.load(flown / "coverage.npz").files]
    assert sorted(names(section("coverage.npz"))) == sorted(files)


def test_the_page_lists_every_key_of_a_design(tmp_path):
    design = sm.design(
        sm.load(
            "eros-quick",
            {"observation.criterion": "arrival", "designer.max_generations": 1, "designer.deliver_within_h": 24},
        )
    )
    folder = design.save(tmp_path / "design", figures=False)
    always, now_and_then = map(names, section("design.json of a design").split("Only where the scenario asks for it:"))
    written = json.loads((folder / "design.json").read_text())
    assert sorted(always) == sorted(written) and set(now_and_then).isdisjoint(written)
    assert {name for name in now_and_then if f'"{name}": ' not in getsource(design_files)} == set()
    for name in np.load(folder / "sightings.npz").files:
        assert f"`{name}`" in section("design.json of a design")
