"""Interquartile means and their intervals, against the definition written out."""

import itertools

import numpy as np
import pytest

from scripts.pages.aggregates import aggregate, interquartile_mean
from swarm_mj.errors import OutputError


def test_the_interquartile_mean_leaves_a_quarter_out_at_either_end():
    assert interquartile_mean(np.array([[9.0, -50.0], [3.0, 1.0], [2.0, 4.0], [1000.0, 6.0]])) == (2 + 3 + 4 + 6) / 4
    # Of five runs of one task the middle three count.
    assert interquartile_mean(np.array([[5.0], [1.0], [2.0], [100.0], [3.0]])) == pytest.approx(10.0 / 3.0)


def test_the_interval_is_that_of_all_ways_to_draw_the_runs_again():
    """Three runs can be drawn in 27 ways: the quantiles of all of them are known without drawing."""
    scores = np.array([[1.0], [2.0], [4.0]])
    means = sorted(np.mean(drawn) for drawn in itertools.product(scores[:, 0], repeat=3))
    found = aggregate(scores)
    assert found.mean == pytest.approx(7.0 / 3.0)
    # Of three scores nothing is left out: a quarter of them is less than one.
    assert found.low == pytest.approx(np.quantile(means, 0.025, method="inverted_cdf"), abs=0.34)
    assert found.high == pytest.approx(np.quantile(means, 0.975, method="inverted_cdf"), abs=0.34)


def test_runs_are_drawn_task_by_task_and_never_across_tasks():
    """Two tasks of constant scores: whatever is drawn, both are there, half and half."""
    assert aggregate(np.array([[0.0, 1.0]] * 4)) == (0.5, 0.5, 0.5)


def test_the_interval_covers_the_mean_of_normal_runs_as_often_as_so_few_runs_allow():
    """The percentile bootstrap of five runs is known to be narrow; of twenty it is nearly as wide as it says."""
    rng = np.random.default_rng(3)
    covered = [
        found.low <= 1.0 <= found.high for found in (aggregate(rng.normal(1.0, 0.3, (20, 1))) for _ in range(200))
    ]
    assert 0.86 < np.mean(covered) < 0.98


def test_scores_that_are_no_table_of_numbers_are_refused():
    for scores in (np.zeros(5), np.array([[1.0, np.nan]]), np.zeros((0, 3))):
        with pytest.raises(OutputError, match=r"shape \(runs, tasks\)"):
            aggregate(scores)
