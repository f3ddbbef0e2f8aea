"""Where a training with PPO stands, kept beside its checkpoint; needs neither torch nor stable-baselines3."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from math import inf, isfinite, nan
from pathlib import Path

from pydantic import NonNegativeFloat, NonNegativeInt

from swarm_mj.errors import ScenarioError
from swarm_mj.io.atomic import write_text
from swarm_mj.io.records import Record, read_record


class StateRecord(Record):
    """state.json; what is not known yet is left out."""

    steps: NonNegativeInt = 0
    seconds: NonNegativeFloat = 0.0
    start: float = 0.0
    best: float = 0.0


@dataclass
class TrainingState:
    """What training has come to, kept beside the checkpoint.

    Attributes:
        steps: Of the environment, that PPO has flown.
        seconds: Of training.
        start: Return on the validation seeds before PPO's first update.
        best: That of `policy.npz`, the best so far.
    """

    steps: int = 0
    seconds: float = 0.0
    start: float = nan
    best: float = -inf

    def write(self, file: Path) -> None:
        """Keep what is known; it takes the place of an earlier file when it is whole."""
        write_text(file, json.dumps({name: value for name, value in asdict(self).items() if isfinite(value)}))


def read_state(file: Path) -> TrainingState:
    """What `TrainingState.write` kept.

    Raises:
        ScenarioError: It is no state of training; one line names file, key, value and what is allowed.
    """
    found = read_record(file, StateRecord, "it is no state of training: train anew without --resume", ScenarioError)
    return TrainingState(**{name: found[name] for name in StateRecord.model_fields if name in found})
