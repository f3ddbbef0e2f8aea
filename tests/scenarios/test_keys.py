"""Keys and plug-ins explained: by `sm.explain`, on the command line and in the JSON schema."""

import jsonschema
import pytest
import yaml

import swarm_mj as sm
from swarm_mj import plugins
from swarm_mj.cli.main import main
from swarm_mj.errors import ScenarioError
from swarm_mj.scenarios.catalogue import GROUPS, arguments, installed, json_schema, summary_of
from swarm_mj.scenarios.loading import load_scenario, packaged, packaged_names


@pytest.fixture(scope="module")
def schema():
    return json_schema()


def errors(schema, overrides):
    return [e.message for e in jsonschema.Draft202012Validator(schema).iter_errors({"name": "own", **overrides})]


@pytest.mark.parametrize("name", packaged_names())
def test_every_packaged_scenario_agrees_with_the_json_schema(schema, name):
    jsonschema.validate(yaml.safe_load(packaged(name)), schema, jsonschema.Draft202012Validator)


def test_the_json_schema_knows_the_arguments_of_the_plug_in_that_is_named(schema):
    law = {"controller": "mrp_sliding_mode", "parameters": {"slope": 0.3}}
    assert not errors(schema, {"control": law})
    assert "'slop' was unexpected" in errors(schema, {"control": {**law, "parameters": {"slop": 0.3}}})[0]
    assert errors(schema, {"control": {**law, "parameters": {"slope": "steep"}}})
    assert errors(schema, {"body": {"gravity": {"model": "point_mass", "parameters": {"densty": 1}}}})
    assert errors(schema, {"behavior": {"name": "target_sweep", "parameters": {}}})  # surface_radius_m is required
    assert not errors(schema, {"body": "bennu"})
    assert not errors(schema, {"control": {"controller": "of_my_own", "parameters": {"anything": 1}}})


def test_every_argument_in_the_schema_is_one_that_the_plug_in_takes():
    for group, place in GROUPS.items():
        for entry in installed(group):
            known = [a.name for a in arguments(plugins.find(group, entry.name), place.given)]
            assert not {"shape", "n_observers", "imaging_radius_m"} & set(known)


def test_a_section_a_key_and_a_plug_in_are_explained():
    assert sm.explain("camera").loc["camera.half_angle_deg", ["unit", "default"]].tolist() == ["deg", "21.5"]
    assert list(sm.explain("camera.half_angle_deg").index) == ["camera.half_angle_deg"]
    assert "faults.wheel_lost.wheel" in sm.explain("faults.wheel_lost").index
    assert "rad/s" in sm.explain("mrp_sliding_mode").loc["control.parameters.slope", "meaning"]
    assert len(sm.explain()) > 190 and set(sm.available()["kind"]) >= {"control law", "gravity field", "behaviour"}


def test_descriptions_are_those_of_the_scenarios_and_plug_ins_that_are_loaded():
    table = sm.available()
    for name in packaged_names():
        assert table.loc[name, "description"] == " ".join(load_scenario(name).description.split())
    for group in GROUPS:
        for entry in installed(group):
            assert table.loc[entry.name, "description"] == " ".join(summary_of(plugins.find(group, entry.name)).split())


def test_an_unknown_key_names_the_likely_one():
    with pytest.raises(ScenarioError, match="'half_angle_deg' is neither .* did you mean .*camera.half_angle_deg"):
        sm.explain("half_angle_deg")
    with pytest.raises(ScenarioError, match=r"'camrea' is neither .* did you mean camera\?"):
        sm.explain("camrea")


def test_the_command_line_explains(capsys):
    assert main(["explain", "camera"]) == 0
    assert "camera.half_angle_deg: number, [deg], default 21.5, > 0, < 90" in capsys.readouterr().out
    assert main(["available"]) == 0
    assert "  mrp_sliding_mode " in capsys.readouterr().out
    assert main(["explain", "target_sweep"]) == 0
    assert "behavior.parameters.surface_radius_m: required" in capsys.readouterr().out
    assert main(["explain", "nope"]) == 2
    assert "'nope'" in capsys.readouterr().err
