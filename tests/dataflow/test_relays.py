"""Elections against exhaustive search."""

from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from swarm_mj.dataflow import relays
from swarm_mj.dataflow.relays import (
    elect_by_delivery,
    k_medoids,
    medoid_cost,
    next_relays,
)
from swarm_mj.errors import MissionError
from swarm_mj.mission.behaviors import elect_medoid

RNG = np.random.default_rng(16)


def distances(r):
    return np.linalg.norm(r[:, None] - r[None], axis=2)


def brute_force(distance, k):
    """Least cost of all sets, summed one by one."""
    n = len(distance)
    return min(sum(min(distance[m, i] for m in chosen) for i in range(n)) for chosen in combinations(range(n), k))


# By positions.


@pytest.mark.parametrize("n", range(1, 9))
def test_medoids_are_the_best_of_all_sets(n):
    for k in range(1, n + 1):
        distance = distances(RNG.normal(size=(n, 3)))
        found = k_medoids(distance, k)
        assert (np.diff(found) > 0).all() and len(found) == k
        assert medoid_cost(distance, found) == pytest.approx(brute_force(distance, k), rel=1e-12, abs=1e-12)


def test_pam_mostly_finds_the_best_set_and_never_less(monkeypatch):
    monkeypatch.setattr(relays, "MOST_HELD", 0)
    part = []
    for seed in range(40):
        distance = distances(np.random.default_rng(seed).normal(size=(8, 3)))
        k = 1 + seed % 4
        part.append(medoid_cost(distance, k_medoids(distance, k)) / brute_force(distance, k))
    assert min(part) > 1 - 1e-9 and np.median(part) < 1 + 1e-9 and max(part) < 1.3


def test_one_medoid_is_the_medoid_also_on_ties():
    square = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    for r in [square, *RNG.normal(size=(50, 12, 3)), *RNG.integers(0, 3, (50, 9, 3)).astype(float)]:
        assert k_medoids(distances(r), 1).tolist() == [elect_medoid(r)]


def test_two_groups_have_a_relay_each_also_by_pam(monkeypatch):
    group = np.array([[0.0, 0, 0], [1, 0, 0], [-1, 0, 0], [0, 1, 0]])
    r = np.vstack((group + [50.0, 0, 0], group))
    assert k_medoids(distances(r), 2).tolist() == [0, 4]
    monkeypatch.setattr(relays, "MOST_HELD", 0)
    assert k_medoids(distances(r), 2).tolist() == [0, 4]


def test_pam_leaves_no_exchange_that_is_better(monkeypatch):
    monkeypatch.setattr(relays, "MOST_HELD", 0)
    distance = distances(RNG.normal(size=(40, 3)))
    found = k_medoids(distance, 4)
    cost = medoid_cost(distance, found)
    for out in found:
        for new in set(range(40)) - set(found.tolist()):
            assert medoid_cost(distance, [*(j for j in found if j != out), new]) >= cost * (1 - 1e-9)
    assert k_medoids(distance, 4).tolist() == found.tolist()


def test_building_up_alone_would_not_do(monkeypatch):
    # The medoid of all stands between the two groups, where neither of two relays belongs.
    r = np.zeros((7, 3))
    r[:, 0] = [-10.0, -10.1, -9.9, 0.0, 10.0, 10.1, 9.9]
    monkeypatch.setattr(relays, "MOST_HELD", 0)
    assert k_medoids(distances(r), 1).tolist() == [3]
    assert k_medoids(distances(r), 2).tolist() == [0, 4]


def test_who_cannot_be_reached_costs_everything_and_is_elected_only_if_need_be():
    distance = distances(np.arange(4.0)[:, None] * [1.0, 0, 0])
    distance[3, :3] = distance[:3, 3] = np.inf
    assert k_medoids(distance, 2).tolist() == [1, 3]
    assert medoid_cost(distance, [1]) == np.inf == medoid_cost(distance, [])
    assert k_medoids(distance, 1).tolist() == [0]


@pytest.mark.parametrize("k", [0, 4])
def test_more_relays_than_spacecraft_are_refused(k):
    with pytest.raises(MissionError, match=rf"data.relays = {k}: must be >= 1 and <= 3"):
        k_medoids(np.zeros((3, 3)), k)
    with pytest.raises(MissionError, match=rf"data.relays = {k}: must be >= 1 and <= 3"):
        elect_by_delivery(lambda chosen: 0.0, [0, 1, 2], k)


