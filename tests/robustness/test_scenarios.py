"""Any scenario, however wrong, ends in a result or in an error of the project's own."""

import datetime
import json
import time

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from swarm_mj.errors import ScenarioError, SwarmError
from swarm_mj.flight.fly import simulate
from swarm_mj.flight.observe import add_coverage, observe_flight
from swarm_mj.flight.plan import make_plan
from swarm_mj.io import values
from swarm_mj.records.summary import summarise
from swarm_mj.scenarios import limits, loading
from swarm_mj.scenarios.loading import design_section, load_scenario, parse_overrides, scenario_from

from .hostile_scenarios import BASE, JUNK, LEAVES, changed, overrides
from .limits import bounded, examples

pytestmark = pytest.mark.robust


def flown(scenario):
    """Everything that `swarm-mj fly` does, but for files and figures."""
    plan = make_plan(scenario)
    telemetry = simulate(plan)
    result = observe_flight(plan, telemetry)
    add_coverage(telemetry, result)
    return telemetry, summarise(plan, telemetry, result, {})


@examples(60)
@given(changes=overrides())
def test_any_values_end_in_a_finite_result_or_a_clear_error(changes):
    with bounded():
        try:
            telemetry, summary = flown(scenario_from(changed(BASE, changes)))
        except SwarmError as error:
            assert str(error).strip()
            return
    json.dumps(summary, allow_nan=False)
    for name, variable in telemetry.data_vars.items():
        assert np.isfinite(variable.values).all(), name


@examples(150)
@given(data=JUNK | st.dictionaries(st.sampled_from([path[0] for path, _, _ in LEAVES]), JUNK, max_size=6))
def test_any_mapping_is_read_or_refused(data):
    with bounded():
        text = yaml.safe_dump(data, allow_unicode=True)
        try:
            scenario_from(loading.parse_yaml(text, "fuzzed"))
        except ScenarioError as error:
            assert "fuzzed" in str(error) or "scenario" in str(error)
            assert len(str(error)) < 20_000


@examples(100)
@given(texts=st.lists(st.text(max_size=40) | st.builds("{}={}".format, st.sampled_from(
    [".".join(path) for path, _, _ in LEAVES]), st.text(max_size=20) | st.integers() | st.floats()), max_size=3))  # fmt: skip
def test_any_override_is_taken_or_refused(texts):
    with bounded():
        try:
            load_scenario("eros-quick", parse_overrides(texts))
        except ScenarioError as error:
            assert str(error).strip()


@examples(150)
@given(content=st.binary(max_size=300) | st.text(alphabet="{}[]&*!|>-:?,#'\"\n ax1<.", max_size=80).map(str.encode))
def test_any_bytes_of_a_file_are_read_or_refused(tmp_path_factory, content):
    path = tmp_path_factory.getbasetemp() / "fuzzed.yaml"
    path.write_bytes(content)
    with bounded(), pytest.raises(ScenarioError, match="fuzzed.yaml"):
        load_scenario(path)


@pytest.mark.parametrize(
    "tag", ["timestamp soon", "bool maybe", "int ''", "float ''", "float x", "omap 3", "binary '#'"]
)
def test_a_tag_that_does_not_fit_its_value_is_refused(tmp_path, tag):
    (tmp_path / "a.yaml").write_text(f"name: !!{tag}\n")
    with pytest.raises(ScenarioError, match=r"a\.yaml"):
        load_scenario(tmp_path / "a.yaml")
    with pytest.raises(ScenarioError, match="name"):
        load_scenario("eros-quick", parse_overrides([f"name=!!{tag}"]))


@pytest.mark.parametrize("override", ["control.parameters=&a {x: *a}", "camera=[&a [1, 1], &b [*a, *a], [*b, *b]]"])
def test_aliases_are_refused_in_overrides_too(override):
    with pytest.raises(ScenarioError, match="aliases"):
        load_scenario("eros-quick", parse_overrides([override]))


