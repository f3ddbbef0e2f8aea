"""SwarmPointing-v0 for many agents: a swarm in which each spacecraft turns itself, through PettingZoo's ParallelEnv.

from swarm_mj.envs.pointing.parallel import swarm_pointing_v0
env = swarm_pointing_v0.parallel_env()
"""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, ClassVar

import numpy as np
from gymnasium import spaces

from ..agents import PerAgent, SwarmParallelEnv
from ..arguments import agent_names, checked_render_mode, nothing_to_draw
from ..batch_env import info_of, must_have_begun, one_of, told_of_step
from .batch import PointingBatch, crossed
from .env import ACTION_SPACE
from .steps import PointingWeights
from .task import make_pointing_task


class SwarmPointingParallelEnv(SwarmParallelEnv):
    """A swarm of n spacecraft in one flyby, each an agent: `sc1`, `sc2`, ... in gene order.

    Spaces, rewards, infos and ends of an agent are those of `SwarmPointingEnv`, and so are the numbers: the agent `scJ` of a
    flight seed flies bit for bit what `SwarmPointingEnv` flies with that seed and `spacecraft=J`. All begin at the same
    instant of the flyby and are truncated together. Rewards are each agent's own: their sum or mean is the team's.

    Args:
        render_mode: None or `"rgb_array"`: what the camera of the first agent sees.
        agent_prefix: What stands before the numbers of the agents; with `"sc_"` they are `sc_1`, `sc_2`, ...
        arguments: The others of `SwarmPointingEnv`.
    """

    name, terms = "swarm_pointing_v0", PointingWeights._fields
    metadata: ClassVar[dict[str, Any]] = {
        "name": name,
        "render_modes": ["rgb_array"],
        "render_fps": 10,
        "is_parallelizable": True,
    }

    def __init__(self, render_mode: str | None = None, *, agent_prefix: str = "sc", **arguments: Any) -> None:
        self.render_mode = checked_render_mode(render_mode, self.metadata["render_modes"])
        task = make_pointing_task(**arguments)
        n, numbers = task.plan.n, task.layout.space
        self._set_up(PointingBatch(task, n), agent_names(agent_prefix, n), task.observation_space, ACTION_SPACE)
        self.state_space = spaces.Box(np.tile(numbers.low, n), np.tile(numbers.high, n), dtype=np.float32)

    def reset(self, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[PerAgent, PerAgent]:
        """Start an episode of all; `options` may hold `flight_seed`, and others are ignored, as PettingZoo asks."""
        chosen, n = self._draw(seed, options), self.task.plan.n
        self.batch.reset(dict.fromkeys(range(n), chosen), list(range(1, n + 1)))
        self._begun, self.agents = True, list(self.possible_agents)
        return self._by_agent(self.batch.observation), self._infos(flight_seed=chosen)

    def _fly(self, actions: PerAgent) -> tuple[PerAgent, PerAgent, PerAgent, PerAgent, PerAgent]:
        batch, flew = self.batch, self.agents
        result = batch.step(np.array([*actions.values()]))
        over, infos = bool(result.truncated.all()), self._infos()
        for j, agent in enumerate(flew):
            infos[agent] |= told_of_step(batch, result, j, self.terms, self.ends)
        rewards = dict(zip(flew, result.reward.tolist(), strict=True))
        self.agents = [] if over else flew
        never, ended = dict.fromkeys(flew, False), dict.fromkeys(flew, over)
        return self._by_agent(batch.observation), rewards, never, ended, infos

    def state(self) -> Any:
        """The numbers of all agents one after the other, for critics that see it all."""
        return self.batch.numbers.ravel().copy()

    def render(self) -> Any:
        """What the camera of the first agent sees with `render_mode="rgb_array"`."""
        if nothing_to_draw(self.render_mode):
            return None
        must_have_begun(self._begun, "render", self.name)
        return crossed(self.batch, 0)

    def _by_agent(self, observed: Any) -> PerAgent:
        return {agent: one_of(observed, j) for j, agent in enumerate(self.possible_agents)}

    def _infos(self, **more: Any) -> PerAgent:
        return {agent: info_of(self.batch, j) | more for j, agent in enumerate(self.possible_agents)}


#: PettingZoo's way to name an environment: `swarm_pointing_v0.parallel_env(...)`.
swarm_pointing_v0 = SimpleNamespace(parallel_env=SwarmPointingParallelEnv)
