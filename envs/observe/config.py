"""The arguments of an environment, checked; `Task` works out what follows from them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from swarm_mj.errors import ScenarioError
from swarm_mj.observation.observer import ObserverKind
from swarm_mj.scenarios.schema import Scenario

from ..arguments import checked_overrides, checked_rate, checked_share, checked_truth
from .actions import check_level
from .rewards import checked_scales

#: What is to be seen: the scenario's target, or all of its body.
TARGETS = ("scenario", "body")
#: What agents may know.
OBSERVABILITY = ("full", "graph")


@dataclass(frozen=True, kw_only=True)
class EnvConfig:
    """What makes one environment different from another; `SwarmObserveEnv` explains each argument.

    Attributes:
        scenario: Packaged name, path of a YAML file, or a `Scenario`.
        control: Level at which the agent acts: `torque`, `pointing` or `role`.
        step_s: Length of a step [s]; None: 10 s, but at the level `torque` the scenario's control period, because an attitude
            cannot be controlled by torques that are held for longer.
        patches: Number of patches K of the target, a square number.
        observer: The judge of pictures.
        complete: Seen share of the target that counts as complete [%].
        reward_weights: Replaces weights of reward terms by name.
        bits_per_pixel: Data of a picture after compression.
        swarm_rate_bit_s: From a spacecraft to the one it tracks [bit/s]; None: by the link budget of `link.crosslink`.
        earth_rate_bit_s: To Earth, which hears one spacecraft at a time [bit/s]; None: by that of `link.earth` and
            `link.ground`.
        observability: What agents of the multi-agent environment know: `full`, or by the `graph`, what has reached them.
        overrides: Changes of the scenario, texts `key=value` with dotted keys, as those of `swarm-mj run --set`.
        target: What is to be seen: the `scenario`'s target, or the whole `body`.
        horizon_terminates: Whether a flight that reaches the scenario's duration counts as terminated, not as truncated.

    Raises:
        ScenarioError: A value is not allowed; those that depend on the scenario are checked by `Task`.
    """

    scenario: str | Path | Scenario = "eros-observe"
    control: str = "role"
    step_s: float | None = None
    patches: int = 16
    observer: ObserverKind = "horizon"
    complete: float = 99.9
    reward_weights: Mapping[str, float] | None = None
    bits_per_pixel: float = 1.0
    swarm_rate_bit_s: float | None = 1e5
    earth_rate_bit_s: float | None = 8e3
    observability: str = "full"
    overrides: Sequence[str] = ()
    horizon_terminates: bool = False
    target: str = "scenario"

    def __post_init__(self) -> None:
        """Refuse what is not allowed whatever the scenario."""
        check_level(self.control)
        checked_scales(self.reward_weights)
        checked_share(self.complete)
        checked_overrides(self.overrides)
        checked_truth("horizon_terminates", self.horizon_terminates)
        checked_rate("bits_per_pixel", self.bits_per_pixel)
        if self.observability not in OBSERVABILITY:
            raise ScenarioError(f"observability = {self.observability!r}: must be one of {', '.join(OBSERVABILITY)}")
        if self.target not in TARGETS or (self.target == "body" and self.control == "pointing"):
            raise ScenarioError(
                f"target = {self.target!r}: must be one of {', '.join(TARGETS)}; with control = pointing, scenario"
            )
        for name in ("swarm_rate_bit_s", "earth_rate_bit_s"):
            if (rate := getattr(self, name)) is not None:
                checked_rate(name, rate, ", or None for the scenario's link budget")
