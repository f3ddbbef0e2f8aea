"""SwarmDownlink-v0 for many agents: each spacecraft decides whom it talks to, through PettingZoo's ParallelEnv.

from swarm_mj.envs.downlink.parallel import swarm_downlink_v0
env = swarm_downlink_v0.parallel_env()
"""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, ClassVar

import numpy as np
from gymnasium import spaces

from ..agents import PerAgent, SwarmParallelEnv
from ..arguments import agent_names, record_of
from ..batch_env import info_of, told_of_step
from .batch import DOWNLINK_ENDS, DownlinkBatch, dict_space
from .config import DownlinkConfig, DownlinkWeights
from .env import NAME
from .world import DownlinkTask


class SwarmDownlinkParallelEnv(SwarmParallelEnv):
    """The swarm of `SwarmDownlinkEnv`, each spacecraft an agent: `sc1`, `sc2`, ... in gene order.

    An agent's action is its choice, Discrete(n + 2). Its observation holds the tables of `SwarmDownlinkEnv` under
    `observation`, which all share, with its own mask under `action_mask`, shape (n + 2,), and `agent`, its number as one of n.
    The reward is the team's and the same for all; all end together. With the same seed it is bit for bit the episode of
    `SwarmDownlinkEnv`. A spacecraft that is lost stays an agent, to whom only idling is allowed.

    Args:
        agent_prefix: What stands before the numbers of the agents.
        arguments: Those of `SwarmDownlinkEnv`, except `observation`.
    """

    name, terms, ends = "swarm_downlink_v0", DownlinkWeights._fields, DOWNLINK_ENDS
    metadata: ClassVar[dict[str, Any]] = {"name": name, "render_modes": [], "is_parallelizable": True}
    render_mode = None

    def __init__(self, *, agent_prefix: str = "sc", **arguments: Any) -> None:
        task = DownlinkTask(record_of(DownlinkConfig, NAME, dict(observation="dict", **arguments)))
        n, tables = task.n, dict(dict_space(task).spaces)
        tables.pop("action_mask")
        own = {"action_mask": spaces.MultiBinary(n + 2), "agent": spaces.MultiBinary(n)}
        whole = spaces.Dict({"observation": spaces.Dict(tables), **own})
        self._set_up(DownlinkBatch(task, 1), agent_names(agent_prefix, n), whole, spaces.Discrete(n + 2))

    def reset(self, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[PerAgent, PerAgent]:
        """Start an episode; `options` may hold `flight_seed`, and others are ignored, as PettingZoo asks."""
        chosen = self._draw(seed, options)
        self.batch.reset({0: chosen})
        self._begun, self.agents = True, list(self.possible_agents)
        return self._observations(), self._infos({"flight_seed": chosen})

    def _fly(self, actions: PerAgent) -> tuple[PerAgent, PerAgent, PerAgent, PerAgent, PerAgent]:
        batch, flew = self.batch, self.agents
        result = batch.step(np.array([*actions.values()])[None])
        ended, truncated = bool(result.end[0]), bool(result.truncated[0])
        self.agents = [] if ended or truncated else flew
        infos = self._infos(told_of_step(batch, result, 0, self.terms, self.ends))
        rewards, ends = dict.fromkeys(flew, float(result.reward[0])), dict.fromkeys(flew, ended)
        return self._observations(), rewards, ends, dict.fromkeys(flew, truncated), infos

    def _infos(self, more: dict[str, Any]) -> PerAgent:
        info = info_of(self.batch, 0) | more
        return {agent: dict(info) for agent in self.possible_agents}

    def _observations(self) -> PerAgent:
        tables, n = self.batch.observation, self.task.n
        mask = tables.pop("action_mask")[0]
        return {
            agent: {
                "observation": {name: table[0].copy() for name, table in tables.items()},
                "action_mask": mask[j],
                "agent": np.eye(n, dtype=np.int8)[j],
            }
            for j, agent in enumerate(self.possible_agents)
        }


#: PettingZoo's way to name an environment: `swarm_downlink_v0.parallel_env(...)`.
swarm_downlink_v0 = SimpleNamespace(parallel_env=SwarmDownlinkParallelEnv)
