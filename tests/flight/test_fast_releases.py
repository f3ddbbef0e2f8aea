"""Releases beyond the deployer: told with numbers, and what is said to be enough is."""

import re

import numpy as np
import pytest

import swarm_mj as sm
from swarm_mj.flight.fast_releases import release_findings
from swarm_mj.flight.plan import make_plan
from swarm_mj.records.run_record import read_run
from swarm_mj.reports.page import report_html
from swarm_mj.scenarios.loading import load_scenario, parse_overrides

LONGER, BURN = "begin earlier and fly longer", "fly insertion burns"
#: Motherships whose velocity is that of the swarm, of a hyperbola, and given.
MISSIONS = {
    "mean": ("eros-config1", {}),
    "hyperbola": ("eros-approach", {}),
    "flyby": ("eros-quick", {"mothership.velocity": [20.0, 10.0, 50.0]}),
}


def plan_of(name, overrides):
    return make_plan(load_scenario(name, overrides), check_separation=False)


def said(plan, remedy):
    """The overrides that the finding of a plan names as a remedy."""
    (words,) = release_findings(plan)
    named = re.search(rf"{remedy} \((.*?)\)(, or|$)", words)[1]
    return parse_overrides([f"{key}={value}" for key, value in re.findall(r"([\w.]+) = (\[.*?\]|[^\s,]+)", named)])


def test_who_is_not_beyond_the_deployer_or_may_leave_at_any_speed_is_not_told():
    assert release_findings(plan_of("bennu-slow", {})) == []
    assert release_findings(plan_of("eros-config1", {"mothership.deployer.max_speed_m_s": None})) == []


@pytest.mark.parametrize("mission", MISSIONS)
def test_the_longer_flights_that_are_named_need_no_more_than_the_deployer_gives_and_visit_at_the_same_instants(mission):
    name, overrides = MISSIONS[mission]
    plan = plan_of(name, overrides)
    assert (plan.deployment.delta_v > 2.0).any() and "beyond mothership.deployer.max_speed_m_s = 2" in release_findings(
        plan
    )[0]
    longer = plan_of(name, {**overrides, **said(plan, LONGER)})
    assert longer.deployment.delta_v.max() <= 2.0
    arrivals = [
        np.datetime64(p.scenario.epoch) + np.timedelta64(round(p.deployment.arrival_s[0]), "s") for p in (plan, longer)
    ]
    assert arrivals[0] == arrivals[1]
    # So the body is turned alike, and points are where they were.
    assert longer.deployment.destination_N == pytest.approx(plan.deployment.destination_N, abs=1.0)


def test_away_from_all_forces_speed_falls_as_the_time_grows():
    far = {"mothership.position_A_m": [0, 0, -40e3], "mothership.velocity": "rest", "body.gravity": {
        "model": "spherical_harmonics",
        "parameters": {"gm": 1e-3, "reference_radius_m": 16e3, "coefficients": [[0, 0, 1.0, 0.0]]},
    }}  # fmt: skip
    plan = plan_of("eros-quick", far)
    ways = np.linalg.norm(plan.points_A - [0.0, 0.0, -40e3], axis=1)
    assert plan.deployment.delta_v == pytest.approx(ways / 600.0, rel=1e-3)
    # A hundredth more than the straight line needs, in whole samples of 5 s.
    assert said(plan, LONGER)["design.time_of_flight_s"] == pytest.approx(1.01 * ways.max() / 2.0, abs=6.0)


@pytest.mark.parametrize("name", ["eros-config1", "itokawa-slow"])
def test_the_thrusters_that_are_named_fly_insertion_burns_of_all_that_is_missing(name):
    overrides = {"mothership.deployer.max_speed_m_s": 2.0 if name == "eros-config1" else 0.3}
    plan = plan_of(name, overrides)
    burning = plan_of(name, {**overrides, "spacecraft.thrusters": {}, **said(plan, BURN)})
    slow = overrides["mothership.deployer.max_speed_m_s"]
    assert burning.deployment.delta_v.max() == pytest.approx(slow)
    assert len(burning.deployment.burns) == (plan.deployment.delta_v > slow).sum()
    assert release_findings(burning) == []


def test_corrections_beside_which_no_burns_are_flown_are_named():
    overrides = {"spacecraft.thrusters": {}, "trajectory.corrections": [{"before_arrival_s": 60}]}
    (words,) = release_findings(plan_of("eros-quick", overrides))
    assert "leave out trajectory.corrections" in words and BURN not in words


def test_summary_table_and_report_of_a_flight_say_so(tmp_path):
    quick = {"duration_s": 600, "physics.stepper": "kernel", "observation.interval_s": 600, "camera.resolution_px": 64}
    flight = sm.fly("eros-quick", quick, out=tmp_path / "run", figures=False, report=False)
    (words,) = flight.summary["deployment_findings"]
    assert words in flight.findings and words in sm.open(tmp_path / "run").findings
    assert "leave at up to 4.48 m/s" in report_html([read_run(tmp_path / "run")])
    # With the thrusters that are named the flight arrives, and no tank runs empty.
    burnt = sm.fly("eros-quick", {**quick, "spacecraft.thrusters": {}, **said(flight.plan, BURN)})
    assert (
        max(burnt.summary["arrival_miss_mm"].values()) < 5e3 and min(burnt.summary["propellant_left_kg"].values()) > 0.0
    )
    assert not burnt.summary["deployment_findings"]
