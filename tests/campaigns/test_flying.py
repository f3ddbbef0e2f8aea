"""One run of a campaign: its row, a failing run, a kept plan that changes no bit, and what may be recorded."""

import json
import math
import time
from concurrent.futures import ThreadPoolExecutor
from functools import partial

import pytest

from swarm_mj.campaigns import flying
from swarm_mj.campaigns.config import FIXED_COLUMNS
from swarm_mj.campaigns.flying import Flyer
from swarm_mj.campaigns.loading import load_campaign
from swarm_mj.campaigns.runner import replay
from swarm_mj.campaigns.store import schema_of, table_of
from swarm_mj.campaigns.summary import summarise_campaign
from swarm_mj.errors import ScenarioError

#: Values below 1 km put the mothership inside the body.
INTO_THE_BODY = """
parameters:
  mothership.position_A_m.2: {distribution: choice, values: [-500.0, -30000.0]}
"""


def without_time(row):
    return {key: value for key, value in row.items() if key != "wall_s"}


def test_the_same_row_is_the_same_whether_the_plan_is_fresh_or_kept(write):
    resolved = load_campaign(write(runs=3))
    kept = Flyer(resolved)
    rows = [without_time(kept.fly(row)) for row in (0, 1, 2, 1)]
    assert rows[1] == rows[3]
    assert rows[2] == without_time(Flyer(resolved).fly(2))
    assert rows[0]["pointing_error_deg_arrival_max"] != rows[1]["pointing_error_deg_arrival_max"]


def test_a_kept_plan_serves_other_faults_and_still_refuses_those_that_cannot_happen(write, monkeypatch):
    made, make = [], flying.make_plan
    monkeypatch.setattr(flying, "make_plan", lambda scenario: made.append(1) or make(scenario))
    lost = [[{"kind": "spacecraft_lost", "spacecraft": f"sc{k}", "at_s": 100}] for k in (1, 2, 99)]
    more = f"parameters: {{faults: {{distribution: choice, values: {json.dumps(lost)}}}}}"
    flyer = Flyer(load_campaign(write(runs=5, more=more)))
    rows = [flyer.fly(row) for row in range(5)]
    assert len(made) == 1
    for row in rows:
        impossible = "sc99" in json.dumps(flyer.sample.trial(row["row"]).values)
        assert (row["status"] == "failed") == impossible, row["error"]
    assert {row["status"] for row in rows} == {"ok", "failed"}


def test_a_row_agrees_with_the_flight_of_its_own_scenario(write):
    from swarm_mj.flight.fly import simulate
    from swarm_mj.flight.observe import observe_flight
    from swarm_mj.flight.plan import make_plan
    from swarm_mj.records.summary import summarise

    flyer = Flyer(load_campaign(write(runs=2)))
    row = flyer.fly(1)
    plan = make_plan(flyer.scenario(flyer.sample.trial(1)))
    telemetry = simulate(plan)
    summary = summarise(plan, telemetry, observe_flight(plan, telemetry), {})
    assert row["status"] == "ok" and row["seed"] == summary["seed"]
    assert row["coverage_percent"] == summary["coverage_percent"]
    assert row["max_wheel_speed_fraction"] == summary["max_wheel_speed_fraction"]
    assert row["pointing_error_deg_final_max"] == max(summary["pointing_error_deg_final"].values())
    assert row["link_closed_percent_mean"] == pytest.approx(sum(summary["link_closed_percent"].values()) / plan.n)
    assert row["covered"] == (100.0 - summary["coverage_percent"] <= 0.1)
    error = telemetry["pointing_error"].values[60]  # 600 s, every 10 s
    assert row["pointing_error_deg_arrival_max"] == math.degrees(error.max())


def test_a_run_that_fails_is_a_row_with_its_error_and_seed(write):
    flyer = Flyer(load_campaign(write(runs=12, more=INTO_THE_BODY)))
    trials = [flyer.sample.trial(row) for row in range(12)]
    bad = next(t for t in trials if t.values["mothership.position_A_m.2"] == -500.0)
    row = flyer.fly(bad.row)
    assert row["status"] == "failed" and row["seed"] == bad.seed
    assert row["error"].startswith("ScenarioError: mothership.position_A_m = [0.0, 0.0, -500.0]: lies inside")
    assert "coverage_percent" not in row


