"""The comparison of swarm classes: the same encounters for all, and numbers that follow from the rows by hand."""

from types import SimpleNamespace

import numpy as np
import pyarrow as pa
import pytest

from swarm_mj.campaigns.classes import (
    _common,
    _formed_s,
    class_results,
    classes_campaign,
    recovery,
    table_by_lost,
    table_of_classes,
)
from swarm_mj.campaigns.flying import Flyer
from swarm_mj.campaigns.loading import resolve
from swarm_mj.campaigns.sampling import Sample
from swarm_mj.cli.main import main
from swarm_mj.designer.robust_points import most_shown
from swarm_mj.errors import ScenarioError
from swarm_mj.scenarios.loading import load_scenario, parse_overrides


def test_every_class_flies_the_same_encounters_with_the_same_losses():
    resolved = classes_campaign(load_scenario("eros-observe"), runs=4, places=(6, 13, 18, 33, 45))
    sample, flyer = Sample(resolved.campaign), Flyer(resolved)
    trials = [sample.trial(row) for row in range(sample.rows)]
    for run in range(4):
        same = [trial for trial in trials if trial.run == run]
        assert len({trial.seed for trial in same}) == 1
        assert len({trial.values["faults.0.probability"] for trial in same}) == 1
    assert len({trial.seed for trial in trials}) == 4
    scenarios = {trial.scenario: flyer.scenario(trial) for trial in trials}
    assert [scenarios[f"class {k}"].swarm.level for k in range(5)] == [0, 1, 2, 3, 4]
    for level in (0, 3, 4):
        assert scenarios[f"class {level} placed"].design.visiting_points == (6, 13, 18, 33, 45)
    holding = [name for name, scenario in scenarios.items() if scenario.swarm.formation is not None]
    assert holding == ["class 1"] and scenarios["class 1"].spacecraft.thrusters is not None
    assert {scenario.physics.stepper for scenario in scenarios.values()} == {"kernel"}


def test_a_formation_begins_when_all_have_left_and_before_a_short_flight_is_over():
    late = {"design.release_s": 100, "design.observers": [{}, {"release_s": 130}, {}, {}, {}]}
    changed = load_scenario("eros-observe", parse_overrides([f"{key}={value}" for key, value in late.items()]))
    short = load_scenario("eros-observe", {"design.time_of_flight_s": 150})
    for base, start in (
        (load_scenario("eros-observe"), 60.0),
        (load_scenario("fast-flyby"), 60.0),
        (changed, 130.0),
        (short, 15.0),
    ):
        assert _formed_s(base) == start


def test_a_spacecraft_that_the_quick_stepper_cannot_fly_is_flown_by_another():
    plain, four = (
        load_scenario("eros-observe", parse_overrides(more)) for more in ([], ["spacecraft.wheel_layout=pyramid"])
    )
    assert "physics.stepper" in _common(plain) and "physics.stepper" not in _common(four)


def test_class_1_flies_uses_propellant_and_talks_and_class_0_does_not():
    lost = {"kind": "spacecraft_lost", "spacecraft": "sc5", "probability": 0.0, "between_s": [0, 50]}
    settings = {"duration_s": 70, "design.time_of_flight_s": 60, "target.cell_size_m": 900, "faults": [lost]}
    flyer = Flyer(classes_campaign(load_scenario("eros-observe"), runs=1, overrides=settings))
    rows = {flyer.sample.trial(row).scenario: flyer.fly(row) for row in range(2)}
    one, none = rows["class 1"], rows["class 0"]
    assert one["status"] == none["status"] == "ok", (one["error"], none["error"])
    assert one["thrust_delta_v_m_s_sum"] > 0.0 and one["formation_bits"] > 0
    assert none["thrust_delta_v_m_s_sum"] is None and none["formation_bits"] == 0


def test_without_pairs_no_two_flights_have_one_seed_and_saltelli_cannot_pair():
    data = {"name": "c", "runs": 3, "scenarios": [{"scenario": "eros-quick"}, {"name": "b", "scenario": "eros-quick"}]}
    sample = Sample(resolve(data, "test").campaign)
    assert len({sample.trial(row).seed for row in range(6)}) == 6
    wrong = {**data, "runs": 4, "method": "saltelli", "paired": True}
    wrong["parameters"] = {"camera.half_angle_deg": {"distribution": "uniform", "low": 3, "high": 4}}
    with pytest.raises(ScenarioError, match="paired"):
        resolve(wrong, "test")


