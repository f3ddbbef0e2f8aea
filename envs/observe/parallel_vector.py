"""Many episodes whose spacecraft are agents: PettingZoo's parallel interface with arrays over the episodes.

from swarm_mj.envs import SwarmObserveParallelVectorEnv
env = SwarmObserveParallelVectorEnv(num_envs=64)
"""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from swarm_mj.errors import ScenarioError
from swarm_mj.typing import Array32, Mask

from ..agents import PerAgent
from ..arguments import agent_names
from .parallel import local_observations, local_space
from .vector import SwarmObserveVectorEnv


class SwarmObserveParallelVectorEnv:
    """E episodes of `SwarmObserve-v0`; every one is bit for bit one of `SwarmObserveParallelEnv`.

    What a multi-agent environment takes and gives by agent is here an array over the episodes, with the number of the episode
    in front. Agents are never taken out of `agents`, for each flies in some episode: `flying[e, j]` says whether the j-th still
    does in episode e. Of who does not, actions are ignored and nothing ends; its rewards and observations mean nothing. An
    episode in which all have ended is started anew by the next call of `step`, which ignores its actions and gives reward 0, as
    gymnasium's vector environments do by default. Infos are those of the vector environment, of episodes and not of agents,
    with `action_mask`, shape (E, n, C). With `observation="entities"` the observation of an agent is a dict of arrays over the
    episodes.

    Args:
        num_envs: Number of episodes E.
        threads: Most that are used; None for the cores that this process may use.
        agent_prefix: What stands before the numbers of the agents.
        arguments: Those of `SwarmObserveEnv`, except `width` and `height`; `render` shows what `vector` draws.

    Attributes:
        num_envs: Number of episodes E.
        possible_agents: Names, in gene order.
        agents: The same.
        flying: Who flies, shape (E, n).
        vector: All spacecraft of an episode as one agent; `get_state`, `set_state` and what else it offers serve here, too.
    """

    def __init__(
        self, num_envs: int = 1, *, threads: int | None = None, agent_prefix: str = "sc", **arguments: Any
    ) -> None:
        self.vector = SwarmObserveVectorEnv(num_envs, threads=threads, **arguments)
        episodes, self.num_envs = self.vector.batch, num_envs
        self.possible_agents = agent_names(agent_prefix, episodes.n)
        self.agents = list(self.possible_agents)
        self._action_space = {agent: spaces.Discrete(episodes.choices) for agent in self.agents}
        self._observation_space = {agent: local_space(episodes) for agent in self.agents}
        self.flying: Mask = np.zeros((num_envs, episodes.n), np.bool_)

    def observation_space(self, agent: str) -> spaces.Space[Any]:
        """Of one agent in one episode."""
        return self._observation_space[agent]

    def state(self) -> Array32:
        """The flat observations of `SwarmObserveEnv`, for critics that see it all, shape (E, F)."""
        flat: Array32 = self.vector.batch.flat()
        return flat

    def _lost(self) -> Mask:
        return np.logical_not(self.vector.batch.infos()["alive"])

    def _local(self) -> PerAgent:
        return dict(zip(self.agents, local_observations(self.vector.batch), strict=True))

    def action_space(self, agent: str) -> spaces.Space[Any]:
        """Of one agent in one flight."""
        return self._action_space[agent]

    def reset(
        self, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[PerAgent, dict[str, Any]]:
        """Start all flights, or those of `options["reset_mask"]`, see the `reset` of `vector`."""
        _, infos = self.vector.reset(seed=seed, options=options)
        begun = infos["_flight_seed"]
        self.flying[begun] = ~self._lost()[begun]
        return self._local(), infos

    def step(self, actions: PerAgent) -> tuple[PerAgent, PerAgent, PerAgent, PerAgent, dict[str, Any]]:
        """Fly on for one step.

        Args:
            actions: Of every agent, shape (E, ...) of its `action_space`.

        Returns:
            Observations (E, F), rewards (E,), terminations (E,) and truncations (E,) by agent, and infos.

        Raises:
            gymnasium.error.InvalidAction: An action does not lie in its space.
            ScenarioError: An agent has no actions, or there are actions of somebody else.
        """
        flew = self.flying.copy()
        _, reward, ended, truncated, infos = self.vector.step(self._joined(actions))
        began = infos.get("_flight_seed", np.zeros(self.num_envs, np.bool_))
        flew[began] = ~self._lost()[began]
        over = ended[:, None] | (self._lost() & ~began[:, None])
        terminations, truncations = flew & over, flew & truncated[:, None] & ~over
        self.flying = flew & ~(terminations | truncations)
        by_agent = {agent: j for j, agent in enumerate(self.agents)}
        return (
            self._local(),
            {agent: reward.copy() for agent in self.agents},
            {agent: terminations[:, j] for agent, j in by_agent.items()},
            {agent: truncations[:, j] for agent, j in by_agent.items()},
            infos,
        )

    def close(self) -> None:
        """End the threads and release the observer."""
        self.vector.close()

    def _joined(self, actions: PerAgent) -> NDArray[Any]:
        if set(actions) != set(self.agents):
            raise ScenarioError(
                f"actions of {sorted(map(str, actions))}: give one array for each of {', '.join(self.agents)}"
            )
        parts = [self._part(agent, actions[agent]) for agent in self.agents]
        parts = [np.where(flies[:, None], part, 0) for part, flies in zip(parts, self.flying.T, strict=True)]
        return np.concatenate(parts, axis=1)

    def _part(self, agent: str, given: Any) -> NDArray[Any]:
        must = (self.num_envs, *(self._action_space[agent].shape or ()))
        if np.shape(given) != must:
            raise ScenarioError(f"actions of {agent}: must be an array of shape {must}, not {np.shape(given)}")
        return np.asarray(given).reshape(self.num_envs, -1)
