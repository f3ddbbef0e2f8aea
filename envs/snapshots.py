"""The state of one flight to go back to, and environments that can be copied and pickled."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import gymnasium
import numpy as np
from numpy.typing import NDArray

from swarm_mj.errors import ScenarioError


class Fingerprinted(Protocol):
    """A task that knows what must agree where a state is taken up."""

    @property
    def fingerprint(self) -> str:
        """Digest of it."""
        ...


class Remembering(Protocol):
    """Episodes whose states can be taken and put back."""

    @property
    def task(self) -> Fingerprinted:
        """What they share."""
        ...

    def get_state(self, e: int) -> dict[str, Any]:
        """All that episode e is."""
        ...

    def set_state(self, e: int, state: dict[str, Any]) -> None:
        """Go on from that."""
        ...


@dataclass(frozen=True, eq=False)
class FlightState:
    """One flight between two steps, as `get_state` of an environment gives it; can be pickled, and holds no view of anything.

    What it is made of is nobody's business and changes between versions of the package.

    Attributes:
        fits: Digest of the task that it belongs to, see `Task.fingerprint`.
        running: Whether the episode goes on.
        random: The random numbers of the resets to come.
        episode: See `EpisodeBatch.get_state`.
        agents: Of the multi-agent environment, who still flies; None in the others.
        knowledge: What its agents know, where only what has reached them counts, see `GraphKnowledge`.
    """

    fits: str
    running: bool
    random: dict[str, Any]
    episode: dict[str, Any]
    agents: tuple[int, ...] | None = None
    knowledge: tuple[NDArray[Any], ...] | None = None


def take_state(batch: Remembering, e: int, *, running: bool, random: np.random.Generator) -> FlightState:
    """The state of flight e of a batch."""
    return FlightState(batch.task.fingerprint, running, dict(random.bit_generator.state), batch.get_state(e))


def restore_state(batch: Remembering, e: int, random: np.random.Generator, state: Any) -> FlightState:
    """Let flight e of a batch go on from a state.

    Raises:
        ScenarioError: It is no such state, or that of another task.
    """
    if not isinstance(state, FlightState):
        raise ScenarioError(f"state = {type(state).__name__}: must be what get_state of such an environment gave")
    if state.fits != batch.task.fingerprint:
        raise ScenarioError(
            "state: was taken from an environment with other arguments, or by another version of swarm_mj; take it from one "
            "with the same scenario, overrides and other arguments"
        )
    batch.set_state(e, state.episode)
    random.bit_generator.state = state.random
    return state


class RebuiltOnCopy:
    """Copied and pickled as the arguments it was made of and where it stands; MuJoCo's memory is made anew.

    Attributes:
        made_of: The constructor's arguments by name.
    """

    made_of: dict[str, Any]

    def __getstate__(self) -> dict[str, Any]:
        """What a copy needs."""
        return {"made_of": self.made_of, "standing": self._standing()}

    def __setstate__(self, saved: dict[str, Any]) -> None:
        """Make it anew, and put it where it stood."""
        self.__init__(**saved["made_of"])  # type: ignore[misc]
        self._stand(saved["standing"])

    def _standing(self) -> dict[str, Any]:
        raise NotImplementedError

    def _stand(self, standing: dict[str, Any]) -> None:
        raise NotImplementedError


def must_have_begun(begun: bool, what: str, name: str = "SwarmObserve-v0") -> None:
    """Refuse what needs a flight of the environment of that name.

    Raises:
        gymnasium.error.ResetNeeded: There is none yet.
    """
    if not begun:
        raise gymnasium.error.ResetNeeded(f"{name}: call reset before {what}")
