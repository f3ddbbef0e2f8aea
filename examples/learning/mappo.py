"""MAPPO: one network flies every spacecraft by what that one knows, and a critic sees the whole swarm while they learn.

    pip install 'swarm_mj[rl]'
    python examples/learning/mappo.py --steps 300000 --seed 1 --out runs/mappo-1
    swarm-mj score runs/mappo-1/policy.npz

Yu and others 2022, "The Surprising Effectiveness of PPO in Cooperative Multi-Agent Games": PPO for each agent with shared
weights, and advantages from a central critic. The update is that of `ppo.py`, with a ratio for each spacecraft.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from common import options
from numpy.typing import NDArray
from ppo import Agent, Settings, mlp, train
from swarm_mj.envs.missions.policies import flat_rows, local_rows
from torch import Tensor, nn


class Team(Agent):
    """One actor for every spacecraft, on what `SwarmObserveV1ParallelEnv` shows it, and a critic on its `state()`."""

    observation = "entities"
    joint = False

    def __init__(self, episodes: Any, hidden: int) -> None:
        nn.Module.__init__(self)
        observed = episodes.entities()
        self.shape = episodes.n, episodes.choices
        self._local = local_rows(observed).shape[2]
        self.actor = mlp(self._local, hidden, episodes.choices, 0.01)
        self.critic = mlp(flat_rows(observed).shape[1], hidden, 1, 1.0)

    def shown(self, observed: Any) -> NDArray[np.float32]:
        """What each knows, one after the other, and then the whole."""
        local = local_rows(observed)
        return np.concatenate([local.reshape(len(local), -1), flat_rows(observed)], axis=1)

    def logits(self, seen: Tensor) -> Tensor:
        """Of each spacecraft's choices."""
        n = self.shape[0]
        return self.actor(seen[..., : n * self._local].unflatten(-1, (n, self._local)))

    def value(self, seen: Tensor) -> Tensor:
        """What the rest of the episode will bring."""
        return self.critic(seen[..., self.shape[0] * self._local :]).squeeze(-1)


if __name__ == "__main__":
    train(options(__doc__, "mappo"), Settings(), Team)
