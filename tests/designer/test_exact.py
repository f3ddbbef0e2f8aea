from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest

from swarm_mj.designer.exact import solve_budget, solve_exact, without_proof
from swarm_mj.designer.problem import CoverProblem
from swarm_mj.designer.reduction import reduce_problem
from swarm_mj.errors import MissionError


def fewest_by_enumeration(problem):
    """Fewest of all sets of points that cover the target, inf where none does."""
    for n in range(1, problem.n_points + 1):
        for chosen in combinations(range(problem.n_points), n):
            missing = problem.area[problem.sees[list(chosen)].sum(axis=0) < problem.fold].sum() / problem.area.sum()
            if 100.0 * missing <= problem.tolerance_percent + 1e-10:
                return n
    return np.inf


VARIANTS = [
    {},
    {"tolerance_percent": 0.0},
    {"tolerance_percent": 5.0},
    {"tolerance_percent": 20.0},
    {"fold": 2, "tolerance_percent": 3.0},
    {"fold": 2},
    {"fold": 3, "tolerance_percent": 30.0},
]


def small_problem(make_discs, seed, variant):
    return make_discs(seed, n_points=9, n_vertices=14, radius=0.5, max_observers=9, **variant)


@pytest.mark.parametrize("variant", VARIANTS, ids=str)
def test_the_proven_minimum_equals_enumeration_of_all_designs(make_discs, variant):
    n_feasible = 0
    for seed in range(12):
        problem = small_problem(make_discs, seed, variant)
        expected = fewest_by_enumeration(problem)
        if np.isinf(expected):
            continue
        n_feasible += 1
        result = solve_exact(problem)
        assert (result.n_observers, result.bound, result.status) == (expected, expected, "optimal")
        assert problem.is_enough(problem.covered_weight(result.points))
        assert len(set(result.points.tolist())) == result.n_observers
    assert n_feasible >= 3


@pytest.mark.parametrize("variant", VARIANTS, ids=str)
def test_of_the_smallest_designs_one_with_the_fewest_avoided_points_is_chosen(make_discs, rng, variant):
    mattered = 0
    for seed in range(8):
        problem = replace(small_problem(make_discs, seed, variant), avoided=rng.random(9) < 0.6)
        n = fewest_by_enumeration(problem)
        if np.isinf(n):
            continue
        designs = [np.array(chosen) for chosen in combinations(range(9), n)]
        counts = [
            problem.avoided[chosen].sum() for chosen in designs if problem.is_enough(problem.covered_weight(chosen + 1))
        ]
        result = solve_exact(problem)
        assert (result.n_observers, result.bound, result.status) == (n, n, "optimal")
        assert problem.avoided[result.points - 1].sum() == min(counts)
        mattered += min(counts) < max(counts)
    assert mattered >= 2


@pytest.mark.parametrize("fold", [1, 2])
def test_the_largest_area_for_a_number_of_spacecraft_equals_enumeration(make_discs, fold):
    for seed in range(6):
        problem = make_discs(seed, n_points=9, n_vertices=14, radius=0.35, fold=fold)
        for n in (1, 2, 3, 4):
            expected = max(problem.covered_percent(np.array(c) + 1) for c in combinations(range(9), n))
            result = solve_budget(problem, n)
            assert result.covered_percent == pytest.approx(expected, abs=1e-6)
            assert result.bound == pytest.approx(expected, abs=1e-5)
            assert 1 <= result.n_observers <= n


def test_where_nothing_can_be_covered_the_largest_area_is_none():
    blind = CoverProblem(sees=np.zeros((3, 4), dtype=bool), area=np.ones(4))
    assert (solve_budget(blind, 2).covered_percent, solve_budget(blind, 2).n_observers) == (0.0, 1)


def test_a_point_that_sees_everything_makes_one_spacecraft_enough(make_discs):
    problem = make_discs(0)
    sees = problem.sees.copy()
    sees[17] = True
    result = solve_exact(CoverProblem(sees=sees, area=problem.area))
    assert (result.n_observers, result.points.tolist(), result.covered_percent) == (1, [18], 100.0)


