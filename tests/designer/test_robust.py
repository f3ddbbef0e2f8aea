"""The fewest spacecraft for a probability: against enumeration of all designs and all losses."""

import json
from itertools import combinations, islice, product

import numpy as np
import pyarrow.parquet as pq
import pytest

import swarm_mj as sm
from swarm_mj.cli.tables import certainty_table, design_table, verified_words
from swarm_mj.designer import robust
from swarm_mj.designer.candidates.visibility import Candidate
from swarm_mj.designer.exact import solve_exact
from swarm_mj.designer.robust import Loss, Realisation, RobustSearch, Sample, fly_realisations, losses_of, realise
from swarm_mj.errors import MissionError, ScenarioError
from swarm_mj.scenarios.loading import load_scenario


def random_realisations(seed, *, n=8, cells=12, count=1, partly=False):
    """Random sightings of n candidates, realisations of a design problem that differ a little, with unequal chances of loss."""
    rng = np.random.default_rng(seed)
    base, area = rng.random((n, cells)) < 0.45, rng.uniform(0.5, 1.5, cells)
    found = []
    for _ in range(count):
        full = base ^ (rng.random((n, cells)) < (0.04 if count > 1 else 0.0))
        lost = full & (rng.random((n, cells)) < 0.3) if partly else np.zeros_like(full)
        found.append(Realisation(full, lost, rng.uniform(0.0, 0.3, n), area))
    return found


def by_enumeration(realisations, chosen, tolerance_percent):
    """P(S) as the sum over all that may be lost, with areas instead of whole units."""
    gone, total = np.array(list(product([False, True], repeat=len(chosen)))), 0.0
    for full, lost, chance, area in realisations:
        q = chance[list(chosen)]
        weight = np.where(gone, q, 1.0 - q).prod(axis=1)
        seen = np.where(gone[:, :, None], lost[list(chosen)], full[list(chosen)]).any(axis=1)
        total += weight @ (100.0 * (~seen @ area) / area.sum() <= tolerance_percent + 1e-9)
    return total / len(realisations)


def search_of(realisations, tolerance_percent, most=20):
    return RobustSearch(realisations=realisations, tolerance_percent=tolerance_percent, max_observers=most)


CASES = [
    {},
    {"partly": True},
    {"tolerance": 12.0},
    {"tolerance": 12.0, "partly": True},
    {"count": 3},
    {"count": 3, "partly": True, "tolerance": 5.0},
]


@pytest.mark.parametrize("case", CASES, ids=str)
def test_the_fewest_for_a_probability_equal_enumeration_of_all_designs_and_losses(case):
    given = {key: value for key, value in case.items() if key != "tolerance"}
    tolerance, feasible = case.get("tolerance", 0.0), 0
    for seed in range(4):
        realisations = random_realisations(seed, **given)
        search = search_of(realisations, tolerance)
        designs = [c for n in range(1, 9) for c in combinations(range(8), n)]
        chances = {c: by_enumeration(realisations, c, tolerance) for c in designs}
        assert search.bound >= max(chances.values()) - 1e-12
        for asked in (0.3, 0.7, 0.9):
            least = min((len(c) for c, chance in chances.items() if chance >= asked), default=None)
            level = search.fewest(asked, 60.0)
            if least is None:
                assert level.points is None
                assert level.bound == 9
                continue
            feasible += 1
            assert len(level.points) == level.bound == least
            assert level.proven
            chosen = tuple(int(p) - 1 for p in level.points)
            assert level.promised == pytest.approx(chances[chosen], abs=1e-12)
            assert level.promised >= asked
    assert feasible >= 6


