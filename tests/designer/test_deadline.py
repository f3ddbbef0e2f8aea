"""Designs whose map must be on Earth in time: cuts against enumeration, bounds against flights, the command and its words."""

import json
import math
import re
from itertools import combinations

import numpy as np
import pytest
from scipy.optimize import linprog

from swarm_mj.cli.main import main
from swarm_mj.designer.deadline import HOUR, Arrival, DeadlineSearch, Needs, fly_design
from swarm_mj.designer.study import study_design
from swarm_mj.errors import MissionError, ScenarioError
from swarm_mj.scenarios.loading import load_scenario, parse_overrides

FAST = ["observation.criterion=arrival", "observation.observer=raycast", "target.cell_size_m=null", "data.slot_s=10",
        "designer.max_generations=10"]  # fmt: skip


def random_needs(problem, seed):
    """Needs with views that cannot be had at all, and with starts that differ by the time that some cells take."""
    rng = np.random.default_rng(seed)
    bit = rng.uniform(100.0, 1000.0, problem.sees.shape)
    bit[~problem.sees & (rng.random(bit.shape) < 0.2)] = np.inf
    start_s = rng.uniform(0.0, 20.0, problem.n_points)
    return Needs(problem=problem, bit=bit, start_s=start_s, light_time_s=30.0, rate_bit_s=100.0)


def full_s(needs, points, luck):
    """When a map would be on Earth: what must be sent is sent at the best rate, after a delay of its own."""
    taken = np.array(points) - 1
    seen = needs.problem.sees[taken].any(axis=0)
    sent = needs.bit[taken].min(axis=0)[seen].sum()
    return needs.start_s[taken].min() + sent / needs.rate_bit_s + needs.light_time_s + luck[hash(points) % len(luck)]


def enumerated(problem, judge, limit_s):
    """Fewest points of all designs that cover the target in time, inf where none does; and the soonest of those that cover."""
    fewest, soonest = math.inf, math.inf
    for n in range(1, problem.max_observers + 1):
        for points in combinations(range(1, problem.n_points + 1), n):
            if problem.is_enough(problem.covered_weight(points)):
                by = judge(np.array(points)).full_s
                soonest = min(soonest, by)
                fewest = min(fewest, n) if by <= limit_s else fewest
    return fewest, soonest


def case(make_discs, seed, **variant):
    problem = make_discs(seed, n_points=6, n_vertices=12, radius=0.6, max_observers=4, **variant)
    needs = random_needs(problem, seed)
    luck = np.random.default_rng(seed).exponential(6.0, 97)

    def judge(points):
        return Arrival(full_s(needs, tuple(map(int, points)), luck), problem.covered_percent(points))

    return problem, needs, judge


@pytest.mark.parametrize("variant", [{"tolerance_percent": 0.0}, {"tolerance_percent": 8.0}], ids=str)
def test_the_fewest_in_time_are_those_of_enumeration_and_what_is_said_to_be_enough_is(make_discs, variant):
    solved = refused = unflown = more = 0
    for seed in range(4):
        problem, needs, judge = case(make_discs, seed, **variant)
        least, soonest = enumerated(problem, judge, math.inf)
        if not math.isfinite(least):
            continue
        for limit_s in (0.97 * soonest, 1.0001 * soonest, 1.05 * soonest):
            fewest, _ = enumerated(problem, judge, limit_s)
            search = DeadlineSearch(problem=problem, needs=needs, limit_s=limit_s, fly=judge)
            if math.isfinite(fewest):
                search.require_possible(60.0)
                result = search.solve(60.0)
                assert (result.n_observers, result.bound, result.status) == (fewest, fewest, "optimal")
                assert search.meets(result.points) and judge(result.points).full_s <= limit_s
                solved, more = solved + 1, more + (fewest > least)
            else:
                with pytest.raises(MissionError, match=r"designer.deliver_within_h = .* h are enough") as error:
                    search.require_possible(60.0)
                    search.solve(60.0)
                said_s = float(re.search(r"([\d.]+) h are enough", str(error.value))[1]) * HOUR
                assert enumerated(problem, judge, said_s)[0] <= problem.max_observers
                refused += 1
            unflown += search.unflown
    assert min(solved, refused, unflown, more) >= 2


