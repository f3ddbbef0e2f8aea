"""SwarmObserve-v0 as gymnasium's vector environment: many batch at once, bit for bit those of single environments."""

from __future__ import annotations

from typing import Any, ClassVar

import gymnasium
import numpy as np
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from swarm_mj.errors import ScenarioError
from swarm_mj.typing import Array, Array32, Mask, Pixels

from .actions import check_action
from .arguments import (
    checked_count,
    checked_index,
    checked_options,
    checked_render_mode,
    first_seeds,
    flight_seed,
    flight_seeds,
    refuse_graph,
)
from .rendering import EpisodeRenderer
from .rewards import ENDS, TERMS, StepResult
from .snapshots import FlightState, RebuiltOnCopy, must_have_begun, restore_state, take_state
from .task import make_task
from .threads import ThreadedBatch, default_threads

Infos = dict[str, Any]


class SwarmObserveVectorEnv(RebuiltOnCopy, VectorEnv[Any, Any, Any]):
    """`num_envs` batch of one scenario; made by `gymnasium.make_vec("swarm_mj:SwarmObserve-v0", ...)`.

    Spaces, rewards and episode ends are those of `SwarmObserveEnv`, which documents them, and so are the numbers: with the
    same seeds every flight is bit for bit that of the single environment, whatever `num_envs` and `threads` are.

    Infos hold arrays over the flights, with the mask of those to whom they apply under the same name with a leading
    underscore: `time_s`, `coverage_percent`, `delivered_bit`, `stored_bit` (num_envs, n), `seen_bit`, `lost_bit`,
    `reward_terms` (a dict of arrays), `flight_seed` where a flight began, `end` (text) where one ended by itself, and `cause`
    where one diverged.

    Args:
        num_envs: Number of flights.
        autoreset_mode: `NextStep` (default, as gymnasium's own vector environments: a flight that ended is started anew by the
            next call of `step`, which ignores its action and gives reward 0), `SameStep` (it is started at once; `final_obs`
            and `final_info` hold the end) or `Disabled` (call `reset(options={"reset_mask": mask})`).
        threads: Most that are used; None for the cores that this process may use.
        render_mode: None or `"rgb_array"`.
        render_flights: How many flights `render` shows, the first ones.
        arguments: The others of `SwarmObserveEnv`, except `width` and `height`.
    """

    #: Whether a flight goes on without the spacecraft that hit the body.
    continues_after_impact: ClassVar[bool] = False
    #: What messages call it.
    name: ClassVar[str] = "SwarmObserve-v0"

    def __init__(
        self,
        num_envs: int = 1,
        *,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        threads: int | None = None,
        render_mode: str | None = None,
        render_flights: int = 4,
        **arguments: Any,
    ) -> None:
        self.made_of = {"num_envs": num_envs, "autoreset_mode": autoreset_mode, "threads": threads, **arguments}
        num_envs = checked_count("num_envs", num_envs)
        if threads is not None:
            threads = checked_count("threads", threads, ", or None")
        self.made_of |= {"render_mode": render_mode, "render_flights": render_flights}
        self.render_mode = checked_render_mode(render_mode, ["rgb_array"])
        shown = min(num_envs, checked_count("render_flights", render_flights))
        self._batch: ThreadedBatch | None = None
        mode = checked_mode(autoreset_mode)
        self.metadata = {"render_modes": ["rgb_array"], "render_fps": 10, "autoreset_mode": mode}
        self._mode, self.num_envs = mode, num_envs
        self.autoreset_mode = mode  # as gymnasium's own vector environments tell it, for TorchRL
        task = make_task(**arguments)
        refuse_graph(task.config.observability)
        used = default_threads() if threads is None else threads
        self._batch = batch = ThreadedBatch(task, num_envs, used, continues_after_impact=self.continues_after_impact)
        self._renderer = EpisodeRenderer([batch.locate(e) for e in range(shown)], 640, 480)
        self.single_observation_space = task.observation_layout.space
        self.single_action_space = self._batch.batches[0].level.action_space
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._random = [seeding.np_random()[0] for _ in range(num_envs)]
        self._over, self._begun = np.zeros(num_envs, np.bool_), np.zeros(num_envs, np.bool_)

    @property
    def batch(self) -> ThreadedBatch:
        """The episodes.

        Raises:
            gymnasium.error.ClosedEnvironmentError: The environment was closed.
        """
        if self._batch is None:
            raise gymnasium.error.ClosedEnvironmentError(f"{self.name} was closed; make it anew")
        return self._batch

    def reset(
        self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Array32, Infos]:
        """Start all flights, or those of `options["reset_mask"]`.

        Args:
            seed: Of the first flight, the next ones follow; or one for each flight; None draws on.
            options: `reset_mask`: bool, shape (num_envs,); `flight_seed`: of all flights, or one for each.

        Raises:
            ScenarioError: A seed or option is not allowed.
        """
        given = checked_options(options)
        mask = checked_mask(given.pop("reset_mask", None), self.num_envs)
        for e, own in enumerate(first_seeds(seed, self.num_envs)):
            if own is not None and mask[e]:
                self._random[e] = seeding.np_random(own)[0]
        chosen = flight_seeds(given.pop("flight_seed", None), self.num_envs)
        flights = {int(e): self._draw(int(e), given, chosen[e]) for e in np.flatnonzero(mask)}
        self.batch.reset(flights)
        self._over[mask], self._begun[mask] = False, True
        infos = self._infos(mask)
        put_infos(infos, "flight_seed", flights, self.num_envs)
        return self.batch.observation, infos

    def _draw(self, e: int, options: dict[str, Any], wanted: Any = None) -> int:
        drawn = int(self._random[e].integers(2**31))
        return flight_seed(options | ({} if wanted is None else {"flight_seed": wanted}), drawn)

    def step(self, actions: NDArray[Any]) -> tuple[Array32, Array, Mask, Mask, Infos]:
        """Fly on for one step with the actions held, shape (num_envs, ...).

        Raises:
            gymnasium.error.InvalidAction: The actions do not lie in the action space.
            gymnasium.error.ResetNeeded: A flight was never begun, or with autoreset disabled one is over.
        """
        if not self._begun.all() or (self._mode is AutoresetMode.DISABLED and self._over.any()):
            raise gymnasium.error.ResetNeeded(f"{self.name}: an episode is over or has not begun; call reset first")
        array = check_action(self.action_space, actions)
        began = self._restart() if self._mode is AutoresetMode.NEXT_STEP and self._over.any() else {}
        live = np.ones(self.num_envs, np.bool_)
        live[list(began)] = False
        result = self.batch.step(array, live)
        terminated, truncated = (result.end > 0) & live, result.truncated & live
        rewards = np.where(live, result.reward, 0.0)
        infos = self._infos(np.ones(self.num_envs, np.bool_)) | self._ends(result, live)
        self._over = terminated | truncated
        observations = self.batch.observation
        if self._mode is AutoresetMode.SAME_STEP and self._over.any():
            observations, infos, began = self._restart_at_once(observations, infos)
        put_infos(infos, "flight_seed", began, self.num_envs)
        return observations, rewards, terminated, truncated, infos

    def _restart(self) -> dict[int, int]:
        began = {int(e): self._draw(int(e), {}) for e in np.flatnonzero(self._over)}
        self.batch.reset(began)
        return began

    def _restart_at_once(self, last: Array32, infos: Infos) -> tuple[Array32, Infos, dict[int, int]]:
        over = self._over.copy()
        began = self._restart()
        final_obs = np.full(self.num_envs, None, dtype=object)
        for e in np.flatnonzero(over):
            final_obs[e] = one_of(last, int(e))
        fresh = self._infos(np.ones(self.num_envs, np.bool_))
        fresh |= {"reward_terms": infos["reward_terms"], "_reward_terms": infos["_reward_terms"] & ~over}
        fresh |= {"final_obs": final_obs, "_final_obs": over, "final_info": infos, "_final_info": over}
        self._over[:] = False
        return self.batch.observation, fresh, began

    def get_state(self, e: int) -> FlightState:
        """Where flight e stands, see `SwarmObserveEnv.get_state`; single and vector environments take each other's states."""
        batch, k = self.batch.locate(checked_index(e, self.num_envs))
        must_have_begun(bool(self._begun[e]), "get_state", self.name)
        return take_state(batch, k, running=not self._over[e], random=self._random[e])

    def set_state(self, e: int, state: FlightState) -> Array32:
        """Let flight e go on from a state, see `SwarmObserveEnv.set_state`; the others are left alone.

        Returns:
            Its observation, shape (F,).
        """
        batch, k = self.batch.locate(checked_index(e, self.num_envs))
        self._over[e] = not restore_state(batch, k, self._random[e], state).running
        self._begun[e] = True
        return batch.observation[k].copy()

    def _standing(self) -> dict[str, Any]:
        kept = {name: getattr(self, name) for name in ("spec", "action_space", "single_action_space", "_random")}
        _ = self.batch
        return {"kept": kept, "flights": {int(e): self.get_state(int(e)) for e in np.flatnonzero(self._begun)}}

    def _stand(self, standing: dict[str, Any]) -> None:
        self.__dict__.update(standing["kept"])
        for e, state in standing["flights"].items():
            self.set_state(e, state)

    def _infos(self, mask: Mask) -> Infos:
        batch = self.batch
        values = {
            "time_s": batch.gather(lambda part: part.time_s),
            "coverage_percent": batch.gather(lambda part: part.totals.percent),
            "delivered_bit": batch.gather(lambda part: part.totals.delivered),
            "stored_bit": batch.gather(lambda part: part.totals.stored),
            "seen_bit": batch.gather(lambda part: part.totals.seen_bit),
            "lost_bit": batch.gather(lambda part: part.totals.lost_bit),
        }
        return values | {f"_{name}": mask.copy() for name in values}

    def _ends(self, result: StepResult, live: Mask) -> Infos:
        terms = dict(zip(TERMS, result.terms, strict=True))
        infos: Infos = {"reward_terms": terms, "_reward_terms": live}
        ended = {int(e): ENDS[result.end[e]] for e in np.flatnonzero(live & (result.end > 0))}
        put_infos(infos, "end", ended, self.num_envs)
        causes = {e: self.batch.cause(e) for e, end in ended.items() if end == "diverged"}
        put_infos(infos, "cause", causes, self.num_envs)
        return infos

    def render(self) -> tuple[Pixels, ...] | None:
        """The overviews of the first `render_flights` flights, see `SwarmObserveEnv.render`, with `render_mode="rgb_array"`."""
        if self.render_mode is None:
            gymnasium.logger.warn("render() draws nothing: make the environment with render_mode='rgb_array'")
            return None
        _ = self.batch
        must_have_begun(bool(self._begun[: self._renderer.count].all()), "render", self.name)
        return tuple(self._renderer.draw(k) for k in range(self._renderer.count))

    def close_extras(self, **kwargs: Any) -> None:
        """End the threads and release the observer."""
        if self._batch is not None:
            self._renderer.close()
            self._batch.close()
        self._batch = None


