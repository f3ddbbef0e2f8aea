"""Many seeds flown together, and what their returns say."""

import numpy as np
import pytest
from swarm_mj.envs.policies.baselines import POLICIES, fly
from swarm_mj.envs.policies.evaluation import fly_seeds, interval


def test_seeds_flown_together_give_the_returns_of_single_episodes(roles):
    def act(observations):
        return np.array([POLICIES["sweep"](roles.task, row) for row in observations])

    flown = fly_seeds(act, [8, 3, 5], threads=2)
    alone = [fly(roles, POLICIES["sweep"], seed) for seed in (8, 3, 5)]
    assert np.allclose(flown.total, [outcome.total_reward for outcome in alone], rtol=0.0, atol=1e-9)
    assert np.array_equal(flown.coverage_percent, [outcome.coverage_percent for outcome in alone])
    assert np.array_equal(flown.delivered_bit, [outcome.delivered_bit for outcome in alone])


def test_the_interval_covers_the_true_mean_nineteen_times_in_twenty():
    rng = np.random.default_rng(0)
    found = [interval(rng.normal(2.0, 1.0, 8)) for _ in range(4000)]
    covered = np.mean([abs(mean - 2.0) < half for mean, half in found])
    assert covered == pytest.approx(0.95, abs=0.01)
