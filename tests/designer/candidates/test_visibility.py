"""Candidates: flown where and pointed how the real flight is, judged as its pictures are, and kept on disk."""

import os
import re
import signal

import numpy as np
import pytest

from swarm_mj.designer.candidates import flights as candidate_flights
from swarm_mj.designer.candidates import pictures
from swarm_mj.designer.candidates.flights import at_points, fly_candidates
from swarm_mj.designer.candidates.pictures import picture_numbers, poses_of, shares_as_they_come
from swarm_mj.designer.candidates.visibility import imaging_model_from, visibility
from swarm_mj.designer.exact import solve_exact
from swarm_mj.designer.problem import CoverProblem
from swarm_mj.errors import MissionError, PathError, ScenarioError
from swarm_mj.flight.fly import simulate
from swarm_mj.flight.observe import observe_flight
from swarm_mj.flight.plan import make_plan
from swarm_mj.io import workers
from swarm_mj.mission.trajectories import NO_TRAJECTORY
from swarm_mj.observation.capture import observe
from swarm_mj.records.design_files import left_out_words
from swarm_mj.scenarios.loading import load_scenario, parse_overrides
from swarm_mj.spacecraft.attitude.mrp import dcm
from tests.designer.judging import seen_cells

#: Arrivals only, few cells, rays: quick enough for tests.
FAST = [
    "observation.criterion=arrival",
    "observation.observer=raycast",
    "target.cell_size_m=null",
    "camera.half_angle_deg=6",
]


def scenario(*overrides):
    return load_scenario("eros-quick", parse_overrides([*FAST, *overrides]))


def all_shares(flights, *what, at=True, workers=None, **how):
    """The shares of all candidates, in order."""
    poses = [poses_of(flights, j, at) for j in range(flights.n)]
    found = dict(shares_as_they_come(poses, *what, workers=workers, **how))
    return [found[j] for j in range(flights.n)]


