"""SwarmPointing-v0 for many agents: a swarm in which each spacecraft turns itself, through PettingZoo's ParallelEnv.

from swarm_mj.envs.pointing.parallel import swarm_pointing_v0
env = swarm_pointing_v0.parallel_env()
"""

from __future__ import annotations

from collections.abc import Mapping
from types import SimpleNamespace
from typing import Any, ClassVar

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.utils import seeding

from swarm_mj.errors import ScenarioError

from ..arguments import check_action, checked_options, checked_prefix, checked_render_mode, flight_seed
from ..autoreset import one_of
from ..batch_env import info_of
from ..snapshots import RebuiltOnCopy, must_have_begun
from .batch import PointingBatch, crossed
from .config import WEIGHTS
from .env import ACTION_SPACE
from .task import make_pointing_task

try:
    from pettingzoo import ParallelEnv
except ImportError as error:
    raise ImportError("the multi-agent environment needs PettingZoo: pip install 'swarm_mj[rl]'") from error

PerAgent = dict[str, Any]


class SwarmPointingParallelEnv(RebuiltOnCopy, ParallelEnv[str, Any, Any]):
    """A swarm of n spacecraft in one flyby, each an agent: `sc1`, `sc2`, ... in gene order.

    Spaces, rewards, infos and ends of an agent are those of `SwarmPointingEnv`, and so are the numbers: the agent `scJ` of a
    flight seed flies bit for bit what `SwarmPointingEnv` flies with that seed and `spacecraft=J`. All begin at the same
    instant of the flyby and are truncated together. Rewards are each agent's own: their sum or mean is the team's.

    Args:
        render_mode: None or `"rgb_array"`: what the camera of the first agent sees.
        agent_prefix: What stands before the numbers of the agents; with `"sc_"` they are `sc_1`, `sc_2`, ...
        arguments: The others of `SwarmPointingEnv`.
    """

    metadata: ClassVar[dict[str, Any]] = {
        "name": "swarm_pointing_v0",
        "render_modes": ["rgb_array"],
        "render_fps": 10,
        "is_parallelizable": True,
    }

    def __init__(self, render_mode: str | None = None, *, agent_prefix: str = "sc", **arguments: Any) -> None:
        self.made_of = {"render_mode": render_mode, "agent_prefix": checked_prefix(agent_prefix), **arguments}
        self.render_mode = checked_render_mode(render_mode, self.metadata["render_modes"])
        self.task = make_pointing_task(**arguments)
        n = self.task.plan.n
        self._batch: PointingBatch | None = PointingBatch(self.task, n)
        self.possible_agents = [f"{agent_prefix}{j + 1}" for j in range(n)]
        self.agents: list[str] = []
        self.observation_spaces = dict.fromkeys(self.possible_agents, self.task.observation_space)
        self.action_spaces = dict.fromkeys(self.possible_agents, ACTION_SPACE)
        numbers = self.task.layout.space
        self.state_space = spaces.Box(np.tile(numbers.low, n), np.tile(numbers.high, n), dtype=np.float32)
        self._random = seeding.np_random()[0]
        self._begun = False

    @property
    def batch(self) -> PointingBatch:
        """The swarm, an episode for each spacecraft.

        Raises:
            gymnasium.error.ClosedEnvironmentError: The environment was closed.
        """
        if self._batch is None:
            raise gymnasium.error.ClosedEnvironmentError("swarm_pointing_v0 was closed; make it anew")
        return self._batch

    def observation_space(self, agent: str) -> spaces.Space[Any]:
        """Of one agent, always the same object."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> spaces.Box:
        """Of one agent, always the same object."""
        return self.action_spaces[agent]

    def reset(self, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[PerAgent, PerAgent]:
        """Start an episode of all; `options` may hold `flight_seed`, and others are ignored, as PettingZoo asks."""
        if seed is not None:
            self._random = seeding.np_random(seed)[0]
        known = {name: value for name, value in checked_options(options).items() if name == "flight_seed"}
        chosen = flight_seed(known, int(self._random.integers(2**31)))
        n = self.task.plan.n
        self.batch.reset(dict.fromkeys(range(n), chosen), list(range(1, n + 1)))
        self._begun, self.agents = True, list(self.possible_agents)
        return self._by_agent(self.batch.observation), self._infos(flight_seed=chosen)

    def step(self, actions: PerAgent) -> tuple[PerAgent, PerAgent, PerAgent, PerAgent, PerAgent]:
        """Fly on for one step with the actions of the agents held, one for each.

        Raises:
            gymnasium.error.ResetNeeded: The episode is over or has not begun.
            gymnasium.error.InvalidAction: An action lies outside its space.
            ScenarioError: An agent has no action, or there is an action of somebody else.
        """
        if not self.agents:
            raise gymnasium.error.ResetNeeded(
                "swarm_pointing_v0: the episode is over or has not begun; call reset first"
            )
        if not isinstance(actions, Mapping) or set(actions) != set(self.agents):
            raise ScenarioError(
                f"actions of {list(actions)}: must be a mapping with one for each of {', '.join(self.agents)}"
            )
        batch, flew = self.batch, self.agents
        result = batch.step(np.array([check_action(ACTION_SPACE, actions[agent]) for agent in flew]))
        over = bool(result.truncated.all())
        infos = self._infos()
        for j, agent in enumerate(flew):
            infos[agent]["reward_terms"] = dict(zip(WEIGHTS, result.terms[j].tolist(), strict=True))
        rewards = dict(zip(flew, result.reward.tolist(), strict=True))
        self.agents = [] if over else flew
        never, ended = dict.fromkeys(flew, False), dict.fromkeys(flew, over)
        return self._by_agent(batch.observation), rewards, never, ended, infos

    def state(self) -> Any:
        """The numbers of all agents one after the other, for critics that see it all."""
        return self.batch.numbers.ravel().copy()

    def render(self) -> Any:
        """What the camera of the first agent sees with `render_mode="rgb_array"`."""
        if self.render_mode is None:
            gymnasium.logger.warn("render() draws nothing: make the environment with render_mode='rgb_array'")
            return None
        must_have_begun(self._begun, "render", "swarm_pointing_v0")
        return crossed(self.batch, 0)

    def close(self) -> None:
        """Forget the episode; may be called again."""
        self._batch, self.agents = None, []

    def _by_agent(self, observed: Any) -> PerAgent:
        return {agent: one_of(observed, j) for j, agent in enumerate(self.possible_agents)}

    def _infos(self, **more: Any) -> PerAgent:
        return {agent: info_of(self.batch, j) | more for j, agent in enumerate(self.possible_agents)}

    def _standing(self) -> dict[str, Any]:
        batch = self._batch
        states = None if batch is None or not self._begun else [batch.get_state(j) for j in range(batch.count)]
        return {"random": self._random, "agents": self.agents, "states": states}

    def _stand(self, standing: dict[str, Any]) -> None:
        self._random, self.agents = standing["random"], list(standing["agents"])
        for j, state in enumerate(standing["states"] or ()):
            self.batch.set_state(j, state)
        self._begun = standing["states"] is not None


#: PettingZoo's way to name an environment: `swarm_pointing_v0.parallel_env(...)`.
swarm_pointing_v0 = SimpleNamespace(parallel_env=SwarmPointingParallelEnv)
