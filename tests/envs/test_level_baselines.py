"""At every level there are baselines, and what they see comes down, whatever the antennas."""

import gymnasium
import numpy as np
import pytest
from swarm_mj.envs.policies.baselines import fly
from swarm_mj.envs.policies.level_baselines import LEVEL_POLICIES

from .flights import ID

FAST = ["physics.wheels=gyrostat", "physics.stepper=kernel"]
#: Least share of the target that each sees [%]; who looks at the body's centre does not see half of it.
SEEN = {"role": 55.0, "pointing": 55.0, "torque": 35.0}
POLICY = {"role": "sweep", "pointing": "sweep", "torque": "feedback"}


@pytest.mark.parametrize(
    ("level", "antenna"),
    [
        ("role", "omnidirectional"),
        ("role", "hemispherical"),
        ("pointing", "omnidirectional"),
        ("pointing", "hemispherical"),
        ("torque", "hemispherical"),
    ],
)
def test_what_is_seen_is_delivered_at_every_level(level, antenna):
    step_s = 1.0 if level == "torque" else 10.0
    env = gymnasium.make(
        ID, control=level, step_s=step_s, overrides=[*FAST, f"link.crosslink.antenna={antenna}"]
    ).unwrapped
    outcome = fly(env, LEVEL_POLICIES[level][POLICY[level]], 1)
    totals = env.batch.totals
    assert outcome.coverage_percent > SEEN[level]
    assert outcome.delivered_bit > 0.9 * totals.seen_bit[0] > 0.0
    assert totals.seen_bit[0] == pytest.approx(outcome.delivered_bit + totals.stored[0].sum() + totals.lost_bit[0])
    env.close()


def test_policies_of_every_level_choose_legal_actions():
    for level, policies in LEVEL_POLICIES.items():
        env = gymnasium.make(ID, control=level, overrides=FAST).unwrapped
        observation, _ = env.reset(seed=0)
        for name, policy in policies.items():
            action = policy(env.task, observation)
            assert env.action_space.contains(action), (level, name)
            assert np.array_equal(action, policy(env.task, observation)), (level, name)
        env.close()