def test_a_mapping_that_contains_itself_or_is_too_deep_is_refused():
    endless = {}
    endless["again"] = endless
    deep = 1.0
    for _ in range(100_000):
        deep = {"a": deep}
    for parameters in (endless, deep):
        with pytest.raises(ScenarioError, match="MAX_DEPTH"):
            scenario_from({**BASE, "control": {"parameters": parameters}})
    with pytest.raises(ScenarioError, match="MAX_DEPTH"):
        load_scenario("eros-quick", parse_overrides(["control.parameters." + "a." * 10_000 + "b=1"]))


def test_a_list_that_unfolds_into_millions_of_values_is_refused():
    unfolding = [1] * 10
    for _ in range(12):
        unfolding = [unfolding] * 10
    with bounded(), pytest.raises(ScenarioError, match="MAX_VALUES"):
        scenario_from({**BASE, "design": {"visiting_points": unfolding}})


@pytest.mark.parametrize(
    "value", [10**400, 2**63, -(2**63), float("nan"), float("inf"), b"\xff", {1, 2}, 1j, "\ud800", "\x1b[2J"]
)
def test_values_that_no_scenario_can_hold_are_refused_wherever_they_stand(value):
    for data in ({**BASE, "description": value}, {**BASE, "control": {"parameters": {"slope": value}}}):
        with pytest.raises(ScenarioError, match=r"must|description"):
            scenario_from(data)


def test_keys_that_are_no_words_are_refused():
    for key in (3, None, datetime.date(2020, 1, 1), "x" * 200, "a\0b"):
        with pytest.raises(ScenarioError, match="is no word"):
            scenario_from({**BASE, "control": {"parameters": {key: 1}}})


def test_thousands_of_mistakes_make_a_message_of_a_screen(tmp_path):
    (tmp_path / "many.yaml").write_text("".join(f"k{i}: 1\n" for i in range(3000)))
    with pytest.raises(ScenarioError, match="and 2981 more mistakes") as error:
        load_scenario(tmp_path / "many.yaml")
    assert len(str(error.value)) < 10_000
    with pytest.raises(ScenarioError) as error:
        load_scenario("eros-quick", parse_overrides(["camera=[" + "[]," * 20_000 + "]"]))
    assert len(str(error.value)) < 1_000


def test_a_key_given_twice_is_found_among_thousands_without_comparing_all_with_all():
    def seconds(count):
        text = "".join(f"k{i}: 1\n" for i in range(count)) + "z: 1\nz: 1\n"
        start = time.process_time()
        with pytest.raises(ScenarioError, match="'z' is given twice"):
            loading.parse_yaml(text, "fuzzed")
        return time.process_time() - start

    seconds(100)
    # Comparing all with all takes 16 times as long for four times as many keys.
    assert seconds(16_000) < 10 * seconds(4_000)


@pytest.mark.parametrize(
    ("changes", "limit"),
    [
        ({"design.visiting_points": [1] * 6000}, "MAX_SPACECRAFT"),
        ({"duration_s": 2_592_000, "physics.timestep_s": 0.001, "design.visiting_points": [1] * 10}, "MAX_SPACECRAFT_STEPS"),
        ({"duration_s": 2_592_000, "telemetry.interval_s": 0.5}, "MAX_SPACECRAFT_SAMPLES"),
        ({"designer.population": 10**9}, "MAX_POPULATION"),
    ],
)  # fmt: skip
def test_a_flight_that_no_machine_can_hold_is_refused_before_it_begins(changes, limit):
    data = changed(BASE, [(tuple(key.split(".")), value) for key, value in changes.items()])
    with bounded(), pytest.raises(ScenarioError, match=limit) as error:
        scenario_from(data)
    assert f"{getattr(limits, limit):g}" in str(error.value) or str(getattr(limits, limit)) in str(error.value) \
        or str(getattr(limits, limit) - 1) in str(error.value)  # fmt: skip


