"""Leaving candidates out by what they could see at most: the proven minimum and the cheapest design stay, by brute force."""

from itertools import combinations

import numpy as np
import pytest

from swarm_mj.designer.candidates.visibility import Thinning, visibility
from swarm_mj.designer.exact import solve_exact
from swarm_mj.designer.problem import CoverProblem
from swarm_mj.designer.study import study_design
from swarm_mj.records.design_files import design_record, left_out_words
from swarm_mj.scenarios.loading import load_scenario, parse_overrides


def cheapest(sees, cost, fold):
    """Fewest rows that see every column `fold` times, and the least cost of so many, by trying all."""
    for n in range(1, len(sees) + 1):
        costs = [
            cost[list(chosen)].sum()
            for chosen in combinations(range(len(sees)), n)
            if (sees[list(chosen)].sum(axis=0) >= fold).all()
        ]
        if costs:
            return n, min(costs)
    return None


def thinned(sees, reach, **how):
    """Who is judged, and who stands in for the others; rows are shown only once they are asked for."""
    shown = np.zeros_like(sees)
    thin, judged = Thinning(reach, shown, **how), []
    for wave in thin.waves():
        shown[wave] = sees[wave]
        judged += wave.tolist()
    return np.sort(judged), thin.stand_in


@pytest.mark.parametrize("fold", [1, 2, 3])
@pytest.mark.parametrize("by_cost", [False, True])
def test_the_fewest_and_the_cheapest_stay_whoever_is_left_out(monkeypatch, fold, by_cost):
    monkeypatch.setattr("swarm_mj.designer.candidates.visibility.FIRST_WAVE", 2)
    rng, left_out, solved = np.random.default_rng(fold), 0, 0
    for _ in range(150):
        n, cells = rng.integers(4, 10), rng.integers(2, 7)
        sees = rng.random((n, cells)) < rng.uniform(0.3, 0.9)
        reach = sees | (rng.random((n, cells)) < 0.05)
        cost = rng.integers(1, 4, n).astype(float) if by_cost else np.ones(n)
        kept, stand_in = thinned(sees, reach, fold=fold, cost=cost if by_cost else None)
        assert sorted([*kept, *stand_in]) == list(range(n)) and not set(stand_in.values()) & set(stand_in)
        for j, i in stand_in.items():
            assert (sees[j] <= sees[i]).all() and cost[i] <= cost[j]
        answer = cheapest(sees, cost, fold)
        assert cheapest(sees[kept], cost[kept], fold) == answer
        left_out, solved = left_out + len(stand_in), solved + (answer is not None)
    assert left_out > 50 and solved > 50


def test_those_that_reach_farthest_are_judged_first_and_waves_double():
    reach = np.tril(np.ones((100, 100), dtype=bool))
    blind = Thinning(reach, np.zeros_like(reach))
    waves = list(blind.waves())
    assert np.concatenate(waves).tolist() == list(range(99, -1, -1)) and not blind.stand_in
    assert [len(wave) for wave in waves] == [16, 32, 52]
    kept, stand_in = thinned(reach, reach)
    assert kept.tolist() == list(range(84, 100)) and set(stand_in.values()) == {99}


FAST = ["observation.observer=raycast", "target.cell_size_m=null", "camera.half_angle_deg=6"]
#: Overrides, and the fewest spacecraft that are expected.
CASES = {
    "arrival": (["observation.criterion=arrival", "designer.altitudes_m=[12000, 16000]"], 2),
    "two fold": (["observation.criterion=arrival", "designer.altitudes_m=[12000, 16000]", "designer.fold=2"], 4),
    "releases": (
        [
            "observation.criterion=arrival",
            "designer.releases_s=[0, 60]",
            "mothership.velocity=[0, 0, 40]",
            "mothership.deployer.max_speed_m_s=20",
        ],
        2,
    ),
    "passage in the light": (["observation.interval_s=200", "observation.max_incidence_deg=80"], 1),
    "two targets": (
        [
            "observation.interval_s=200",
            "designer.extra_targets=[{latitude_deg: 0, longitude_deg: 60, half_angle_deg: 10}]",
        ],
        2,
    ),
}


@pytest.mark.parametrize("case", CASES)
def test_flown_candidates_are_thinned_to_the_same_minimum(tmp_path, monkeypatch, case):
    monkeypatch.setenv("SWARM_MJ_CACHE", str(tmp_path))
    every = load_scenario("eros-quick", parse_overrides([*FAST, *CASES[case][0]]))
    few = load_scenario("eros-quick", parse_overrides([*FAST, *CASES[case][0], "designer.thin_from=1"]))
    told = []
    whole, thin = visibility(every), visibility(few, progress=told.append)
    rows = dict(zip(whole.candidates, whole.sees, strict=True))
    assert sorted([*thin.candidates, *(j for j, _ in thin.thinned)]) == sorted(whole.candidates)
    assert all(np.array_equal(rows[c], row) for c, row in zip(thin.candidates, thin.sees, strict=True))
    assert len(thin.thinned) > 5 and all((rows[j] <= rows[i]).all() for j, i in thin.thinned)
    assert not whole.thinned and told == sorted(told) and told[-1] == 1.0
    problems = [
        CoverProblem(sees=v.sees, area=v.area, tolerance_percent=1.0, fold=every.designer.fold) for v in (whole, thin)
    ]
    whole_answer, thin_answer = (solve_exact(problem) for problem in problems)
    assert whole_answer.n_observers == thin_answer.n_observers >= CASES[case][1]
    assert whole_answer.status == thin_answer.status == "optimal"
    # Who stands in is beyond the deployer only for one that is, too.
    beyond = dict(zip(whole.candidates, whole.beyond, strict=True))
    assert all(beyond[j] or not beyond[i] for j, i in thin.thinned)


def test_a_thinned_design_says_how_many_and_the_trade_off_keeps_the_cheap():
    overrides = [*FAST, "observation.interval_s=200", "designer.max_generations=5"]
    scenario = load_scenario("eros-quick", parse_overrides([*overrides, "designer.thin_from=51"]))
    study = study_design(scenario)
    record, n = design_record(study), len(study.visibility.thinned)
    assert record["candidates_thinned"] == n > 5 and record["candidates_count"] == 51 - n
    assert left_out_words(study.visibility).startswith(f"{n} of 51 candidates are left out: {n} seeing no more")
    by_cost = visibility(scenario, costs=True)
    whole = visibility(load_scenario("eros-quick", parse_overrides([*overrides, "designer.thin_from=52"])))
    delta_v = dict(zip(whole.candidates, whole.delta_v, strict=True))
    assert not whole.thinned and not left_out_words(whole)
    assert 0 < len(by_cost.thinned) < n
    assert all(delta_v[i] <= delta_v[j] for j, i in by_cost.thinned)
