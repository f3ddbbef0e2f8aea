"""Reading scenarios: good ones, and bad input with an error that helps."""

import json
import os
import re

import pytest
import yaml

from swarm_mj.cli.main import main
from swarm_mj.errors import ScenarioError
from swarm_mj.io.records import record_from
from swarm_mj.scenarios.bodies import packaged_files
from swarm_mj.scenarios.design_record import MadeFor
from swarm_mj.scenarios.loading import (
    design_record,
    design_section,
    load_scenario,
    packaged_names,
    parse_overrides,
    parse_yaml,
    scenario_from,
)
from swarm_mj.scenarios.schema import Scenario
from swarm_mj.scenarios.schema_imaging import Observation


def test_all_packaged_scenarios_load_and_are_named_like_their_file():
    assert {"eros-config1", "eros-config2", "eros-quick"} <= set(packaged_names())
    for name in packaged_names():
        scenario = load_scenario(name)
        assert scenario.name == name
        assert scenario.description


def test_the_papers_scenarios_hold_the_papers_parameters():
    for name in ("eros-config1", "eros-config2", "eros-literal"):
        s = load_scenario(name)
        assert (s.target.latitude_deg, s.target.longitude_deg, s.target.half_angle_deg) == (0, 90, 20)
        assert s.design.imaging_altitude_m == 14e3
        assert s.design.time_of_flight_s == 600
        assert s.duration_s == 1200
        assert s.mothership.position_A_m == (0, 0, -30e3)
        assert s.spacecraft.mass_kg == 8
    literal = load_scenario("eros-literal")
    assert literal.camera.half_angle_deg == 21.5
    assert literal.observation.criterion == "passage"
    assert literal.design.visiting_points == (7, 25, 31, 34, 38)


def test_the_packaged_configurations_name_their_design_and_say_which_reading_they_use():
    for name in ("eros-config1", "eros-config2"):
        s = load_scenario(name)
        assert s.design.reference == "eros-visit"
        assert list(s.design.visiting_points) == design_section("eros-visit")["visiting_points"]
        assert len(s.design.visiting_points) == 5
        assert "instant of the arrival" in s.description


def test_points_that_are_given_go_before_a_reference_and_a_broken_reference_is_a_clear_error(tmp_path):
    assert load_scenario("eros-config1", {"design.visiting_points": [3]}).design.visiting_points == (3,)
    path = tmp_path / "design.json"
    path.write_text(json.dumps({**design_record("eros-visit"), "visiting_points": [4, 5]}))
    assert load_scenario("eros-config1", {"design.reference": path}).design.visiting_points == (4, 5)
    wrong = [
        json.dumps({**design_record("eros-visit"), "visiting_points": points}) for points in ("all", [1.5], [], None)
    ]
    for broken in ("", "[]", "{}", '{"visiting_points": [4, 5]}', *wrong, "[" * 100_000):
        path.write_text(broken)
        with pytest.raises(ScenarioError, match="design.reference"):
            load_scenario("eros-config1", {"design.reference": path})
    with pytest.raises(ScenarioError, match="eros-visit"):
        load_scenario("eros-config1", {"design.reference": "nobody"})


@pytest.mark.parametrize(
    "key",
    ["visiting_points", "proof", "proof.minimum", "proof.lower_bound", "proof.status", "proof.visiting_points",
     "proof.covered_percent", "proof.seconds", "genetic", "selected_by", "candidates_count", "tolerance_percent", "fold"],
)  # fmt: skip
def test_a_design_that_lacks_what_a_report_says_of_it_is_refused_and_what_lacks_is_named(tmp_path, key):
    record = json.loads(json.dumps(design_record("eros-visit")))
    *parents, last = key.split(".")
    inner = record
    for parent in parents:
        inner = inner[parent]
    del inner[last]
    path = tmp_path / "design.json"
    path.write_text(json.dumps(record))
    with pytest.raises(ScenarioError, match=re.escape(f"is no design.json of `swarm-mj design` ({key} is missing)")):
        design_section(str(path))


