"""The environment's constant-time observer against face-ID buffers, over whole flights that sweep the target."""

import gymnasium
import numpy as np
import pytest
import swarm_mj.envs  # noqa: F401
from swarm_mj.envs.baselines import POLICIES

ID = "swarm_mj.envs:SwarmObserve-v0"


def seen_share(observer, seed, given=None):
    """Seen share of the target at the end [%], and the actions flown: greedy ones, unless given."""
    env = gymnasium.make(ID, observer=observer).unwrapped
    observation, _ = env.reset(seed=seed)
    actions, over = [], False
    while not over:
        actions.append(POLICIES["greedy"](env.task, observation) if given is None else given[len(actions)])
        observation, _, *ends, info = env.step(actions[-1])
        over = any(ends)
    env.close()
    return info["coverage_percent"], actions


def test_horizon_maps_see_what_face_id_buffers_see_within_a_percent_without_bias():
    """Greedy flights cut many cells at the border of the picture, where half a cell decides."""
    errors = []
    for seed in range(1, 7):
        by_maps, actions = seen_share("horizon", seed)
        by_pixels, _ = seen_share("raster", seed, actions)
        assert by_pixels > 70.0
        errors.append(by_maps - by_pixels)
    assert np.abs(errors).max() < 1.0
    assert np.mean(errors) == pytest.approx(0.0, abs=0.35)
