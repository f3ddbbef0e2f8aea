"""After a loss: what was taken stays, the others cover the hole as well as can be, and a repair is never worse than none."""

from functools import partial

import numpy as np
import pytest

from swarm_mj.coordination.allocation.auction import cbba
from swarm_mj.coordination.allocation.greedy import greedy
from swarm_mj.coordination.allocation.losses import after_loss, reallocate
from swarm_mj.coordination.allocation.optimum import optimum
from swarm_mj.coordination.allocation.problem import allocation_of, plain_problem
from swarm_mj.errors import MissionError
from tests.coordination.allocation.cases import most_by_trying, random_graph, random_problem


def random_loss(rng):
    """A plan, one who is lost in it, and what is flown of it without a repair."""
    problem = random_problem(rng, agents=3, aims=5, slots=5)
    plan, slot, lost = greedy(problem), int(rng.integers(0, 6)), np.arange(3) == rng.integers(3)
    flown = tuple(tuple(p for p in taken if p[0] < slot or not lost[a]) for a, taken in enumerate(plan.pictures))
    return problem, plan, slot, lost, flown


@pytest.mark.parametrize("seed", range(2))
def test_a_repair_is_the_best_of_all_that_go_on_from_what_is_taken(seed):
    rng, gained = np.random.default_rng(seed), 0
    for _ in range(40):
        problem, plan, slot, lost, flown = random_loss(rng)
        taken = tuple(tuple(p for p in of if p[0] < slot) for of in plan.pictures)
        anew = reallocate(problem, plan, slot, lost, by=optimum, keep=False)
        assert anew.value == pytest.approx(most_by_trying(problem, taken, slot, lost), abs=1e-9)
        assert anew.bound == pytest.approx(anew.value, abs=1e-6)
        beside = reallocate(problem, plan, slot, lost, by=optimum)
        assert beside.value == pytest.approx(most_by_trying(problem, flown, slot, lost), abs=1e-9)
        assert anew.value >= beside.value - 1e-9 and beside.value >= problem.value_of(flown)
        gained += beside.value > problem.value_of(flown)
    assert gained > 3


def test_the_auction_repairs_as_greedy_choice_does_and_keeps_what_is_started():
    rng = np.random.default_rng(7)
    for _ in range(40):
        problem, plan, slot, lost, flown = random_loss(rng)
        by_messages = partial(cbba, links=random_graph(rng, 3, more=1.0), working=~lost)
        for keep in (True, False):
            repaired = reallocate(problem, plan, slot, lost, by=by_messages, keep=keep)
            assert repaired.pictures == reallocate(problem, plan, slot, lost, keep=keep).pictures
            for agent, taken in enumerate(repaired.pictures):
                assert {p for p in taken if p[0] < slot} == {p for p in plan.pictures[agent] if p[0] < slot}
                assert not lost[agent] or taken == flown[agent]
                assert not keep or set(flown[agent]) <= set(taken)


def test_the_hole_is_covered_in_time_and_not_when_it_is_too_late():
    # The first agent takes patch 0 in slot 0; the second is to take patch 1 in slot 2, which the first could do as well.
    can = np.zeros((2, 2, 3), bool)
    can[0, 0, 0] = can[0, 1, 2] = can[1, 1, 2] = True
    for slew, budget, slot, value in [(2, 2, 1, 3.0), (2, 2, 3, 2.0), (3, 2, 1, 2.0), (2, 1, 1, 2.0)]:
        problem = plain_problem([2.0, 1.0], can, slew, [budget, 1])
        plan = allocation_of(problem, (((0, 0),), ((2, 1),)))
        assert plan.value == 3.0
        assert reallocate(problem, plan, slot, [False, slot < 3]).value == (value if slot < 3 else 3.0)
        assert reallocate(problem, plan, slot, [True, True]).value == (2.0 if slot < 3 else 3.0)


def test_what_the_lost_had_seen_can_be_lost_with_them():
    problem = plain_problem([1.0], np.ones((2, 1, 2), bool), 1, 1)
    plan = greedy(problem)
    assert plan.pictures == (((0, 0),), ())
    assert reallocate(problem, plan, 1, [True, False]).pictures == plan.pictures
    again = reallocate(problem, plan, 1, [True, False], data_lost=True)
    assert again.pictures == ((), ((1, 0),)) and again.who.tolist() == [1]
    assert reallocate(problem, plan, 2, [True, False], data_lost=True).value == 0.0
    assert reallocate(problem, plan, 1, True, data_lost=True).value == 0.0


def test_what_is_seen_counts_no_more_and_what_does_not_fit_is_refused():
    problem = plain_problem([1.0, 2.0], np.ones((1, 2, 3), bool), 2, 3)
    rest = after_loss(problem, 1, seen=[False, True], fixed=(((0, 1),),))
    assert rest.weight.tolist() == [1.0, 0.0] and rest.budget.tolist() == [2]
    assert np.argwhere(rest.possible[0]).tolist() == [[0, 2]]
    for given, said in [
        ({"slot": 4}, "slot = 4"),
        ({"slot": 0, "seen": [True]}, "seen: shape"),
        ({"slot": 0, "lost": [True, False]}, "lost: shape"),
        ({"slot": 2, "fixed": (((0, 0), (1, 1)),)}, "needs 2 slots"),
    ]:
        with pytest.raises(MissionError, match=said):
            after_loss(problem, **given)