@pytest.mark.parametrize(
    ("content", "words"),
    [(None, "(no such file)"), ("a: 1", "(no JSON)"), (b"\xff\xfe", "(no JSON)"), ("[3]", "(it holds [3]: must be ")],
)
def test_a_file_that_is_no_design_is_told_in_words_and_with_the_option(tmp_path, content, words):
    path = tmp_path / "design.json"
    if content is not None:
        path.write_bytes(content.encode() if isinstance(content, str) else content)
    with pytest.raises(ScenarioError, match="^design.reference \\(--design\\) = ") as error:
        design_section(str(path))
    assert words in str(error.value)
    assert "Error" not in str(error.value)


def test_a_campaign_is_told_from_a_scenario(tmp_path):
    path = tmp_path / "cam.yaml"
    path.write_text("name: cam\nruns: 3\nscenarios: [eros-quick]\nparameters: {}\n")
    for name in (str(path), "eros-losses"):
        with pytest.raises(ScenarioError) as error:
            load_scenario(name)
        assert str(error.value) == f"{name}: this is a campaign; fly it with `swarm-mj campaign {name}`"


@pytest.mark.parametrize(
    ("override", "line"),
    [
        ("camera=3", "camera = 3: must be a section with the keys half_angle_deg, shape, resolution_px, detector_ifov_rad"),
        ("camera=null", "camera = None: must be a section with the keys half_angle_deg, shape, "),
        ("body.orbit=[1]", "body.orbit = [1]: must be a section with the keys semi_major_axis_au, "),
        ("designer.extra_targets=[3]",
         "designer.extra_targets.0 = 3: must be a section with the keys latitude_deg, longitude_deg, half_angle_deg"),
        ("faults=3", "faults = 3: must be a list, in brackets"),
        ("faults=[3]", "faults.0 = 3: must be a section with the key kind: spacecraft_lost, "),
        ("spacecraft.size_m=[1]", "spacecraft.size_m = [1]: must be a list of 3, not 1"),
        ("spacecraft.size_m=[1, 2, 3, 4]", "spacecraft.size_m = [1, 2, 3, 4]: must be a list of at most 3, not 4"),
        ("body.radius_range_m=[1]", "body.radius_range_m = [1]: must be a list of 2, not 1"),
        ("mothership.velocity=[1, 2]", "mothership.velocity = [1, 2]: must be 'mean' or 'rest' or a list of 3, not 2"),
        ("mothership.velocity=3", "mothership.velocity = 3: must be 'mean' or 'rest' or a list, in brackets"),
        ("target.cell_size_m=x", "target.cell_size_m = 'x': must be a number or 'auto'"),
        ("control.parameters=3", "control.parameters = 3: must be a section of keys and values"),
        ("design.visiting_points=[a]", "design.visiting_points.0 = 'a': must be a whole number"),
        ("design.visiting_points=[]", "design.visiting_points = []: must be a list of at least 1, not 0"),
        ("seed=1.5", "seed = 1.5: must be a whole number"),
        ("duration_s=long", "duration_s = 'long': must be a number"),
        ("observation.any_pixel=maybe", "observation.any_pixel = 'maybe': must be true or false"),
        ("description=3", "description = 3: must be a text; put it in quotes"),
        ("camera.shape=3", "camera.shape = 3: must be 'square' or 'cone'"),
    ],
)  # fmt: skip
def test_a_value_of_the_wrong_kind_is_told_in_one_line_of_plain_words(override, line):
    with pytest.raises(ScenarioError) as error:
        load_scenario("eros-quick", parse_overrides([override]))
    first, *rest = str(error.value).splitlines()
    assert first == "eros-quick:" and len(rest) == 1
    assert rest[0].startswith(f"  {line}")
    assert not re.search("(?i)tuple|dictionary|instance|input|valid", rest[0])


def test_overrides_change_nested_values_and_keep_the_rest():
    scenario = load_scenario("eros-quick", {"camera.half_angle_deg": 3, "design.visiting_points": [1, 2, 3], "seed": 9})
    assert scenario.camera.half_angle_deg == 3
    assert scenario.camera.resolution_px == 128
    assert scenario.design.visiting_points == (1, 2, 3)
    assert scenario.seed == 9


