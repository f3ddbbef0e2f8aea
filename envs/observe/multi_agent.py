"""SwarmObserve-v0 for many agents: each spacecraft decides for itself, through PettingZoo's ParallelEnv.

from swarm_mj.envs.observe.multi_agent import swarm_observe_v0
env = swarm_observe_v0.parallel_env(control="role")
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, ClassVar

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.utils import seeding
from numpy.typing import NDArray

from swarm_mj.errors import ScenarioError
from swarm_mj.mission.behaviors import TargetKind
from swarm_mj.scenarios.schema import Scenario
from swarm_mj.typing import Array, Array32, Pixels

from ..arguments import checked_options, checked_prefix, checked_render_mode, flight_seed
from ..snapshots import FlightState, RebuiltOnCopy, must_have_begun, restore_state, take_state
from .actions import check_action
from .batch import EpisodeBatch
from .config import EnvConfig
from .graph_knowledge import GraphKnowledge, News, groups_of
from .local_observations import action_part, local_observation, local_space
from .rendering import EpisodeRenderer
from .task import make_task

try:
    from pettingzoo import ParallelEnv
except ImportError as error:
    raise ImportError("the multi-agent environment needs PettingZoo: pip install 'swarm_mj[rl]'") from error

Observation = Array32
PerAgent = dict[str, Any]


class SwarmObserveParallelEnv(RebuiltOnCopy, ParallelEnv[str, Observation, Any]):
    """One flyby in which each spacecraft is an agent: `sc1`, `sc2`, ... in gene order, a dedicated communications one last.

    Task, dynamics, pictures, radio and episode ends are those of `SwarmObserveEnv`.

    **Actions** of an agent, by control level: `torque` Box(-1, 1, (w,)) with w the number of its wheels, `pointing`
    Box(-1, 1, (2,)), `role` Discrete(K + n + 3), with the meaning that `SwarmObserveEnv` gives one spacecraft's entries.

    **Observation** of an agent, Box, float32: its own block of 26 + w numbers (29 with the usual three wheels) as in
    `SwarmObserveEnv`; then, for each other spacecraft in order, its position relative to one's own in A over 10 km, its stored
    data over the nominal volume, whether it images, and whether it is alive (6 numbers); then the seen share of the K patches,
    time left, seen share of the target and data delivered. A swarm shares positions and coverage by radio (the paper's election
    needs as much); attitudes, rates, wheels and link states of the others stay unknown. `state()` is the observation of
    `SwarmObserveEnv`, of all spacecraft together, and lies in `state_space`.

    With `observability="graph"` an agent knows what has reached it: at the end of a step all who hear one another over the
    crosslinks, directly or through others, tell all they know; of who is out of reach or lost, it has what it last heard, and
    of the target what those saw first of whom it has heard since. The shape of the observation is the same.

    **Reward**: the team's, the same for every agent, as in `SwarmObserveEnv`, with the weight of `loss` for each spacecraft
    lost. `info[agent]["reward_terms"]` holds the terms.

    **Ends**: a spacecraft that hits the body, or is lost to a fault, is terminated and leaves `agents`; the others go on. All
    are terminated when the target is seen and delivered, the flight diverges or nobody is left, and truncated at the
    scenario's duration.

    Args:
        scenario: See `SwarmObserveEnv`.
        control: See `SwarmObserveEnv`.
        render_mode: None or `"rgb_array"`.
        agent_prefix: What stands before the numbers of the agents; with `"sc_"` they are `sc_1`, `sc_2`, ...
        arguments: The others of `SwarmObserveEnv`.
    """

    metadata: ClassVar[dict[str, Any]] = {
        "name": "swarm_observe_v0",
        "render_modes": ["rgb_array"],
        "render_fps": 10,
        "is_parallelizable": True,
    }

    def __init__(
        self,
        scenario: str | Path | Scenario = EnvConfig.scenario,
        control: str = EnvConfig.control,
        render_mode: str | None = None,
        *,
        agent_prefix: str = "sc",
        **arguments: Any,
    ) -> None:
        self.made_of = {"scenario": scenario, "control": control, "render_mode": render_mode, **arguments}
        self.made_of["agent_prefix"] = checked_prefix(agent_prefix)
        self.render_mode = checked_render_mode(render_mode, self.metadata["render_modes"])
        self.task = make_task(scenario=scenario, control=control, **arguments)
        batch = EpisodeBatch(self.task, 1, continues_after_impact=True)
        self._batch: EpisodeBatch | None = batch
        self._renderer = EpisodeRenderer([(batch, 0)], 640, 480)
        plan = self.task.plan
        self.possible_agents = [f"{agent_prefix}{j + 1}" for j in range(plan.n)]
        self.agents: list[str] = []
        self._number = {name: j for j, name in enumerate(self.possible_agents)}
        whole = batch.level.action_space
        self._whole = whole
        self.action_spaces = {name: action_part(whole, j, plan.n) for name, j in self._number.items()}
        self.observation_spaces = {name: local_space(self.task.observation_layout, plan.n) for name in self._number}
        self.state_space: spaces.Box = self.task.observation_layout.space
        self._random = seeding.np_random()[0]
        self._begun = False
        self._knowledge: GraphKnowledge | None = None

    @property
    def batch(self) -> EpisodeBatch:
        """The episode; see `EpisodeBatch`."""
        if self._batch is None:
            raise gymnasium.error.ClosedEnvironmentError("swarm_observe_v0 was closed; make it anew")
        return self._batch

    def observation_space(self, agent: str) -> spaces.Box:
        """Of one agent, always the same object."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> spaces.Space[Any]:
        """Of one agent, always the same object."""
        return self.action_spaces[agent]

    def reset(self, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[PerAgent, PerAgent]:
        """Start a flyby with all spacecraft; `options` may hold `flight_seed`, and others are ignored, as PettingZoo asks."""
        if seed is not None:
            self._random = seeding.np_random(seed)[0]
        known = {name: value for name, value in checked_options(options).items() if name == "flight_seed"}
        chosen = flight_seed(known, int(self._random.integers(2**31)))
        self.batch.reset(0, chosen)
        self._begun, self._knowledge = True, None
        self.agents = list(self.possible_agents)
        info = self.batch.info(0) | {"flight_seed": chosen}
        return self._observations(), {agent: dict(info) for agent in self.agents}

    def step(self, actions: PerAgent) -> tuple[PerAgent, PerAgent, PerAgent, PerAgent, PerAgent]:
        """Fly on for one step with the actions of the agents held.

        Args:
            actions: One for each agent in `agents`.

        Raises:
            gymnasium.error.ResetNeeded: The episode is over or has not begun.
            gymnasium.error.InvalidAction: An action lies outside its space.
            ScenarioError: An agent has no action, or there is an action of somebody else.
        """
        if not self.agents:
            raise gymnasium.error.ResetNeeded(
                "swarm_observe_v0: the episode is over or has not begun; call reset first"
            )
        batch, flew = self.batch, self.agents
        result = batch.step(self._joined(actions)[None])
        info, lost, ended = batch.step_info(0, result), batch.totals.lost[0], bool(result.end[0])
        observations = self._observations()
        rewards = dict.fromkeys(flew, float(result.reward[0]))
        terminations = {agent: ended or bool(lost[self._number[agent]]) for agent in flew}
        truncations = {agent: bool(result.truncated[0]) and not terminations[agent] for agent in flew}
        infos = {agent: dict(info) for agent in flew}
        self.agents = [agent for agent in flew if not (terminations[agent] or truncations[agent])]
        return observations, rewards, terminations, truncations, infos

    def get_state(self) -> FlightState:
        """Where the flight stands, see `SwarmObserveEnv.get_state`."""
        must_have_begun(self._begun, "get_state")
        flying = tuple(self._number[agent] for agent in self.agents)
        state = take_state(self.batch, 0, running=bool(flying), random=self._random)
        told = None if self._knowledge is None else tuple(array.copy() for array in self._knowledge.arrays)
        return replace(state, agents=flying, knowledge=told)

    def set_state(self, state: FlightState) -> PerAgent:
        """Go on from a state, see `SwarmObserveEnv.set_state`; returns the observations of those that fly."""
        if isinstance(state, FlightState) and state.agents is None:
            raise ScenarioError(
                "state: was taken from an environment that knows no agents; take it from a multi-agent one"
            )
        flying = restore_state(self.batch, 0, self._random, state).agents or ()
        self.agents, self._begun, self._knowledge = [self.possible_agents[j] for j in flying], True, None
        observations = self._observations()
        if self._knowledge is None or state.knowledge is None:
            return observations
        for array, known in zip(self._knowledge.arrays, state.knowledge, strict=True):
            array[:] = known
        return self._observations()  # to be told the same again changes nothing

    def _standing(self) -> dict[str, Any]:
        kept = {name: getattr(self, name) for name in ("action_spaces", "observation_spaces", "_random")}
        return {"kept": kept, "flight": self.get_state() if self._begun and self.batch else None}

    def _stand(self, standing: dict[str, Any]) -> None:
        self.__dict__.update(standing["kept"])
        if standing["flight"] is not None:
            self.set_state(standing["flight"])

    def _joined(self, actions: PerAgent) -> NDArray[Any]:
        if not isinstance(actions, Mapping):
            raise ScenarioError(f"actions = {actions!r}: must be a mapping from agents to actions")
        missing, strange = set(self.agents) - set(actions), set(actions) - set(self.agents)
        if missing or strange:
            raise ScenarioError(
                f"actions: missing for {sorted(missing) or 'nobody'}, not asked for {sorted(strange) or 'nobody'}; "
                f"give one for each of {', '.join(self.agents)}"
            )
        joined = np.zeros(self._whole.shape or (0,), self._whole.dtype or float).reshape(len(self.possible_agents), -1)
        for agent in self.agents:
            joined[self._number[agent]] = check_action(self.action_spaces[agent], actions[agent])
        return joined.ravel()

    def _observations(self) -> PerAgent:
        batch, n = self.batch, len(self.possible_agents)
        whole = batch.observation[0]
        layout = self.task.observation_layout
        block, tail = whole[: layout.features * n].reshape(n, layout.features), whole[layout.features * n :]
        # As the other observations, those of a flight that has diverged are the last that were finite.
        now = batch.now if batch.flights.finite[0] else batch.before
        r_A, alive = now.r_A[0], ~batch.totals.lost[0]
        known = np.column_stack([*(block[:, layout.columns[name]] for name in ("stored", "imaging")), alive])
        told = self._told(block, tail, r_A, known)
        out = {}
        for agent in self.agents:
            j = self._number[agent]
            others = np.arange(n) != j
            where, facts, end = (r_A, known, tail) if told is None else self._as_told(told, j, tail)
            out[agent] = local_observation(block[j], r_A[j], where[others], facts[others], end)
        return out

    def _told(self, block: Array32, tail: Array32, r_A: Array, known: Array) -> GraphKnowledge | None:
        """What has reached each by now; None where all know all."""
        if self.task.config.observability == "full":
            return None
        batch, columns = self.batch, self.task.observation_layout.columns
        earthward = (block[:, columns["role"]][:, TargetKind.EARTH] > 0.5) & batch.totals.closed[0]
        news = News(r_A.copy(), known, batch.totals.first_by[0], float(tail[-1]), earthward)
        if self._knowledge is None:
            self._knowledge = GraphKnowledge(len(block), known.shape[1], self.task.patches)
            self._knowledge.begin(news)
        now = batch.now if batch.flights.finite[0] else batch.before
        self._knowledge.tell(news, groups_of(self.task, self.task.occluder, now, ~batch.totals.lost[0]))
        return self._knowledge

    def _as_told(self, told: GraphKnowledge, j: int, tail: Array32) -> tuple[Array, Array, Array]:
        """Positions, facts and the end of the observation as spacecraft j knows them."""
        patches, seen, delivered = told.tail(j)
        return told.r_A[j], told.facts[j], np.concatenate([patches, [tail[-3], seen, delivered]])

    def render(self) -> Pixels | None:
        """The overview as a picture with `render_mode="rgb_array"`; see `SwarmObserveEnv.render`."""
        if self.render_mode is None:
            gymnasium.logger.warn("render() draws nothing: make the environment with render_mode='rgb_array'")
            return None
        _ = self.batch
        if not self._begun:
            raise gymnasium.error.ResetNeeded("swarm_observe_v0: there is nothing to draw before the first reset")
        return self._renderer.draw()

    def state(self) -> Observation:
        """The observation of `SwarmObserveEnv`: everything, for critics that see it all."""
        return self.batch.observation[0].copy()

    def close(self) -> None:
        """Release observer and OpenGL context; may be called again."""
        self._renderer.close()
        if self._batch is not None:
            self.task.close()
        self._batch, self.agents = None, []


#: PettingZoo's way to name an environment: `swarm_observe_v0.parallel_env(...)`.
swarm_observe_v0 = SimpleNamespace(parallel_env=SwarmObserveParallelEnv)