def test_a_known_design_that_is_in_time_and_as_small_as_the_bound_ends_the_search(make_discs):
    problem, needs, judge = case(make_discs, 3, tolerance_percent=15.0)
    first = DeadlineSearch(problem=problem, needs=needs, limit_s=1e9, fly=judge).solve(60.0)
    search = DeadlineSearch(problem=problem, needs=needs, limit_s=1e9, fly=judge)
    search.arrival(first.points)
    again = search.solve(60.0, first.points)
    assert list(again.points) == list(first.points) and again.status == "optimal" and len(search.arrivals) == 1


def test_without_time_nothing_is_called_proven(make_discs):
    problem, needs, judge = case(make_discs, 3, tolerance_percent=15.0)
    limit_s = enumerated(problem, judge, math.inf)[1] * 0.999
    with pytest.raises(MissionError, match=r"nor is it proven that there is none .* allow more time"):
        DeadlineSearch(problem=problem, needs=needs, limit_s=limit_s, fly=judge).solve(1e-6)


def test_what_must_be_sent_is_the_least_that_the_tolerance_allows(make_discs):
    for seed in range(5):
        problem, needs, _ = case(make_discs, seed, tolerance_percent=12.0)
        held = needs.held(np.array([1, 4]))
        answer = linprog(
            -held, A_ub=[problem.weights / problem.slack], b_ub=[1.0], bounds=[(0.0, 1.0)] * len(held), method="highs"
        )
        assert needs.sent_at_least(held) == pytest.approx(held.sum() + answer.fun, rel=1e-9)


def test_a_map_is_complete_at_the_edge_of_a_slot(make_discs):
    problem, needs, _ = case(make_discs, 0)
    edged = Needs(**{**needs.__dict__, "edges_s": np.arange(0.0, 500.0, 25.0)})
    free_s, at_edge_s = needs.soonest_s(), edged.soonest_s()
    assert 0.0 <= at_edge_s - free_s < 25.0 and (at_edge_s - 30.0) % 25.0 == pytest.approx(0.0)
    assert (
        edged.capacity_bit(at_edge_s, 0.0)
        == edged.capacity_bit(at_edge_s + 24.0, 0.0)
        == pytest.approx(100.0 * (at_edge_s - 30.0))
    )


@pytest.fixture(scope="module", params=["adaptable_roles", "dedicated_communications"])
def flown(request):
    """A study of few candidates, and when the maps of all designs of one or two are on Earth."""
    few = [
        f"behavior.name={request.param}",
        "target.half_angle_deg=6",
        "camera.half_angle_deg=4",
        "camera.resolution_px=512",
    ]
    scenario = load_scenario("eros-quick", parse_overrides([*FAST, *few, "designer.deliver_within_h=48"]))
    study = study_design(scenario)
    n = len(study.visibility.candidates)
    sets = [np.array(points) for k in (1, 2) for points in combinations(range(1, n + 1), k)]
    return study, {tuple(map(int, points)): study.deadline.arrival(points) for points in sets}