# By what is delivered.


def covered(areas):
    """Value of a set: what the union of its members' tiles is worth, as in a map."""
    tiles = RNG.random((len(areas), 30)) < 0.2
    worth = RNG.random(30)
    return lambda chosen: float(worth[tiles[list(chosen)].any(axis=0)].sum())


@pytest.mark.parametrize("n", [3, 6, 8])
def test_the_set_that_delivers_most_is_elected(n):
    value_of = covered(range(n))
    for k in (1, 2, n):
        found = elect_by_delivery(value_of, range(n), k)
        assert value_of(tuple(found)) == max(value_of(chosen) for chosen in combinations(range(n), k))


def test_beyond_a_few_no_exchange_delivers_more():
    value_of, asked = covered(range(14)), []
    found = elect_by_delivery(lambda chosen: asked.append(chosen) or value_of(chosen), range(14), 3)
    best = value_of(tuple(found))
    for out in found:
        for new in set(range(14)) - set(found.tolist()):
            assert value_of((*(j for j in found if j != out), new)) <= best * (1 + 1e-9)
    assert best >= 0.9 * max(value_of(chosen) for chosen in combinations(range(14), 3))
    assert len(asked) == len(set(asked))


def test_equal_values_elect_the_lowest_candidates_and_rounding_decides_nothing():
    assert elect_by_delivery(lambda chosen: 1.0, [7, 2, 5], 2).tolist() == [2, 5]
    assert elect_by_delivery(lambda chosen: 1.0 + 1e-14 * chosen[0], [7, 2, 5], 1).tolist() == [2]
    assert elect_by_delivery(lambda chosen: 1.0 + 1e-14 * chosen[0], range(3, 20), 1).tolist() == [3]
    assert elect_by_delivery(lambda chosen: 0.0, range(3, 20), 2).tolist() == [3, 4]
    assert elect_by_delivery(lambda chosen: 1.0 + 1e-6 * chosen[0], [7, 2, 5], 1).tolist() == [7]


@pytest.mark.parametrize("n", [7, 12])
def test_sets_that_cannot_be_better_are_not_tried(n):
    value_of, asked = covered(range(n)), []
    without = elect_by_delivery(value_of, range(n), 2)
    found = elect_by_delivery(
        lambda chosen: asked.append(chosen) or value_of(chosen),
        range(n),
        2,
        bound_of=lambda chosen: 1.1 * value_of(chosen),
    )
    assert found.tolist() == without.tolist()
    assert len(asked) < len(list(combinations(range(n), 2))) and len(asked) == len(set(asked))
    asked.clear()
    elect_by_delivery(lambda chosen: asked.append(chosen) or 5.0, range(7), 2, bound_of=lambda chosen: 5.0)
    assert asked == [(0, 1)]


# Again and again.

SHARE = st.floats(0.0, 1.0)


@settings(deadline=None)
@given(noise=st.lists(st.floats(-1.0, 1.0), min_size=2, max_size=60), hysteresis=st.floats(0.01, 0.9))
def test_noise_below_the_threshold_changes_nobody(noise, hysteresis):
    # Costs of two sets that differ by noise alone: (1 - a) / (1 + a) > 1 - hysteresis.
    amplitude = 0.99 * hysteresis / (2.0 - hysteresis)
    costs = {0: 100.0, 1: 100.0}
    now = np.array([0])
    for k, x in enumerate(noise):
        costs[k % 2] = 100.0 * (1.0 + amplitude * x)
        better = min(costs, key=costs.get)
        now = next_relays(now, np.array([better]), costs[int(now[0])], costs[better], hysteresis)
        assert now.tolist() == [0]


@settings(deadline=None)
@given(current=st.floats(1e-3, 1e6), candidate=st.floats(0.0, 1e6), hysteresis=SHARE)
def test_a_change_gains_the_part_that_is_asked_for(current, candidate, hysteresis):
    found = next_relays(np.array([0]), np.array([1]), current, candidate, hysteresis)
    if found[0] == 1:
        assert candidate < current and (current - candidate) / current >= hysteresis - 1e-12
    else:
        assert (current - candidate) / current <= hysteresis + 1e-12


def test_who_cannot_go_on_is_replaced_whatever_the_hysteresis():
    assert next_relays(np.array([0]), np.array([1]), np.inf, 5.0, 1.0).tolist() == [1]
    assert next_relays(np.array([0]), np.array([1]), 0.0, 0.0, 0.0).tolist() == [0]
