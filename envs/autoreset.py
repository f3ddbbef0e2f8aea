"""What vector environments of flights have in common: seeds, masks, the modes of autoreset, and infos with masks."""

from __future__ import annotations

from abc import abstractmethod
from typing import Any, ClassVar

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from swarm_mj.errors import ScenarioError
from swarm_mj.typing import Array, Mask

from .arguments import check_action, checked_options, first_seeds, flight_seed, flight_seeds
from .observe.rewards import ENDS, TERMS, StepResult

Infos = dict[str, Any]


class FlightsVectorEnv(VectorEnv[Any, Any, Any]):
    """E flights at once, each with random numbers of its own.

    Its `batch` has `reset(flights)`, `step(actions, live)`, `observation`, `cause(e)` and `close()`.
    """

    #: What messages call it.
    name: ClassVar[str]
    _batch: Any = None

    def _set_up(self, batch: Any, mode: AutoresetMode, count: int, single: tuple[spaces.Space[Any], Any]) -> None:
        """Take the flights, and the observation and action space of one of them."""
        self._batch = batch
        self._mode, self.num_envs = mode, count
        self.autoreset_mode = mode  # as gymnasium's own vector environments tell it, for TorchRL
        self.single_observation_space, self.single_action_space = single
        self.observation_space = batch_space(self.single_observation_space, count)
        self.action_space = batch_space(self.single_action_space, count)
        self._random = [seeding.np_random()[0] for _ in range(count)]
        self._over, self._begun = np.zeros(count, np.bool_), np.zeros(count, np.bool_)

    @property
    def batch(self) -> Any:
        """The episodes.

        Raises:
            gymnasium.error.ClosedEnvironmentError: The environment was closed.
        """
        if self._batch is None:
            raise gymnasium.error.ClosedEnvironmentError(f"{self.name} was closed; make it anew")
        return self._batch

    @abstractmethod
    def _infos(self, mask: Mask) -> Infos:
        """What every step tells of all flights, with the mask of those to whom it applies."""

    def _begin(self, flights: dict[int, int], given: Any) -> None:
        """Start flights anew from their seeds; `given` is what the options of `reset` say besides."""
        self.batch.reset(flights)

    def reset(
        self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, Infos]:
        """Start all flights, or those of `options["reset_mask"]`.

        Args:
            seed: Of the first flight, the next ones follow; or one for each flight; None draws on.
            options: `reset_mask`: bool, shape (num_envs,); `flight_seed`: of all flights, or one for each.

        Raises:
            ScenarioError: A seed or option is not allowed.
        """
        given = checked_options(options)
        mask = checked_mask(given.pop("reset_mask", None), self.num_envs)
        extra = {name: given.pop(name) for name in self._own_options if name in given}
        for e, own in enumerate(first_seeds(seed, self.num_envs)):
            if own is not None and mask[e]:
                self._random[e] = seeding.np_random(own)[0]
        chosen = flight_seeds(given.pop("flight_seed", None), self.num_envs)
        flights = {int(e): self._draw(int(e), given, chosen[e]) for e in np.flatnonzero(mask)}
        self._begin(flights, extra)
        self._over[mask], self._begun[mask] = False, True
        infos = self._infos(mask)
        put_infos(infos, "flight_seed", flights, self.num_envs)
        return self.batch.observation, infos

    #: Options of `reset` besides those of all.
    _own_options: ClassVar[tuple[str, ...]] = ()

    def _draw(self, e: int, options: dict[str, Any], wanted: Any = None) -> int:
        drawn = int(self._random[e].integers(2**31))
        others = [*self._own_options, "reset_mask"]
        return flight_seed(options | ({} if wanted is None else {"flight_seed": wanted}), drawn, others)

    def step(self, actions: NDArray[Any]) -> tuple[Any, Array, Mask, Mask, Infos]:
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
        self._begin(began, {})
        return began

    def _restart_at_once(self, last: Any, infos: Infos) -> tuple[Any, Infos, dict[int, int]]:
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

    def _ends(self, result: StepResult, live: Mask) -> Infos:
        terms = dict(zip(TERMS, result.terms, strict=True))
        infos: Infos = {"reward_terms": terms, "_reward_terms": live}
        ended = {int(e): ENDS[result.end[e]] for e in np.flatnonzero(live & (result.end > 0))}
        put_infos(infos, "end", ended, self.num_envs)
        causes = {e: self.batch.cause(e) for e, end in ended.items() if end == "diverged"}
        put_infos(infos, "cause", causes, self.num_envs)
        return infos

    def close_extras(self, **kwargs: Any) -> None:
        """End the threads and release the observers."""
        if self._batch is not None:
            self._batch.close()
        self._batch = None


def put_infos(infos: Infos, name: str, values: dict[int, Any], count: int) -> None:
    """Add what applies to some flights only, with its mask."""
    if values:
        kind = np.int64 if isinstance(next(iter(values.values())), int) else object
        array, mask = np.zeros(count, kind), np.zeros(count, np.bool_)
        for e, value in values.items():
            array[e], mask[e] = value, True
        infos[name], infos[f"_{name}"] = array, mask


def one_of(observations: Any, e: int) -> Any:
    """The observation of flight e, a copy, of those of all, which may be a dict of parts."""
    if isinstance(observations, dict):
        return {name: part[e].copy() for name, part in observations.items()}
    return observations[e].copy()


def checked_mode(given: Any) -> AutoresetMode:
    """The mode of autoreset."""
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
