"""Repair against a plain statement of its rules, with sets and counts, and against brute force."""

from itertools import combinations

import numpy as np
import pytest

from swarm_mj.designer.repair import refill_designs, repair_designs

#: Discs over a patch, see conftest: loose and exact covers, simple and double ones.
CASES = [
    {"tolerance_percent": 0.0},
    {"tolerance_percent": 4.0},
    {"tolerance_percent": 2.0, "fold": 2},
    {"tolerance_percent": 0.0, "fold": 2},
]


def weight_of(problem, points):
    """Weight of the faces that are seen often enough."""
    times = problem.sees[np.array(points, int) - 1].sum(axis=0) if len(points) else np.zeros(problem.n_faces)
    return int(problem.weights[times >= problem.fold].sum())


def repaired_by_the_book(problem, points, noise):
    """Add who sees most of what is missing; take away whose loss costs least, as long as the rest is enough."""
    chosen, enough = [], problem.total_weight - problem.slack
    for p in points:
        if p not in chosen:
            chosen.append(p)
    while weight_of(problem, chosen) < enough and len(chosen) < problem.max_observers:
        missing = problem.sees[np.array(chosen, int) - 1].sum(axis=0) < problem.fold
        gains = (problem.sees & missing) @ problem.weights * (1.0 - noise)
        gains[[p - 1 for p in chosen]] = 0.0
        if gains.max() <= 0.0:
            break
        chosen.append(int(gains.argmax()) + 1)
    least = min(enough, weight_of(problem, chosen))
    while len(chosen) > 1:
        whole = weight_of(problem, chosen)
        losses = [whole - weight_of(problem, chosen[:k] + chosen[k + 1 :]) for k in range(len(chosen))]
        blurred = [
            (loss + 1.0) * (1.0 - noise[p - 1]) if whole - loss >= least else np.inf
            for loss, p in zip(losses, chosen, strict=True)
        ]
        worst = int(np.argmin(blurred))
        if blurred[worst] == np.inf:
            break
        chosen[worst] = chosen[-1]
        chosen.pop()
    return sorted(chosen)


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("blur", [0.0, 0.5])
def test_repair_completes_greedily_and_prunes_what_costs_least(make_discs, rng, case, blur):
    problem = make_discs(3, n_points=60, radius=0.3, max_observers=16, **case)
    genes = rng.integers(1, 61, (12, 17))
    genes[:, 0] = rng.integers(1, 17, 12)
    noise = blur * rng.random((12, 60))
    repaired = repair_designs(problem, genes, noise)
    for before, after, gains in zip(genes, repaired, noise, strict=True):
        assert after[1 : 1 + after[0]].tolist() == repaired_by_the_book(problem, before[1 : 1 + before[0]], gains)


@pytest.mark.parametrize("case", CASES)
def test_no_spacecraft_can_be_taken_from_a_repaired_design_that_covers(make_discs, rng, case):
    problem = make_discs(5, n_points=80, radius=0.3, max_observers=40, **case)
    genes = rng.integers(1, 81, (10, 41))
    genes[:, 0] = 20
    for design in repair_designs(problem, genes, np.zeros((10, 80))):
        points = design[1 : 1 + design[0]].tolist()
        assert problem.is_enough(weight_of(problem, points))
        assert not any(problem.is_enough(weight_of(problem, c)) for c in combinations(points, len(points) - 1))


def test_a_design_that_sees_all_is_cut_down_to_what_is_needed(make_discs):
    problem = make_discs(7, n_points=50, radius=0.35, max_observers=50)
    everyone = np.concatenate([[50], np.arange(1, 51)])[None]
    (design,) = repair_designs(problem, everyone, np.zeros((1, 50)))
    assert 4 <= design[0] < 20


def test_refilling_keeps_the_number_of_spacecraft_and_leaves_out_who_adds_nothing(make_discs, rng):
    problem = make_discs(3, n_points=60, radius=0.2, max_observers=16)
    genes = rng.integers(1, 61, (10, 17))
    genes[:, 0] = rng.integers(1, 17, 10)
    for before, after in zip(genes, refill_designs(problem, genes, np.zeros((10, 60))), strict=True):
        points = after[1 : 1 + after[0]].tolist()
        assert after[0] <= before[0]
        assert weight_of(problem, points) >= weight_of(problem, sorted(set(before[1 : 1 + before[0]].tolist())))
        whole = weight_of(problem, points)
        assert len(points) == 1 or all(weight_of(problem, c) < whole for c in combinations(points, len(points) - 1))