@pytest.mark.parametrize(
    ("override", "words"),
    [
        ("target.half_angle_deg=90", ["target.half_angle_deg", "90", "less than 90"]),
        ("design.time_of_flight_s=0", ["design.time_of_flight_s", "0", "greater than 0"]),
        ("design.time_of_flight_s=-5", ["design.time_of_flight_s", "-5"]),
        ("design.imaging_altitude_m=-100", ["design.imaging_altitude_m", "-100", "greater than 0"]),
        ("spacecraft.mass_kg=-8", ["spacecraft.mass_kg", "-8", "greater than 0"]),
        ("spacecraft.mass_kg=0.2", ["mass_kg", "0.2", "three wheels"]),
        ("duration_s=.nan", ["duration_s", "nan", "finite"]),
        ("duration_s=.inf", ["duration_s", "inf"]),
        ("duration_s=500", ["duration_s", "500", "time_of_flight_s"]),
        ("camera.shape=round", ["camera.shape", "round", "square"]),
        ("camera.half_angel_deg=3", ["camera.half_angel_deg", "unknown key", "half_angle_deg"]),
        ("camara.half_angle_deg=3", ["camara", "unknown key", "camera"]),
        ("physics.timestep_s=0.3", ["physics.timestep_s", "multiple"]),
        ("seed=-1", ["seed", "-1"]),
        ("design.visiting_points=[]", ["design.visiting_points", "at least 1"]),
        ("body.radius_range_m=big", ["body.radius_range_m", "big"]),
        ("name=../../etc", ["name", "../../etc"]),
        ("epoch=2018-13-45", ["epoch", "2018-13-45"]),
        ("epoch=soon", ["epoch", "soon"]),
        ("physics.timestep_s=1e-320", ["physics.timestep_s", "0.001"]),
        ("body.orbit.semi_major_axis_au=1e-300", ["semi_major_axis_au", "0.01"]),
    ],
)
def test_a_wrong_value_is_refused_with_key_value_and_what_is_allowed(override, words):
    with pytest.raises(ScenarioError) as error:
        load_scenario("eros-quick", parse_overrides([override]))
    for word in words:
        assert word in str(error.value)


def test_numbers_with_an_exponent_and_no_point_are_numbers():
    scenario = load_scenario("eros-quick", {"control.parameters.disturbance_torque": 1e-05, "spacecraft.mass_kg": 8.0})
    assert scenario.control.parameters["disturbance_torque"] == 1e-5
    assert scenario.spacecraft.mass_kg == 8.0


def test_paths_in_a_file_are_relative_to_it(tmp_path, monkeypatch):
    (tmp_path / "case").mkdir()
    (tmp_path / "case" / "mesh.obj").write_text("")
    (tmp_path / "case" / "mine.yaml").write_text("name: mine\nbody: {shape: mesh.obj}\n")
    monkeypatch.chdir(tmp_path)
    assert load_scenario("case/mine.yaml").body.shape == str(tmp_path / "case" / "mesh.obj")


def test_a_packaged_name_means_the_packaged_scenario_whatever_stands_in_the_current_folder(tmp_path, monkeypatch):
    expected = load_scenario("eros-config2")
    monkeypatch.chdir(tmp_path)
    (tmp_path / "eros-config2").mkdir()
    for name in ("eros-quick", "eros", "eros-visit"):  # a scenario, a shape and a design
        (tmp_path / name).write_text("name: other")
    assert load_scenario("eros-config2") == expected
    assert load_scenario("eros-quick").name == "eros-quick"
    (tmp_path / "eros-config2.yaml").write_text("name: mine")
    assert load_scenario("eros-config2.yaml").name == "mine"


