"""Remarks: on pointing that should have settled, on pictures that could not be taken, on values taken from Eros."""

from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest

from swarm_mj.flight.fly import simulate
from swarm_mj.flight.observe import picture_count
from swarm_mj.flight.plan import make_plan
from swarm_mj.mission.behaviors import TargetKind, Targets
from swarm_mj.records.findings import (
    borrowed_findings,
    direction_findings,
    imaging_findings,
    near_collision_findings,
    summary_findings,
)
from swarm_mj.records.modes import held_s
from swarm_mj.records.observed import causes_text, observed_findings
from swarm_mj.scenarios.loading import load_scenario, parse_overrides, scenario_from

SWEEP = ["behavior={name: target_sweep, parameters: {surface_radius_m: 7000, dwell_s: 50}}", "duration_s=1000"]


@pytest.fixture(scope="module")
def swept():
    """Two spacecraft that look at one part of the target after another, 50 s each, and then talk to Earth."""
    return simulate(make_plan(load_scenario("eros-quick", parse_overrides(SWEEP))))


def test_a_target_is_held_since_it_was_chosen_though_its_kind_stays_the_same(swept):
    held, times = held_s(swept), swept["time"].values
    assert (swept["mode"].values == 3).any() and (swept["mode"].values == 2).any()
    looking = swept["mode"].values == 3
    expected = np.broadcast_to((times % 50.0)[:, None], held.shape)
    assert np.array_equal(held[looking], expected[looking])
    for j in range(2):
        first = np.flatnonzero(~looking[:, j])[0]
        stays = swept["mode"].values[first:, j] == swept["mode"].values[first, j]
        assert np.allclose(held[first:, j][stays], times[first:][stays] - times[first])


def test_a_direction_is_held_until_another_is_given(swept):
    telemetry = swept.copy(deep=True)
    telemetry["mode"].values[:] = 4
    telemetry["line_of_sight_N"].values[:] = (0.0, 0.0, 1.0)
    telemetry["line_of_sight_N"].values[60:] = (0.0, 1e-3, 1.0)
    held = held_s(telemetry)
    assert held[59, 0] == telemetry["time"].values[59] and held[60, 0] == 0.0


def summary(error_deg, held_s, **more):
    switch = {"error_before_deg": error_deg, "target_held_s": held_s}
    return {
        "pointing_error_deg_final": {"sc1": 1e-6, "sc2": error_deg},
        "target_held_s_final": {"sc1": 500.0, "sc2": held_s},
        "mode_switches": {"sc1": [switch], "sc2": []},
        "wheel_saturation_s": {"sc1": 0.0, "sc2": 0.0},
        "spacecraft": 2,
        **more,
    }


def test_pointing_that_had_time_and_did_not_settle_is_told_from_targets_that_were_switched_soon():
    assert summary_findings(summary(1.5, 300.0)) == [
        "pointing had not settled at the end: sc2, up to 1.5 deg",
        "pointing had not settled before a switch: sc1, up to 1.5 deg",
    ]
    assert summary_findings(summary(1.5, 30.0)) == [
        "the flight ended less than 120 s after a target was chosen, while still turning: sc2, up to 1.5 deg",
        "targets were switched again less than 120 s after a target was chosen, while still turning: sc1, up to 1.5 deg",
    ]
    assert summary_findings(summary(0.01, 30.0)) == []
    assert summary_findings(summary(0.01, 30.0, encounter_findings=["too fast"])) == ["too fast"]
    assert len(summary_findings(summary(1.5, 300.0, lost=["sc1", "sc2"]))) == 0


def test_of_many_near_collisions_the_nearest_are_told_and_the_rest_counted():
    pairs = [{"spacecraft": ["sc1", f"sc{k}"], "time_s": 60.0, "distance_m": 30.0 - k} for k in range(2, 27)]
    told = near_collision_findings({"near_collisions": pairs})
    assert told[0] == "near-collision of sc1 and sc26, 4.0 m at t = 60 s" and len(told) == 11
    assert told[-1] == "and 15 more near-collisions, see summary.json"
    assert len(near_collision_findings({"near_collisions": pairs[:10]})) == 10


def test_a_summary_of_an_earlier_version_tells_nothing_of_targets_and_is_read():
    old = summary(1.5, 300.0)
    del old["target_held_s_final"], old["mode_switches"]["sc1"][0]["target_held_s"]
    assert len(summary_findings(old)) == 2


