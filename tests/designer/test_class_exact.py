from itertools import combinations

import numpy as np
import pytest
from scipy.optimize import Bounds, LinearConstraint, milp
from scipy.sparse import lil_array

from swarm_mj.designer import exact
from swarm_mj.designer.class_problem import class_problem
from swarm_mj.designer.exact import solve_budget, solve_exact, without_proof
from swarm_mj.designer.genetic import GeneticSettings, evolve
from swarm_mj.designer.relaxation import violated
from swarm_mj.designer.repair import repair_designs
from swarm_mj.designer.requirements import completed
from swarm_mj.errors import MissionError
from swarm_mj.observation.quality import bounds_of, is_pair, is_varied, mapped, sector_of, usable
from swarm_mj.scenarios.schema_quality import Demand, QualityClass
from tests.designer.synthetic_looks import class_of, random_looks

DEMANDS = {
    "count": ({"looks": 3}, {"pictures": 1}),
    "limited count": ({"looks": 3, "max_gsd_m": 1.2}, {"pictures": 3}),
    "pair": ({"convergence_deg": (30.0, 60.0), "alike_light_deg": 20.0}, {}),
    "sectors": ({"sectors": 3}, {}),
    "all sectors": ({"sectors": 4}, {"pictures": 2, "share": 0.9}),
    "varied light": ({"looks": 4, "light_varied_deg": (20.0, 120.0)}, {"suns": 6}),
    "sides and pair": ({"sectors": 2, "convergence_deg": (20.0, 90.0)}, {"pictures": 1, "share": 0.8}),
}
SHAPE = QualityClass(
    name="own",
    demands=(
        Demand(looks=3, max_gsd_m=1.7),
        Demand(convergence_deg=(20.0, 80.0), alike_light_deg=60.0),
        Demand(emission_deg=(0.0, 40.0), light_varied_deg=(20.0, 90.0)),
    ),
)
CLASSES = {name: (class_of(**demand), how) for name, (demand, how) in DEMANDS.items()} | {"several": (SHAPE, {})}


def instance(name, seed, n_points=8, n_cells=10, tolerance_percent=0.0):
    quality_class, how = CLASSES[name]
    rng = np.random.default_rng(seed)
    looks = random_looks(rng, n_points, n_cells, **how)
    area = rng.uniform(0.5, 2.0, n_cells)
    problem = class_problem(quality_class, looks, n_points, area, tolerance_percent=tolerance_percent)
    return problem, lambda chosen: mapped(quality_class, looks, np.isin(np.arange(n_points), chosen)), looks


def tolerance_of(name, seed):
    """Every other instance allows gaps; all allow what no set maps."""
    problem, maps, _ = instance(name, seed)
    lost = 100.0 - problem.coverable_percent
    return min(lost + (0.01, 12.0)[seed % 2], 99.0)


def fewest_by_enumeration(problem, maps):
    for n in range(1, problem.n_points + 1):
        for chosen in combinations(range(problem.n_points), n):
            missing = problem.area[~maps(list(chosen))].sum() / problem.area.sum()
            if 100.0 * missing <= problem.tolerance_percent + 1e-9:
                return n
    return np.inf


@pytest.mark.parametrize("name", CLASSES)
def test_the_fewest_for_a_class_equal_enumeration_of_all_designs_by_the_rule_of_the_class(name):
    sizes = []
    for seed in range(26):
        problem, maps, _ = instance(name, seed, tolerance_percent=tolerance_of(name, seed))
        if not problem.can_be_covered:  # no set maps any cell
            continue
        expected = fewest_by_enumeration(problem, maps)
        result = solve_exact(problem)
        assert (result.n_observers, result.bound, result.status) == (expected, expected, "optimal")
        there = maps(result.points - 1)
        assert result.covered_percent == pytest.approx(100.0 * problem.area[there].sum() / problem.area.sum(), abs=1e-6)
        sizes.append(expected)
    assert len(sizes) >= 25 and len(set(sizes)) > 1


@pytest.mark.parametrize("name", CLASSES)
def test_a_set_of_candidates_maps_what_the_rule_of_the_class_says(name, rng):
    for seed in range(5):
        problem, maps, _ = instance(name, seed, n_cells=60)
        for size in (0, 1, 3, 5, 8):
            chosen = rng.choice(8, size, replace=False)
            covered = problem.weights[maps(chosen)].sum()
            assert problem.covered_weight(chosen + 1) == covered


