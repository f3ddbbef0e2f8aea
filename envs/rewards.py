"""The reward, term by term; `SwarmObserveEnv` says what each one means."""

from __future__ import annotations

from collections.abc import Mapping
from math import isfinite

from swarm_mj.errors import ScenarioError

#: Weight of each term. The first two reach 1 each when the whole target is seen and delivered at nominal volume.
DEFAULT_WEIGHTS = {"seen": 1.0, "delivered": 1.0, "effort": -0.02, "saturation": -0.1, "approach": -0.1, "loss": -1.0}

#: Names of the terms in their order.
TERMS = tuple(DEFAULT_WEIGHTS)


def checked_weights(given: Mapping[str, float] | None) -> dict[str, float]:
    """All weights, with those given in place of the defaults.

    Raises:
        ScenarioError: A name is unknown or a weight is not a finite number.
    """
    weights = dict(DEFAULT_WEIGHTS)
    for name, value in (given or {}).items():
        if name not in weights:
            raise ScenarioError(f"reward_weights: unknown term {name!r}; there are {', '.join(weights)}")
        if not isinstance(value, (int, float)) or not isfinite(value):
            raise ScenarioError(f"reward_weights[{name!r}] = {value!r}: must be a finite number")
        weights[name] = float(value)
    return weights
