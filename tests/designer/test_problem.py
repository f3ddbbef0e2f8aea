import re
from itertools import combinations

import numpy as np
import pytest

from swarm_mj.designer.problem import CoverProblem, gene_map, pack, set_weight, weight_table
from swarm_mj.designer.repair import refill_designs, repair_designs
from swarm_mj.errors import MissionError


def covered_area(problem, points):
    """Area seen at least `fold` times, by counting in plain NumPy."""
    return problem.area[problem.sees[np.unique(points) - 1].sum(axis=0) >= problem.fold].sum()


def random_genes(problem, rng, m):
    high = np.concatenate([[problem.max_observers], np.full(problem.max_observers, problem.n_points)])
    return rng.integers(1, high + 1, size=(m, 1 + problem.max_observers))


def two_faces(**parameters):
    return CoverProblem(sees=np.array([[True, False], [False, True]]), area=np.array([1.0, 9.0]), **parameters)


@pytest.mark.parametrize("n_faces", [1, 63, 64, 65, 170])
def test_the_weight_of_a_packed_set_is_the_sum_of_its_weights(rng, n_faces):
    weights = rng.integers(0, 2**45, n_faces)
    rows = rng.random((20, n_faces)) < 0.5
    assert [set_weight(row, weight_table(weights)) for row in pack(rows)] == (rows @ weights).tolist()


@pytest.mark.parametrize("fold", [1, 2, 3, 5])
def test_coverage_of_many_designs_equals_counting_them_one_by_one(make_discs, rng, fold):
    problem = make_discs(1, n_points=25, radius=0.35, fold=fold)
    genes = random_genes(problem, rng, 200)
    expected = [100.0 * covered_area(problem, g[1 : 1 + g[0]]) / problem.area.sum() for g in genes]
    assert problem.evaluate(genes).covered_percent == pytest.approx(expected, abs=1e-9)
    assert [problem.covered_percent(g[1 : 1 + g[0]]) for g in genes] == pytest.approx(expected, abs=1e-9)


def test_only_the_first_genes_are_read(make_discs):
    problem = make_discs(1, max_observers=4)
    value = problem.evaluate(np.array([[2, 5, 9, 1, 1], [2, 9, 5, 30, 40]]))
    assert value.covered_percent[0] == value.covered_percent[1]
    assert value.n_observers.tolist() == [2, 2]


def test_a_point_visited_twice_counts_once():
    design = np.array([[2, 2, 2] + [1] * 18])
    assert two_faces(fold=2).evaluate(design).covered_percent[0] == 0.0
    assert two_faces().evaluate(design).covered_percent[0] == pytest.approx(90.0, abs=1e-12)


def test_the_tolerance_is_of_area_and_not_of_the_number_of_faces():
    design = np.array([[1, 2] + [1] * 19])
    assert two_faces(tolerance_percent=10.0).evaluate(design).feasible[0]
    assert not two_faces(tolerance_percent=9.999).evaluate(design).feasible[0]


def test_a_design_exactly_at_the_tolerance_is_feasible():
    thousand = CoverProblem(sees=np.eye(1000, dtype=bool), area=np.full(1000, 0.1), tolerance_percent=0.1)
    assert thousand.is_enough(thousand.covered_weight(np.arange(1, 1000)))
    assert not thousand.is_enough(thousand.covered_weight(np.arange(1, 999)))


def test_every_feasible_design_is_fitter_than_every_infeasible_one(make_discs, rng):
    problem = make_discs(3, radius=0.5)
    value = problem.evaluate(random_genes(problem, rng, 2000))
    assert 0 < value.feasible.sum() < 2000
    assert value.fitness[value.feasible].max() < value.fitness[~value.feasible].min()
    assert np.array_equal(value.fitness[value.feasible], value.n_observers[value.feasible])
    missing = np.argsort(value.covered_percent[~value.feasible], kind="stable")
    assert np.all(np.diff(value.fitness[~value.feasible][missing]) <= 0.0)


def test_a_gene_map_holds_the_sorted_points_and_repeats_them():
    assert gene_map([9, 4, 7], 7).tolist() == [3, 4, 7, 9, 4, 7, 9, 4]


@pytest.mark.parametrize("noise", [0.0, 0.9])
@pytest.mark.parametrize("fold", [1, 2])
def test_a_repaired_design_covers_and_no_spacecraft_can_be_taken_from_it(make_discs, rng, noise, fold):
    problem = make_discs(5, radius=0.4, tolerance_percent=1.0, fold=fold, max_observers=30)
    repaired = repair_designs(problem, random_genes(problem, rng, 100), noise * rng.random((100, problem.n_points)))
    assert problem.evaluate(repaired).feasible.all()
    for design in repaired:
        points = design[1 : 1 + design[0]]
        for j in range(len(points)):
            assert not problem.is_enough(problem.covered_weight(np.delete(points, j)))