def test_a_packaged_shape_and_design_are_meant_by_their_names_whatever_stands_beside_the_file(tmp_path):
    (tmp_path / "mine.yaml").write_text("name: mine\nbody: {shape: eros}\ndesign: {reference: eros-visit}\n")
    expected = load_scenario(tmp_path / "mine.yaml")
    for name in ("eros", "eros-visit"):
        (tmp_path / name).write_text('{"visiting_points": [1]}')
    assert load_scenario(tmp_path / "mine.yaml") == expected
    assert (
        expected.body.shape == "eros"
        and list(expected.design.visiting_points) == design_section("eros-visit")["visiting_points"]
    )


def test_a_pipe_and_an_endless_name_are_refused(tmp_path):
    os.mkfifo(tmp_path / "pipe.yaml")
    with pytest.raises(ScenarioError, match="no regular file"):
        load_scenario(tmp_path / "pipe.yaml")
    for name in ("x" * 5000 + ".yaml", "a\0.yaml"):
        with pytest.raises(ScenarioError, match="cannot be read") as error:
            load_scenario(name)
        assert len(str(error.value)) < 500
    with pytest.raises(ScenarioError, match="no such scenario"):
        load_scenario("x" * 5000)


@pytest.mark.parametrize(
    ("override", "words"),
    [
        ("seed=" + "[" * 3000, "more than 20 levels deep"),
        ("camera", "must read key=value"),
        ("=3", "must read key=value"),
        ("camera.half_angle_deg.x=3", "camera.half_angle_deg = {'x': 3}: must be a number"),
        ("camera.resolution_px.x.y=3", "camera.resolution_px is a single value"),
        ("design.visiting_points.0=3", "design.visiting_points is a list: give the whole of it"),
        ("camera=[", "not valid YAML"),
        ("seed.x=1", r"seed = {'x': 1}: must be a whole number"),
    ],
)
def test_a_malformed_override_is_refused(override, words):
    with pytest.raises(ScenarioError, match=words):
        load_scenario("eros-quick", parse_overrides([override]))


@pytest.mark.parametrize("word", ["float", "str", "none", "tuple", "a[b", "[0]"])
def test_an_unknown_key_may_be_any_word_and_is_named_with_what_is_allowed(word):
    with pytest.raises(ScenarioError, match=re.escape(f"  {word}: unknown key. Allowed: name, description, seed")):
        scenario_from({"name": "x", word: 1})
    with pytest.raises(ScenarioError, match=re.escape(f"  camera.{word}: unknown key. Allowed: half_angle_deg, shape")):
        scenario_from({"name": "x", "camera": {word: 1}})


@pytest.mark.parametrize(
    ("override", "words"),
    [
        (
            "designer.extra_targets=[{latitude_deg: 1, longitude: 2}]",
            "extra_targets.0.longitude: unknown key. Did you mean 'longitude_deg'? Allowed: latitude_deg, longitude_deg, half",
        ),
        ("faults=[{kind: nobody}]", "faults.0.kind = 'nobody': unknown; allowed: spacecraft_lost, communications_lost"),
        ("faults=[{at_s: 3}]", "faults.0.kind: missing; allowed: spacecraft_lost, communications_lost"),
        ("faults=[{kind: camera_off, spacecraft: sc1, at: 3}]", "at: unknown key. Did you mean 'at_s'? Allowed: probability"),
    ],
)  # fmt: skip
def test_a_wrong_entry_of_a_list_is_told_what_is_allowed(override, words):
    with pytest.raises(ScenarioError, match=re.escape(words)):
        load_scenario("eros-quick", parse_overrides([override]))


def test_a_key_that_is_no_word_is_told_after_its_source():
    with pytest.raises(ScenarioError, match="^file: key 3 is no word"):
        parse_yaml("3: 1", "file")


def test_a_tag_on_a_long_text_makes_a_short_message():
    with pytest.raises(ScenarioError, match="file: not valid YAML: could not convert string to float: 'xxx") as error:
        parse_yaml(f"name: !!float {'x' * 100_000}", "file")
    assert len(str(error.value)) < 1_000


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"[1, 2]",
        b"name: [",
        b"\xff\xfe\x00bad",
        b"name: !!python/object/apply:os.system ['echo hacked']",
        b"a: &x [1]\nb: *x",
        b"[" * 3000,
        b"name: x\nepoch: 12:99",
        b"name: x\nseed: 1\nseed: 2",
        b"x" * 2_000_000,
    ],
)
def test_a_broken_file_is_a_clear_error(tmp_path, content):
    path = tmp_path / "broken.yaml"
    path.write_bytes(content)
    with pytest.raises(ScenarioError, match="broken.yaml"):
        load_scenario(path)


