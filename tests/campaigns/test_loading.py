"""A wrong campaign file ends in an error that names the key, the value and what is allowed."""

import pytest
import yaml

from swarm_mj.campaigns.flying import failed_row
from swarm_mj.campaigns.loading import load_campaign, restore, scenario_of
from swarm_mj.campaigns.sampling import Sample
from swarm_mj.campaigns.store import schema_of, table_of
from swarm_mj.errors import ScenarioError
from swarm_mj.scenarios.loading import load_scenario

from .conftest import ONE

CASES = {
    "unknown key": ("nmae: x\n", "nmae: unknown key. Did you mean 'name'"),
    "unknown distribution": (
        "parameters: {camera.half_angle_deg: {distribution: gauss}}",
        r"camera.half_angle_deg.distribution = 'gauss': unknown; allowed: uniform, log_uniform, normal",
    ),
    "no distribution": ("parameters: {camera.half_angle_deg: {mean: 3}}", "half_angle_deg.distribution: missing"),
    "wrong value": (
        "parameters: {camera.half_angle_deg: {distribution: normal, mean: 4, std: -1}}",
        "parameters.camera.half_angle_deg.std = -1: input should be greater than 0",
    ),
    "missing value": ("parameters: {seed2: {distribution: normal, mean: 4}}", "parameters.seed2.std: missing"),
    "wrong law's key": (
        "parameters: {camera.half_angle_deg: {distribution: normal, mean: 4, sigma: 1}}",
        "sigma: unknown key. Allowed: steps, distribution, mean, std",
    ),
    "ends in disorder": (
        "parameters: {camera.half_angle_deg: {distribution: uniform, low: 4, high: 3}}",
        "camera.half_angle_deg.high = 3: must be above low = 4",
    ),
    "unknown parameter": (
        "parameters: {camera.half_angel_deg: {distribution: uniform, low: 4, high: 5}}",
        "camera.half_angel_deg: unknown key. Did you mean 'half_angle_deg'",
    ),
    "a parameter inside a number": (
        "parameters: {duration_s.x: {distribution: uniform, low: 4, high: 5}}",
        "parameters.duration_s.x: duration_s is a single value",
    ),
    "a component that is not there": (
        "parameters: {mothership.position_A_m.3: {distribution: uniform, low: 4, high: 5}}",
        "'3' must be a number from 0 to 2",
    ),
    "an impossible value": (
        "parameters: {camera.half_angle_deg: {distribution: uniform, low: 94, high: 95}}",
        "camera.half_angle_deg = 94",
    ),
    "a parameter deep inside a number": (
        "parameters: {duration_s.x.y: {distribution: uniform, low: 4, high: 5}}",
        "parameters.duration_s.x.y: duration_s is a single value",
    ),
    "an entry of an empty list": (
        "parameters: {faults.0.probability: {distribution: uniform, low: 0, high: 1}}",
        "parameters.faults.0.probability: '0' names an entry of a list that is empty",
    ),
    "a section with a column's name": (
        "parameters: {spacecraft: {distribution: choice, values: [{mass_kg: 8}, {mass_kg: 9}]}}",
        "parameters.spacecraft: cannot be drawn as a whole",
    ),
    "a design by reference": (
        "parameters: {design: {distribution: choice, values: [{reference: eros-visit}]}}",
        "parameters.design: a design cannot be drawn by its reference",
    ),
    "an endless grid": (
        "method: grid\nparameters: {seed2: {distribution: integer, low: 1, high: 1000000000000}}",
        "runs = 3: with method = grid, 1 parameters and 1 scenarios these are 3000000000000 flights: at most 10000000",
    ),
    "the seed": ("parameters: {seed: {distribution: integer, low: 1, high: 5}}", "seed: cannot be drawn"),
    "unknown method": ("method: random", "method = 'random'"),
    "no power of 2": ("method: sobol", "runs = 3: must be a power of 2 where method = sobol"),
    "nothing to sweep": ("method: grid", "parameters: at least one is needed where method = grid"),
    "bad override": ("set: {camera.half_angle: 3}", "half_angle: unknown key"),
    "not YAML": ("set: {", "not valid YAML"),
    "nothing to record": ("record: []", "record = "),
}


@pytest.mark.parametrize("case", CASES)
def test_a_wrong_file_is_explained(write, case):
    text, words = CASES[case]
    head = "" if text.startswith("nmae") else "name: x\n"
    path = write(head.replace("{", "{{") + "runs: 3\nscenarios: [eros-quick]\n{more}", more=text)
    with pytest.raises(ScenarioError) as told:
        load_campaign(path)
    assert words in str(told.value)


