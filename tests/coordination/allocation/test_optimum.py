"""The optimum equals trying everything; greedy choice keeps its bound, and the bound is what it is said to be."""

import numpy as np
import pytest

from swarm_mj.coordination.allocation.greedy import greedy
from swarm_mj.coordination.allocation.optimum import optimum
from swarm_mj.coordination.allocation.problem import AllocationProblem
from swarm_mj.errors import MissionError
from tests.coordination.allocation.cases import can_be_taken, guarantee, most_by_trying, plain_problem, random_problem


@pytest.mark.parametrize("seed", range(4))
def test_optimum_equals_trying_everything(seed):
    rng, better = np.random.default_rng(seed), 0
    for _ in range(50):
        problem = random_problem(rng)
        best, simple = optimum(problem), greedy(problem)
        assert can_be_taken(problem, best.pictures) and can_be_taken(problem, simple.pictures)
        assert best.value == pytest.approx(most_by_trying(problem), abs=1e-9)
        assert best.proven and best.bound == pytest.approx(best.value, abs=1e-6)
        assert simple.value >= guarantee(problem) * best.value - 1e-9
        better += best.value > simple.value + 1e-9
    assert better > 0  # else the program was never asked anything


def test_greedy_choice_can_lose_nearly_half_and_the_guarantee_says_so():
    # The first agent sees both patches in the only slot, the second only the one that the first takes: it weighs a little more.
    problem = plain_problem([1.0, 1.01], [[[True], [True]], [[False], [True]]], 1, 1)
    assert guarantee(problem) == 0.5
    assert greedy(problem).value == 1.01 and optimum(problem).value == pytest.approx(2.01)


def test_long_slews_lower_the_guarantee_and_are_kept():
    # One agent, slews of two slots: the patch in the middle slot costs both beside it.
    feasible = np.eye(3, dtype=bool)[None]
    problem = plain_problem([1.0, 1.01, 1.0], feasible, 2, 3)
    assert greedy(problem).pictures == (((1, 1),),) and optimum(problem).pictures == (((0, 0), (2, 2)),)
    assert guarantee(problem) == pytest.approx(1 / 3)
    assert guarantee(plain_problem([1.0, 1.01, 1.0], feasible, 3, 3)) == pytest.approx(1 / 3)
    assert guarantee(plain_problem([1.0, 1.01, 1.0], feasible, 1, 3)) == 0.5


def test_slews_count_from_the_earlier_picture_to_the_later():
    feasible = np.array([[[True, False], [False, True]]])
    slew = np.array([[[1, 2], [1, 1]]])
    assert optimum(plain_problem([1.0, 1.0], feasible, slew, 2)).value == 1.0
    assert optimum(plain_problem([1.0, 1.0], feasible, slew.transpose(0, 2, 1), 2)).value == 2.0


def test_a_picture_counts_for_all_that_it_shows_and_a_patch_once():
    shows = np.zeros((1, 2, 2, 3), bool)
    shows[0, 0, 0, [0, 1]] = shows[0, 1, :, [1, 2]] = True
    problem = AllocationProblem(weight=[1.0, 2.0, 4.0], shows=shows, slew=np.ones((1, 2, 2)), budget=[2])
    for found in (greedy(problem), optimum(problem)):
        assert found.value == 7.0 and found.pictures == (((0, 0), (1, 1)),)


def test_a_time_limit_leaves_a_bound_that_holds():
    rng = np.random.default_rng(5)
    problem = plain_problem(rng.random(40), rng.random((6, 40, 20)) < 0.15, rng.integers(1, 5, (6, 40, 40)), 4)
    short = optimum(problem, time_limit_s=0.3)
    assert short.status in ("time limit", "optimal") and greedy(problem).value <= short.value <= short.bound
    assert short.bound <= problem.coverable
    with pytest.raises(MissionError, match="time_limit_s = 0"):
        optimum(problem, time_limit_s=0.0)


@pytest.mark.parametrize("shape", [(0, 2, 3), (2, 0, 3), (2, 3, 0)])
def test_nobody_nothing_and_no_time_are_worth_nothing(shape):
    problem = plain_problem(np.ones(shape[1]), np.ones(shape, bool), 1, 2)
    for solve in (greedy, optimum):
        found = solve(problem)
        assert found.value == 0.0 and found.pictures == ((),) * shape[0]


def test_the_value_is_submodular():
    rng = np.random.default_rng(9)
    problem = random_problem(rng, agents=4, aims=6, slots=5)
    everything = [(a, k, m) for a, m, k in zip(*np.nonzero(problem.possible), strict=True)]

    def value(chosen):
        return problem.value_of(tuple(tuple((k, m) for b, k, m in chosen if b == a) for a in range(problem.n_agents)))

    for _ in range(300):
        order = rng.permutation(len(everything))
        few, many, one = sorted(rng.integers(0, len(order), 3))
        few, many = [everything[i] for i in order[:few]], [everything[i] for i in order[:many]]
        x = everything[order[one]]
        assert value([*few, x]) - value(few) >= value([*many, x]) - value(many) - 1e-12 >= -1e-9
