"""Annealed plans: they can be flown, are no worse than greedy choice and no better than the optimum, and mostly reach it."""

from dataclasses import replace

import numpy as np
import pytest

from swarm_mj.coordination.allocation.annealing import annealed
from swarm_mj.coordination.allocation.greedy import greedy
from swarm_mj.coordination.allocation.optimum import optimum
from swarm_mj.coordination.replanning import planned_together

from .cases import can_be_taken, most_by_trying, random_problem


def test_annealed_plans_can_be_taken_and_mostly_are_the_best():
    best = 0
    for seed in range(60):
        problem = random_problem(np.random.default_rng(seed))
        start = greedy(problem)
        found = annealed(problem, start.pictures, np.random.default_rng(0), moves=3000)
        assert can_be_taken(problem, found)
        value, most = problem.value_of(found), most_by_trying(problem)
        assert start.value - 1e-12 <= value <= most + 1e-12
        best += value > most - 1e-9
    assert best >= 57


def test_most_pictures_of_all_together_bind_every_planner():
    for seed in range(30):
        problem = replace(random_problem(np.random.default_rng(seed), agents=2, slots=4), most=2)
        # Whoever takes one and two, or none and two: the optimum of two pictures is the best of these budgets.
        shares = [np.minimum(problem.budget, split) for split in ((2, 0), (1, 1), (0, 2))]
        most = max(most_by_trying(replace(problem, most=None, budget=budget)) for budget in shares)
        exact = optimum(problem)
        assert exact.value == pytest.approx(most) and exact.bound >= most - 1e-9
        for pictures in (
            exact.pictures,
            greedy(problem).pictures,
            annealed(problem, greedy(problem).pictures, np.random.default_rng(1), moves=2000),
        ):
            assert sum(map(len, pictures)) <= 2 and can_be_taken(problem, pictures)
            assert problem.value_of(pictures) <= most + 1e-9


def test_a_plan_is_never_above_its_bound_and_the_same_every_time():
    for seed in range(5):
        problem = random_problem(np.random.default_rng(seed), agents=3, aims=6, slots=5)
        first, again = (planned_together(problem, 5.0) for _ in range(2))
        assert first.value <= first.bound and first.pictures == again.pictures
        assert first.bound >= most_by_trying(problem) - 1e-9