def test_the_probability_equals_the_closed_form_and_a_monte_carlo_of_losses():
    # Two seers of one cell, one of another: 1 - q1 q2 and 1 - q3.
    full = np.array([[True, False], [True, False], [False, True]])
    seen = Realisation(full, np.zeros_like(full), np.array([0.3, 0.2, 0.1]), np.ones(2))
    search = search_of([seen], 0.0)
    assert search.probability(np.arange(3)) == pytest.approx((1 - 0.3 * 0.2) * 0.9)
    assert search.bound == pytest.approx(0.9)
    (seen,) = random_realisations(3, n=10, cells=30, partly=True)
    gone = np.random.default_rng(1).random((20_000, 10)) < seen.chance
    seen_then = np.where(gone[:, :, None], seen.lost, seen.full).any(axis=1)
    share = (100.0 * (seen_then @ seen.area) / seen.area.sum() >= 90.0).mean()
    assert search_of([seen], 10.0).probability(np.arange(10)) == pytest.approx(share, abs=4 * 0.5 / np.sqrt(20_000))


def test_certainty_costs_ever_more_and_nothing_where_nothing_is_lost(make_discs):
    problem = make_discs(4, n_points=20, n_vertices=30, radius=0.5)
    least = solve_exact(problem).n_observers
    for q in (0.0, 0.05, 0.1):
        seen = Realisation(problem.sees, np.zeros_like(problem.sees), np.full(20, q), problem.area)
        search = search_of([seen], problem.tolerance_percent)
        levels = [search.fewest(asked, 60.0) for asked in (0.95, 0.5, 0.9)]
        numbers = [len(level.points) for level in sorted(levels)]
        assert all(level.proven and level.promised >= level.asked for level in levels)
        assert numbers == sorted(numbers) and numbers[0] >= least
        assert q > 0.0 or numbers == [least] * 3
    assert numbers[-1] > least


def test_the_bound_holds_when_the_time_is_up(make_discs):
    problem = make_discs(4, n_points=30, n_vertices=40, radius=0.4)
    seen = Realisation(problem.sees, np.zeros_like(problem.sees), np.full(30, 0.1), problem.area)
    fast, slow = (search_of([seen], 0.1).fewest(0.95, limit) for limit in (1e-9, 60.0))
    assert fast.bound <= len(slow.points) <= len(fast.points)
    assert fast.promised >= 0.95 and not fast.proven


def test_designs_that_other_seeds_refuse_are_not_taken():
    kind, harsh = random_realisations(1, n=8, cells=10), random_realisations(1, n=8, cells=10)
    harsh = [one._replace(chance=np.minimum(2.0 * one.chance, 1.0)) for one in harsh]
    others = [Sample(one, 0.0) for one in harsh]
    search = RobustSearch(realisations=kind, tolerance_percent=0.0, max_observers=8, others=others)
    level, easy = search.fewest(0.6, 60.0), search_of(kind, 0.0).fewest(0.6, 60.0)
    assert level.promised == pytest.approx(by_enumeration(harsh, tuple(level.points - 1), 0.0))
    assert level.promised >= 0.6 > by_enumeration(harsh, tuple(easy.points - 1), 0.0)
    assert level.bound <= len(easy.points)  # the proof is that of the realisations sought on


FIRST_SEEN = np.array([[100.0, 300.0, np.nan], [500.0, np.nan, 500.0], [np.nan, np.nan, np.nan]])


def test_who_is_lost_at_a_random_time_has_seen_what_came_before():
    rng, area, losses = np.random.default_rng(0), np.ones(3), [Loss(0.4, 0.0, 400.0)]
    drawn = [realise(FIRST_SEEN, area, losses, rng) for _ in range(4000)]
    # 300 of 400 s lie before the first one's last cell; the second's lies after all losses; the third sees nothing to lose.
    assert drawn[0].chance == pytest.approx([0.3, 0.4, 0.0])
    kept = np.mean([one.lost for one in drawn], axis=0)
    assert kept[0] == pytest.approx([2 / 3, 0.0, 0.0], abs=0.03)  # lost after 100 s, given that it is before 300 s
    assert not kept[1:].any()


def test_two_losses_happen_independently_and_the_first_counts():
    rng, area = np.random.default_rng(0), np.ones(3)
    losses = [Loss(0.5, 200.0, 200.0), Loss(0.2, -np.inf, -np.inf)]
    drawn = [realise(FIRST_SEEN, area, losses, rng) for _ in range(4000)]
    assert drawn[0].chance == pytest.approx([0.6, 0.6, 0.0])
    # Of the 0.6 lost, those that never left, 0.2, have not seen the first cell.
    assert np.mean([one.lost[0, 0] for one in drawn]) == pytest.approx(0.4 / 0.6, abs=0.03)


