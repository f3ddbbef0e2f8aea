"""SwarmObserve-v0 for many agents: each spacecraft decides for itself, through PettingZoo's ParallelEnv.

from swarm_mj.envs.observe.parallel import swarm_observe_v0
env = swarm_observe_v0.parallel_env(split="train")
"""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, ClassVar

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from swarm_mj.errors import ScenarioError
from swarm_mj.io.progress import said_when_late
from swarm_mj.typing import Array32, Pixels

from ..agents import PerAgent, SwarmParallelEnv
from ..arguments import agent_names, checked_render_mode, record_of
from ..batch_env import FIRST_USE, StepOutcome
from ..snapshots import EpisodeSnapshot, must_have_begun, restore_state, take_state
from .catalogue import DEFAULT_COUNT
from .config import EnvConfig
from .episodes import Episodes, box
from .knowledge import GraphKnowledge
from .layout import Observed, local_rows
from .rendering import EpisodeRenderer
from .rewards import no_result
from .single import NAME


class SwarmObserveParallelEnv(SwarmParallelEnv):
    """An episode of `SwarmObserveEnv` in which each spacecraft is an agent: `sc1`, `sc2`, ...

    All are among its `agents` as an episode begins; who does not fly in it leaves them with the first step, and who is lost as
    that happens, terminated, and the others go on.

    **Actions**: Discrete, one entry there. **Reward**: the team's. **Observation**: `entities`: a Dict with its own
    row of the table of spacecraft (`self`), its own row of pairs (`pairs`), the rows of the others in cyclic order (`others`),
    `patches`, `general`, and `action_mask`; or, if it chooses among candidates, these (`candidates`) in the place of pairs and
    patches; `flat`: the same in one Box, without the mask. With `knowledge="graph"` each is shown what has reached it, see
    `GraphKnowledge`; `knowledge="full"` shows all to all, which no spacecraft may be able to know. `state()` is the flat
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

    metadata: ClassVar[dict[str, Any]] = {
        "name": "swarm_observe_v0",
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
        self.made_of = {"missions": missions, "split": split, "render_mode": render_mode, **arguments}
        self.made_of["agent_prefix"] = agent_prefix
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
        with said_when_late(f"{type(self).__name__}: first reset: {FIRST_USE}"):
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
        must_have_begun(self._begun, "get_state", "swarm_observe_v0")
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

    def _saved(self) -> dict[str, Any]:
        flight = self.get_state() if self._begun and self._batch is not None else None
        return {"kept": self._kept, "flight": flight}

    def _restore(self, saved: dict[str, Any]) -> None:
        self.__dict__.update(saved["kept"])
        if saved["flight"] is not None:
            self.set_state(saved["flight"])

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
        if self.config.observation != "flat":
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
        pictures = self._renderer.render(self.render_mode, self._begun, "swarm_observe_v0")
        return None if pictures is None else pictures[0]

    def close(self) -> None:
        """Release observers and OpenGL context; may be called again."""
        if self._batch is not None:
            self._renderer.close()
        super().close()


def _step_info(result: StepOutcome) -> dict[str, Any]:
    """What is told of a step, in numbers alone, as TorchRL needs it."""
    return {"reward_terms": result.terms[0].copy(), "end": int(result.end[0])}


def _row(shown: Any, e: int) -> Any:
    """Of one of the episodes."""
    return {name: part[e] for name, part in shown.items()} if isinstance(shown, dict) else shown[e]


def local_observations(episodes: Episodes, observed: Observed | None = None) -> list[Any]:
    """What each spacecraft is shown in every episode, arrays (E, ...) by name or one (E, L), copies.

    Args:
        episodes: Of an environment.
        observed: Tables by name; None: those of the episodes.
    """
    shown, n = episodes.interface.shown(episodes.entities() if observed is None else observed), episodes.n
    if episodes.config.observation == "flat":
        return list(local_rows(shown).transpose(1, 0, 2).copy())
    own = "pairs" if "pairs" in shown else "candidates"
    found = []
    for j in range(n):
        others = shown["spacecraft"][:, (j + 1 + np.arange(n - 1)) % n]
        parts = {"self": shown["spacecraft"][:, j], own: shown[own][:, j], "others": others}
        parts |= {name: shown[name].copy() for name in ("patches", "general") if name in shown}
        found.append(parts | {"action_mask": shown["action_mask"][:, j]})
    return found


def local_space(episodes: Episodes) -> spaces.Space[Any]:
    """Of what one spacecraft is shown in one episode."""
    shown = local_observations(episodes)[0]
    if not isinstance(shown, dict):
        return box(shown.shape[1])
    found: dict[str, spaces.Space[Any]] = {name: box(*part.shape[1:]) for name, part in shown.items()}
    return spaces.Dict(found | {"action_mask": spaces.MultiBinary(episodes.choices)})


#: PettingZoo's way to name an environment: `swarm_observe_v0.parallel_env(...)`.
swarm_observe_v0 = SimpleNamespace(parallel_env=SwarmObserveParallelEnv)