@pytest.mark.parametrize(
    ("key", "value", "words"),
    [
        ("design.visiting_points", [True, 2], "must be a number, not True"),
        ("mothership.position_A_m", [0, "-3e4", 0], "must be a number, not '-3e4'"),
        ("body.rotation.w_rate_deg_per_day", "4.46e2", "must be a number, not '4.46e2'"),
        ("camera.half_angle_deg", True, "must be a number, not True"),
        ("observation.occlusion", 1, "must be true or false, not 1"),
        ("body.rotation.pole_ra_deg", 1e30, "less than or equal to 360"),
        ("epoch", "0001-01-01T00:00:00", "must be from 1800 to 2049, where the elements of the Earth hold"),
        ("epoch", "2200-01-01T00:00:00", "must be from 1800 to 2049, where the elements of the Earth hold"),
    ],
)
def test_a_value_of_another_kind_or_beyond_what_is_known_is_refused_by_name(key, value, words):
    with pytest.raises(ScenarioError, match=words) as error:
        load_scenario("eros-quick", {key: value})
    assert f"{key} = " in str(error.value)


@pytest.mark.parametrize("gm", ["4.46e5", True])
def test_arguments_of_plug_ins_are_numbers_where_their_defaults_are(gm):
    scenario = load_scenario("eros-quick", {"body.gravity": {"model": "point_mass", "parameters": {"gm": gm}}})
    with pytest.raises(SwarmError, match=f"body.gravity.model = .*gm = {gm!r}: must be a number"):
        make_plan(scenario)


@pytest.mark.parametrize("name", ["a/b", "../up", "..", "/etc/x", "a\0b", "a\nb", "x\n", "", ".hidden", "C:\\x", "a b"])
def test_a_name_that_would_leave_the_output_folder_is_refused(name):
    with pytest.raises(ScenarioError, match="name"):
        scenario_from({**BASE, "name": name})


DESIGNS = {
    "too large": b'{"visiting_points": [1], "x": "' + b"y" * 2_000_000 + b'"}',
    "cut short": b'{"visiting_points": [1, 2',
    "deep": b"[" * 200_000,
    "not text": b"\xff\xfe{}",
    "another thing": b'"all"',
    "no numbers": b'{"visiting_points": ["1"]}',
    "not a number": b'{"visiting_points": [NaN]}',
    "endless number": b'{"visiting_points": [' + b"9" * 10_000 + b"]}",
}


@pytest.mark.parametrize("case", DESIGNS)
def test_a_design_that_is_none_is_refused(tmp_path, case):
    path = tmp_path / "design.json"
    path.write_bytes(DESIGNS[case])
    with bounded(), pytest.raises(ScenarioError, match="design.reference") as error:
        design_section(str(path))
    assert len(str(error.value)) < 2_000


@pytest.mark.parametrize("reference", ["x" * 5000, "a\0b", "../eros-visit", "/", "/dev/zero", ".", ""])
def test_a_reference_that_names_no_design_is_refused(reference):
    with bounded(), pytest.raises(ScenarioError, match="design.reference"):
        design_section(reference)


PARTS = st.none() | st.integers() | st.floats() | st.text(max_size=5)
KEYS = st.sampled_from(["visiting_points", "observers", "x"])
RECORDS = st.recursive(PARTS, lambda inner: st.lists(inner, max_size=3) | st.dictionaries(KEYS, inner, max_size=3))


@examples(100)
@given(content=st.binary(max_size=200) | RECORDS.map(lambda record: json.dumps(record).encode()))
def test_any_design_file_is_read_or_refused(tmp_path_factory, content):
    path = tmp_path_factory.getbasetemp() / "fuzzed.json"
    path.write_bytes(content)
    with bounded():
        try:
            assert all(type(point) is int for point in design_section(str(path)))
        except ScenarioError as error:
            assert "design.reference" in str(error)


