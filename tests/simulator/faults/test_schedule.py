"""What is drawn for one flight: chances, times, victims, and what is refused."""

import numpy as np
import pytest
from scipy.stats import kstest

from swarm_mj.errors import ScenarioError
from swarm_mj.flight.plan import make_plan
from swarm_mj.scenarios.loading import load_scenario, parse_overrides
from swarm_mj.scenarios.schema import Scenario
from swarm_mj.simulator.faults.schedule import RELAY, draw_schedule


def drawn(*faults, seed=0, n=5):
    checked = Scenario.model_validate({"name": "x", "faults": list(faults)})
    return draw_schedule(checked.faults, seed, n=n, n_wheels=4, duration_s=1000.0)


def test_chances_and_times_are_as_given():
    lost = {"kind": "spacecraft_lost", "spacecraft": "all", "probability": 0.1}
    found = [entry for seed in range(400) for entry in drawn(lost, seed=seed)]
    assert len(found) / 2000 == pytest.approx(0.1, abs=0.02)
    assert kstest([entry.time_s / 1000 for entry in found], "uniform").pvalue > 1e-3
    late = drawn({**lost, "probability": 1.0, "between_s": [200, 300]})
    assert len(late) == 5
    assert all(200 <= entry.time_s <= 300 for entry in late)
    assert [entry.time_s for entry in late] == sorted(entry.time_s for entry in late)


def test_any_is_one_spacecraft_and_one_wheel_each_as_often_as_the_others():
    found = [drawn({"kind": "wheel_lost", "spacecraft": "any", "wheel": "any"}, seed=k) for k in range(1000)]
    assert all(len(entries) == 1 for entries in found)
    for counts in (
        np.bincount([e[0].spacecraft for e in found], minlength=5) * 5,
        np.bincount([e[0].wheels[0] for e in found], minlength=4) * 4,
    ):
        assert counts / 1000 == pytest.approx(1.0, abs=0.2)
    (every,) = drawn({"kind": "wheel_lost", "spacecraft": "sc2", "wheel": "all", "at_s": 5})
    assert every.wheels == (0, 1, 2, 3)


def test_another_fault_at_the_end_of_the_list_and_another_chance_move_nothing():
    first = {"kind": "spacecraft_lost", "spacecraft": "all", "probability": 0.5}
    more = {"kind": "camera_off", "spacecraft": "all"}
    plain, longer = drawn(first), drawn(first, more)
    assert [e for e in longer if e.fault.kind == "spacecraft_lost"] == list(plain)
    likely = drawn({**first, "probability": 0.9})
    times = {e.spacecraft: e.time_s for e in likely}
    assert all(times[e.spacecraft] == e.time_s for e in plain)


def test_the_relay_is_found_when_the_time_has_come():
    (entry,) = drawn({"kind": "communications_lost", "at_s": 7})
    assert (entry.spacecraft, entry.time_s) == (RELAY, 7)


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        ("{kind: camera_off, spacecraft: sc3, at_s: 0}", ["faults.0.spacecraft = sc3", "sc1 to sc2"]),
        ("{kind: wheel_lost, spacecraft: sc1, wheel: 4, at_s: 0}", ["faults.0.wheel = 4", "1 to 3"]),
        ("{kind: camera_off, spacecraft: sc1, at_s: 5000}", ["faults.0", "5000", "duration_s = 1200"]),
        ("{kind: camera_off, spacecraft: sc1, between_s: [0, 1201]}", ["faults.0", "1201"]),
    ],
)
def test_a_fault_that_cannot_happen_to_this_swarm_is_refused(fault, words):
    with pytest.raises(ScenarioError) as error:
        make_plan(load_scenario("eros-quick", parse_overrides([f"faults=[{fault}]"])))
    for word in words:
        assert word in str(error.value)


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        ("{kind: wheel_lst, spacecraft: sc1}", ["faults.0", "wheel_lst", "wheel_lost"]),
        ("{kind: camera_off, spacecraft: 7, at_s: 1}", ["spacecraft", "7"]),
        ("{kind: camera_off, spacecraft: sc1, at: 1}", ["at", "unknown key", "Did you mean 'at_s'", "duration_s"]),
        ("{kind: camera_off, spacecraft: sc1, at_s: 1, between_s: [1, 2]}", ["at_s", "not both"]),
        ("{kind: camera_off, spacecraft: sc1, between_s: [2, 1]}", ["between_s", "earlier first"]),
        ("{kind: camera_off, spacecraft: sc1, probability: 1.5}", ["probability", "1.5"]),
        ("{kind: wheel_weakened, spacecraft: sc1, wheel: 0, at_s: 1}", ["wheel", "0"]),
    ],
)
def test_a_malformed_fault_is_refused_with_its_key(fault, words):
    with pytest.raises(ScenarioError) as error:
        load_scenario("eros-quick", parse_overrides([f"faults=[{fault}]"]))
    for word in words:
        assert word in str(error.value)


def test_a_design_counts_on_what_is_planned_and_does_not_mind_the_faults():
    from swarm_mj.designer.candidates.flights import fly_candidates

    flights = fly_candidates(load_scenario("eros-faults", {"dispersions.target_m": 300}))
    plain = fly_candidates(load_scenario("eros-faults", {"faults": [], "dispersions": {}}))
    assert np.array_equal(flights.r_A, plain.r_A)
    assert np.array_equal(flights.plan.region.area, plain.plan.region.area)


def test_the_page_on_faults_lists_every_kind_of_fault_with_its_defaults_and_every_dispersion():
    from pathlib import Path

    from swarm_mj.scenarios.schema_faults import FAULT_KINDS, Dispersions

    page = (Path(__file__).parents[3] / "docs" / "how-to" / "faults.md").read_text("utf-8")
    rows = {line.split("`")[1]: line for line in page.splitlines() if line.startswith("| `")}
    common = {"kind", "spacecraft", "wheel", "at_s", "between_s", "probability", "duration_s", "detection_s"}
    for kind, model in FAULT_KINDS.items():
        for key, field in model.model_fields.items():
            assert key in common or key in rows[kind], (kind, key)
            if key == "duration_s" and field.default is not None:
                assert f"`duration_s` {field.default:g}" in rows[kind]
            elif isinstance(field.default, float) and key not in common:
                assert float(rows[kind].split(f"`{key}` ")[1].split()[0].strip(",")) == field.default, (kind, key)
    assert all(f"`{key}`" in page for key in Dispersions.model_fields)
