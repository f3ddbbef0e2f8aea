"""The state of one flight to go back to, and what environments over a batch have in common: they can be copied and pickled."""

from __future__ import annotations

from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from typing import Any, ClassVar, Self

import gymnasium
import numpy as np
from numpy.typing import NDArray

from swarm_mj.errors import ScenarioError
from swarm_mj.io.progress import said_when_late

#: What takes long at first, in words; the times are those of `docs/how-to/environments.md`.
FIRST_USE = "compiling, once on this machine, about a minute; each mission's tables, once, about a second"


@dataclass(frozen=True, eq=False)
class EpisodeSnapshot:
    """One flight between two steps, as `get_state` of an environment gives it; can be pickled, and holds no view of anything.

    What it is made of is nobody's business and changes between versions of the package.

    Attributes:
        fits: Digest of the task that it belongs to, its `fingerprint`.
        running: Whether the episode goes on.
        random: The random numbers of the resets to come.
        episode: See `get_state` of a batch, `batch_env`.
        agents: Of the multi-agent environment, who still flies; None in the others.
        knowledge: What its agents know, where only what has reached them counts, see `GraphKnowledge`.
    """

    fits: str
    running: bool
    random: dict[str, Any]
    episode: dict[str, Any]
    agents: tuple[int, ...] | None = None
    knowledge: tuple[NDArray[Any], ...] | None = None


def take_state(batch: Any, e: int, *, running: bool, random: np.random.Generator) -> EpisodeSnapshot:
    """The state of flight e of a batch."""
    return EpisodeSnapshot(batch.task.fingerprint, running, dict(random.bit_generator.state), batch.get_state(e))


def restore_state(batch: Any, e: int, random: np.random.Generator, state: Any) -> EpisodeSnapshot:
    """Let flight e of a batch go on from a state.

    Raises:
        ScenarioError: It is no such state, or that of another task.
    """
    if not isinstance(state, EpisodeSnapshot):
        raise ScenarioError(f"state = {type(state).__name__}: must be what get_state of such an environment gave")
    if state.fits != batch.task.fingerprint:
        raise ScenarioError(
            "state: was taken from an environment with other arguments, or by another version of swarm_mj; take it from one "
            "with the same scenario, overrides and other arguments"
        )
    batch.set_state(e, state.episode)
    random.bit_generator.state = state.random
    return state


class OverBatch:
    """What all environments over a batch of episodes have in common, see `batch_env`.

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


def must_have_begun(begun: bool, what: str, name: str) -> None:
    """Refuse what needs a flight of the environment of that name.

    Raises:
        gymnasium.error.ResetNeeded: There is none yet.
    """
    if not begun:
        raise gymnasium.error.ResetNeeded(f"{name}: call reset before {what}")
