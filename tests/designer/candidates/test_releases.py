"""Releases as choices of a design: each sees what a mission of that release sees, and light that comes later is used."""

import re

import numpy as np
import pytest

import swarm_mj as sm
from swarm_mj.designer.candidates.flights import at_points, fly_candidates
from swarm_mj.designer.candidates.pictures import Watcher, picture_numbers
from swarm_mj.designer.candidates.visibility import flight_variants, visibility
from swarm_mj.errors import MissionError
from swarm_mj.flight.fly import simulate
from swarm_mj.flight.observe import picture_count
from swarm_mj.flight.plan import make_plan
from swarm_mj.scenarios.loading import load_scenario

#: A ball that turns in 20 min below a mothership that is at rest above its pole; the target is dark at the first arrival.
DATA = {
    "name": "waiting",
    "duration_s": 1000,
    "body": {
        "name": "Ball",
        "shape": "ellipsoid",
        "semi_axes_m": [7e3, 7e3, 6e3],
        "gravity": {
            "model": "spherical_harmonics",
            "parameters": {"gm": 4e5, "reference_radius_m": 7e3, "coefficients": [[0, 0, 1.0, 0.0]]},
        },
        "rotation": {"w_rate_deg_per_day": 360.0 * 72.0},
    },
    "target": {"longitude_deg": -120, "half_angle_deg": 12},
    "design": {"imaging_altitude_m": 12e3, "time_of_flight_s": 300},
    "mothership": {"position_A_m": [0, 0, -25e3], "velocity": "rest"},
    "behavior": {"name": "adaptable_roles"},
    "camera": {"half_angle_deg": 12, "resolution_px": 64},
    "observation": {"observer": "horizon", "interval_s": 50, "criterion": "arrival"},
    "designer": {"max_generations": 2},
    "telemetry": {"interval_s": 10},
    "physics": {"stepper": "kernel"},
}
LATER = {"designer.releases_s": [0, 200, 500]}


def scenario(**overrides):
    return load_scenario(DATA, {key.replace("__", "."): value for key, value in overrides.items()})


@pytest.fixture(scope="module", autouse=True)
def own_cache(tmp_path_factory):
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("SWARM_MJ_CACHE", str(tmp_path_factory.mktemp("cache")))
        yield


@pytest.fixture(scope="module")
def seen():
    return visibility(load_scenario(DATA, LATER))


def test_a_choice_sees_what_a_mission_with_that_release_sees(seen):
    release = np.array([candidate.release_s for candidate in seen.candidates])
    for when in LATER["designer.releases_s"]:
        alone = visibility(scenario(design__release_s=when))
        assert np.array_equal(alone.sees, seen.sees[release == when])
        assert alone.point_A == pytest.approx(seen.point_A[release == when])
        assert alone.delta_v == pytest.approx(seen.delta_v[release == when])
    assert not seen.sees[release == 0].any() and seen.sees[release == 500].any()


def test_aboard_no_candidate_takes_a_picture_and_later_each_takes_those_of_its_flight_of_which_settled_ones_count():
    later = scenario(design__release_s=500, observation__criterion="passage", observation__interval_s=10)
    flights = fly_candidates(later)
    assert not flights.observing[flights.times < 500.0].any() and flights.observing[flights.times >= 500.0].any()
    plan = make_plan(at_points(later, [1, 5]))
    telemetry = simulate(plan)
    assert flights.observing[np.ix_(flights.counts, [0, 4])].sum() == picture_count(plan, telemetry) > 0
    for j, number in enumerate((0, 4)):
        error = telemetry["pointing_error"].values[np.isin(telemetry["time"].values, flights.times), j]
        counted = Watcher(flights, number).pictures
        assert len(counted) > 20 and error[counted].max() < np.radians(0.01 * 12.0)
        assert error[np.setdiff1d(picture_numbers(flights, number, flights.counts), counted)].max() > np.radians(12.0)


def test_a_target_that_is_dark_at_first_is_covered_by_a_design_that_waits_and_its_flight_sees_what_was_promised():
    with pytest.raises(MissionError, match=r"100 % never lit") as refused:
        sm.design(DATA)
    first, last = map(float, re.search(r"release from (\S+) to (\S+) s past", str(refused.value)).groups())
    design = sm.design(DATA, {"designer.releases_s": [0, 10 * round(0.05 * (first + last))], "duration_s": 1500})
    assert design.covered_percent >= 99.9 and design.proven
    assert {entry["release_s"] for entry in design.record["observers"]} == {10.0 * round(0.05 * (first + last))}
    flight = sm.fly(design.to_scenario())
    assert flight.summary["coverage_percent"] >= design.covered_percent - 1e-6
    aboard = flight.telemetry["time"].values < design.record["observers"][0]["release_s"]
    assert not flight.telemetry["released"].values[aboard].any()


def test_whose_place_of_release_depends_on_who_is_chosen_is_refused():
    with pytest.raises(
        MissionError, match=r"mothership\.velocity = 'mean' depends on who is chosen.*releases_s; give 'rest'"
    ):
        visibility(load_scenario(DATA, {**LATER, "mothership.velocity": "mean"}))
    burning = {"spacecraft.thrusters": {"thrust_n": 50, "propellant_kg": 1}, "mothership.velocity": "mean"}
    with pytest.raises(MissionError, match=r"so do insertion burns"):
        visibility(load_scenario(DATA, burning))


def test_no_two_that_a_design_may_need_at_one_time_are_at_one_point_then():
    choices = {"designer.releases_s": [0, 100, 200], "designer.times_of_flight_s": [300, 400], "designer.fold": 2}
    flown = [(v.design.release_s, v.design.time_of_flight_s) for v in flight_variants(load_scenario(DATA, choices))]
    # Of those that arrive at 400 or 500 s the longer flight, which needs less speed.
    assert flown == [(0, 300), (0, 400), (100, 400), (200, 400)]


def test_releases_that_the_deployer_cannot_give_are_avoided_or_left_out(seen):
    most = float(np.median(seen.delta_v))
    limit = {**LATER, "mothership.deployer.max_speed_m_s": most}
    told = visibility(load_scenario(DATA, limit))
    assert np.array_equal(told.beyond, told.delta_v > most * (1.0 + 1e-9)) and 0 < told.beyond.sum() < len(told.beyond)
    refused = visibility(load_scenario(DATA, {**limit, "mothership.deployer.beyond_max_speed": "refused"}))
    assert refused.candidates == [c for c, fast in zip(told.candidates, told.beyond, strict=True) if not fast]
    assert {why for _, why in refused.left_out} == {"beyond the deployer's speed"}
