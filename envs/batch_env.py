"""Environments over a batch of episodes: gymnasium's single and vector ones, which a task completes with a few lines.

A task's batch has

    task             with `fingerprint`, a digest of all that must agree where the state of an episode is taken up;
    count            number of episodes E;
    space            of the observation of one episode;
    observation      of all of them, a copy, an array or a dict of arrays with E in front;
    reset(flights, **options)    start episodes anew, a mapping from their numbers to their flight seeds;
    step(actions, live)          fly the live ones on; returns a `StepOutcome`, or what has its attributes;
    infos()          what is told of all of them by name, arrays with E in front;
    cause(e)         why episode e diverged, where `diverged` is an end;
    get_state(e), set_state(e, state), close().
"""

from __future__ import annotations

from contextlib import AbstractContextManager, nullcontext
from typing import Any, ClassVar, NamedTuple, Self

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from swarm_mj.errors import ScenarioError
from swarm_mj.io.progress import said_when_late
from swarm_mj.typing import Array, Ints, Mask

from .arguments import (
    check_action,
    checked_count,
    checked_index,
    checked_options,
    first_seeds,
    flight_seed,
    flight_seeds,
)
from .snapshots import EpisodeSnapshot, restore_state, take_state

Infos = dict[str, Any]
#: What takes long at first, in words; the times are those of `docs/how-to/environments.md`.
FIRST_USE = "compiling, once on this machine, half a minute or so; each mission's tables, once, half a second"


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


class OverBatch:
    """What all environments over a batch of episodes have in common.

    They are copied and pickled as the arguments they were made of and where they stand; MuJoCo's memory is made anew.

    Attributes:
        made_of: The constructor's arguments, by place and by name.
    """

    #: What messages call it, its reward terms, how an episode can end by itself, and options of `reset` besides `flight_seed`.
    name: ClassVar[str]
    terms: ClassVar[tuple[str, ...]]
    ends: ClassVar[tuple[str, ...]] = ("",)
    own_options: ClassVar[tuple[str, ...]] = ()
    #: Attributes that a copy takes over.
    kept: ClassVar[tuple[str, ...]]
    made_of: tuple[tuple[Any, ...], dict[str, Any]]
    _batch: Any = None
    _renderer: Any = None
    _begun: Any = False
    _used: tuple[str, ...] = ()

    def __new__(cls, *given: Any, **named: Any) -> Self:
        """Remember the constructor's arguments."""
        made = super().__new__(cls)
        made.made_of = given, named
        return made

    @property
    def batch(self) -> Any:
        """The episodes.

        Raises:
            gymnasium.error.ClosedEnvironmentError: The environment was closed.
        """
        if self._batch is None:
            raise gymnasium.error.ClosedEnvironmentError(f"{self.name} was closed; make it anew")
        return self._batch

    @property
    def task(self) -> Any:
        """What all episodes share."""
        return self.batch.task

    def _first_use(self, what: str) -> AbstractContextManager[None]:
        """Says what a first call does, if that takes long."""
        if what in self._used:
            return nullcontext()
        self._used = (*self._used, what)
        return said_when_late(f"{self.name}: first {what}: {FIRST_USE}")

    def _release(self) -> None:
        """Release what the episodes and their pictures hold."""
        if self._batch is not None:
            if self._renderer is not None:
                self._renderer.close()
            self._batch.close()
        self._batch = None

    def __getstate__(self) -> dict[str, Any]:
        """What a copy needs."""
        kept = {name: getattr(self, name) for name in self.kept}
        return {"made_of": self.made_of, "kept": kept, "flights": {} if self._batch is None else self._flights()}

    def __setstate__(self, saved: dict[str, Any]) -> None:
        """Make it anew, and put it where it stood."""
        self.made_of = given, named = saved["made_of"]
        self.__init__(*given, **named)  # type: ignore[misc]
        self.__dict__.update(saved["kept"])
        for e, state in saved["flights"].items():
            self._go_on(e, state)

    def _flights(self) -> dict[int, Any]:
        """Where the episodes stand that have begun, by number."""
        raise NotImplementedError

    def _go_on(self, e: int, state: Any) -> None:
        """Let an episode go on from there."""
        raise NotImplementedError


