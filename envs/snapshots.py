"""The state of one flight to go back to."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarm_mj import __version__
from swarm_mj.errors import ScenarioError
from swarm_mj.io.cache import hash_of


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


def digest(*told: Any) -> str:
    """Digest of what must agree where the state of a flight is taken up, in values that JSON has; NumPy's count as Python's."""
    return hash_of(json.dumps([__version__, *told], sort_keys=True, default=np.generic.item))


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
