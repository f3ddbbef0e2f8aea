"""Scenarios through the public API: read from names, files and mappings, changed, listed, shown."""

import pickle
from pathlib import Path

import numpy as np
import pytest
import yaml

import swarm_mj as sm
from swarm_mj.scenarios.loading import load_scenario, packaged, parse_overrides


def test_a_name_a_file_and_a_mapping_are_the_same_scenario(tmp_path):
    (tmp_path / "mine.yaml").write_text(packaged("eros-config2"))
    by_name, by_file = sm.load("eros-config2"), sm.load(tmp_path / "mine.yaml")
    by_mapping = sm.load(by_name.model_dump(mode="json"))
    assert by_name == by_file == by_mapping
    assert by_name.model_dump() == load_scenario("eros-config2").model_dump()


def test_overrides_seed_design_and_policy_are_what_the_command_line_sets():
    scenario = sm.load("eros-config2", {"camera.half_angle_deg": 6}, seed=7, design="eros-visit", policy="greedy")
    assert (scenario.camera.half_angle_deg, scenario.seed, scenario.design.reference) == (6.0, 7, "eros-visit")
    assert scenario.behavior.name == "scripted_policy" and scenario.behavior.parameters["policy"] == "greedy"
    assert sm.load("eros-config2", {"seed": 3}) == sm.load("eros-config2", seed=3)
    words = ["camera.half_angle_deg=6", "seed=3"]
    assert sm.load("eros-config2", parse_overrides(words)) == sm.load(
        "eros-config2", {"camera.half_angle_deg": 6, "seed": 3}
    )


def test_every_verb_reads_a_name_a_file_a_mapping_and_a_scenario_alike(tmp_path):
    path = sm.load("eros-quick").save(tmp_path / "mine.yaml")
    narrow, sources = (
        {"camera.half_angle_deg": 3},
        ["eros-quick", path, yaml.safe_load(path.read_text()), sm.load(path)],
    )
    for source in sources:
        assert sm.load(source, narrow).camera.half_angle_deg == 3.0
        assert sm.navigate(source, narrow).scenario.camera.half_angle_deg == 3.0
        assert sm.simulation(source, narrow).time == 0.0


def test_values_of_numpy_and_paths_are_those_of_yaml():
    given = {"camera.half_angle_deg": np.float64(3.5), "design.visiting_points": np.array([1, 2]), "seed": np.int64(4)}
    scenario = sm.load("eros-quick", given)
    assert scenario == sm.load(
        "eros-quick", {"camera.half_angle_deg": 3.5, "design.visiting_points": [1, 2], "seed": 4}
    )
    assert sm.load("eros-quick", {"body.shape": Path("mine.obj")}).body.shape == "mine.obj"


@pytest.mark.parametrize("wrong", [["camera.half_angle_deg=3"], "camera.half_angle_deg=3", {3: 4}])
def test_overrides_that_are_no_mapping_are_refused_with_an_example(wrong):
    with pytest.raises(sm.SwarmError, match=r"must be a mapping of dotted keys .*{'camera.half_angle_deg': 3}"):
        sm.load("eros-quick", wrong)


def test_a_change_leaves_the_scenario_alone_and_is_checked():
    scenario = sm.load("eros-quick")
    changed = scenario.changed({"camera.half_angle_deg": 3, "seed": 5})
    assert (changed.camera.half_angle_deg, changed.seed) == (3.0, 5)
    assert scenario.camera.half_angle_deg != 3.0
    with pytest.raises(sm.SwarmError, match=r"camera\.half_angle_deg = -1"):
        scenario.changed({"camera.half_angle_deg": -1})
    with pytest.raises(sm.SwarmError, match="colour: unknown key"):
        sm.load({"name": "x", "colour": "red"})


def test_a_saved_scenario_is_read_back(tmp_path):
    scenario = sm.load("eros-quick", {"camera.half_angle_deg": 5})
    assert sm.load(scenario.save(tmp_path / "mine.yaml")) == scenario
    with pytest.raises(sm.SwarmError, match="cannot be written"):
        scenario.save(tmp_path / "none" / "mine.yaml")


def test_the_mapping_that_is_given_is_not_changed():
    mapping = {"name": "x", "design": {"visiting_points": [3]}, "behavior": {"name": "adaptable_roles"}}
    sm.load(mapping, {"camera.half_angle_deg": 3, "design.visiting_points": [4]})
    assert mapping == {"name": "x", "design": {"visiting_points": [3]}, "behavior": {"name": "adaptable_roles"}}


def test_a_scenario_shows_itself_and_travels_to_other_processes():
    scenario = sm.load("eros-quick")
    assert repr(scenario) == "Scenario('eros-quick', 2 observers past 433 Eros)"
    html = scenario._repr_html_()
    assert "<table>" in html and "data:image/png;base64," in html and "eros-quick" in html
    assert pickle.loads(pickle.dumps(scenario)) == scenario


def test_a_scenario_that_cannot_be_drawn_says_why_in_its_place():
    html = sm.load("eros-quick", {"design.visiting_points": [1, 900]})._repr_html_()
    assert "design.visiting_points: 900 is not one of" in html and "<table>" in html


def test_what_is_packaged_is_listed_with_its_kind():
    table = sm.available()
    assert table.loc["eros-config1", "kind"] == "scenario" and table.loc["eros-losses", "kind"] == "campaign"
    assert table["description"].str.len().min() > 10
