"""The reward, term by term; `SwarmObserveEnv` says what each one means."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import isfinite

from swarm_mj.errors import ScenarioError

#: Weight of each term. The first two reach 1 each when the whole target is seen and delivered at nominal volume.
DEFAULT_WEIGHTS = {"seen": 1.0, "delivered": 1.0, "effort": -0.02, "saturation": -0.1, "approach": -0.1, "loss": -1.0}

#: Wheel speed over its limit from which on saturation costs.
SATURATION_FROM = 0.9


@dataclass(frozen=True, kw_only=True)
class StepMeasures:
    """What a step did, before weighting; all without unit.

    Attributes:
        seen: Newly seen area over the target's area.
        delivered: Data received by Earth over the nominal volume of the target.
        effort: Mean square of the motor torques over their limit, times the step's share of the flight.
        saturation: Mean over the wheels of how far they are from 90 to 100 % of their top speed (0 to 1), times that share.
        approach: Share of all pairs of spacecraft that came closer than allowed, times that share.
        loss: 1 at an impact or divergence.
    """

    seen: float = 0.0
    delivered: float = 0.0
    effort: float = 0.0
    saturation: float = 0.0
    approach: float = 0.0
    loss: float = 0.0


def reward_terms(measures: StepMeasures, weights: Mapping[str, float]) -> dict[str, float]:
    """Weighted terms; their sum is the reward."""
    return {name: weight * getattr(measures, name) for name, weight in weights.items()}


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