LONG_INTEGERS = {
    "binary": "0b" + "1" * 20_000,
    "octal": "0" + "7" * 20_000,
    "hexadecimal": "0x" + "f" * 20_000,
    "base 60": ":".join(["59"] * 20_000),
    "decimal": "9" * 20_000,
    "tagged": "!!int '0x" + "f" * 20_000 + "'",
}


@pytest.mark.parametrize("notation", LONG_INTEGERS)
def test_an_integer_too_long_to_be_written_is_refused_in_any_notation(tmp_path, notation):
    text = LONG_INTEGERS[notation]
    (tmp_path / "long.yaml").write_text(f"name: long\nduration_s: {text}\n")
    with bounded(10), pytest.raises(ScenarioError, match=r"long\.yaml.*MAX_INTEGER_CHARACTERS") as error:
        load_scenario(tmp_path / "long.yaml")
    assert len(str(error.value)) < 1_000
    with bounded(10), pytest.raises(ScenarioError, match=r"--set duration_s=.*MAX_INTEGER_CHARACTERS"):
        load_scenario("eros-quick", parse_overrides([f"duration_s={text}"]))
    with pytest.raises(ScenarioError, match="MAX_INTEGER_CHARACTERS"):
        loading.parse_yaml(f"? {text}\n: 1\n", "key")


@pytest.mark.parametrize("value", ["0x" + "f" * 900, "0b" + "1" * 900, ":".join(["59"] * 300)])
def test_an_integer_that_fits_no_machine_is_refused_by_name(value):
    with pytest.raises(ScenarioError, match=r"value = \d+\.\.\.\d+: must be less than"):
        load_scenario("eros-quick", parse_overrides([f"duration_s={value}"]))


def test_a_message_shows_integers_of_any_size():
    for value in (10**5000, -(10**5000), [1 << 100_000], {"a": -(1 << 100_000)}):
        assert "bits" in values.shown(value)
        with pytest.raises(ScenarioError, match="bits"):
            scenario_from({**BASE, "duration_s": value if isinstance(value, int) else 1 << 100_000})


DEEP = ["[", "{", "- ", "? ", "{a: ", "[\n  ", ": ", "[? "]


@pytest.mark.parametrize("opening", DEEP)
def test_depth_is_refused_in_a_time_that_does_not_depend_on_it(tmp_path, opening):
    text = ("x: " if opening[0] in "[{" else "") + opening * (980_000 // len(opening))
    (tmp_path / "deep.yaml").write_text(text)
    start = time.process_time()
    with bounded(), pytest.raises(ScenarioError, match="MAX_DEPTH"):
        load_scenario(tmp_path / "deep.yaml")
    with bounded(), pytest.raises(ScenarioError, match="MAX_DEPTH"):
        load_scenario("eros-quick", parse_overrides([f"name={opening * 40_000}"]))
    assert time.process_time() - start < 3.0  # a fraction of a second; 150 s where time grows with the square


@examples(60)
@given(
    opening=st.lists(st.sampled_from([*DEEP, "a: ", "[]", "\n"]), min_size=1, max_size=6), count=st.integers(1, 3_000)
)
def test_any_nesting_is_read_or_refused_soon(opening, count):
    start = time.process_time()
    with bounded(20):
        try:
            loading.parse_yaml("".join(opening) * count, "nested")
        except ScenarioError as error:
            assert "nested" in str(error)
    assert time.process_time() - start < 10.0


def test_the_deepest_mapping_that_a_scenario_may_hold_is_still_read():
    text = "{a: " * (values.MAX_DEPTH + 1) + "{b: 1}" + "}" * (values.MAX_DEPTH + 1)
    with pytest.raises(ScenarioError, match="MAX_DEPTH"):
        loading.parse_yaml(text, "deep")
    text = "{a: " * (values.MAX_DEPTH - 1) + "{b: 1}" + "}" * (values.MAX_DEPTH - 1)
    assert loading.parse_yaml(text, "deep")["a"]["a"]
