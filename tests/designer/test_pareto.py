from itertools import combinations

import numpy as np
import pytest
from scipy.optimize import Bounds, LinearConstraint, milp

from swarm_mj.designer.exact import solve_budget
from swarm_mj.designer.pareto import dominated, pareto_front

QUICK = {"population": 100, "generations": 60}


def values(front):
    return np.column_stack([front.n_observers, front.delta_v, front.uncovered_percent])


def front_by_enumeration(problem, delta_v):
    """All non-dominated (N, delta-v, uncovered), from every set of points, by comparing every pair in NumPy."""
    designs = [
        np.array(c) for n in range(1, problem.max_observers + 1) for c in combinations(range(problem.n_points), n)
    ]
    rows = np.array(
        [
            (len(c), delta_v[c].sum(), 100.0 * problem.area[~problem.sees[c].any(axis=0)].sum() / problem.area.sum())
            for c in designs
        ]
    ).round(9)
    kept = [r for r in rows if not np.any(np.all(rows <= r, axis=1) & np.any(rows < r, axis=1))]
    return {tuple(r) for r in kept}


def least_delta_v(problem, delta_v, n, uncovered_percent):
    """A lower bound of the delta-v of at most n spacecraft that leave so much uncovered, as a program."""
    points, faces = problem.sees.shape
    share = problem.area / problem.area.sum()
    program = milp(
        np.concatenate([delta_v, np.zeros(faces)]),
        constraints=[
            LinearConstraint(np.hstack([problem.sees.T.astype(float), np.eye(faces)]), 1.0, np.inf),
            LinearConstraint(np.concatenate([np.zeros(points), share]), 0.0, 0.01 * uncovered_percent + 1e-9),
            LinearConstraint(np.concatenate([np.ones(points), np.zeros(faces)]), 0.0, n),
        ],
        bounds=Bounds(0.0, 1.0),
        integrality=np.ones(points + faces),
    )
    return program.mip_dual_bound


@pytest.mark.parametrize("seed", range(4))
def test_on_small_problems_the_front_is_that_of_all_designs(make_discs, seed):
    problem = make_discs(seed, n_points=10, n_vertices=40, radius=0.35, max_observers=10)
    delta_v = 40.0 + 20.0 * np.random.default_rng(seed).random(10)
    front = pareto_front(problem, delta_v, **QUICK)
    assert {tuple(r) for r in values(front).round(9)} == front_by_enumeration(problem, delta_v)


def test_the_values_of_a_front_belong_to_its_designs(make_discs, rng):
    problem, delta_v = make_discs(6, radius=0.3), None
    delta_v = rng.uniform(40.0, 60.0, problem.n_points)
    front = pareto_front(problem, delta_v, **QUICK)
    for n, spent, uncovered, points in zip(*values(front).T, front.points, strict=True):
        assert n == len(points) == len(set(points.tolist()))
        assert spent == pytest.approx(delta_v[points - 1].sum())
        assert uncovered == pytest.approx(100.0 - problem.covered_percent(points), abs=1e-9)
    assert not dominated(values(front), values(front)).any()


def test_no_design_of_the_front_is_better_than_the_proof_and_most_attain_it(make_discs, rng):
    problem = make_discs(9, n_points=40, n_vertices=60, radius=0.35, max_observers=6)
    delta_v = rng.uniform(40.0, 60.0, 40)
    front = pareto_front(problem, delta_v)
    ratios = []
    for n, spent, uncovered in values(front)[::4]:
        ratios.append(spent / least_delta_v(problem, delta_v, n, uncovered))
    assert min(ratios) > 1.0 - 1e-6
    assert np.median(ratios) < 1.0 + 1e-6


def test_from_proven_designs_the_front_holds_the_largest_area_of_every_number(make_discs, rng):
    problem = make_discs(9, radius=0.3, max_observers=6)
    proven = [solve_budget(problem, n) for n in range(1, 7)]
    front = pareto_front(problem, rng.uniform(40.0, 60.0, problem.n_points), **QUICK, known=[p.points for p in proven])
    for n, best in enumerate(proven, start=1):
        least = front.uncovered_percent[front.n_observers <= n].min()
        assert least == pytest.approx(100.0 - best.covered_percent, abs=1e-6)


def test_the_same_seed_gives_the_same_front(make_discs, rng):
    problem = make_discs(3)
    delta_v = rng.uniform(40.0, 60.0, problem.n_points)
    first, second = (pareto_front(problem, delta_v, population=40, generations=10) for _ in range(2))
    assert np.array_equal(values(first), values(second))
    assert first.explored == second.explored


def test_points_that_cost_nothing_are_allowed_and_two_folds_are_counted(make_discs):
    problem = make_discs(3, n_points=12, n_vertices=20, radius=0.5, fold=2, max_observers=6)
    front = pareto_front(problem, np.zeros(12), population=40, generations=20)
    assert np.all(front.delta_v == 0.0)
    for points, uncovered in zip(front.points, front.uncovered_percent, strict=True):
        twice = problem.sees[points - 1].sum(axis=0) >= 2
        assert uncovered == pytest.approx(100.0 * problem.area[~twice].sum() / problem.area.sum(), abs=1e-9)


def test_a_design_dominates_only_where_it_is_nowhere_worse_and_somewhere_better():
    rows = np.array([[1.0, 1.0], [1.0, 1.0], [1.0, 2.0], [0.5, 3.0]])
    assert dominated(rows, rows).tolist() == [False, False, True, False]