def test_repair_without_room_returns_a_valid_design_that_misses(make_discs, rng):
    problem = make_discs(5, radius=0.2, max_observers=3)
    repaired = repair_designs(problem, random_genes(problem, rng, 50), np.zeros((50, problem.n_points)))
    value = problem.evaluate(repaired)
    assert not value.feasible.any()
    assert value.n_observers.max() == 3


def test_a_refilled_design_is_no_larger_and_covers_no_less(make_discs, rng):
    problem = make_discs(5, radius=0.25)
    genes = random_genes(problem, rng, 100)
    before = problem.evaluate(genes)
    after = problem.evaluate(refill_designs(problem, genes, np.zeros((100, problem.n_points))))
    assert np.all(after.n_observers <= before.n_observers)
    assert np.all(after.covered_percent >= before.covered_percent - 1e-9)


def test_an_uncoverable_target_says_how_much_can_be_seen_and_what_would_do():
    sees = np.array([[True, False, True], [False, False, True]])
    problem = CoverProblem(sees=sees, area=np.array([1.0, 1.0, 2.0]))
    with pytest.raises(MissionError, match=r"sees 75\.00 %.*1 of 3 faces.*tolerance of at least 25\.00 %"):
        problem.require_coverable()
    CoverProblem(sees=sees, area=problem.area, tolerance_percent=25.0).require_coverable()
    with pytest.raises(MissionError, match=r"sees 0\.00 %.*3 of 3 faces fall short; add visiting points$"):
        CoverProblem(sees=np.zeros_like(sees), area=problem.area).require_coverable()


@pytest.mark.parametrize("missing", [0.2, 0.07, 1.1, 0.0004, 100.0 / 3.0, 99.99])
def test_the_tolerance_that_is_told_is_the_least_in_hundredths_that_is_accepted(missing):
    sees, area = np.array([[True] * 3 + [False]]), np.array([50.0, 30.0, 20.0 - missing, missing])
    area[:3] *= (100.0 - missing) / area[:3].sum()
    with pytest.raises(MissionError) as refused:
        CoverProblem(sees=sees, area=area, tolerance_percent=0.0).require_coverable()
    seen, told = map(float, re.search(r"sees (\S+) %.*tolerance of at least (\S+) %", str(refused.value)).groups())
    CoverProblem(sees=sees, area=area, tolerance_percent=told).require_coverable()
    assert not CoverProblem(sees=sees, area=area, tolerance_percent=max(told - 0.01, 0.0)).can_be_covered
    assert seen + told == pytest.approx(100.0)


def test_of_designs_that_miss_too_much_the_one_that_misses_less_is_fitter(make_discs, rng):
    problem = make_discs(4, n_points=60, radius=0.2, max_observers=5)
    genes = rng.integers(1, 61, (50, 6))
    genes[:, 0] = rng.integers(1, 6, 50)
    value = problem.evaluate(genes)
    assert not value.feasible.any() and value.fitness.min() > 6.0
    assert np.array_equal(np.argsort(-value.covered_percent, kind="stable"), np.argsort(value.fitness, kind="stable"))
    missing = 100.0 - problem.tolerance_percent - value.covered_percent
    assert value.fitness - 6.0 == pytest.approx(missing / 100.0, abs=1e-9)


@pytest.mark.parametrize("fold", [1, 2])
@pytest.mark.parametrize("most", [1, 2, 3])
def test_whoever_is_in_a_design_that_is_enough_is_of_use(rng, most, fold):
    left_out = 0
    for _ in range(30):
        sees, area = rng.random((8, 12)) < rng.uniform(0.2, 0.7, (8, 1)), rng.uniform(0.1, 1.0, 12)
        problem = CoverProblem(sees=sees, area=area, tolerance_percent=40, max_observers=most, fold=fold)
        designs = [np.array(d) for n in range(1, most + 1) for d in combinations(range(8), n)]
        share = [area[sees[d].sum(axis=0) >= fold].sum() / area.sum() for d in designs]
        needed = {j for d, reached in zip(designs, share, strict=True) if reached >= 0.6 for j in d.tolist()}
        assert needed <= set(np.flatnonzero(problem.of_use).tolist())
        left_out += int((~problem.of_use).sum())
        if most == 1:
            assert problem.of_use.tolist() == (sees @ area / area.sum() >= 0.6).tolist()
    assert left_out > 0 or most > 2