def full_model(quality_class, looks, problem):
    """Fewest spacecraft by HiGHS on the model with one variable for every pair of candidates of every face."""
    n, faces = problem.n_points, np.flatnonzero(problem.coverable)
    rows, low = [], []
    width = n + problem.n_faces

    def variable():
        nonlocal width
        width += 1
        return width - 1

    def at_least(terms, least):
        rows.append(terms)
        low.append(least)

    for f in faces:
        y = n + int(f)
        for demand in quality_class.all_demands:
            bounds, keep = bounds_of(demand), usable(demand, looks)
            of_face = [k for k in range(looks.start[f], looks.start[f + 1]) if keep[k]]
            takers = [int(looks.taker[k]) for k in of_face]
            count = {p: float(takers.count(p)) for p in takers}
            at_least({**count, y: -float(demand.looks)}, 0.0)
            sides = {}
            for k, p in zip(of_face, takers, strict=True):
                if (side := int(sector_of(looks, f, k))) >= 0:
                    sides.setdefault(side, set()).add(p)
            seen = {}
            for points in sides.values() if demand.sectors else ():
                s = variable()
                at_least({**dict.fromkeys(points, 1.0), s: -1.0}, 0.0)
                seen[s] = 1.0
            if demand.sectors:
                at_least({**seen, y: -float(demand.sectors)}, 0.0)
            for asked, rule in ((bounds.paired, is_pair), (bounds.varied, is_varied)):
                together = {
                    tuple(sorted((takers[a], takers[b])))
                    for a, b in combinations(range(len(of_face)), 2)
                    if asked and rule(bounds, looks, of_face[a], of_face[b])
                }
                both = {}
                for p, q in together:
                    z = variable()
                    both[z] = 1.0
                    at_least({p: 1.0, z: -1.0}, 0.0)
                    at_least({q: 1.0, z: -1.0}, 0.0)
                if asked:
                    at_least({**both, y: -1.0}, 0.0)
    percent = 100.0 * problem.area / problem.area.sum()
    at_least({n + int(f): percent[f] for f in faces}, 100.0 - problem.tolerance_percent - 1e-7)
    matrix = lil_array((len(rows), width))
    for i, terms in enumerate(rows):
        for j, value in terms.items():
            matrix[i, j] = value
    cost = np.concatenate([np.ones(n), np.zeros(width - n)])
    whole = np.arange(width) < n + problem.n_faces  # of the rest any fraction stands for a whole
    answer = milp(
        cost, constraints=LinearConstraint(matrix.tocsr(), low, np.inf), integrality=whole, bounds=Bounds(0, 1)
    )
    return int(np.rint(answer.fun))


@pytest.mark.parametrize("name", ["count", "pair", "sectors", "varied light", "several"])
def test_the_fewest_for_a_class_equal_those_of_the_full_model_with_a_variable_for_every_pair(name):
    for seed in range(4):
        problem, _, looks = instance(name, seed, n_points=16, n_cells=24)
        tolerance = min(100.0 - problem.coverable_percent + (0.01, 6.0)[seed % 2], 99.0)
        problem, _, looks = instance(name, seed, n_points=16, n_cells=24, tolerance_percent=tolerance)
        result = solve_exact(problem)
        assert (result.n_observers, result.status) == (full_model(CLASSES[name][0], looks, problem), "optimal")


@pytest.mark.parametrize("name", ["pair", "sectors"])
def test_without_time_the_bound_for_a_class_holds_and_no_proof_is_claimed(name):
    for seed in range(4):
        problem, _, _ = instance(name, seed, n_points=14, n_cells=30, tolerance_percent=20.0)
        if not problem.can_be_covered:
            continue
        proven, hurried = solve_exact(problem), solve_exact(problem, time_limit_s=0.0)
        assert problem.is_enough(problem.covered_weight(hurried.points))
        assert hurried.bound <= proven.n_observers <= hurried.n_observers
        assert 1 <= without_proof(problem, None).bound <= proven.n_observers


def test_the_largest_area_of_a_class_for_a_number_of_spacecraft_equals_enumeration():
    for name in ("pair", "several"):
        problem, maps, _ = instance(name, 5, n_cells=14)
        for n in (2, 3):
            areas = [problem.area[maps(list(chosen))].sum() for chosen in combinations(range(8), n)]
            result = solve_budget(problem, n)
            assert result.covered_percent == pytest.approx(100.0 * max(areas) / problem.area.sum(), abs=1e-6)
            assert result.bound == pytest.approx(result.covered_percent, abs=1e-5)


@pytest.mark.parametrize("fold", [1, 2])
@pytest.mark.parametrize("tolerance", [0.0, 4.0])
def test_a_warm_start_and_rows_that_come_as_they_are_broken_change_no_minimum(make_discs, monkeypatch, fold, tolerance):
    for seed in range(6):
        problem = make_discs(seed, n_points=45, radius=0.33, fold=fold, tolerance_percent=tolerance, max_observers=45)
        if not problem.can_be_covered:
            continue
        avoided = np.random.default_rng(seed).random(45) < 0.5
        problem = type(problem)(**{**vars_of(problem), "avoided": avoided})
        monkeypatch.setattr(exact, "AT_ONCE_MOST", 10**9)
        cold = solve_exact(problem)
        monkeypatch.setattr(exact, "AT_ONCE_MOST", 0)
        warm = solve_exact(problem)
        assert (warm.n_observers, warm.status) == (cold.n_observers, "optimal")
        assert avoided[warm.points - 1].sum() == avoided[cold.points - 1].sum()