def flown(images, **distances_km):
    return {"least_distance_to_centre_km": distances_km, "observers": 2, "images": images}


def test_an_imaging_radius_below_the_closest_approach_is_told_with_both_numbers():
    scenario = load_scenario("eros-quick", {"behavior.imaging_radius_m": 9000})
    assert imaging_findings(scenario, flown(0, sc1=15.63, sc2=16.2, sc3=5.0)) == [
        "no picture was taken: no observer ever came inside behavior.imaging_radius_m = 9 km of the body's centre; "
        "the closest approach was 15.63 km"
    ]
    assert imaging_findings(scenario, flown(7, sc1=15.63, sc2=8.0)) == [
        "sc1 never came inside behavior.imaging_radius_m = 9 km of the body's centre; the closest approach was 15.63 km"
    ]
    assert imaging_findings(scenario, flown(7, sc1=8.9, sc2=8.0, sc3=20.0)) == []


def test_what_a_body_of_its_own_takes_from_eros_is_told_key_by_key():
    own, epoch = "body.shape=mine.obj", "epoch=2030-01-01T00:00:00"
    (remark,) = borrowed_findings(load_scenario("eros-quick", parse_overrides([own])))
    assert "mine.obj" in remark and "body.rotation (pole and spin), body.orbit (where" in remark and "epoch" in remark
    spinning = [own, epoch, "body.rotation={pole_ra_deg: 0, pole_dec_deg: 90, w0_deg: 0, w_rate_deg_per_day: 4000}"]
    (remark,) = borrowed_findings(load_scenario("eros-quick", parse_overrides(spinning)))
    assert "body.orbit (" in remark and "rotation" not in remark and "epoch" not in remark
    (remark,) = borrowed_findings(
        load_scenario("eros-quick", parse_overrides([own, epoch, "body.rotation.w_rate_deg_per_day=4000"]))
    )
    assert "body.rotation.pole_ra_deg" in remark and "w_rate" not in remark
    orbit = "body.orbit={semi_major_axis_au: 2, eccentricity: 0.1, inclination_deg: 3, node_deg: 4, " \
            "argument_of_perihelion_deg: 5, perihelion_jd: 2450000}"  # fmt: skip
    assert borrowed_findings(load_scenario("eros-quick", parse_overrides([*spinning, orbit]))) == []
    assert borrowed_findings(load_scenario("eros-quick")) == []


def test_a_scenario_that_a_run_wrote_tells_the_same():
    scenario = load_scenario("eros-quick", {"body.shape": "mine.obj"})
    assert borrowed_findings(scenario_from(scenario.model_dump(mode="json"))) == borrowed_findings(scenario) != []


@dataclass
class Starers:
    """The first observer looks at a direction for 300 s and then at the body's centre, as the second does all the time."""

    dedicated_communications = False

    def targets(self, view, memory):
        kind = np.array([TargetKind.DIRECTION if view.t < 300.0 else TargetKind.ASTEROID, TargetKind.ASTEROID])
        return Targets(kind, np.zeros(2, int), np.tile([0.0, 0.0, 1.0], (2, 1))), memory


def test_an_observer_that_is_told_a_direction_takes_no_pictures_and_that_is_said():
    plan = make_plan(load_scenario("eros-quick", {"observation.interval_s": 10, "duration_s": 600}))
    told = replace(plan, behavior=Starers())
    telemetry = simulate(told)
    assert picture_count(told, telemetry) == 2 * 61 - 30
    run = SimpleNamespace(scenario=told.scenario, telemetry=telemetry, n_observers=2)
    (remark,) = direction_findings(run)
    assert remark.startswith("1 of 2 observers took no picture at 30 of 122 due") and "answer SURFACE" in remark
    telemetry["mode"].values[:] = TargetKind.ASTEROID
    assert direction_findings(run) == []


def test_what_is_not_observed_is_rounded_up_so_that_with_what_is_observed_it_is_all():
    parts = [
        {"cause": "dark", "percent": 2.6824, "remedy": "wait"},
        {"cause": "hidden", "percent": 1.2e-5, "remedy": "wait"},
    ]
    assert causes_text({"not_observed": parts}) == "2.69 % dark, 0.01 % hidden"
    assert [told.split(" of")[0] for told in observed_findings({"not_observed": parts})] == ["2.69 %", "0.01 %"]