def losing(**fault):
    return load_scenario("eros-quick", {"faults": [{"kind": "spacecraft_lost", "spacecraft": "all", **fault}]})


def test_losses_come_from_the_faults_that_any_spacecraft_may_have():
    assert losses_of(losing(probability=0.1, between_s=[0, 600])) == [Loss(0.1, 0.0, 600.0)]
    assert losses_of(losing(probability=0.1)) == [Loss(0.1, 0.0, 1200.0)]
    assert losses_of(losing(probability=0.1, at_s=30)) == [Loss(0.1, 30.0, 30.0)]
    with pytest.raises(ScenarioError, match=r"faults\.0\.spacecraft = sc2: .* must be all"):
        losses_of(losing(spacecraft="sc2"))


@pytest.mark.parametrize("other", [{"designer.fold": 2}, {"designer.deliver_within_h": 2}])
def test_a_probability_stands_alone_among_demands_of_safety(other):
    with pytest.raises(ScenarioError, match=r"must be left out with probability = 0\.9"):
        load_scenario("eros-quick", {"designer.probability": 0.9, **other})


SMALL = {"observation.criterion": "arrival", "observation.observer": "raycast", "target.cell_size_m": None,
         "camera.half_angle_deg": 7, "telemetry.interval_s": 10, "observation.interval_s": 600, "designer.realisations": 2,
         "designer.check_flights": 3, "designer.time_limit_s": 10,
         "faults": [{"kind": "spacecraft_lost", "spacecraft": "all", "probability": 0.1, "between_s": [0, 600]}]}  # fmt: skip


@pytest.mark.slow
def test_a_design_for_a_probability_is_written_flown_and_verified(tmp_path, monkeypatch):
    monkeypatch.setenv("SWARM_MJ_CACHE", str(tmp_path / "cache"))
    out = tmp_path / "design"
    found = sm.design("eros-quick", {**SMALL, "designer.probability": 0.9}, out=out, verify=3, progress=False)
    record = json.loads((out / "design.json").read_text())
    first = record["certainty"][0]
    assert [level["probability"] for level in record["certainty"]] == [0.9, 0.5, 0.95, 0.99]
    assert record["n_observers"] == first["n_observers"] == len(record["visiting_points"])
    assert first["promised"] >= 0.9 and record["n_observers"] > record["nominal_minimum"]
    flown = record["verified"]
    seen = pq.read_table(tmp_path / "design-verification" / "results.parquet")["covered"].to_pylist()
    assert (flown["flights"], flown["covered"]) == (3, sum(seen))
    assert flown["inside"] == (flown["low"] <= first["promised"] <= flown["high"])
    assert {"certainty.png", "cover.png"} <= {path.name for path in out.iterdir()}
    assert sm.open_design(out).certainty["n_observers"].tolist() == found.certainty["n_observers"].tolist()
    assert f"{flown['covered']} of 3 flights" in verified_words(record)


def test_a_probability_that_none_can_keep_is_refused_with_what_is_possible(tmp_path, monkeypatch):
    monkeypatch.setenv("SWARM_MJ_CACHE", str(tmp_path))
    certain = {"kind": "spacecraft_lost", "spacecraft": "all", "probability": 0.6, "at_s": 10}
    asked = {
        **SMALL,
        "faults": [certain],
        "designer.realisations": 0,
        "designer.probability": 0.999,
        "designer.max_observers": 4,
    }
    with pytest.raises(
        MissionError, match=r"designer\.probability = 0\.999: .* the best known keeps 0\.\d+ with \d; ask for less"
    ):
        sm.design("eros-quick", asked, progress=False)