def one_of(observations: Any, e: int) -> Any:
    """The observation of flight e, a copy, of those of all, which may be a dict of parts."""
    if isinstance(observations, dict):
        return {name: part[e].copy() for name, part in observations.items()}
    return observations[e].copy()


def put_infos(infos: Infos, name: str, values: dict[int, Any], count: int) -> None:
    """Add what applies to some flights only, with its mask."""
    if values:
        kind = np.int64 if isinstance(next(iter(values.values())), int) else object
        array, mask = np.zeros(count, kind), np.zeros(count, np.bool_)
        for e, value in values.items():
            array[e], mask[e] = value, True
        infos[name], infos[f"_{name}"] = array, mask


def checked_mode(given: Any) -> AutoresetMode:
    """The autoreset mode of that name, or as it was given.

    Raises:
        ScenarioError: There is no such mode.
    """
    try:
        return AutoresetMode(given)
    except ValueError:
        modes = ", ".join(mode.value for mode in AutoresetMode)
        raise ScenarioError(f"autoreset_mode = {given!r}: must be one of {modes}") from None


def checked_mask(given: Any, count: int) -> Mask:
    """The `reset` option `reset_mask`, all where it is None."""
    if given is None:
        return np.ones(count, np.bool_)
    try:
        mask = np.asarray(given)
    except ValueError:  # rows of different lengths
        mask = np.zeros(0)
    if mask.shape != (count,) or mask.dtype != np.bool_ or not mask.any():
        raise ScenarioError(
            f"reset option reset_mask: must be {count} booleans, at least one of them true, not {given!r}"
        )
    return mask