def vars_of(problem):
    names = ("sees", "area", "tolerance_percent", "max_observers", "fold")
    return {name: getattr(problem, name) for name in names}


def test_evolution_of_designs_for_a_class_comes_near_the_proven_minimum():
    problem, maps, _ = instance("pair", 3, n_points=25, n_cells=40, tolerance_percent=15.0)
    found = evolve(problem, GeneticSettings(population=30, max_generations=20, seed=1))
    assert found.feasible and solve_exact(problem).n_observers <= found.n_observers
    assert 100.0 * problem.area[maps(found.points - 1)].sum() / problem.area.sum() >= 85.0
    assert found.n_observers <= solve_exact(problem).n_observers + 1


@pytest.mark.parametrize("name", CLASSES)
def test_repair_of_a_class_drops_in_order_who_is_not_needed_by_the_rule_of_the_class(name, rng):
    spared = 0
    for seed in range(3):
        lost = 100.0 - instance(name, seed, 12, 40)[0].coverable_percent
        problem, maps, _ = instance(name, seed, 12, 40, tolerance_percent=min(lost + 10.0, 99.0))
        enough, noise = problem.total_weight - problem.slack, 0.5 * rng.random((6, 12))
        genes = np.array([[12 - 2 * k, *rng.permutation(12) + 1] for k in range(6)])
        for before, after, blur in zip(genes, repair_designs(problem, genes, noise), noise, strict=True):
            kept = np.sort(after[1 : 1 + after[0]]) - 1
            assert problem.weights[maps(kept)].sum() >= enough
            fewer = [np.setdiff1d(kept, [j]) for j in kept]
            assert len(kept) == 1 or max(problem.weights[maps(rest)].sum() for rest in fewer) < enough
            if before[0] == 12:  # nothing is added, so that the rule of dropping alone decides
                left = np.arange(12)
                for j in np.argsort((problem.gains + 1.0) * (1.0 - blur), kind="stable"):
                    rest = np.setdiff1d(left, [j])
                    left = rest if len(rest) and problem.weights[maps(rest)].sum() >= enough else left
                assert kept.tolist() == left.tolist()
                spared += 12 - len(left)
    assert spared > 0


def test_a_set_that_is_too_small_is_completed_by_who_adds_most_looks_that_cells_still_lack(rng):
    for seed in range(5):
        problem, _, looks = instance("count", seed, 14, 60)
        q, cell = problem.asked, np.repeat(np.arange(60), np.diff(looks.start))
        sees = np.zeros((14, 60), np.bool_)
        sees[looks.taker, cell] = True
        start, noise, enough = rng.permutation(14)[:seed], 0.5 * rng.random(14), int(0.97 * problem.weights.sum())
        chosen = start.tolist()
        while problem.weights[sees[chosen].sum(axis=0) >= 3].sum() < enough and len(chosen) < 12:
            gains = (sees & (sees[chosen].sum(axis=0) < 3)) @ problem.weights * (1.0 - noise)
            gains[chosen] = 0.0
            chosen.append(int(gains.argmax()))
        found, covered = completed(q, problem.weights, problem.gains, start, 12, enough, noise)
        assert found.tolist() == chosen and len(chosen) > seed
        assert covered == problem.weights[sees[chosen].sum(axis=0) >= 3].sum()


@pytest.mark.parametrize("name", ["pair", "all sectors", "varied light", "several"])
def test_rows_that_a_fractional_design_breaks_hold_for_every_design_by_the_rule_of_the_class(name, rng):
    problem, maps, _ = instance(name, 1)
    designs = np.array([np.isin(np.arange(8), c) for n in range(9) for c in combinations(range(8), n)])
    missed = np.array([~maps(np.flatnonzero(chosen)) for chosen in designs])
    for _ in range(5):
        x = 0.4 * rng.random(8)
        rows = violated(problem.asked, x, np.zeros(10))
        assert len(rows.need) and (rows.matrix @ x < rows.need).all()
        assert ((rows.matrix @ designs.T).T + rows.need * missed[:, rows.cell] >= rows.need).all()


def test_what_no_set_of_candidates_maps_is_told_by_the_demand_that_fails():
    problem, _, _ = instance("limited count", 0, tolerance_percent=0.0, n_points=3)
    assert not problem.can_be_covered
    assert sum(problem.causes().values()) == pytest.approx(100.0 - problem.coverable_percent)
    with pytest.raises(MissionError, match=r"at class own, 100 % is asked for.*% lack looks within the limits"):
        solve_exact(problem)
    unlike, _, _ = instance("pair", 0, n_points=2, n_cells=30)
    assert set(unlike.causes()) >= {"lack convergence in alike light"}
