"""SwarmObserve-v0 for many agents: each spacecraft decides for itself, through PettingZoo's ParallelEnv.

from swarm_mj.envs.observe.parallel import swarm_observe_v0
env = swarm_observe_v0.parallel_env(split="train")

`SwarmObserveParallelVectorEnv` has the same interface with arrays over many episodes.
"""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, ClassVar

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from swarm_mj.errors import ScenarioError
from swarm_mj.typing import Array32, Mask, Pixels

from ..agents import PerAgent, SwarmParallelEnv
from ..arguments import agent_names, checked_render_mode, record_of
from ..batch_env import StepOutcome, must_have_begun
from ..pixels import IMAGE_SPACE
from ..snapshots import EpisodeSnapshot, restore_state, take_state
from .catalogue import DEFAULT_COUNT
from .config import EnvConfig
from .episodes import Episodes, box
from .knowledge import GraphKnowledge
from .layout import Observed, local_parts, local_rows
from .rendering import EpisodeRenderer
from .rewards import no_result
from .single import NAME
from .vector import SwarmObserveVectorEnv


class SwarmObserveParallelEnv(SwarmParallelEnv):
    """An episode of `SwarmObserveEnv` in which each spacecraft is an agent: `sc1`, `sc2`, ...

    All are among its `agents` as an episode begins; who does not fly in it leaves them with the first step, and who is lost as
    that happens, terminated, and the others go on.

    **Actions**: Discrete, one entry there. **Reward**: the team's. **Observation**: `entities`: a Dict with its own
    row of the table of spacecraft (`self`), its own row of pairs (`pairs`), the rows of the others in cyclic order (`others`),
    `patches`, `general`, and `action_mask`; or, if it chooses among candidates, these (`candidates`) in the place of pairs and
    patches; `flat`: the same in one Box, without the mask; `pixels`: that as `state`, and what its own camera sees as `image`.
    With `knowledge="graph"` each is shown what has reached it, see `GraphKnowledge`; `knowledge="full"` shows all to all, which
    no spacecraft may be able to know. `state()` is the flat
    observation of `SwarmObserveEnv`, for critics. Infos hold what that environment tells, `action_mask` only beside flat
    observations, `reward_terms` as an array in the order of `rewards.TERMS`, and `end` as a number in `rewards.ENDS`, 0 where
    the flight goes on.

    Args:
        missions: See `SwarmObserveEnv`.
        split: See `SwarmObserveEnv`.
        render_mode: None or `"rgb_array"`.
        agent_prefix: What stands before the numbers of the agents.
        arguments: The others of `SwarmObserveEnv`.
    """

    name = "swarm_observe_v0"
    metadata: ClassVar[dict[str, Any]] = {
        "name": name,
        "render_modes": ["rgb_array"],
        "render_fps": 10,
        "is_parallelizable": True,
    }

    def __init__(
        self,
        missions: Any = DEFAULT_COUNT,
        split: str = "train",
        render_mode: str | None = None,
        *,
        agent_prefix: str = "sc",
        **arguments: Any,
    ) -> None:
        arguments = {"knowledge": "graph"} | arguments
        self.render_mode = checked_render_mode(render_mode, self.metadata["render_modes"])
        self.config = record_of(EnvConfig, NAME, {"missions": missions, "split": split, **arguments})
        episodes = Episodes(self.config, 1)
        self._renderer = EpisodeRenderer(episodes, 1)
        names = agent_names(agent_prefix, self.config.spacecraft)
        self._number = {name: j for j, name in enumerate(names)}
        self._set_up(episodes, names, local_space(episodes), spaces.Discrete(episodes.choices))
        self.state_space: spaces.Box = box(episodes.layout.size)
        self._knowledge: GraphKnowledge | None = None

    def reset(self, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[PerAgent, PerAgent]:
        """Start an episode; `options` may hold `flight_seed` and `draw`, and others are ignored, as PettingZoo asks."""
        chosen = self._draw(seed, options)
        with self._first_use("reset"):
            self.batch.reset({0: chosen}, (options or {}).get("draw"))
        if self.config.knowledge == "graph":
            self._knowledge = GraphKnowledge(self.batch)
            self._knowledge.begin()
        info, self._begun = self.batch.info(0) | _step_info(no_result(1)) | {"flight_seed": chosen}, True
        self.agents = list(self.possible_agents)
        return self._observations(), self._infos(self.agents, info)

    def _fly(self, actions: PerAgent) -> tuple[PerAgent, PerAgent, PerAgent, PerAgent, PerAgent]:
        episodes, flew = self.batch, self.agents
        result = episodes.fly(self._joined(actions)[None], np.ones(1, np.bool_))
        if self._knowledge is not None and not result.end[0]:
            self._knowledge.tell()
        info, ended = episodes.info(0) | _step_info(result), bool(result.end[0])
        terminations = {agent: ended or not info["alive"][self._number[agent]] for agent in flew}
        truncations = {agent: bool(result.truncated[0]) and not terminations[agent] for agent in flew}
        observations = self._observations()
        rewards = dict.fromkeys(flew, float(result.reward[0]))
        self.agents = [agent for agent in flew if not (terminations[agent] or truncations[agent])]
        return observations, rewards, terminations, truncations, self._infos(flew, info)

    def get_state(self) -> EpisodeSnapshot:
        """Where the flight stands, see `SwarmObserveEnv.get_state`."""
        must_have_begun(self._begun, "get_state", self.name)
        flying = tuple(self._number[agent] for agent in self.agents)
        known = None if self._knowledge is None else tuple(array.copy() for array in self._knowledge.arrays)
        state = take_state(self.batch, 0, running=bool(flying), random=self._random)
        return replace(state, agents=flying, knowledge=known)

    def set_state(self, state: EpisodeSnapshot) -> PerAgent:
        """Go on from a state that such an environment gave; returns the observations of those that fly."""
        if isinstance(state, EpisodeSnapshot) and state.agents is None:
            raise ScenarioError(
                "state: was taken from an environment that knows no agents; take it from a multi-agent one"
            )
        flying = restore_state(self.batch, 0, self._random, state).agents or ()
        if state.knowledge is not None:
            self._knowledge = GraphKnowledge(self.batch)
            for ours, theirs in zip(self._knowledge.arrays, state.knowledge, strict=True):
                ours[:] = theirs
        self.agents, self._begun = [self.possible_agents[j] for j in flying], True
        return self._observations()

    def _flights(self) -> dict[int, EpisodeSnapshot]:
        return {0: self.get_state()} if self._begun else {}

    def _go_on(self, e: int, state: EpisodeSnapshot) -> None:
        self.set_state(state)

    def _joined(self, actions: PerAgent) -> NDArray[Any]:
        joined = np.zeros(self.batch.n, np.int64)
        for agent, action in actions.items():
            joined[self._number[agent]] = action
        # Candidates are those that each knows of.
        observed, n = self._observed, len(joined)
        chosen = self.batch.interface.decoded(observed, np.tile(joined, (len(observed["pairs"]), 1)))
        return np.asarray(chosen[0] if self._knowledge is None else chosen[np.arange(n), np.arange(n)])

    @property
    def _observed(self) -> Observed:
        """What the swarm is shown, the tables of one episode; or what each spacecraft knows, those of n."""
        return self.batch.entities() if self._knowledge is None else self._knowledge.observed

    def _infos(self, agents: list[str], info: dict[str, Any]) -> PerAgent:
        own = {name: value for name, value in info.items() if name != "action_mask"}
        if self.config.observation == "entities":
            return {agent: dict(own) for agent in agents}
        mask, alike = self.batch.interface.shown(self._observed)["action_mask"], self._knowledge is None
        rows = {agent: self._number[agent] for agent in agents}
        return {agent: own | {"action_mask": mask[0 if alike else j, j].copy()} for agent, j in rows.items()}

    def _observations(self) -> PerAgent:
        shown = local_observations(self.batch, self._observed)
        row = {agent: 0 if self._knowledge is None else j for agent, j in self._number.items()}
        return {agent: _row(shown[self._number[agent]], row[agent]) for agent in self.agents}

    def state(self) -> Array32:
        """The flat observation of `SwarmObserveEnv`: everything, for critics that see it all."""
        return self.batch.flat()[0]

    def render(self) -> Pixels | None:
        """The overview as a picture with `render_mode="rgb_array"`, see `SwarmObserveEnv.render`."""
        _ = self.batch
        pictures = self._renderer.render(self.render_mode, self._begun, self.name)
        return None if pictures is None else pictures[0]


def _step_info(result: StepOutcome) -> dict[str, Any]:
    """What is told of a step, in numbers alone, as TorchRL needs it."""
    return {"reward_terms": result.terms[0].copy(), "end": int(result.end[0])}


def _row(shown: Any, e: int) -> Any:
    """Of one of the episodes."""
    return {name: part[e] for name, part in shown.items()} if isinstance(shown, dict) else shown[e]


def local_observations(episodes: Episodes, observed: Observed | None = None) -> list[Any]:
    """What each spacecraft is shown in every episode, arrays (E, ...) by name or one (E, L), copies.

    Tables by name take the place of those of the episodes where they are given.
    """
    shown = episodes.interface.shown(episodes.entities() if observed is None else observed)
    if episodes.config.observation != "entities":
        rows = list(local_rows(shown).transpose(1, 0, 2).copy())
        if episodes.config.observation == "flat":
            return rows
        images = episodes.images()
        # Where each is shown what it knows, tables are those of n of them, of one episode.
        count = max(len(images), len(rows[0]))
        return [
            {"image": np.tile(images[:, j], (count // len(images), 1, 1, 1)), "state": rows[j]}
            for j in range(episodes.n)
        ]
    parts = local_parts(shown) | {"action_mask": shown["action_mask"]}
    return [{name: part[:, j].copy() for name, part in parts.items()} for j in range(episodes.n)]


def local_space(episodes: Episodes) -> spaces.Space[Any]:
    """Of what one spacecraft is shown in one episode."""
    shown = local_observations(episodes)[0]
    if not isinstance(shown, dict):
        return box(shown.shape[1])
    if "image" in shown:
        return spaces.Dict({"image": IMAGE_SPACE, "state": box(shown["state"].shape[1])})
    found: dict[str, spaces.Space[Any]] = {name: box(*part.shape[1:]) for name, part in shown.items()}
    return spaces.Dict(found | {"action_mask": spaces.MultiBinary(episodes.choices)})


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


#: PettingZoo's way to name an environment: `swarm_observe_v0.parallel_env(...)`.
swarm_observe_v0 = SimpleNamespace(parallel_env=SwarmObserveParallelEnv)
