"""Environments over a batch of episodes: gymnasium's single and vector ones, which a task completes with a few lines.

A task's batch has

    task             with `fingerprint`, a digest of all that must agree where the state of an episode is taken up;
    count            number of episodes E;
    space            of the observation of one episode;
    observation      of all of them, a copy, an array or a dict of arrays with E in front;
    reset(flights, **options)    start episodes anew, a mapping from their numbers to their flight seeds;
    step(actions, live)          fly the live ones on; returns a `StepOutcome`;
    infos()          what is told of all of them by name, arrays with E in front;
    get_state(e), set_state(e, state).
"""

from __future__ import annotations

from typing import Any, ClassVar, NamedTuple

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.vector import AutoresetMode

from swarm_mj.typing import Array, Ints, Mask

from .arguments import check_action, checked_count, checked_index, checked_options, flight_seed
from .autoreset import FlightsVectorEnv, Infos, checked_mode, one_of, put_infos
from .snapshots import FlightState, RebuiltOnCopy, must_have_begun, restore_state, take_state


class StepOutcome(NamedTuple):
    """Rewards and ends of a step of E episodes.

    Attributes:
        terms: Weighted reward terms, shape (E, terms).
        reward: Their sum, shape (E,).
        end: How an episode ended by itself, a number in `ends` of the environment, 0 where it goes on, shape (E,).
        truncated: Whether it is over by its time, shape (E,).
    """

    terms: Array
    reward: Array
    end: Ints
    truncated: Mask


class BatchEnv(RebuiltOnCopy, gymnasium.Env[Any, Any]):
    """One episode: a batch of one."""

    #: What messages call it, its reward terms, how an episode can end by itself, and options of `reset` besides `flight_seed`.
    name: ClassVar[str]
    terms: ClassVar[tuple[str, ...]]
    ends: ClassVar[tuple[str, ...]] = ("",)
    own_options: ClassVar[tuple[str, ...]] = ()
    _batch: Any = None

    def _set_up(self, batch: Any, action_space: spaces.Space[Any]) -> None:
        self._batch, self.task = batch, batch.task
        self.observation_space, self.action_space = batch.space, action_space
        self._running = self._begun = False

    @property
    def batch(self) -> Any:
        """The episode, as a batch of one.

        Raises:
            gymnasium.error.ClosedEnvironmentError: The environment was closed.
        """
        if self._batch is None:
            raise gymnasium.error.ClosedEnvironmentError(f"{self.name} was closed; make it anew")
        return self._batch

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Start an episode; the class says how.

        Raises:
            ScenarioError: `options` holds something else than a valid `flight_seed` and the environment's own options.
        """
        super().reset(seed=seed)
        given = checked_options(options)
        own = {name: given.pop(name) for name in self.own_options if name in given}
        drawn = flight_seed(given, int(self.np_random.integers(2**31)), self.own_options)
        self.batch.reset({0: drawn}, **own)
        self._running = self._begun = True
        return one_of(self.batch.observation, 0), self._info() | {"flight_seed": drawn}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Fly on for one step with the action held.

        Raises:
            gymnasium.error.ResetNeeded: There is no episode, or it is over.
            gymnasium.error.InvalidAction: The action does not lie in the action space.
        """
        batch = self.batch
        if not self._running:
            raise gymnasium.error.ResetNeeded(f"{self.name}: the episode is over or has not begun; call reset first")
        result = batch.step(check_action(self.action_space, action)[None], np.ones(1, np.bool_))
        terminated, truncated = bool(result.end[0]), bool(result.truncated[0])
        self._running = not (terminated or truncated)
        info = self._info() | {"reward_terms": dict(zip(self.terms, result.terms[0].tolist(), strict=True))}
        if terminated:
            info["end"] = self.ends[result.end[0]]
        return one_of(batch.observation, 0), float(result.reward[0]), terminated, truncated, info

    def get_state(self) -> FlightState:
        """Where the episode stands, to go back to by `set_state`, here or in any environment made with the same arguments.

        Raises:
            gymnasium.error.ResetNeeded: There is none before the first `reset`.
        """
        must_have_begun(self._begun, "get_state", self.name)
        return take_state(self.batch, 0, running=self._running, random=self.np_random)

    def set_state(self, state: FlightState) -> tuple[Any, dict[str, Any]]:
        """Go on from a state: the same actions bring the same, bit for bit.

        Raises:
            ScenarioError: It is no such state, or was taken from an environment with other arguments.
        """
        self._running = restore_state(self.batch, 0, self.np_random, state).running
        self._begun = True
        return one_of(self.batch.observation, 0), self._info()

    def close(self) -> None:
        """Forget the episode; may be called again."""
        self._batch, self._running = None, False

    def _info(self) -> dict[str, Any]:
        return info_of(self.batch, 0)

    def _standing(self) -> dict[str, Any]:
        kept = {name: getattr(self, name) for name in ("spec", "action_space", "_np_random", "_np_random_seed")}
        return {"kept": kept, "flight": self.get_state() if self._begun and self._batch is not None else None}

    def _stand(self, standing: dict[str, Any]) -> None:
        self.__dict__.update(standing["kept"])
        if standing["flight"] is not None:
            self.set_state(standing["flight"])


