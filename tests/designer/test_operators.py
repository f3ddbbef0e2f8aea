"""What the genetic algorithm is made of, against counts and closed forms."""

import numpy as np
import pytest
from pymoo.core.population import Population

from swarm_mj.designer.genetic import (
    FORGET_RATE,
    FitnessTournament,
    ForgetMutation,
    GeneMapProblem,
    RandomGeneMaps,
    UniqueDesigns,
)


@pytest.fixture
def problem(make_discs):
    return GeneMapProblem(make_discs(3, n_points=40, max_observers=6))


def test_the_fitter_of_two_wins_so_often_as_drawing_two_with_replacement_says(rng):
    n, draws = 8, 40_000
    fitness = rng.permutation(n).astype(float)
    pop = Population.new("X", np.zeros((n, 3)), "F", fitness[:, None])
    winners = FitnessTournament().do(None, pop, draws // 2, 2, to_pop=False, random_state=rng)
    wins = np.bincount(fitness[np.ravel(winners)].astype(int), minlength=n) / draws
    # Of rank k: both draws at k or behind, less both behind it.
    behind = (n - np.arange(n)) / n
    assert wins == pytest.approx(behind**2 - (behind - 1 / n) ** 2, abs=4 * 0.5 / np.sqrt(draws))


def test_designs_that_visit_the_same_points_in_another_order_are_one():
    genes = np.array([[2, 5, 7, 1], [2, 7, 5, 9], [2, 5, 8, 1], [3, 5, 7, 1], [3, 1, 7, 5]])
    kept = UniqueDesigns().do(Population.new("X", genes))
    assert kept.get("X").tolist() == genes[[0, 2, 3]].tolist()
    others = Population.new("X", np.array([[2, 8, 5, 4]]))
    assert UniqueDesigns().do(Population.new("X", genes), others).get("X").tolist() == genes[[0, 3]].tolist()


def test_random_gene_maps_fill_their_domains_and_forgetting_replaces_its_share_of_points(problem, rng):
    genes = RandomGeneMaps()(problem, 4000, random_state=rng).get("X")
    assert (genes[:, 0].min(), genes[:, 0].max(), genes[:, 1:].min(), genes[:, 1:].max()) == (1, 6, 1, 40)
    assert genes[:, 1:].mean() == pytest.approx(20.5, abs=0.3)
    forgotten = ForgetMutation()(problem, Population.new("X", genes), random_state=rng).get("X")
    assert np.array_equal(forgotten[:, 0], genes[:, 0])
    # One replacement in forty names the same point again.
    assert (forgotten[:, 1:] != genes[:, 1:]).mean() == pytest.approx(FORGET_RATE * 39 / 40, abs=0.01)
