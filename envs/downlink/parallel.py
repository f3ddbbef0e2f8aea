"""SwarmDownlink-v0 for many agents: each spacecraft decides whom it talks to, through PettingZoo's ParallelEnv.

from swarm_mj.envs.downlink.parallel import swarm_downlink_v0
env = swarm_downlink_v0.parallel_env()
"""

from __future__ import annotations

from collections.abc import Mapping
from types import SimpleNamespace
from typing import Any, ClassVar

import gymnasium
import numpy as np
from gymnasium import spaces

from swarm_mj.errors import ScenarioError

from ..arguments import check_action, checked_options, checked_prefix
from .env import SwarmDownlinkEnv
from .observations import dict_space

try:
    from pettingzoo import ParallelEnv
except ImportError as error:
    raise ImportError("the multi-agent environment needs PettingZoo: pip install 'swarm_mj[rl]'") from error

PerAgent = dict[str, Any]


class SwarmDownlinkParallelEnv(ParallelEnv[str, Any, Any]):
    """The swarm of `SwarmDownlinkEnv`, each spacecraft an agent: `sc1`, `sc2`, ... in gene order.

    An agent's action is its choice, Discrete(n + 2). Its observation holds the tables of `SwarmDownlinkEnv` under
    `observation`, which all share, with its own mask under `action_mask`, shape (n + 2,), and `agent`, its number as one of n.
    The reward is the team's and the same for all; all end together. With the same seed it is bit for bit the episode of
    `SwarmDownlinkEnv`. A spacecraft that is lost stays an agent, to whom only idling is allowed.

    Args:
        agent_prefix: What stands before the numbers of the agents.
        arguments: Those of `SwarmDownlinkEnv`, except `observation`.
    """

    metadata: ClassVar[dict[str, Any]] = {"name": "swarm_downlink_v0", "render_modes": [], "is_parallelizable": True}
    render_mode = None

    def __init__(self, *, agent_prefix: str = "sc", **arguments: Any) -> None:
        self._env = SwarmDownlinkEnv(**arguments, observation="dict")
        self.task, n = self._env.task, self._env.task.n
        self.possible_agents = [f"{checked_prefix(agent_prefix)}{j + 1}" for j in range(n)]
        self.agents: list[str] = []
        tables = dict(dict_space(self.task).spaces)
        tables.pop("action_mask")
        own = {"action_mask": spaces.MultiBinary(n + 2), "agent": spaces.MultiBinary(n)}
        whole = spaces.Dict({"observation": spaces.Dict(tables), **own})
        self.observation_spaces = {agent: whole for agent in self.possible_agents}
        self.action_spaces = {agent: spaces.Discrete(n + 2) for agent in self.possible_agents}

    def observation_space(self, agent: str) -> spaces.Space[Any]:
        """Of one agent, always the same object."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> spaces.Space[Any]:
        """Of one agent, always the same object."""
        return self.action_spaces[agent]

    def reset(self, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[PerAgent, PerAgent]:
        """Start an episode; `options` may hold `flight_seed`, and others are ignored, as PettingZoo asks."""
        known = {name: value for name, value in checked_options(options).items() if name == "flight_seed"}
        tables, info = self._env.reset(seed=seed, options=known)
        self.agents = list(self.possible_agents)
        return self._observations(tables), {agent: dict(info) for agent in self.agents}

    def step(self, actions: PerAgent) -> tuple[PerAgent, PerAgent, PerAgent, PerAgent, PerAgent]:
        """Fly a slot with a choice of each agent.

        Raises:
            gymnasium.error.ResetNeeded: The episode is over or has not begun.
            gymnasium.error.InvalidAction: An action lies outside its space.
            ScenarioError: An agent has no action, or there is an action of somebody else.
        """
        flew = self.agents
        if not flew:
            raise gymnasium.error.ResetNeeded(f"{self.metadata['name']}: the episode is over; call reset first")
        if not isinstance(actions, Mapping) or set(actions) != set(flew):
            raise ScenarioError(f"actions of {list(actions)}: must be a mapping with one for each of {', '.join(flew)}")
        choices = [int(check_action(self.action_spaces[agent], actions[agent])) for agent in flew]
        tables, reward, terminated, truncated, info = self._env.step(np.array(choices))
        self.agents = [] if terminated or truncated else flew
        rewards, ended = dict.fromkeys(flew, reward), dict.fromkeys(flew, terminated)
        infos = {agent: dict(info) for agent in flew}
        return self._observations(tables), rewards, ended, dict.fromkeys(flew, truncated), infos

    def _observations(self, tables: dict[str, Any]) -> PerAgent:
        n, mask = self.task.n, tables.pop("action_mask")
        return {
            agent: {
                "observation": {name: table.copy() for name, table in tables.items()},
                "action_mask": mask[j],
                "agent": np.eye(n, dtype=np.int8)[j],
            }
            for j, agent in enumerate(self.possible_agents)
        }


#: PettingZoo's way to name an environment: `swarm_downlink_v0.parallel_env(...)`.
swarm_downlink_v0 = SimpleNamespace(parallel_env=SwarmDownlinkParallelEnv)
