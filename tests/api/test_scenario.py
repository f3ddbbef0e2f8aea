"""Scenarios through the public API: read from names, files and mappings, changed, listed, shown."""

import pickle

import pytest

import swarm_mj as sm
from swarm_mj.scenarios.loading import load_scenario, packaged_text


def test_a_name_a_file_and_a_mapping_are_the_same_scenario(tmp_path):
    (tmp_path / "mine.yaml").write_text(packaged_text("eros-config2"))
    by_name, by_file = sm.load("eros-config2"), sm.load(tmp_path / "mine.yaml")
    by_mapping = sm.load(by_name.model_dump(mode="json"))
    assert by_name == by_file == by_mapping
    assert by_name.model_dump() == load_scenario("eros-config2").model_dump()


def test_overrides_seed_design_and_policy_are_what_the_command_line_sets():
    scenario = sm.load("eros-config2", ["camera.half_angle_deg=6"], seed=7, design="eros-visit", policy="greedy")
    assert (scenario.camera.half_angle_deg, scenario.seed, scenario.design.reference) == (6.0, 7, "eros-visit")
    assert scenario.behavior.name == "scripted_policy" and scenario.behavior.parameters["policy"] == "greedy"
    assert sm.load("eros-config2", "seed=3") == sm.load("eros-config2", seed=3)


def test_a_change_leaves_the_scenario_alone_and_is_checked():
    scenario = sm.load("eros-quick")
    changed = scenario.changed("camera.half_angle_deg=3", "seed=5")
    assert (changed.camera.half_angle_deg, changed.seed) == (3.0, 5)
    assert scenario.camera.half_angle_deg != 3.0
    with pytest.raises(sm.SwarmError, match=r"camera\.half_angle_deg = -1"):
        scenario.changed("camera.half_angle_deg=-1")
    with pytest.raises(sm.SwarmError, match="colour: unknown key"):
        sm.load({"name": "x", "colour": "red"})


def test_a_saved_scenario_is_read_back(tmp_path):
    scenario = sm.load("eros-quick", ["camera.half_angle_deg=5"])
    assert sm.load(scenario.save(tmp_path / "mine.yaml")) == scenario
    with pytest.raises(sm.SwarmError, match="cannot be written"):
        scenario.save(tmp_path / "none" / "mine.yaml")


def test_the_mapping_that_is_given_is_not_changed():
    mapping = {"name": "x", "design": {"visiting_points": [3]}, "behavior": {"name": "adaptable_roles"}}
    sm.load(mapping, ["camera.half_angle_deg=3", "design.visiting_points=[4]"])
    assert mapping == {"name": "x", "design": {"visiting_points": [3]}, "behavior": {"name": "adaptable_roles"}}


def test_a_scenario_shows_itself_and_travels_to_other_processes():
    scenario = sm.load("eros-quick")
    assert repr(scenario) == "Scenario('eros-quick', 2 observers past 433 Eros)"
    html = scenario._repr_html_()
    assert "<table>" in html and "data:image/png;base64," in html and "eros-quick" in html
    assert pickle.loads(pickle.dumps(scenario)) == scenario


def test_a_scenario_that_cannot_be_drawn_says_why_in_its_place():
    html = sm.load("eros-quick", ["design.visiting_points=[1, 900]"])._repr_html_()
    assert "design.visiting_points: 900 is not one of" in html and "<table>" in html


def test_what_is_packaged_is_listed_with_its_kind():
    table = sm.available()
    assert table.loc["eros-config1", "kind"] == "scenario" and table.loc["eros-losses", "kind"] == "campaign"
    assert table["description"].str.len().min() > 10