class BatchEnv(OverBatch, gymnasium.Env[Any, Any]):
    """One episode: a batch of one."""

    kept = ("spec", "action_space", "observation_space", "_np_random", "_np_random_seed")

    def _set_up(self, batch: Any, action_space: spaces.Space[Any]) -> None:
        self._batch = batch
        self.observation_space, self.action_space = batch.space, action_space
        self._running = self._begun = False

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Start an episode; the class says how.

        Raises:
            ScenarioError: `options` holds something else than a valid `flight_seed` and the environment's own options.
        """
        super().reset(seed=seed)
        given = checked_options(options)
        own = {name: given.pop(name) for name in self.own_options if name in given}
        drawn = flight_seed(given, int(self.np_random.integers(2**31)), self.own_options)
        with self._first_use("reset"):
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
        with self._first_use("step"):
            result = batch.step(check_action(self.action_space, action)[None], np.ones(1, np.bool_))
        terminated, truncated = bool(result.end[0]), bool(result.truncated[0])
        self._running = not (terminated or truncated)
        info = self._info() | told_of_step(batch, result, 0, self.terms, self.ends)
        return one_of(batch.observation, 0), float(result.reward[0]), terminated, truncated, info

    def get_state(self) -> EpisodeSnapshot:
        """Where the episode stands, to go back to by `set_state`, here or in any environment made with the same arguments.

        Raises:
            gymnasium.error.ResetNeeded: There is none before the first `reset`.
        """
        must_have_begun(self._begun, "get_state", self.name)
        return take_state(self.batch, 0, running=self._running, random=self.np_random)

    def set_state(self, state: EpisodeSnapshot) -> tuple[Any, dict[str, Any]]:
        """Go on from a state: the same actions bring the same observations, rewards and infos as there, bit for bit.

        Returns:
            Observation and info of that instant.

        Raises:
            ScenarioError: It is no such state, or was taken from an environment with other arguments.
        """
        self._running = restore_state(self.batch, 0, self.np_random, state).running
        self._begun = True
        return one_of(self.batch.observation, 0), self._info()

    def close(self) -> None:
        """Release what the episode holds; may be called again."""
        self._release()
        self._running = False

    def _info(self) -> dict[str, Any]:
        return info_of(self.batch, 0)

    def _flights(self) -> dict[int, EpisodeSnapshot]:
        return {0: self.get_state()} if self._begun else {}

    def _go_on(self, e: int, state: EpisodeSnapshot) -> None:
        self.set_state(state)


class BatchVectorEnv(OverBatch, VectorEnv[Any, Any, Any]):
    """Many episodes, each with random numbers of its own, bit for bit those of `BatchEnv`; infos as arrays and their masks."""

    kept = ("spec", "action_space", "observation_space", "single_action_space", "_random")

    def _set_up(
        self, batch: Any, mode: AutoresetMode, action_space: spaces.Space[Any], render_fps: int | None = None
    ) -> None:
        """Take the episodes, and the action space of one of them; `render_fps` where pictures can be drawn."""
        count = batch.count
        self._batch, self._mode, self.num_envs = batch, mode, count
        self.autoreset_mode = mode  # as gymnasium's own vector environments tell it, for TorchRL
        drawn = {} if render_fps is None else {"render_fps": render_fps}
        self.metadata = {"render_modes": ["rgb_array"] if drawn else [], "autoreset_mode": mode} | drawn
        self.single_observation_space, self.single_action_space = batch.space, action_space
        self.observation_space = batch_space(self.single_observation_space, count)
        self.action_space = batch_space(self.single_action_space, count)
        self._random = [seeding.np_random()[0] for _ in range(count)]
        self._over, self._begun = np.zeros(count, np.bool_), np.zeros(count, np.bool_)

    def reset(
        self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, Infos]:
        """Start all episodes, or those of `options["reset_mask"]`.

        Args:
            seed: Of the first episode, the next ones follow; or one for each; None draws on.
            options: `reset_mask`: bool, shape (num_envs,); `flight_seed`: of all episodes, or one for each; and the
                environment's own.

        Raises:
            ScenarioError: A seed or option is not allowed.
        """
        given = checked_options(options)
        mask = checked_mask(given.pop("reset_mask", None), self.num_envs)
        own = {name: given.pop(name) for name in self.own_options if name in given}
        for e, drawn_from in enumerate(first_seeds(seed, self.num_envs)):
            if drawn_from is not None and mask[e]:
                self._random[e] = seeding.np_random(drawn_from)[0]
        chosen = flight_seeds(given.pop("flight_seed", None), self.num_envs)
        flights = {int(e): self._draw(int(e), given, chosen[e]) for e in np.flatnonzero(mask)}
        with self._first_use("reset"):
            self.batch.reset(flights, **own)
        self._over[mask], self._begun[mask] = False, True
        infos = self._infos(mask)
        put_infos(infos, "flight_seed", flights, self.num_envs)
        return self.batch.observation, infos

    def _draw(self, e: int, options: dict[str, Any], wanted: Any = None) -> int:
        drawn = int(self._random[e].integers(2**31))
        others = [*self.own_options, "reset_mask"]
        return flight_seed(options | ({} if wanted is None else {"flight_seed": wanted}), drawn, others)

    def step(self, actions: NDArray[Any]) -> tuple[Any, Array, Mask, Mask, Infos]:
        """Fly on for one step with the actions held, shape (num_envs, ...).

        Raises:
            gymnasium.error.InvalidAction: The actions do not lie in the action space.
            gymnasium.error.ResetNeeded: An episode was never begun, or with autoreset disabled one is over.
        """
        if not self._begun.all() or (self._mode is AutoresetMode.DISABLED and self._over.any()):
            raise gymnasium.error.ResetNeeded(f"{self.name}: an episode is over or has not begun; call reset first")
        array = check_action(self.action_space, actions)
        began = self._restart() if self._mode is AutoresetMode.NEXT_STEP and self._over.any() else {}
        live = np.ones(self.num_envs, np.bool_)
        live[list(began)] = False
        with self._first_use("step"):
            result = self.batch.step(array, live)
        terminated, truncated = (result.end > 0) & live, result.truncated & live
        rewards = np.where(live, result.reward, 0.0)
        infos = self._infos(np.ones(self.num_envs, np.bool_)) | self._told_of_step(result, live)
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

    def get_state(self, e: int) -> EpisodeSnapshot:
        """Where episode e stands; single and vector environments take each other's states."""
        k = checked_index(e, self.num_envs)
        must_have_begun(bool(self._begun[k]), "get_state", self.name)
        return take_state(self.batch, k, running=not self._over[k], random=self._random[k])

    def set_state(self, e: int, state: EpisodeSnapshot) -> Any:
        """Let episode e go on from a state; the others are left alone. Returns its observation."""
        k = checked_index(e, self.num_envs)
        self._over[k] = not restore_state(self.batch, k, self._random[k], state).running
        self._begun[k] = True
        return one_of(self.batch.observation, k)

    def _infos(self, mask: Mask) -> Infos:
        """What every step tells of all episodes, with the mask of those to whom it applies."""
        values = self.batch.infos()
        return values | {f"_{name}": mask.copy() for name in values}

    def _told_of_step(self, result: Any, live: Mask) -> Infos:
        terms = dict(zip(self.terms, result.terms.T.copy(), strict=True))
        infos: Infos = {"reward_terms": terms, "_reward_terms": live}
        ended = {int(e): self.ends[result.end[e]] for e in np.flatnonzero(live & (result.end > 0))}
        put_infos(infos, "end", ended, self.num_envs)
        causes = {e: self.batch.cause(e) for e, end in ended.items() if end == "diverged"}
        put_infos(infos, "cause", causes, self.num_envs)
        return infos

    def close_extras(self, **kwargs: Any) -> None:
        """Release what the episodes hold."""
        self._release()

    def _flights(self) -> dict[int, EpisodeSnapshot]:
        return {e: self.get_state(e) for e in np.flatnonzero(self._begun).tolist()}

    def _go_on(self, e: int, state: EpisodeSnapshot) -> None:
        self.set_state(e, state)


