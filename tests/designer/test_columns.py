from itertools import combinations, product

import numpy as np
import pytest

import swarm_mj as sm
from swarm_mj.cli.main import main
from swarm_mj.coordination.allocation.problem import AllocationProblem, in_conflict
from swarm_mj.designer.columns import fewest_sweeps
from swarm_mj.errors import MissionError, ScenarioError


def random_paths(seed, n_paths=4, n_aims=3, n_slots=3, n_patches=7):
    rng = np.random.default_rng(seed)
    return AllocationProblem(
        weight=rng.uniform(0.5, 2.0, n_patches),
        shows=rng.random((n_paths, n_aims, n_slots, n_patches)) < 0.28,
        slew=rng.integers(1, 3, (n_paths, n_aims, n_aims)),
        budget=np.full(n_paths, 2),
    )


def sweeps_of(problem, path):
    """All sets of patches that a spacecraft on a path can show, by trying all its pictures."""
    pictures = list(product(range(problem.n_slots), range(problem.n_aims)))
    for n in range(problem.budget[path] + 1):
        for taken in combinations(pictures, n):
            apart = all(not in_conflict(problem.slew, path, *one, *other) for one, other in combinations(taken, 2))
            if apart:
                yield problem.shown_by(tuple(taken if a == path else () for a in range(problem.n_agents)))


def fewest_by_enumeration(problem, slack):
    shown = [np.unique(list(sweeps_of(problem, path)), axis=0) for path in range(problem.n_agents)]
    for n in range(1, problem.n_agents + 1):
        for paths in combinations(range(problem.n_agents), n):
            for sweeps in product(*(shown[path] for path in paths)):
                if problem.weight[~np.logical_or.reduce(sweeps)].sum() <= slack * (1.0 + 1e-9):
                    return n
    return None


@pytest.mark.parametrize("tolerance_percent", [0.0, 15.0])
def test_designs_of_paths_and_sweeps_lie_between_their_bound_and_the_fewest_of_all(tolerance_percent):
    proven = 0
    for seed in range(8):
        problem = random_paths(seed)
        fewest = fewest_by_enumeration(problem, tolerance_percent / 100.0 * problem.weight.sum())
        try:
            design = fewest_sweeps(problem, tolerance_percent)
        except MissionError:  # greedily planned paths do not show enough
            continue
        assert design.bound <= fewest <= len(design.columns)
        assert len({column.path for column in design.columns}) == len(design.columns)
        assert design.covered_percent >= 100.0 - tolerance_percent - 1e-6
        for column in design.columns:
            assert any(np.array_equal(column.shows, shown) for shown in sweeps_of(problem, column.path))
        proven += design.proven
    assert proven >= 4


def test_what_no_paths_show_is_told():
    dark = AllocationProblem(
        weight=np.ones(4), shows=np.zeros((2, 1, 1, 4)), slew=np.ones((2, 1, 1)), budget=np.ones(2)
    )
    with pytest.raises(MissionError, match=r"100 % of the target stays unseen.*larger tolerance"):
        fewest_sweeps(dark, 1.0)


def test_a_scenario_is_designed_for_sweeps_and_its_flight_sees_what_they_show(capsys):
    found = sm.design_sweeps("bennu-map", {"designer.tolerance_percent": 5})
    assert found.proven and len(found.points) == 1 and found.covered_percent >= 95.0
    flown = sm.fly(found.scenario)
    assert flown.summary["picture_plan"]["planned_percent"] >= 95.0
    assert flown.coverage.percent >= 90.0
    assert main(["design", "bennu-map", "--sweeps", "--set", "designer.tolerance_percent=5"]) == 0
    said = capsys.readouterr().out
    assert f"1 spacecraft, proven, visiting {found.points[0]}" in said
    assert f"--set behavior.name=planned_sweep --set 'design.visiting_points=[{found.points[0]}]'" in said


def test_what_sweeps_know_nothing_of_is_refused():
    with pytest.raises(ScenarioError, match="designer.quality_class: must be left out"):
        sm.design_sweeps("bennu-map", {"designer.quality_class": "stereo"})