def test_flights_are_no_sooner_than_their_bounds_and_the_fewest_in_time_are_those_of_all_flights(flown):
    study, arrivals = flown
    problem, needs = study.problem, study.deadline.needs
    assert 4 <= len(study.visibility.candidates) <= 8
    for points, arrival in arrivals.items():
        assert arrival.full_s >= needs.soonest_s(np.array(points)) >= needs.soonest_s()
        assert arrival.full_s < needs.soonest_s(np.array(points)) + 400.0
    times = sorted({a.full_s for a in arrivals.values()})
    for limit_s in (times[0], times[len(times) // 3], times[-1]):
        good = [
            p for p, a in arrivals.items() if problem.is_enough(problem.covered_weight(p)) and a.meets(limit_s, 0.1)
        ]
        search = DeadlineSearch(
            problem=problem, needs=needs, limit_s=limit_s, fly=lambda points: arrivals[tuple(map(int, points))]
        )
        if good:
            assert search.solve(60.0).n_observers == min(map(len, good))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    out = tmp_path_factory.mktemp("within") / "run"
    sets = [part for override in (*FAST, "camera.half_angle_deg=8") for part in ("--set", override)]
    typed = ["design", "eros-quick", "--quiet", "--no-figures", "--deliver-within", "0.631", "--out", str(out), *sets]
    assert main(typed) == 0
    return out, sets


def test_one_would_see_all_but_two_are_sooner_and_their_flight_delivers_in_time(folder, tmp_path, capsys):
    out, sets = folder
    record = json.loads((out / "design.json").read_text())
    assert (record["n_observers"], record["proof"]["minimum"], record["proof"]["status"]) == (2, 2, "optimal")
    assert record["genetic"]["repair"]["n_observers"] == 1 and record["gap"] is None
    assert record["genetic_delivered_in_time"]["repair"] is False and record["delivered_in_time"] is True
    assert record["delivery_bound_h"] <= record["delivered_by_h"] <= 0.631 < record["genetic_delivered_by_h"]["repair"]
    flight = ["fly", "eros-quick", "--quiet", "--no-figures", "--no-report", "--out", str(tmp_path / "o")]
    assert main([*flight, "--design", str(out / "design.json"), *sets]) == 0
    summary = json.loads((tmp_path / "o" / "summary.json").read_text())
    assert summary["time_to_all_data_s_bound"] / HOUR == pytest.approx(record["delivered_by_h"], abs=1e-6)
    assert summary["delivered_percent"] >= 99.9


def test_hours_that_no_design_can_keep_are_refused_with_a_bound_and_with_hours_that_are_enough(tmp_path, capsys):
    sets = [part for override in (*FAST, "camera.half_angle_deg=8") for part in ("--set", override)]
    out = str(tmp_path / "o")
    assert (
        main(["design", "eros-quick", "--quiet", "--no-figures", "--deliver-within", "0.5", "--out", out, *sets]) == 2
    )
    said = capsys.readouterr().err
    bound, enough = re.search(
        r"deliver_within_h = 0.5: .* before ([\d.]+) h.* ([\d.]+) h are enough for the 1 at", said
    ).groups()
    assert 0.5 < float(bound) < float(enough)
    assert not list(tmp_path.iterdir())
    point = int(re.search(r"at points (\d+)", said)[1])
    scenario = load_scenario("eros-quick", parse_overrides([*FAST, "camera.half_angle_deg=8"]))
    assert fly_design(scenario, np.array([point])).meets(float(enough) * HOUR, 0.1)


def test_a_design_of_several_flights_cannot_be_asked_to_deliver():
    with pytest.raises(ScenarioError, match=r"releases_s: must be empty with deliver_within_h = 2"):
        load_scenario("eros-quick", {"designer.deliver_within_h": 2, "designer.releases_s": [60]})
    with pytest.raises(ScenarioError, match=r"altitudes_m: must be empty with deliver_within_h = 2"):
        load_scenario("eros-quick", {"designer.deliver_within_h": 2, "designer.altitudes_m": [18000]})


def test_an_interruption_while_designs_are_flown_leaves_one_that_is_not_checked(tmp_path, monkeypatch, capsys):
    def interrupt(*arguments):
        raise KeyboardInterrupt

    monkeypatch.setattr("swarm_mj.designer.study.fly_design", interrupt)
    sets = [part for override in (*FAST, "camera.half_angle_deg=8") for part in ("--set", override)]
    out = tmp_path / "o"
    assert (
        main(["design", "eros-quick", "--quiet", "--no-figures", "--deliver-within", "2", "--out", str(out), *sets])
        == 130
    )
    record = json.loads((out / "design.json").read_text())
    assert (record["delivery_checked"], record["delivered_by_h"], record["proof"]["status"]) == (
        False,
        None,
        "interrupted",
    )