def test_a_missing_file_and_an_unknown_name_say_what_exists(tmp_path):
    with pytest.raises(ScenarioError, match="cannot be read"):
        load_scenario(tmp_path / "none.yaml")
    with pytest.raises(ScenarioError, match="Did you mean 'eros-config1'"):
        load_scenario("eros-confg1")


def test_a_scenario_survives_a_round_trip_through_yaml():
    scenario = load_scenario("eros-config2")
    text = yaml.safe_dump(scenario.model_dump(mode="json"))
    assert Scenario.model_validate(yaml.safe_load(text)) == scenario


def test_the_command_lists_names_prints_files_and_the_schema(capsys):
    assert main(["available"]) == 0
    listing = capsys.readouterr().out
    assert all(name in listing for name in packaged_names())
    assert main(["packaged", "eros-quick"]) == 0
    assert "name: eros-quick" in capsys.readouterr().out
    assert main(["json-schema"]) == 0
    schema = json.loads(capsys.readouterr().out)
    assert "imaging_radius_m" in schema["$defs"]["Behavior"]["properties"]
    assert main(["packaged", "nothing"]) == 2


@pytest.mark.parametrize("key", ["camera.half_angle_deg", "half_angle_deg", "camrea"])
def test_a_copy_with_a_key_that_is_none_is_refused_with_what_serves(key):
    scenario = load_scenario("eros-quick")
    with pytest.raises(ScenarioError, match=f"model_copy: {key} is no key of scenario: .*changed") as told:
        scenario.model_copy(update={key: 3})
    assert "\n" not in str(told.value)
    narrow = scenario.camera.model_copy(update={"half_angle_deg": 3.0})
    assert scenario.model_copy(update={"camera": narrow}).camera.half_angle_deg == 3.0


def test_a_packaged_design_says_its_criterion_by_the_keys_of_today():
    for reference in packaged_files("designs", ".json"):
        said = design_record(reference)["criterion"].keys()
        assert Observation.model_fields.keys() - {"classes", "sequence"} <= said <= Observation.model_fields.keys()


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("design.time_of_flight_s", 1e19),
        ("body.gravity.parameters.gm", 1e300),
        ("control.parameters.stiffness", -1e200),
        ("designer.altitudes_m", [5e3, 1e19]),
        ("behavior.parameters.a.b", [[{"c": 1e19}]]),
        ("faults", [{"kind": "wheel_lost", "spacecraft": "sc1", "wheel": 1, "between_s": [0.0, 1e30]}]),
    ],
)
def test_a_number_whose_square_could_overflow_is_refused_by_its_key_however_deep_it_stands(key, value):
    name = {"behavior.parameters.a.b": f"{key}.c", "faults": "faults.0.wheel_lost.between_s"}.get(key, key)
    for told in (lambda: load_scenario("eros-quick", {key: value}), lambda: load_scenario(nested(key, value))):
        with pytest.raises(ScenarioError, match=rf"{name} = -?1e\+\d+: must be less than 9.22337e\+18 in size"):
            told()


def test_the_bound_of_a_key_is_told_before_that_of_all_numbers():
    with pytest.raises(ScenarioError, match=r"duration_s = 1e\+19: must be less than or equal to 2592000"):
        load_scenario("eros-quick", {"duration_s": 1e19})


def nested(key, value):
    for name in reversed(key.split(".")):
        value = {name: value}
    return {"name": "x", **value}


def test_a_record_may_hold_larger_numbers_than_a_scenario():
    assert record_from('{"body.volume_m3": 4.2e18}', MadeFor)
    with pytest.raises(ValueError, match="finite"):
        record_from('{"body.volume_m3": 1e999}', MadeFor)
