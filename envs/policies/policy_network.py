"""Plain networks as policies, in an array file without pickle: two hidden layers of tanh, and a logit for every choice.

    x = (s - mean) / scale        h = tanh(W2 tanh(W1 x + b1) + b2)        l = W3 h + b3

of what is shown, s. A network that `reads` the swarm takes the flat observation and gives the logits of all spacecraft; one
that reads a spacecraft takes what that one knows, and is the same for all; one that reads a choice takes what is known of that
choice, is the same for all choices, and flies with any number of them. The choice made is the allowed one with the largest
logit.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import PositiveInt

from swarm_mj.errors import ScenarioError
from swarm_mj.io.arrays import Declared, arrays_in
from swarm_mj.io.atomic import atomic_file
from swarm_mj.io.records import Record, reading, record_from
from swarm_mj.typing import Array, Ints

#: Raise when the network or the meaning of its file changes.
FORMAT = 3
#: What a file of a policy may have, packed and unpacked [bytes].
MAX_POLICY_BYTES = 2**28
#: What a network may read at once.
Reads = Literal["swarm", "spacecraft", "choice"]
#: Arrays of the network.
WEIGHTS = ("mean", "scale", "W1", "b1", "W2", "b2", "W3", "b3")
#: Arrays of a file; `ABOUT` is JSON.
ABOUT = {"about": Declared("U")}
ARRAYS = {
    "mean": Declared("f4", ("readings",)),
    "scale": Declared("f4", ("readings",), 1e-6),
    "W1": Declared("f4", ("first", "readings")),
    "b1": Declared("f4", ("first",)),
    "W2": Declared("f4", ("second", "first")),
    "b2": Declared("f4", ("second",)),
    "W3": Declared("f4", ("logits", "second")),
    "b3": Declared("f4", ("logits",)),
}
REMEDY = "give a policy that a program of examples/learning wrote"


class Provenance(Record):
    """What a policy was trained for, as its file tells; empty in files of other programs that do not tell.

    Attributes:
        environment: Its id.
        arguments: Those of the environment that are not the defaults, the scenario by its name.
        layout: Version of the observation's layout.
        package: Version of swarm_mj.
    """

    environment: str = ""
    arguments: dict[str, Any] = {}
    layout: PositiveInt = 1
    package: str = ""


class NetworkAbout(Provenance):
    """What the file of a network tells of it.

    Attributes:
        format: Version of the file.
        reads: What it is shown at once.
        spacecraft: How many it was trained for.
        choices: Of each spacecraft.
    """

    format: Literal[3]
    reads: Reads
    spacecraft: PositiveInt
    choices: PositiveInt


@dataclass(frozen=True, eq=False)
class NetworkPolicy:
    """A network and what it is for.

    Attributes:
        weights: Arrays by name, see `WEIGHTS`.
        about: See `NetworkAbout`.
    """

    weights: Mapping[str, Array]
    about: Mapping[str, Any]

    @property
    def readings(self) -> int:
        """Numbers that one agent is shown."""
        return len(self.weights["mean"])

    def logits(self, shown: NDArray[np.floating]) -> Array:
        """Preferences, shape (E, n, C), from what is shown: (E, F), (E, n, F) or (E, n, C, F), as the network reads."""
        # One after another: products of matrices round differently with their number.
        return np.concatenate([self._logits(row[None]) for row in np.asarray(shown)])

    def _logits(self, shown: NDArray[np.floating]) -> Array:
        w = self.weights
        x = (np.asarray(shown, np.float64) - w["mean"]) / w["scale"]
        hidden = np.tanh(np.tanh(x @ w["W1"].T + w["b1"]) @ w["W2"].T + w["b2"])
        out = np.asarray(hidden @ w["W3"].T + w["b3"])
        # Of a choice there is one logit, whatever the number of choices.
        return out[..., 0] if self.about["reads"] == "choice" else out.reshape(len(x), -1, self.about["choices"])

    def act(self, shown: NDArray[np.floating], mask: NDArray[Any]) -> Ints:
        """Choices, shape (E, n), of those that the mask (E, n, C) allows."""
        return masked_argmax(self.logits(shown), mask)


def masked_argmax(logits: NDArray[np.floating], mask: NDArray[Any]) -> Ints:
    """The allowed choice with the largest logit, shape (E, n); both are of shape (E, n, C)."""
    return np.where(np.asarray(mask, np.bool_), logits, -np.inf).argmax(axis=2).astype(np.int64)


def save_network(file: str | Path, policy: NetworkPolicy) -> None:
    """Write a network as `.npz`; it takes the place of an earlier one only when it is whole.

    Raises:
        OutputError: The file cannot be written.
    """
    text = json.dumps({"format": FORMAT} | dict(policy.about), sort_keys=True)
    arrays: dict[str, NDArray[Any]] = {name: np.asarray(policy.weights[name], np.float32) for name in WEIGHTS}
    with atomic_file(Path(file)) as partial, partial.open("wb") as stream:
        np.savez_compressed(stream, about=np.array(text), **arrays)  # type: ignore[arg-type]


def load_network(file: str | Path) -> NetworkPolicy:
    """Read what `save_network` wrote; nothing in the file is executed.

    Raises:
        ScenarioError: The file is missing, is no network, or has another format.
    """
    path = Path(file)
    with reading(f"policy {path}", REMEDY, ScenarioError):
        about = record_from(str(arrays_in(path, ABOUT, most=MAX_POLICY_BYTES)["about"]), NetworkAbout)
        arrays = arrays_in(path, ARRAYS, most=MAX_POLICY_BYTES)
        logits = {"choice": 1, "spacecraft": about["choices"], "swarm": about["choices"] * about["spacecraft"]}
        must = logits[about["reads"]]
        if len(arrays["b3"]) != must:
            raise ValueError(
                f"b3 has the shape {arrays['b3'].shape}, must have {must} entries, as it reads a {about['reads']}"
            )
    return NetworkPolicy({name: arrays[name].astype(np.float64) for name in WEIGHTS}, about)