def test_dispersed_flights_of_an_interrupted_design_are_not_flown_again(tmp_path, monkeypatch):
    changes = {**SMALL, "dispersions.target_m": 200.0, "dispersions.deployment_velocity_m_s": 0.1}
    scenario, flown = load_scenario("eros-quick", changes), []
    design = scenario.design
    pair = [Candidate(k, 0, design.imaging_altitude_m, design.time_of_flight_s, 0.0) for k in (1, 5)]
    simulate = robust.simulate
    monkeypatch.setattr(robust, "simulate", lambda plan, **given: flown.append(0) or simulate(plan, **given))

    def draw(cache, count):
        monkeypatch.setenv("SWARM_MJ_CACHE", str(tmp_path / cache))
        return list(islice(fly_realisations(scenario, pair, [11, 12, 13]), count))

    whole, _, resumed = draw("a", 3), draw("b", 1), draw("b", 3)
    assert len(flown) == 3 + 3
    for one, other in zip(whole, resumed, strict=True):
        assert all(np.array_equal(a, b) for a, b in zip(one, other, strict=True))
    assert not np.array_equal(whole[0].full, whole[1].full) or not np.array_equal(whole[1].full, whole[2].full)


def interrupt_after(monkeypatch, calls):
    """Let an interruption come when the search has looked for one so many times."""
    left = [calls]

    def check():
        left[0] -= 1
        if left[0] < 0:
            raise KeyboardInterrupt

    monkeypatch.setattr("swarm_mj.designer.robust.interruption.check", check)


@pytest.mark.parametrize(("asked", "calls", "size"), [(0.4, 20, None), (0.4, 24, 4), (0.4, 28, 3), (0.6, 24, None)])
def test_an_interrupted_search_gives_the_smallest_design_known_to_keep_the_probability(monkeypatch, asked, calls, size):
    kind, harsh = random_realisations(7, count=2, partly=True), random_realisations(7, partly=True)
    search = RobustSearch(
        realisations=kind, tolerance_percent=0.0, max_observers=8, others=[Sample(one, 0.0) for one in harsh]
    )
    with monkeypatch.context() as patched, pytest.raises(KeyboardInterrupt):
        interrupt_after(patched, calls)
        search.fewest(asked, 60.0)
    kept = [c for c in search.known if by_enumeration(kind, c, 0.0) >= asked]
    judged = [c for c in kept if by_enumeration(harsh, c, 0.0) >= asked]
    assert min(map(len, judged), default=None) == size and (kept or asked == 0.4)
    level = search.so_far(asked)
    assert size == (None if level.points is None else len(level.points))
    assert level.points is None or level.promised == pytest.approx(by_enumeration(harsh, tuple(level.points - 1), 0.0))
    whole = search.fewest(asked, 60.0)
    assert level.bound <= whole.bound == search.so_far(asked).bound
    assert len(search.so_far(asked).points) == len(whole.points)


@pytest.mark.parametrize("calls", [0, 300])
def test_an_interrupted_robust_design_says_what_it_is(tmp_path, monkeypatch, calls):
    monkeypatch.setenv("SWARM_MJ_CACHE", str(tmp_path / "cache"))
    fewest = RobustSearch.fewest

    def interrupted(search, *given):
        with monkeypatch.context() as patched:
            interrupt_after(patched, calls)
            return fewest(search, *given)

    monkeypatch.setattr(RobustSearch, "fewest", interrupted)
    asked = {**SMALL, "designer.realisations": 0, "designer.probability": 0.9}
    with pytest.raises(KeyboardInterrupt), pytest.warns(UserWarning) as warned:
        sm.design("eros-quick", asked, out=tmp_path / "o", progress=False)
    said = " ".join(str(one.message) for one in warned)
    record = json.loads((tmp_path / "o" / "design.json").read_text())
    level = record["certainty"][0]
    assert (record["interrupted"], record["proof"]["status"]) == ("P = 0.9", "interrupted")
    if calls:
        assert record["n_observers"] == level["n_observers"] > record["nominal_minimum"]
        assert level["promised"] >= 0.9 and "allows for no losses" not in said
    else:
        assert record["n_observers"] == record["nominal_minimum"] and level["n_observers"] is None
        assert "which allows for no losses: none for probability 0.9 was found yet" in said
        assert "no design for probability 0.9 yet" in design_table(record).caption
    assert certainty_table(record).row_count == 1
    assert sm.open_design(tmp_path / "o").certainty["lower_bound"].iloc[0] >= 1