def test_a_replayed_failure_leaves_its_scenario_and_traceback(write, tmp_path):
    resolved = load_campaign(write(runs=12, more=INTO_THE_BODY))
    flyer = Flyer(resolved)
    bad = next(r for r in range(12) if flyer.sample.trial(r).values["mothership.position_A_m.2"] == -500.0)
    assert replay(resolved, bad, tmp_path / "out").differs is None
    kept = tmp_path / "out" / "replays" / str(bad)
    assert "lies inside" in (kept / "error.txt").read_text()
    assert f"seed: {flyer.sample.trial(bad).seed}" in (kept / "scenario.yaml").read_text()


def test_a_row_that_is_not_there_cannot_be_replayed(write, tmp_path):
    with pytest.raises(ScenarioError, match="--replay 4: must be a row of this campaign, 0 to 3"):
        replay(load_campaign(write()), 4, tmp_path / "out")


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("coverage", "record: coverage: is not recorded; there are"),
        ("link_closed_percent", "needs one of max, min, mean, sum or a spacecraft"),
        ("coverage_percent.max", "needs no part"),
        ("link_closed_percent.sc9", "needs one of"),
        ("observer", "record: observer: is 'raycast', no number"),
        ("observer.max", "needs no part"),
        ("versions.python", "record: versions.python: is '3.*, no number"),
        ("versions.max", "record: versions.max: is '.*, no number"),
    ],
)
def test_what_cannot_be_recorded_ends_the_campaign_with_words(write, name, words):
    with pytest.raises(ScenarioError, match=words):
        Flyer(load_campaign(write(more=f"record: [{name}]"))).fly(0)


def test_a_spacecraft_without_a_number_in_a_run_has_none_there(write):
    names = "pointing_error_deg_final.sc2, pointing_error_deg_final.sc1, pointing_error_deg_before_switch.sc2"
    lost = f"""
    record: [{names}]
    parameters: {{faults: {{distribution: choice, values: [[{{kind: spacecraft_lost, spacecraft: sc2, at_s: 100}}]]}}}}
    """
    row = Flyer(load_campaign(write(runs=1, more=lost))).fly(0)
    assert row["status"] == "ok", row["error"]
    assert row["pointing_error_deg_final_sc2"] is None and row["pointing_error_deg_before_switch_sc2"] is None
    assert 0.0 <= row["pointing_error_deg_final_sc1"] < 180.0


def test_what_has_a_column_already_is_not_recorded_twice(write):
    taken = "[seed, spacecraft, covered, scenario, events, wall_s, duration_s, images]"
    more = f"record: {taken}\nparameters: {{duration_s: {{distribution: choice, values: [1200, 1300]}}}}"
    resolved = load_campaign(write(runs=2, more=more))
    flyer, schema = Flyer(resolved), schema_of(resolved.campaign)
    table = table_of([flyer.fly(row) for row in range(2)], schema)
    assert schema.names == [*FIXED_COLUMNS[:4], "duration_s", *FIXED_COLUMNS[4:8], "images", *FIXED_COLUMNS[8:]]
    assert table["seed"].to_pylist() == [flyer.sample.trial(row).seed for row in range(2)]
    assert summarise_campaign(resolved, table)["scenarios"]["eros-quick"]["outcomes"].keys() == {"images"}


def test_threads_that_begin_together_share_one_flyer(write, monkeypatch):
    made = []

    class Slow(Flyer):
        def __init__(self, *arguments):
            made.append(arguments)
            time.sleep(0.3)
            super().__init__(*arguments)

        def fly(self, row):
            return {"row": row}

    monkeypatch.setattr(flying, "Flyer", Slow)
    text = load_campaign(write(runs=977)).dumps()
    with ThreadPoolExecutor(2) as threads:
        assert list(threads.map(partial(flying.fly_row, text, None), range(2))) == [{"row": 0}, {"row": 1}]
    assert len(made) == 1


def test_spacecraft_and_lists_can_be_recorded(write):
    record = "record: [link_closed_percent.sc2, near_collisions, mode_switches.sc1, target_area_km2]"
    row = Flyer(load_campaign(write(more=record))).fly(0)
    assert row["near_collisions"] == 0.0 and 0.0 <= row["link_closed_percent_sc2"] <= 100.0
    assert row["target_area_km2"] > 1.0 and row["mode_switches_sc1"] >= 1.0
    json.dumps(row, allow_nan=False)