class BatchVectorEnv(RebuiltOnCopy, FlightsVectorEnv):
    """Many episodes, bit for bit those of `BatchEnv`, with infos as arrays and their masks."""

    terms: ClassVar[tuple[str, ...]]
    ends: ClassVar[tuple[str, ...]] = ("",)

    def _set_up_batch(self, batch: Any, mode: AutoresetMode, action_space: spaces.Space[Any]) -> None:
        self.task = batch.task
        self._set_up(batch, mode, batch.count, (batch.space, action_space))

    def _begin(self, flights: dict[int, int], given: Any) -> None:
        self.batch.reset(flights, **given)

    def get_state(self, e: int) -> FlightState:
        """Where episode e stands; single and vector environments take each other's states."""
        k = checked_index(e, self.num_envs)
        must_have_begun(bool(self._begun[k]), "get_state", self.name)
        return take_state(self.batch, k, running=not self._over[k], random=self._random[k])

    def set_state(self, e: int, state: FlightState) -> Any:
        """Let episode e go on from a state; returns its observation."""
        k = checked_index(e, self.num_envs)
        self._over[k] = not restore_state(self.batch, k, self._random[k], state).running
        self._begun[k] = True
        return one_of(self.batch.observation, k)

    def _infos(self, mask: Mask) -> Infos:
        values = self.batch.infos()
        return values | {f"_{name}": mask.copy() for name in values}

    def _ends(self, result: Any, live: Mask) -> Infos:
        terms = dict(zip(self.terms, result.terms.T.copy(), strict=True))
        infos: Infos = {"reward_terms": terms, "_reward_terms": live}
        ended = {int(e): self.ends[result.end[e]] for e in np.flatnonzero(live & (result.end > 0))}
        put_infos(infos, "end", ended, self.num_envs)
        return infos

    def close_extras(self, **kwargs: Any) -> None:
        """Forget the episodes."""
        self._batch = None

    def _standing(self) -> dict[str, Any]:
        kept = {name: getattr(self, name) for name in ("spec", "action_space", "single_action_space", "_random")}
        begun = np.flatnonzero(self._begun).tolist() if self._batch is not None else []
        return {"kept": kept, "flights": {e: self.get_state(e) for e in begun}}

    def _stand(self, standing: dict[str, Any]) -> None:
        self.__dict__.update(standing["kept"])
        for e, state in standing["flights"].items():
            self.set_state(e, state)


def vector_arguments(num_envs: Any, autoreset_mode: Any) -> tuple[int, AutoresetMode]:
    """Number of episodes and mode of autoreset, checked."""
    return checked_count("num_envs", num_envs), checked_mode(autoreset_mode)


def info_of(batch: Any, e: int) -> dict[str, Any]:
    """What is told of one episode: numbers as Python's, arrays as they are."""
    rows = {name: values[e] for name, values in batch.infos().items()}
    return {name: row.item() if np.ndim(row) == 0 else row for name, row in rows.items()}