def must_have_begun(begun: bool, what: str, name: str) -> None:
    """Refuse what needs a flight of the environment of that name.

    Raises:
        gymnasium.error.ResetNeeded: There is none yet.
    """
    if not begun:
        raise gymnasium.error.ResetNeeded(f"{name}: call reset before {what}")


def info_of(batch: Any, e: int) -> dict[str, Any]:
    """What is told of one episode: numbers as Python's, arrays as they are."""
    rows = {name: values[e] for name, values in batch.infos().items()}
    return {name: row.item() if np.ndim(row) == 0 else row for name, row in rows.items()}


def told_of_step(batch: Any, result: Any, e: int, terms: tuple[str, ...], ends: tuple[str, ...]) -> dict[str, Any]:
    """What is told of a step of one episode besides: reward terms by name, and how it ended by itself."""
    told: dict[str, Any] = {"reward_terms": dict(zip(terms, result.terms[e].tolist(), strict=True))}
    if result.end[e]:
        told["end"] = ends[result.end[e]]
        if told["end"] == "diverged":
            told["cause"] = batch.cause(e)
    return told


def put_infos(infos: Infos, name: str, values: dict[int, Any], count: int) -> None:
    """Add what applies to some episodes only, with its mask."""
    if values:
        kind = np.int64 if isinstance(next(iter(values.values())), int) else object
        array, mask = np.zeros(count, kind), np.zeros(count, np.bool_)
        for e, value in values.items():
            array[e], mask[e] = value, True
        infos[name], infos[f"_{name}"] = array, mask


def one_of(observations: Any, e: int) -> Any:
    """The observation of episode e, a copy, of those of all, which may be a dict of parts."""
    if isinstance(observations, dict):
        return {name: part[e].copy() for name, part in observations.items()}
    return observations[e].copy()


def vector_arguments(num_envs: Any, autoreset_mode: Any) -> tuple[int, AutoresetMode]:
    """Number of episodes and mode of autoreset, checked."""
    count = checked_count("num_envs", num_envs)
    try:
        return count, AutoresetMode(autoreset_mode)
    except ValueError:
        modes = ", ".join(mode.value for mode in AutoresetMode)
        raise ScenarioError(f"autoreset_mode = {autoreset_mode!r}: must be one of {modes}") from None


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
