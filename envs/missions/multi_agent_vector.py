"""Many episodes of SwarmObserve-v1 whose spacecraft are agents: PettingZoo's parallel interface with arrays over the episodes.

from swarm_mj.envs.missions.multi_agent_vector import SwarmObserveV1ParallelVectorEnv
env = SwarmObserveV1ParallelVectorEnv(num_envs=64)
"""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium import spaces

from swarm_mj.typing import Array32, Mask

from ..observe.multi_agent_vector import ParallelVectorEnv, PerAgent
from .multi_agent import local_observations, local_space
from .vector import SwarmObserveV1VectorEnv


class SwarmObserveV1ParallelVectorEnv(ParallelVectorEnv):
    """Episodes of `SwarmObserve-v1`; every one is bit for bit one of `SwarmObserveV1ParallelEnv`; see `ParallelVectorEnv`.

    Who does not fly in an episode is not among those of `flying`. Infos hold `action_mask`, shape (E, n, C). With
    `observation="entities"` the observation of an agent is a dict of arrays over the episodes.

    Args:
        num_envs: Number of episodes E.
        threads: Most that are used; None for the cores that this process may use.
        agent_prefix: What stands before the numbers of the agents.
        arguments: Those of `SwarmObserveV1Env`, except `width` and `height`; `render` shows what `vector` draws.
    """

    def __init__(
        self, num_envs: int = 1, *, threads: int | None = None, agent_prefix: str = "sc", **arguments: Any
    ) -> None:
        vector = SwarmObserveV1VectorEnv(num_envs, threads=threads, **arguments)
        self._set_up(vector, agent_prefix, vector.batch.n)
        self._observation_space = {agent: local_space(vector.batch) for agent in self.agents}

    def observation_space(self, agent: str) -> spaces.Space[Any]:
        """Of one agent in one episode."""
        return self._observation_space[agent]

    def state(self) -> Array32:
        """The flat observations of `SwarmObserveV1Env`, for critics that see it all, shape (E, F)."""
        flat: Array32 = self.vector.batch.flat()
        return flat

    def _lost(self) -> Mask:
        return np.logical_not(self.vector.batch.infos()["alive"])

    def _local(self, whole: Any) -> PerAgent:
        return dict(zip(self.agents, local_observations(self.vector.batch), strict=True))
