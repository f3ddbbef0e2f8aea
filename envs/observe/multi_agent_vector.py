"""Many flights of many agents at once: PettingZoo's parallel interface with arrays over the flights.

from swarm_mj.envs import SwarmObserveParallelVectorEnv
env = SwarmObserveParallelVectorEnv(num_envs=64, control="role")
"""

from __future__ import annotations

from abc import abstractmethod
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from swarm_mj.errors import ScenarioError
from swarm_mj.typing import Array, Array32, Mask

from ..arguments import checked_prefix
from .local_observations import action_part, local_observation, local_space
from .vector import SwarmObserveVectorEnv

#: By agent, an array over the flights.
PerAgent = dict[str, NDArray[Any]]


class _Teams(SwarmObserveVectorEnv):
    """Flights that go on without the spacecraft that hit the body."""

    continues_after_impact = True


class ParallelVectorEnv:
    """E flights whose spacecraft are agents: what such environments of v0 and v1 share.

    What a multi-agent environment takes and gives by agent is here an array over the flights, with the number of the flight in
    front. Agents are never taken out of `agents`, for each flies in some flight: `flying[e, j]` says whether the j-th still
    does in flight e. Of who does not, actions are ignored and nothing ends; its rewards and observations mean nothing. A
    flight in which all have ended is started anew by the next call of `step`, which ignores its actions and gives reward 0, as
    gymnasium's vector environments do by default.

    Infos are those of the vector environment, of flights and not of agents.

    Attributes:
        num_envs: Number of flights E.
        possible_agents: Names, in gene order.
        agents: The same.
        flying: Who flies, shape (E, n).
        vector: All spacecraft of a flight as one agent; `get_state`, `set_state` and what else it offers serve here, too.
    """

    vector: Any

    def _set_up(self, vector: Any, agent_prefix: str, n: int) -> None:
        """Take the flights of n spacecraft."""
        self.vector, self.num_envs = vector, vector.num_envs
        self.possible_agents = [f"{checked_prefix(agent_prefix)}{j + 1}" for j in range(n)]
        self.agents = list(self.possible_agents)
        whole = vector.single_action_space
        self._action_space = {agent: action_part(whole, j, n) for j, agent in enumerate(self.agents)}
        self.flying: Mask = np.zeros((self.num_envs, n), np.bool_)

    @abstractmethod
    def observation_space(self, agent: str) -> spaces.Space[Any]:
        """Of one agent in one flight."""

    @abstractmethod
    def state(self) -> Array32:
        """Observations of everything, for critics that see it all, shape (E, F)."""

    @abstractmethod
    def _lost(self) -> Mask:
        """Who is no more, shape (E, n)."""

    @abstractmethod
    def _local(self, whole: Any) -> PerAgent:
        """Observations of the agents, from those of the vector environment."""

    def action_space(self, agent: str) -> spaces.Space[Any]:
        """Of one agent in one flight."""
        return self._action_space[agent]

    def reset(
        self, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[PerAgent, dict[str, Any]]:
        """Start all flights, or those of `options["reset_mask"]`, see the `reset` of `vector`."""
        whole, infos = self.vector.reset(seed=seed, options=options)
        begun = infos["_flight_seed"]
        self.flying[begun] = ~self._lost()[begun]
        return self._local(whole), infos

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
        whole, reward, ended, truncated, infos = self.vector.step(self._joined(actions))
        began = infos.get("_flight_seed", np.zeros(self.num_envs, np.bool_))
        flew[began] = ~self._lost()[began]
        over = ended[:, None] | (self._lost() & ~began[:, None])
        terminations, truncations = flew & over, flew & truncated[:, None] & ~over
        self.flying = flew & ~(terminations | truncations)
        by_agent = {agent: j for j, agent in enumerate(self.agents)}
        return (
            self._local(whole),
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


class SwarmObserveParallelVectorEnv(ParallelVectorEnv):
    """Flights of `SwarmObserve-v0`; every one is bit for bit one of `SwarmObserveParallelEnv`; see `ParallelVectorEnv`.

    Args:
        num_envs: Number of flights E.
        threads: Most that are used; None for the cores that this process may use.
        agent_prefix: What stands before the numbers of the agents.
        arguments: Those of `SwarmObserveEnv`, except `render_mode`.
    """

    def __init__(
        self, num_envs: int = 1, *, threads: int | None = None, agent_prefix: str = "sc", **arguments: Any
    ) -> None:
        vector = _Teams(num_envs, threads=threads, **arguments)
        task = vector.batch.task
        self._layout = task.observation_layout
        self._set_up(vector, agent_prefix, task.plan.n)
        self._observation_space = {agent: local_space(self._layout, task.plan.n) for agent in self.agents}

    def observation_space(self, agent: str) -> spaces.Box:
        """Of one agent in one flight."""
        return self._observation_space[agent]

    def state(self) -> Array32:
        """Observations of everything, for critics that see it all, shape (E, F)."""
        observation: Array32 = self.vector.batch.observation
        return observation

    def _lost(self) -> Mask:
        lost: Mask = self.vector.batch.gather(lambda batch: batch.totals.lost)
        return lost

    def _local(self, whole: Array32) -> PerAgent:
        layout, n = self._layout, len(self.agents)
        block = whole[:, : layout.features * n].reshape(-1, n, layout.features)
        r_A, alive = self.vector.batch.gather(_places), ~self._lost()
        told = [block[:, :, layout.columns[name]] for name in ("stored", "imaging")]
        facts = np.concatenate([*told, alive[:, :, None]], axis=2)
        out = {}
        for j, agent in enumerate(self.agents):
            others = np.arange(n) != j
            own: Array = r_A[:, j]
            tail = whole[:, layout.features * n :]
            out[agent] = local_observation(block[:, j], own, r_A[:, others], facts[:, others], tail)
        return out


def _places(batch: Any) -> Array:
    """Positions in A; of a flight that has diverged, the last that were finite, shape (E, n, 3) [m]."""
    return np.where(batch.flights.finite[:, None, None], batch.now.r_A, batch.before.r_A)
