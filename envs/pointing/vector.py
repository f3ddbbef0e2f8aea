"""SwarmPointing-v0 as gymnasium's vector environment: many spacecraft at once, bit for bit those of single environments."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ClassVar

import gymnasium
import numpy as np
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from swarm_mj.typing import Array32, Mask, Pixels

from ..arguments import checked_count, checked_index, checked_options, checked_render_mode, flight_seeds
from ..autoreset import Infos, checked_mode, one_of
from ..observe.rewards import StepResult
from ..observe.vector import SwarmObserveVectorEnv
from ..snapshots import FlightState, must_have_begun, restore_state
from ..threads import refuse_beyond_memory
from .batch import PointingBatch
from .config import WEIGHTS
from .single import ACTION_SPACE, NAME, checked_spacecraft, crossed
from .task import PointingTask, make_pointing_task


class PointingFlights:
    """A batch with the interface of `ThreadedBatch`.

    Args:
        task: What they share.
        count: Number of episodes E.

    Attributes:
        task: What they share.
        whole: All of them.
        wanted: Which spacecraft the next resets are to fly, from 0, by episode; any where it is not named.
    """

    def __init__(self, task: PointingTask, count: int) -> None:
        refuse_beyond_memory(task, count)
        self.task, self.whole = task, PointingBatch(task, count)
        self.wanted: dict[int, int | None] = {}

    def reset(self, seeds: dict[int, int]) -> None:
        """Start episodes anew from their flight seeds, by number of the episode."""
        for e, seed in seeds.items():
            self.whole.reset(e, seed, self.wanted.get(e))

    def step(self, actions: NDArray[Any], live: Mask) -> StepResult:
        """Fly the live episodes one step."""
        batch = self.whole
        batch.step(actions, live)
        nobody = np.zeros(batch.count, np.int64)
        terms: Any = batch.state.terms.T.copy()
        over, hit = batch.over() & live, np.zeros((batch.count, 1), np.bool_)
        return StepResult(reward=batch.state.reward.copy(), terms=terms, end=nobody, truncated=over, hit=hit)

    @property
    def observation(self) -> Any:
        """Of all episodes, a copy."""
        return self.whole.observed()

    def gather(self, pick: Callable[[PointingBatch], NDArray[Any]]) -> NDArray[Any]:
        """One array over all episodes."""
        return np.array(pick(self.whole))

    def locate(self, e: int) -> tuple[PointingBatch, int]:
        """The batch that flies episode e, and its number there."""
        return self.whole, e

    def close(self) -> None:
        """Nothing to release."""


class SwarmPointingVectorEnv(SwarmObserveVectorEnv):
    """`num_envs` spacecraft; made by `gymnasium.make_vec("swarm_mj.envs:SwarmPointing-v0", ...)`.

    Spaces and rewards are those of `SwarmPointingEnv`, which documents them, and so are the numbers: with the same seeds
    every episode is bit for bit that of the single environment. Autoreset is as in `SwarmObserveVectorEnv`. `reset` takes
    the options `flight_seed` and `spacecraft`, for all or one for each: a swarm is n episodes of one seed,

        envs.reset(options={"flight_seed": 7, "spacecraft": [1, 2, 3, 4, 5]})

    Infos hold arrays over the episodes, with the mask of those to whom they apply under the same name with a leading
    underscore: those that `SwarmPointingEnv` names.

    Args:
        num_envs: Number of episodes.
        autoreset_mode: See `SwarmObserveVectorEnv`.
        render_mode: None or `"rgb_array"`.
        render_flights: How many cameras `render` shows, the first ones.
        arguments: The others of `SwarmPointingEnv`.
    """

    name: ClassVar[str] = NAME

    def __init__(
        self,
        num_envs: int = 1,
        *,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        render_mode: str | None = None,
        render_flights: int = 4,
        **arguments: Any,
    ) -> None:
        self.made_of = {"num_envs": num_envs, "autoreset_mode": autoreset_mode, "render_mode": render_mode}
        self.made_of |= {"render_flights": render_flights, **arguments}
        count = checked_count("num_envs", num_envs)
        self._shown = min(count, checked_count("render_flights", render_flights))
        self.render_mode = checked_render_mode(render_mode, ["rgb_array"])
        self.num_envs, self._mode = count, checked_mode(autoreset_mode)
        self.autoreset_mode = self._mode
        self.metadata = {"render_modes": ["rgb_array"], "render_fps": 10, "autoreset_mode": self._mode}
        task = make_pointing_task(**arguments)
        self._batch: Any = PointingFlights(task, count)
        self.single_observation_space, self.single_action_space = task.observation_space, ACTION_SPACE
        self.observation_space = batch_space(self.single_observation_space, count)
        self.action_space = batch_space(ACTION_SPACE, count)
        self._random = [seeding.np_random()[0] for _ in range(count)]
        self._over, self._begun = np.zeros(count, np.bool_), np.zeros(count, np.bool_)

    @property
    def batch(self) -> Any:
        """The episodes, see `PointingFlights`.

        Raises:
            gymnasium.error.ClosedEnvironmentError: The environment was closed.
        """
        return super().batch

    def reset(
        self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Array32, Infos]:
        """Start all episodes, or those of `options["reset_mask"]`; see the class for the other options."""
        given, flights = checked_options(options), self.batch
        wanted = flight_seeds(given.pop("spacecraft", None), self.num_envs)
        flights.wanted = {e: checked_spacecraft(j, flights.task) for e, j in enumerate(wanted)}
        try:
            return super().reset(seed=seed, options=given)
        finally:
            flights.wanted = {}

    def set_state(self, e: int, state: FlightState) -> Any:
        """Let episode e go on from a state; returns its observation."""
        batch, k = self.batch.locate(checked_index(e, self.num_envs))
        self._over[e] = not restore_state(batch, k, self._random[e], state).running
        self._begun[e] = True
        return one_of(batch.observed(), k)

    def _infos(self, mask: Mask) -> Infos:
        batch = self.batch.whole
        state, steps = batch.state, np.maximum(batch.state.step, 1)
        values = {
            "time_s": batch.time_s,
            "spacecraft": batch.spacecraft + 1,
            "error_deg": np.degrees(state.error),
            "on_target": state.on_target / steps,
            "held": state.held.sum(axis=1),
            "success": batch.success,
        }
        return values | {f"_{name}": mask.copy() for name in values}

    def _ends(self, result: StepResult, live: Mask) -> Infos:
        return {"reward_terms": dict(zip(WEIGHTS, result.terms, strict=True)), "_reward_terms": live}

    def render(self) -> tuple[Pixels, ...] | None:
        """What the first `render_flights` cameras see, see `SwarmPointingEnv.render`."""
        if self.render_mode is None:
            gymnasium.logger.warn("render() draws nothing: make the environment with render_mode='rgb_array'")
            return None
        must_have_begun(bool(self._begun[: self._shown].all()), "render", NAME)
        return tuple(crossed(self.batch.whole, e) for e in range(self._shown))

    def close_extras(self, **kwargs: Any) -> None:
        """Forget the episodes."""
        self._batch = None