def test_a_scenario_in_place_of_a_campaign_is_flown_with_one_seed_after_the_other(write, tmp_path):
    text = "name: mine\nseed: 3\nduration_s: 600\ncamera: {{half_angle_deg: 5}}\n"
    path = write(text)
    for source in (path, yaml.safe_load(text.replace("{{", "{").replace("}}", "}")), load_scenario(path)):
        resolved = load_campaign(source, {"camera.half_angle_deg": 6}, runs=7)
        assert (resolved.campaign.name, resolved.campaign.runs) == ("mine-campaign", 7)
        assert resolved.bases["mine"] == load_scenario(path, {"camera.half_angle_deg": 6})
        seeds = {
            scenario_of(resolved.bases["mine"], {}, Sample(resolved.campaign).trial(row).seed).seed for row in range(7)
        }
        assert len(seeds) == 7
    assert list(load_campaign("eros-quick").bases) == ["eros-quick"]
    with pytest.raises(ScenarioError, match="camra: unknown key.*camera"):
        load_campaign(write(text + "camra: 1\n"))


def test_a_campaign_is_read_from_a_mapping_too(write):
    path = write(ONE)
    data = yaml.safe_load(path.read_text())
    assert load_campaign(data) == load_campaign(path)
    assert load_campaign(data, {"duration_s": 900}).bases["one"].duration_s == 900.0
    with pytest.raises(ScenarioError, match="half_angel_deg: unknown key"):
        load_campaign(data, {"camera.half_angel_deg": 3})
    with pytest.raises(ScenarioError, match="camera: unknown key"):
        load_campaign(write("name: mine\nruns: 3\ncamera: {{half_angle_deg: 5}}\n"))


def test_two_scenarios_of_one_name_are_refused(write):
    path = write("name: x\nscenarios: [eros-quick, eros-quick]\n")
    with pytest.raises(ScenarioError, match="two are called 'eros-quick'"):
        load_campaign(path)


def test_a_scenario_that_is_not_there_is_named(write):
    with pytest.raises(ScenarioError, match="scenarios, nowhere: nowhere: no such scenario"):
        load_campaign(write("name: x\nscenarios: [nowhere]\n"))


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"\xff\xfe", "byte 0 is not UTF-8"),
        (b"x" * 1_000_001, "cannot be read .*larger than 1000000 bytes.; give a campaign"),
        (b"- a\n- b\n", "must be a mapping"),
        (b"".join(b"k%d: 1\n" % k for k in range(100)), "and 82 more mistakes"),
    ],
)
def test_a_file_that_is_no_campaign_is_refused(tmp_path, content, words):
    (tmp_path / "c.yaml").write_bytes(content)
    with pytest.raises(ScenarioError, match=rf"c\.yaml(.|\n)*{words}"):
        load_campaign(tmp_path / "c.yaml")


def test_dates_without_quotes_and_any_letters_may_be_set_and_drawn(write):
    more = """
    set: {epoch: 2018-01-15T00:00:00, description: "☄ 🛰"}
    parameters: {epoch: {distribution: choice, values: [2018-02-01T00:00:00]}}
    """
    resolved = load_campaign(write(ONE, more=more))
    base, trial = resolved.bases["one"], Sample(resolved.campaign).trial(0)
    assert (base.epoch, base.description) == ("2018-01-15T00:00:00", "☄ 🛰")
    assert scenario_of(base, trial.values, 1).epoch == "2018-02-01T00:00:00"
    assert table_of([failed_row(trial, "")], schema_of(resolved.campaign))["epoch"].to_pylist() == [
        "2018-02-01T00:00:00"
    ]
    assert restore(resolved.dumps()) == resolved


def test_a_scenario_file_is_looked_for_beside_the_campaign(write, tmp_path):
    (tmp_path / "mine.yaml").write_text("name: mine\nduration_s: 600\n")
    assert load_campaign(write("name: x\nscenarios: [mine.yaml]\n")).bases["mine"].duration_s == 600.0


def test_a_scenario_is_called_by_its_own_name_unless_the_campaign_gives_another(write, tmp_path):
    for folder, name in (("a", "first"), ("b", "second")):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "case.yaml").write_text(f"name: {name}\nduration_s: 600\n")
    resolved = load_campaign(
        write("name: x\nscenarios: [a/case.yaml, b/case.yaml, {{name: third, scenario: a/case.yaml}}]\n")
    )
    assert list(resolved.bases) == ["first", "second", "third"]
    assert Sample(resolved.campaign).names == ["first", "second", "third"]
    assert restore(resolved.dumps()) == resolved


def test_drawn_values_reach_the_scenario_and_nothing_else_changes(write):
    base = load_campaign(write()).bases["eros-quick"]
    drawn = scenario_of(base, {"mothership.position_A_m.1": 7.5, "camera.half_angle_deg": 3.0}, 11)
    assert drawn.mothership.position_A_m == (0.0, 7.5, -30000.0)
    assert (drawn.camera.half_angle_deg, drawn.seed) == (3.0, 11)
    assert drawn.model_copy(update={"mothership": base.mothership, "camera": base.camera, "seed": base.seed}) == base


def test_what_a_worker_is_told_is_the_same_campaign(write):
    resolved = load_campaign(
        write(more="parameters: {link.max_range_m: {distribution: lognormal, median: 5e4, sigma: 0.1}}")
    )
    assert restore(resolved.dumps()) == resolved