@pytest.fixture(autouse=True)
def own_cache(tmp_path, monkeypatch):
    monkeypatch.setenv("SWARM_MJ_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


@pytest.fixture(scope="module")
def flights():
    return fly_candidates(scenario())


def test_every_visiting_point_has_a_candidate_that_is_there_at_the_time_of_flight(flights):
    k = int(np.flatnonzero(flights.times == 600.0)[0])
    points = flights.plan.region.visiting_points_A(14e3)
    assert flights.n == 51
    assert np.linalg.norm(flights.r_A[k] - points, axis=1).max() < 1e-3


def test_candidates_look_at_the_centre_while_inside_the_imaging_radius(flights):
    radius = np.linalg.norm(flights.r_A, axis=2)
    assert np.array_equal(flights.observing, radius <= 35e3)
    z = flights.C_CA[..., 2, :]
    cosine = np.einsum("knj,knj->kn", z, -flights.r_A) / radius
    assert np.allclose(cosine[flights.observing], 1.0, atol=1e-12)
    identity = np.einsum("knij,knlj->knil", flights.C_CA, flights.C_CA)
    assert np.allclose(identity, np.eye(3), atol=1e-12)


def test_candidates_fly_as_the_simulation_does():
    points = [5, 30]
    plan = make_plan(scenario(f"design.visiting_points={points}"))
    telemetry = simulate(plan)
    candidates = fly_candidates(scenario())
    for k, t in enumerate(candidates.times):
        C_AN = dcm(telemetry["sigma_AN"].sel(time=t).values)
        for j, point in enumerate(points):
            flown = C_AN @ telemetry["r_BN_N"].sel(time=t).values[j]
            assert np.linalg.norm(flown - candidates.r_A[k, point - 1]) < 2e-3


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_what_a_flight_sees_contains_what_its_candidates_promise_whatever_the_roll(seed):
    seen = visibility(scenario())
    points = [8, 40]
    plan = make_plan(scenario(f"design.visiting_points={points}", f"seed={seed}"))
    result = observe_flight(plan, simulate(plan))
    for j, point in enumerate(points):
        promised, flown = seen.sees[point - 1], result.coverage.seen_by[j]
        assert promised.any()
        assert not (promised & ~flown).any()
        assert flown.sum() > promised.sum()


def test_pictures_are_kept_and_an_interrupted_computation_goes_on(flights, own_cache, monkeypatch):
    region, imaging_model = flights.plan.region, imaging_model_from(scenario())
    at = flights.times == 600.0
    done = []
    judged = []
    real = pictures._judge

    def interrupted(judge, r_A, C_CA):
        if len(judged) == 20:
            raise KeyboardInterrupt
        judged.append(r_A)
        return real(judge, r_A, C_CA)

    monkeypatch.setattr(pictures, "_judge", interrupted)
    with pytest.raises(KeyboardInterrupt):
        all_shares(flights, region, imaging_model, at=at)
    assert len(list(own_cache.rglob("*.npy"))) == 20
    monkeypatch.setattr(pictures, "_judge", lambda judge, r, C: judged.append(r) or real(judge, r, C))
    shares = all_shares(flights, region, imaging_model, at=at, progress=done.append)
    assert len(judged) == 51
    assert done[0] == 20 and done[-1] == 51
    # A third time everything is read.
    again = all_shares(flights, region, imaging_model, at=at)
    assert len(judged) == 51
    assert all(np.array_equal(a, b) for a, b in zip(shares, again, strict=True))
    assert not list(own_cache.rglob("*.partial"))


def test_a_damaged_file_in_the_cache_is_computed_again(flights, own_cache):
    region, imaging_model = flights.plan.region, imaging_model_from(scenario())
    at = flights.times == 600.0
    shares = all_shares(flights, region, imaging_model, at=at)
    for k, file in enumerate(sorted(own_cache.rglob("*.npy"))[:4]):
        file.write_bytes([b"", b"junk", file.read_bytes()[:100], b"\x80\x04." * 50][k])
    again = all_shares(flights, region, imaging_model, at=at)
    assert all(np.array_equal(a, b) for a, b in zip(shares, again, strict=True))


def test_the_cache_tells_cameras_observers_and_targets_apart(flights, own_cache):
    region = flights.plan.region
    at = flights.times == 600.0
    for count, overrides in enumerate(
        ([], ["camera.half_angle_deg=5"], ["observation.occlusion=false"], ["designer.any_roll=false"]), start=1
    ):
        all_shares(flights, region, imaging_model_from(scenario(*overrides)), at=at)
        assert len(list((own_cache / "pictures").iterdir())) == count


def test_a_cache_that_cannot_be_written_only_costs_time(flights, monkeypatch):
    monkeypatch.setenv("SWARM_MJ_CACHE", "/proc/nowhere")
    at = flights.times == 600.0
    shares = all_shares(flights, flights.plan.region, imaging_model_from(scenario()), at=at)
    assert len(shares) == 51


def test_processes_give_the_same_as_one(flights, monkeypatch):
    region, imaging_model = flights.plan.region, imaging_model_from(scenario())
    few = flights.times % 240 == 0
    one = all_shares(flights, region, imaging_model, at=few, workers=1)
    monkeypatch.setenv("SWARM_MJ_CACHE", os.environ["SWARM_MJ_CACHE"] + "2")
    monkeypatch.setattr(pictures, "MIN_PARALLEL", 1)
    two = all_shares(flights, region, imaging_model, at=few, workers=2)
    assert all(np.array_equal(a, b) for a, b in zip(one, two, strict=True))
    assert sum(len(picture_numbers(flights, j, few)) for j in range(flights.n)) == sum(len(a) for a in one)


def test_the_passage_sees_more_than_the_arrival_and_limits_see_less():
    arrival = visibility(scenario()).sees
    passage = visibility(scenario("observation.criterion=passage")).sees
    assert (passage | ~arrival).all() and passage.sum() > arrival.sum()
    for limit in ("max_emission_deg=30", "max_range_m=14000", "max_incidence_deg=30", "max_gsd_m=6"):
        limited = visibility(scenario(f"observation.{limit}")).sees
        assert not (limited & ~arrival).any()
        assert limited.sum() < arrival.sum(), limit


@pytest.mark.parametrize(
    ("criterion", "observer"),
    [
        ("min_fraction=0.28", "raycast"),
        ("any_pixel=true", "raycast"),
        ("max_emission_deg=30", "raycast"),
        ("max_incidence_deg=50", "raycast"),
        ("light=ignored", "raycast"),
        ("light=sunlit", "horizon"),
        ("min_pixels=30", "raycast"),
        ("occlusion=false", "raycast"),
        ("criterion=passage", "raycast"),
    ],
)
def test_candidates_are_judged_as_the_pictures_of_a_flight_are(flights, criterion, observer):
    told = scenario(f"observation.observer={observer}", f"observation.{criterion}", "observation.interval_s=120")
    few, model, region = fly_candidates(told), imaging_model_from(told), flights.plan.region
    seen, environment = seen_cells(told, few, region, model), few.plan.environment
    judge, rule = model.open(region), told.observation
    for j in range(0, few.n, 5):
        expected = np.zeros(region.n_cells, bool)
        for k in np.flatnonzero(few.observing[:, j] & few.counts):
            t = float(few.times[k])
            sun_A = environment.C_AN(t) @ environment.sun.at(t)
            expected |= observe(judge, few.r_A[k, j], few.C_CA[k, j], rule, sun_A)
        assert np.array_equal(seen[j], expected)
    assert seen.any()


def test_night_hides_the_target_from_every_candidate():
    # Half a turn of Eros after the default epoch.
    assert not visibility(scenario("epoch=2018-01-01T05:53:00", "observation.max_incidence_deg=80")).sees.any()


def test_several_targets_altitudes_and_times_make_more_candidates_with_their_own_meaning():
    extra = "designer.extra_targets=[{latitude_deg: 0, longitude_deg: 60, half_angle_deg: 10}]"
    seen = visibility(scenario(extra))
    region = seen.region
    first, second = region.targets
    assert seen.sees.shape == (first.n_visiting + second.n_visiting, region.n_cells)
    assert {c.target for c in seen.candidates} == {0, 1}
    own = seen.sees[first.n_visiting :, region.cells_of(1)]
    assert own.any(axis=1).all()

    free = visibility(scenario("designer.altitudes_m=[10000, 14000]", "designer.times_of_flight_s=[480, 600]"))
    assert len(free.candidates) == 4 * 51
    assert {(c.altitude_m, c.time_of_flight_s) for c in free.candidates} == {
        (h, t) for h in (10e3, 14e3) for t in (480, 600)
    }
    low, high = (np.array([c.altitude_m == h for c in free.candidates]) for h in (10e3, 14e3))
    assert free.sees[low].sum() < free.sees[high].sum()


def test_a_time_of_flight_that_does_not_fit_the_scenario_is_refused():
    with pytest.raises(ScenarioError, match="time_of_flight_s"):
        visibility(scenario("designer.times_of_flight_s=[5000]"))


@pytest.mark.parametrize(("half_angle_deg", "fewest"), [(21.5, 1), (7.5, 2), (7, 3), (6, 4), (5, 5), (4.1, 8)])
def test_whole_faces_at_the_arrival_need_as_many_as_the_corners_in_the_cone_say(flights, half_angle_deg, fewest):
    told = scenario(
        f"camera.half_angle_deg={half_angle_deg}", "observation.min_fraction=0.999", "observation.min_pixels=0"
    )
    region, k = flights.plan.region, int(np.flatnonzero(flights.times == 600.0)[0])
    seen = seen_cells(told, flights, region, imaging_model_from(told))
    # By hand: nothing on the target hides another part of it from any of the points, and each looks at the centre.
    to_corner = region.corners_A - flights.r_A[k][:, None, None]
    ahead = -flights.r_A[k] / np.linalg.norm(flights.r_A[k], axis=1, keepdims=True)
    cosine = np.einsum("jnci,ji->jnc", to_corner, ahead) / np.linalg.norm(to_corner, axis=3)
    assert np.array_equal(seen, (cosine >= np.cos(np.radians(half_angle_deg))).all(axis=2))
    problem = CoverProblem(sees=seen, area=region.area, tolerance_percent=0.1, max_observers=20)
    assert solve_exact(problem).n_observers == fewest


def test_processes_for_whose_pictures_nobody_waits_any_more_are_gone(flights, own_cache, monkeypatch):
    begun, begin = [], workers.begin

    def noted(*arguments, **keywords):
        begun.append(begin(*arguments, **keywords))
        return begun[-1]

    def interrupted():
        if begun:
            raise KeyboardInterrupt

    monkeypatch.setattr(workers, "begin", noted)
    monkeypatch.setattr(pictures.interruption, "check", interrupted)
    monkeypatch.setattr(pictures, "MIN_PARALLEL", 1)
    with pytest.raises(KeyboardInterrupt):
        all_shares(flights, flights.plan.region, imaging_model_from(scenario()), workers=2)
    assert [process.exitcode for process, _ in begun] == [-signal.SIGKILL] * 2


def test_candidates_whose_flight_would_hit_the_body_are_left_out_and_only_they(own_cache):
    beside = scenario("mothership.position_A_m=[22000, -5000, 2000]")
    flights = fly_candidates(beside)
    assert set(flights.left_out.values()) == {"hitting 433 Eros"}
    assert sorted([*flights.points, *flights.left_out]) == list(range(1, 52)) and len(flights.left_out) == 10
    for point in (*list(flights.left_out)[:2], *flights.points[:2]):
        alone = at_points(beside, [point])
        if point in flights.left_out:
            with pytest.raises(PathError, match="sc1 hits 433 Eros"):
                make_plan(alone, check_separation=False)
        else:
            r_A = make_plan(alone, check_separation=False).points_A[0]
            assert np.linalg.norm(flights.plan.points_A[flights.points.index(point)] - r_A) < 1e-6
    seen = visibility(beside)
    assert [candidate.point for candidate in seen.candidates] == list(flights.points)
    assert left_out_words(seen) == "10 of 51 candidates are left out: 10 hitting 433 Eros"


def test_where_no_candidate_can_be_flown_to_there_is_one_error():
    with pytest.raises(
        MissionError, match="no visiting point of the target can be flown to: sc1 hits 433 Eros"
    ) as told:
        visibility(scenario("mothership.position_A_m=[20000, -18000, 0]"))
    assert re.search(r"4\d more do", str(told.value)) and "\n" not in str(told.value)


@pytest.mark.parametrize("named", [True, False])
def test_points_that_make_a_plan_fail_are_found_whether_the_error_names_them_or_not(monkeypatch, named):
    bad = {3, 17, 18, 51}

    def planned(told, **keywords):
        points = told.design.visiting_points
        there = [k for k, point in enumerate(points) if point in bad]
        if there:
            raise PathError("no", "too far", there[:1]) if named else MissionError("no")
        return points

    monkeypatch.setattr(candidate_flights, "make_plan", planned)
    plan, left_out = candidate_flights._reachable(scenario(), range(1, 52), None)
    assert set(plan) == set(range(1, 52)) - bad
    assert left_out == dict.fromkeys(sorted(bad), "too far" if named else NO_TRAJECTORY)


def test_an_interruption_leaves_what_the_judged_candidates_see(own_cache, monkeypatch):
    whole = visibility(scenario(), workers=1)
    monkeypatch.setenv("SWARM_MJ_CACHE", str(own_cache / "new"))
    judged = []

    def interrupted():
        judged.append(1)
        if len(judged) > 20:
            raise KeyboardInterrupt

    monkeypatch.setattr(pictures.interruption, "check", interrupted)
    part = visibility(scenario(), workers=1)
    assert part.unjudged == 31
    assert np.array_equal(part.sees[:20], whole.sees[:20]) and not part.sees[20:].any()
