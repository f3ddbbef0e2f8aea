"""Environments with an agent for each spacecraft, through PettingZoo's ParallelEnv: what they have in common."""

from __future__ import annotations

from collections.abc import Mapping
from copy import deepcopy
from typing import Any, ClassVar

import gymnasium
from gymnasium import spaces
from gymnasium.utils import seeding

from swarm_mj.errors import ScenarioError

from .arguments import check_action, checked_options, flight_seed
from .batch_env import OverBatch

try:
    from pettingzoo import ParallelEnv
except ImportError as error:
    raise ImportError("the multi-agent environment needs PettingZoo: pip install 'swarm_mj[rl]'") from error

PerAgent = dict[str, Any]


class SwarmParallelEnv(OverBatch, ParallelEnv[str, Any, Any]):
    """Spacecraft as agents over a batch of episodes, see `batch_env`.

    Attributes:
        possible_agents: Names, in gene order.
        agents: Of those who fly.
        observation_spaces: By agent.
        action_spaces: By agent.
    """

    metadata: ClassVar[dict[str, Any]]
    kept = ("action_spaces", "observation_spaces", "_random", "agents")

    def _set_up(self, batch: Any, agents: list[str], observation: spaces.Space[Any], action: spaces.Space[Any]) -> None:
        """Take the episodes, the names of the agents, and the spaces of each."""
        self._batch, self.possible_agents = batch, agents
        self.agents: list[str] = []
        self.observation_spaces = dict.fromkeys(agents, observation)
        self.action_spaces = {agent: deepcopy(action) for agent in agents}
        self._random, self._begun = seeding.np_random()[0], False

    def observation_space(self, agent: str) -> spaces.Space[Any]:
        """Of one agent, always the same object."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> Any:
        """Of one agent, always the same object."""
        return self.action_spaces[agent]

    def _draw(self, seed: int | None, options: dict[str, Any] | None) -> int:
        """The flight seed of an episode; options other than `flight_seed` are ignored, as PettingZoo asks."""
        if seed is not None:
            self._random = seeding.np_random(seed)[0]
        known = {name: value for name, value in checked_options(options).items() if name == "flight_seed"}
        return flight_seed(known, int(self._random.integers(2**31)))

    def step(self, actions: PerAgent) -> tuple[PerAgent, PerAgent, PerAgent, PerAgent, PerAgent]:
        """Fly on for one step with an action of each agent held.

        Returns:
            Observations, rewards, terminations, truncations and infos by agent.

        Raises:
            gymnasium.error.ResetNeeded: The episode is over or has not begun.
            gymnasium.error.InvalidAction: An action lies outside its space.
            ScenarioError: An agent has no action, or there is an action of somebody unknown.
        """
        if not self.agents:
            raise gymnasium.error.ResetNeeded(f"{self.name}: the episode is over or has not begun; call reset first")
        # TorchRL gives actions of those who are no more, too.
        known = isinstance(actions, Mapping) and set(self.agents) <= set(actions) <= set(self.possible_agents)
        if not known:
            raise ScenarioError(
                f"actions = {actions!r}: must be a mapping with one for each of {', '.join(self.agents)}"
            )
        return self._fly({agent: check_action(self.action_spaces[agent], actions[agent]) for agent in self.agents})

    def _fly(self, actions: PerAgent) -> tuple[PerAgent, PerAgent, PerAgent, PerAgent, PerAgent]:
        """The same with actions that are checked, arrays in the order of `agents`."""
        raise NotImplementedError

    def close(self) -> None:
        """Release what the episodes hold; may be called again."""
        self._release()
        self.agents = []

    def _flights(self) -> dict[int, Any]:
        return {e: self._batch.get_state(e) for e in range(self._batch.count)} if self._begun else {}

    def _go_on(self, e: int, state: Any) -> None:
        self._batch.set_state(e, state)
        self._begun = True
