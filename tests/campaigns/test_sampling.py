"""Which runs a campaign has: their seeds, their draws, and the structure of each method's sample."""

import numpy as np
import pytest
from scipy.stats import kstest, qmc

from swarm_mj.campaigns.config import Campaign
from swarm_mj.campaigns.sampling import Sample

UNIT = {"distribution": "uniform", "low": 0.0, "high": 1.0}


def sample(method="monte_carlo", runs=8, d=3, scenarios=("a", "b"), seed=1, laws=None):
    parameters = laws or {f"x.{k}": UNIT for k in range(d)}
    return Sample(
        Campaign(
            name="c", seed=seed, runs=runs, method=method, parameters=parameters,
            scenarios=[{"scenario": "s", "name": name} for name in scenarios],
        )
    )  # fmt: skip


def points(sample_, scenario):
    trials = [sample_.trial(row) for row in range(sample_.rows)]
    return np.array([list(t.values.values()) for t in trials if t.scenario == scenario])


def test_seeds_are_those_of_spawned_children_and_all_different():
    sample_ = sample(runs=200)
    spawned = np.random.SeedSequence(1).spawn(2)[1].spawn(sample_.rows)
    seeds = [sample_.trial(row).seed for row in range(sample_.rows)]
    assert seeds == [int(child.generate_state(1, np.uint64)[0] >> np.uint64(1)) for child in spawned]
    assert len(set(seeds)) == sample_.rows
    assert 0 <= min(seeds) and max(seeds) < 2**63


def test_rows_take_the_scenarios_in_turn():
    trials = [sample().trial(row) for row in range(6)]
    assert [(t.run, t.scenario) for t in trials] == [(0, "a"), (0, "b"), (1, "a"), (1, "b"), (2, "a"), (2, "b")]


@pytest.mark.parametrize("method", ["monte_carlo", "latin_hypercube", "sobol", "saltelli"])
def test_a_row_is_the_same_in_whatever_order_it_is_asked_for(method):
    forward, backward = sample(method), sample(method)
    expected = [forward.trial(row) for row in range(forward.rows)]
    assert [backward.trial(row) for row in reversed(range(backward.rows))] == expected[::-1]
    assert sample(method, seed=2).trial(0).values != expected[0].values


def test_more_monte_carlo_runs_leave_the_first_ones_as_they_were():
    few, many = sample(runs=3), sample(runs=50)
    assert [few.trial(r) for r in range(few.rows)] == [many.trial(r) for r in range(few.rows)]


def test_monte_carlo_draws_are_uniform_and_independent_of_each_other():
    drawn = points(sample(runs=2000, scenarios=("a",)), "a")
    assert min(kstest(drawn[:, k], "uniform").pvalue for k in range(3)) > 1e-3
    assert np.abs(np.corrcoef(drawn.T) - np.eye(3)).max() < 0.08


@pytest.mark.parametrize("scenario", ["a", "b"])
def test_a_latin_hypercube_has_one_point_in_every_slice_of_every_parameter(scenario):
    drawn = points(sample("latin_hypercube", runs=37), scenario)
    for k in range(3):
        assert sorted(np.floor(37 * drawn[:, k]).astype(int)) == list(range(37))


def test_a_sobol_sequence_fills_every_binary_box_evenly():
    drawn = points(sample("sobol", runs=64, d=2, scenarios=("a",)), "a")
    for i, j in ((3, 3), (6, 0), (1, 5)):
        boxes = np.floor(drawn * (2**i, 2**j)).astype(int)
        assert len({tuple(box) for box in boxes}) == 64
    random = np.random.default_rng(0).random((64, 2))
    assert qmc.discrepancy(drawn) < 0.3 * qmc.discrepancy(random)


def test_a_grid_has_every_combination_as_often_as_asked():
    laws = {"x": {"distribution": "choice", "values": [1, 2, 3]}, "y": {**UNIT, "steps": 4}}
    drawn = points(sample("grid", runs=2, laws=laws, scenarios=("a",)), "a")
    combinations, times = np.unique(drawn, axis=0, return_counts=True)
    assert len(combinations) == 12
    assert set(times) == {2}


def test_on_a_grid_the_last_parameter_varies_fastest_and_only_levels_are_kept():
    laws = {
        "x": {**UNIT, "steps": 3000},
        "y": {"distribution": "choice", "values": ["p", "q"]},
        "z": {**UNIT, "steps": 1000},
    }
    sample_ = sample("grid", runs=1, laws=laws, scenarios=("a",))
    assert sample_.rows == 6_000_000
    last = 1.0
    assert sample_.trial(0).values == {"x": 0.0, "y": "p", "z": 0.0}
    assert sample_.trial(999).values == {"x": 0.0, "y": "p", "z": last}
    assert sample_.trial(1000).values == {"x": 0.0, "y": "q", "z": 0.0}
    assert sample_.trial(2000).values == {"x": pytest.approx(1.0 / 2999.0), "y": "p", "z": 0.0}
    assert sample_.trial(5_999_999).values == {"x": last, "y": "q", "z": last}


def test_a_saltelli_group_changes_one_factor_at_a_time_and_the_seed_last():
    sample_ = sample("saltelli", runs=4, d=2, scenarios=("a",))
    assert sample_.rows == 4 * 5
    for k in range(4):
        a, b, first, second, seed = [sample_.trial(5 * k + m) for m in range(5)]
        x = [list(t.values.values()) for t in (a, b, first, second, seed)]
        assert set(x[0]).isdisjoint(x[1])
        assert x[2] == [x[1][0], x[0][1]]
        assert x[3] == [x[0][0], x[1][1]]
        assert x[4] == x[0]
        assert a.seed == first.seed == second.seed != b.seed == seed.seed


def test_a_row_beyond_the_last_is_refused():
    with pytest.raises(IndexError, match="0 to 15"):
        sample().trial(16)