def rows():
    """Class 3 sees 80 whole and 50 and 70 with one loss; class 4 90, 75 and 70."""
    found = []
    for name, seen in (("class 3", (80.0, 50.0, 70.0, 20.0)), ("class 4", (90.0, 75.0, 70.0, 60.0))):
        for run, (percent, lost) in enumerate(zip(seen, (0, 1, 1, 2), strict=True)):
            found.append(
                {
                    "scenario": name,
                    "run": run,
                    "status": "ok",
                    "lost": float(lost),
                    "coverage_percent": percent,
                    "delivered_percent": percent - 1.0,
                    "covered": percent == 90.0,
                    "time_to_all_data_s": 7200.0 if lost == 0 else None,
                    "coordination_bits": 2e6 if name == "class 4" else 0.0,
                    "deployment_delta_v_m_s_sum": 35.0,
                    "thrust_delta_v_m_s_sum": None if name == "class 3" else 2.0 * run,
                    "formation_bits": 1e6,
                }
            )
    return pa.Table.from_pylist(found)


def test_what_is_recovered_follows_from_the_pairs_with_one_loss():
    found = recovery(rows(), "class 3", "class 4")
    assert found.flights == 2
    assert found.lost.value == pytest.approx(80.0 - 60.0)
    assert found.kept.value == pytest.approx((25.0 + 0.0) / 2)
    assert found.other_lost.value == pytest.approx(90.0 - 72.5)
    assert found.share == pytest.approx(12.5 / 20.0)
    assert np.isnan(recovery(rows().slice(0, 1), "class 3", "class 4").share)


def test_results_are_the_means_of_the_rows():
    three, four = class_results(rows())
    assert (three.name, four.name) == ("3", "4")
    assert three.seen.value == 55.0 and three.delivered.value == 54.0
    assert four.whole.value == 0.25 and four.map_h == 2.0 and four.message_bit == 3e6
    assert four.thrust_m_s == 3.0 and np.isnan(three.thrust_m_s)
    assert {k: v.value for k, v in four.by_lost.items()} == {0: 89.0, 1: 71.5, 2: 59.0}
    assert "| 4 | replanned in flight over the links | 73.8" in table_of_classes([three, four])
    assert "| 35.0 | 3.00 | 3.0 | 2.00 |" in table_of_classes([four]) and "| 35.0 | - | 1.0 |" in table_of_classes(
        [three]
    )
    assert "| 3 | 79.0 | 59.0 | 19.0 |" in table_by_lost([three, four])


def test_without_bars_the_tables_are_shown_all_the_same(monkeypatch, capsys, tmp_path):
    compared = SimpleNamespace(classes=class_results(rows()))
    monkeypatch.setattr("swarm_mj.api.campaign.compare_classes", lambda *_, **__: compared)
    assert main(["compare-classes", "eros-observe", "--quiet", "--out", str(tmp_path)]) == 0
    assert table_by_lost(compared.classes) in capsys.readouterr().out


def test_a_class_that_never_flew_is_told():
    failed = rows().to_pylist()[:4]
    with pytest.raises(ScenarioError, match="no flight succeeded; the first ended with: it broke"):
        class_results(pa.Table.from_pylist([{**row, "status": "failed", "error": "it broke"} for row in failed]))


def test_places_are_chosen_so_that_two_can_show_each_part():
    shown = np.array([[1, 1, 1, 0], [1, 1, 1, 0], [1, 1, 1, 0], [0, 0, 1, 1]], bool)
    area = np.array([1.0, 1.0, 1.0, 1.5])
    assert most_shown(shown, area, 3) == [0, 1, 3]  # a third look at the same adds nothing
    best = max(
        (sum(area[q] * min(2, sum(shown[j, q] for j in chosen)) for q in range(4)), chosen)
        for chosen in ((0, 1, 2), (0, 1, 3), (0, 2, 3), (1, 2, 3))
    )
    assert best[0] == sum(area[q] * min(2, shown[[0, 1, 3], q].sum()) for q in range(4))
