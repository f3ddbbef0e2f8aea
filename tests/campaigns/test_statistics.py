"""Intervals and sensitivities against closed forms and against what they promise."""

import numpy as np
import pytest
from scipy.stats import beta, norm, qmc

from swarm_mj.campaigns import statistics


def test_wilson_is_the_score_interval():
    k, n, z = 7, 40, norm.ppf(0.975)
    p = k / n
    centre = (p + z**2 / (2 * n)) / (1 + z**2 / n)
    half = z / (1 + z**2 / n) * np.sqrt(p * (1 - p) / n + z**2 / (4 * n**2))
    found = statistics.probability(k, n)
    assert (found.value, found.low, found.high) == pytest.approx((p, centre - half, centre + half))


def test_clopper_pearson_is_that_of_beta_quantiles():
    found = statistics.probability(7, 40, "exact")
    assert (found.low, found.high) == pytest.approx((beta.ppf(0.025, 7, 34), beta.ppf(0.975, 8, 33)))
    assert statistics.probability(40, 40, "exact").high == 1.0


def test_no_trial_tells_nothing():
    found = statistics.probability(0, 0)
    assert np.isnan(found.value) and (found.low, found.high) == (0.0, 1.0)


def test_quantile_intervals_hold_the_truth_as_often_as_promised():
    rng = np.random.default_rng(0)
    truth = -np.log(0.05)
    found = [statistics.quantile(rng.exponential(size=200), 0.95) for _ in range(400)]
    hits = np.mean([q.low <= truth <= q.high for q in found])
    assert 0.92 <= hits <= 1.0
    assert np.mean([q.value for q in found]) == pytest.approx(truth, rel=0.03)


def test_a_sample_too_small_for_an_end_says_so():
    assert np.isnan(statistics.quantile(np.arange(10.0), 0.99).high)


def test_the_bootstrapped_mean_agrees_with_the_normal_interval():
    values = np.random.default_rng(1).normal(5.0, 2.0, 400)
    found = statistics.mean(values, np.random.default_rng(0))
    half = 1.96 * values.std(ddof=1) / 20.0
    assert found.value == pytest.approx(values.mean())
    assert (found.value - found.low, found.high - found.value) == pytest.approx((half, half), rel=0.15)


def test_spearman_of_a_bivariate_normal_is_six_over_pi_arcsine_half_r():
    rng, r = np.random.default_rng(2), 0.6
    x = rng.standard_normal(4000)
    y = np.exp(r * x + np.sqrt(1 - r**2) * rng.standard_normal(4000))
    found, p_value = statistics.spearman(x, y)
    assert found.low < 6 / np.pi * np.arcsin(r / 2) < found.high
    assert found.high - found.low < 0.06
    assert p_value < 1e-12
    assert statistics.spearman(x, np.ones(4000)) is None


def test_sobol_indices_of_the_ishigami_function_are_the_analytic_ones():
    def ishigami(x):
        return np.sin(x[:, 0]) + 7.0 * np.sin(x[:, 1]) ** 2 + 0.1 * x[:, 2] ** 4 * np.sin(x[:, 0])

    n, d = 2048, 3
    cube = 2.0 * np.pi * qmc.Sobol(2 * d, rng=np.random.default_rng(0)).random(n) - np.pi
    a, b = cube[:, :d], cube[:, d:]
    members = [ishigami(a), ishigami(b)]
    for k in range(d):
        mixed = a.copy()
        mixed[:, k] = b[:, k]
        members.append(ishigami(mixed))
    first, total = statistics.sobol(np.array(members).T, np.random.default_rng(1))
    assert [e.value for e in first] == pytest.approx([0.3139, 0.4424, 0.0], abs=0.03)
    assert [e.value for e in total] == pytest.approx([0.5576, 0.4424, 0.2437], abs=0.03)
    for estimate, truth in zip(total, (0.5576, 0.4424, 0.2437), strict=True):
        assert estimate.low < truth < estimate.high


def test_a_constant_outcome_has_no_sobol_indices():
    assert statistics.sobol(np.ones((8, 4)), np.random.default_rng(0)) is None


def test_an_index_is_told_where_its_interval_is_narrow():
    told = statistics.index_told
    assert told(statistics.Estimate(0.2, 0.0, 0.5)) and told(statistics.Estimate(0.0, 0.0, 0.0))
    assert not told(statistics.Estimate(0.81, 0.09, 1.58))
    assert not told(statistics.Estimate(0.3, np.nan, np.nan))
