"""The scripted policies: legal actions, and a task in which decisions matter."""

import numpy as np
import pytest
from swarm_mj.envs.policies.baselines import POLICIES, fly, middle_patch


@pytest.fixture(scope="module")
def outcomes(roles):
    return {name: [fly(roles, policy, seed) for seed in (1, 2)] for name, policy in POLICIES.items()}


def test_baselines_choose_legal_actions_and_repeat_themselves(roles, outcomes):
    for name, policy in POLICIES.items():
        observation, _ = roles.reset(seed=0)
        assert roles.action_space.contains(policy(roles.task, observation)), name
    assert fly(roles, POLICIES["greedy"], 1) == outcomes["greedy"][0]


def test_the_bodys_centre_does_not_suffice_and_looking_at_what_is_missing_pays(outcomes):
    shares = {name: np.mean([o.coverage_percent for o in runs]) for name, runs in outcomes.items()}
    assert shares["body centre"] < 50.0
    assert shares["target centre"] < 50.0
    assert shares["sweep"] > shares["body centre"] + 10.0
    assert shares["greedy"] > shares["sweep"] + 10.0
    rewards = {name: np.mean([o.total_reward for o in runs]) for name, runs in outcomes.items()}
    assert sorted(rewards, key=rewards.get) == ["target centre", "body centre", "sweep", "greedy", "greedy ahead"]


def test_rewards_of_an_episode_are_the_sum_of_its_terms(outcomes):
    for runs in outcomes.values():
        for outcome in runs:
            assert outcome.total_reward == pytest.approx(sum(outcome.terms.values()), abs=1e-9)


def test_the_middle_patch_lies_at_the_targets_middle(roles):
    row, column = divmod(middle_patch(roles.task), 4)
    assert row in (1, 2) and column in (1, 2)