def test_each_point_that_alone_sees_a_face_is_visited():
    result = solve_exact(CoverProblem(sees=np.eye(12, dtype=bool), area=np.arange(1.0, 13.0)))
    assert result.points.tolist() == list(range(1, 13))


def test_the_tolerance_spends_area_and_not_faces():
    area = np.array([1.0] * 10 + [90.0])
    problem = CoverProblem(sees=np.eye(11, dtype=bool), area=area, tolerance_percent=10.0)
    assert solve_exact(problem).points.tolist() == [11]


@pytest.mark.parametrize(("excess", "expected"), [(0.0, 1), (1e-9, 2)])
def test_a_gap_beyond_the_tolerance_by_less_than_the_solvers_accuracy_is_not_let_pass(excess, expected):
    area = np.array([0.4 + excess, 0.6, 99.0 - excess])
    problem = CoverProblem(sees=np.eye(3, dtype=bool), area=area, tolerance_percent=1.0)
    assert solve_exact(problem).n_observers == expected


def test_with_k_folds_the_loss_of_any_k_minus_one_uncovers_nothing(make_discs):
    for fold in (2, 3):
        problem = make_discs(2, n_points=80, radius=0.45, fold=fold)
        points = solve_exact(problem).points
        assert len(set(points.tolist())) == len(points)
        once = CoverProblem(sees=problem.sees, area=problem.area)
        for lost in combinations(range(len(points)), fold - 1):
            assert once.is_enough(once.covered_weight(np.delete(points, lost)))


def test_too_few_spacecraft_says_how_many_are_needed_and_what_fewer_see():
    problem = CoverProblem(sees=np.eye(6, dtype=bool), area=np.ones(6), max_observers=2)
    with pytest.raises(MissionError, match=r"max_observers = 2.*at most 33\.34 %.*6 are needed"):
        solve_exact(problem)


def test_a_target_that_no_point_sees_says_how_much_can_be_seen():
    with pytest.raises(MissionError, match=r"sees 50\.00 %"):
        solve_exact(CoverProblem(sees=np.array([[True, False]]), area=np.ones(2)))


def test_more_folds_than_points_cannot_be_covered():
    with pytest.raises(MissionError, match=r"3 times.*lower fold"):
        solve_exact(CoverProblem(sees=np.ones((2, 4), dtype=bool), area=np.ones(4), fold=3))


def test_without_time_the_answer_is_a_valid_design_and_claims_no_proof(make_discs):
    problem = make_discs(7, radius=0.2)
    proven = solve_exact(problem)
    hurried = solve_exact(problem, time_limit_s=0.0)
    assert problem.is_enough(problem.covered_weight(hurried.points))
    assert hurried.bound <= proven.n_observers <= hurried.n_observers
    assert hurried.status == ("optimal" if hurried.bound == hurried.n_observers else "time limit")


def test_reduction_leaves_a_smaller_problem(make_discs):
    problem = make_discs(4, n_points=150, radius=0.35)
    reduced = reduce_problem(problem)
    assert len(reduced.points) < 150 and len(reduced.weights) < problem.n_faces
    assert (len(reduced.asked.at), len(reduced.asked.cell)) == (len(reduced.points) + 1, len(reduced.weights))


def test_faces_that_cannot_be_covered_are_taken_from_the_tolerance():
    sees = np.array([[True, True, False], [False, True, False]])
    problem = CoverProblem(sees=sees, area=np.array([50.0, 47.0, 3.0]), tolerance_percent=5.0)
    reduced = reduce_problem(problem)
    assert reduced.slack / problem.total_weight == pytest.approx(0.02)
    assert reduced.points.tolist() == [0]


@pytest.mark.parametrize("fold", [1, 2])
def test_what_is_known_without_a_proof_is_a_design_and_a_bound_that_holds(make_discs, fold):
    for seed in range(10):
        problem = make_discs(seed, n_points=60, radius=0.3, fold=fold, max_observers=40)
        proven, unproven = solve_exact(problem), without_proof(problem, None)
        assert unproven.status == "interrupted"
        assert problem.is_enough(problem.covered_weight(unproven.points))
        assert 1 <= unproven.bound <= proven.n_observers <= unproven.n_observers
