import dataclasses

import numpy as np
import pytest

from swarm_mj.designer.exact import solve_exact
from swarm_mj.designer.genetic import GeneticSettings, evolve
from swarm_mj.designer.problem import CoverProblem
from swarm_mj.errors import MissionError

OPERATORS = ("plain", "repair")


def geometric_instances(make_discs, n):
    """The first n random instances whose proven minimum is 4 to 13, with the proof."""
    found, seed = [], 0
    while len(found) < n:
        problem, seed = make_discs(seed), seed + 1
        try:
            proof = solve_exact(problem)
        except MissionError:  # this sample of points leaves a corner of the patch unseen
            continue
        if 4 <= proof.n_observers <= 13:
            found.append((seed, problem, proof))
    return found


def gaps(instances, **settings):
    """Spacecraft beyond the proven minimum, per instance."""
    found = []
    for seed, problem, proof in instances:
        result = evolve(problem, GeneticSettings(seed=seed, **settings))
        assert result.feasible and problem.is_enough(problem.covered_weight(result.points))
        found.append(result.n_observers - proof.n_observers)
    return np.array(found)


def test_on_geometric_instances_evolution_never_beats_the_proof_and_equals_it_in_95_percent(make_discs):
    instances = geometric_instances(make_discs, 25)
    assert all(50 <= problem.n_points <= 200 and 160 <= problem.n_faces <= 180 for _, problem, _ in instances)
    minima = {proof.n_observers for _, _, proof in instances}
    assert minima >= set(range(4, 12))
    gap = gaps(instances, patience=15)
    assert gap.min() >= 0
    assert np.mean(gap == 0) >= 0.95


@pytest.mark.slow
def test_plain_operators_rarely_reach_the_minimum_that_repair_reaches(make_discs):
    instances = geometric_instances(make_discs, 3)
    plain, repair = gaps(instances, operators="plain"), gaps(instances, patience=15)
    assert plain.min() >= 0 and repair.min() >= 0
    assert np.mean(plain == 0) < 0.5 < 0.95 <= np.mean(repair == 0)


@pytest.mark.parametrize("operators", OPERATORS)
def test_the_same_seed_gives_the_same_run_and_another_seed_another(make_discs, operators):
    problem = make_discs(11, radius=0.2)
    settings = GeneticSettings(operators=operators, max_generations=6, seed=3)
    first, second = evolve(problem, settings), evolve(problem, settings)
    other = evolve(problem, dataclasses.replace(settings, seed=4))
    assert np.array_equal(first.genes, second.genes)
    assert np.array_equal(first.history.mean, second.history.mean)
    assert not np.array_equal(first.history.mean, other.history.mean)


@pytest.mark.parametrize("operators", OPERATORS)
def test_best_and_mean_fitness_never_get_worse(make_discs, operators):
    history = evolve(make_discs(12), GeneticSettings(operators=operators, max_generations=40)).history
    assert np.all(np.diff(history.best) <= 0.0)
    assert np.all(np.diff(history.mean) <= 1e-12)
    assert np.all(history.best <= history.mean)


@pytest.mark.parametrize("operators", OPERATORS)
def test_every_evaluated_design_is_counted_once(make_discs, monkeypatch, operators):
    evaluated = []
    evaluate = CoverProblem.evaluate
    monkeypatch.setattr(
        CoverProblem, "evaluate", lambda self, genes: evaluated.append(len(genes)) or evaluate(self, genes)
    )
    result = evolve(make_discs(13), GeneticSettings(operators=operators, max_generations=8, patience=20, population=30))
    assert result.explored == sum(evaluated[:-1])  # the last call is the report's own
    assert result.generations == 8 and len(result.history.explored) == 9
    assert result.history.explored.tolist() == np.cumsum(evaluated[:-1]).tolist()


@pytest.mark.parametrize("operators", OPERATORS)
def test_a_run_as_long_as_the_papers_explores_as_many_designs(make_discs, operators):
    problem = make_discs(
        11, n_points=200, radius=0.17
    )  # so many designs that the first population holds no design twice
    result = evolve(problem, GeneticSettings(operators=operators, max_generations=67, patience=67))
    assert (result.explored, result.generations, result.stopped_by) == (6800, 67, "max_generations")


def test_the_selected_gene_map_reads_as_the_papers_figure_8(make_discs):
    result = evolve(make_discs(14), GeneticSettings(max_generations=5))
    assert result.genes[0] == result.n_observers == len(result.genes) - 1
    assert result.genes[1:].tolist() == sorted(set(result.points.tolist()))


def test_patience_stops_the_run_that_many_generations_after_the_last_improvement(make_discs):
    result = evolve(make_discs(12), GeneticSettings(patience=7))
    assert result.stopped_by == "patience"
    assert result.generations == np.argmin(result.history.best) + 7


def test_where_one_point_sees_everything_evolution_finds_it(make_discs):
    sees = np.concatenate(
        [make_discs(0, n_points=60).sees, np.ones((1, make_discs(0, n_points=60).n_faces), dtype=bool)]
    )
    result = evolve(CoverProblem(sees=sees, area=np.ones(sees.shape[1])))
    assert result.genes.tolist() == [1, 61]


def test_where_no_new_design_can_be_bred_the_run_stops():
    only_two = CoverProblem(sees=np.ones((2, 3), dtype=bool), area=np.ones(3))
    result = evolve(only_two)
    assert result.n_observers == 1
    assert (result.explored, result.generations, result.stopped_by) == (2, 1, "no new designs")


@pytest.mark.parametrize("operators", OPERATORS)
def test_a_single_visiting_point_is_a_design(operators):
    problem = CoverProblem(sees=np.ones((1, 3), dtype=bool), area=np.ones(3))
    assert evolve(problem, GeneticSettings(operators=operators)).genes.tolist() == [1, 1]


@pytest.mark.parametrize("fold", [2, 3])
def test_k_fold_designs_stay_near_the_proof_and_survive_a_loss(make_discs, fold):
    problem = make_discs(2, n_points=80, radius=0.45, fold=fold)
    result, proof = evolve(problem, GeneticSettings(patience=15)), solve_exact(problem)
    assert proof.n_observers <= result.n_observers <= proof.n_observers + 1
    once = CoverProblem(sees=problem.sees, area=problem.area)
    assert all(once.is_enough(once.covered_weight(np.delete(result.points, j))) for j in range(result.n_observers))


@pytest.mark.parametrize("operators", OPERATORS)
def test_too_few_spacecraft_end_in_the_best_infeasible_design(operators):
    problem = CoverProblem(sees=np.eye(6, dtype=bool), area=np.arange(1.0, 7.0), max_observers=4)
    result = evolve(problem, GeneticSettings(operators=operators, seed=1))
    assert not result.feasible
    assert result.points.tolist() == [3, 4, 5, 6]
    assert result.history.best[-1] > problem.max_observers


def test_an_uncoverable_target_is_refused():
    with pytest.raises(MissionError, match=r"sees 50\.00 %"):
        evolve(CoverProblem(sees=np.array([[True, False]]), area=np.ones(2)))
