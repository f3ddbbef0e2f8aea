"""The arguments of SwarmPointing-v0, checked."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from swarm_mj.errors import ScenarioError
from swarm_mj.mission.behaviors import TargetKind
from swarm_mj.scenarios.loading import ScenarioSource, checked_overrides

from ..arguments import checked_count, checked_numbers, checked_rate, is_number
from ..pixels import LIGHTS
from .steps import PointingWeights

#: What may have to be looked at, and how guidance knows it.
REFERENCES = {
    "body": TargetKind.ASTEROID,
    "surface": TargetKind.SURFACE,
    "earth": TargetKind.EARTH,
    "direction": TargetKind.DIRECTION,
}
#: What an observation may hold.
OBSERVATIONS = ("state", "camera")
#: Half-angle of the camera [deg] below which the packaged bodies do not fit into the picture.
CAMERA_DEG = 45.0
#: Largest attitude error at the start [deg], by what is observed: a camera must have the body in the picture.
START_DEG = {"state": 180.0, "camera": 40.0}
#: Error that counts as pointing [deg]: half a pixel of the camera and more.
TOLERANCE_DEG = {"state": 2.0, "camera": 5.0}


@dataclass(frozen=True, kw_only=True)
class PointingConfig:
    """What makes one environment different from another; `SwarmPointingEnv` explains each argument.

    Raises:
        ScenarioError: A value is not allowed; those that depend on the scenario are checked by `PointingTask`.
    """

    scenario: ScenarioSource = "eros-observe"
    observation: str = "state"
    references: Sequence[str] | None = None
    holds: int = 2
    hold_s: float = 60.0
    step_s: float = 0.5
    tolerance_deg: float | None = None
    steady_s: float = 10.0
    start_deg: float | None = None
    rate_deg_s: float = 2.0
    wheel_share: float = 0.2
    reward_weights: Mapping[str, float] | None = None
    camera_half_angle_deg: float = CAMERA_DEG
    light: str = "sun"
    overrides: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Refuse what is not allowed whatever the scenario."""
        if self.observation not in OBSERVATIONS:
            raise ScenarioError(f"observation = {self.observation!r}: must be one of {', '.join(OBSERVATIONS)}")
        checked_count("holds", self.holds)
        for name in ("hold_s", "step_s", "steady_s"):
            checked_rate(name, getattr(self, name))
        _within("tolerance_deg", self.largest_error_deg, 0.0, 180.0)
        if not self.largest_error_deg > 0.0:
            raise ScenarioError("tolerance_deg = 0: must be above 0, as errors are measured in it")
        _within("start_deg", self.largest_start_deg, 0.0, 180.0)
        _within("rate_deg_s", self.rate_deg_s, 0.0, 90.0)
        _within("wheel_share", self.wheel_share, 0.0, 1.0)
        _within("camera_half_angle_deg", self.camera_half_angle_deg, 1.0, 80.0)
        if self.light not in LIGHTS:
            raise ScenarioError(f"light = {self.light!r}: must be one of {', '.join(LIGHTS)}")
        checked_overrides(self.overrides)
        _ = self.kinds, self.weights

    @property
    def kinds(self) -> tuple[TargetKind, ...]:
        """What may have to be looked at."""
        camera = self.observation == "camera"
        given = self.references if self.references is not None else ("body",) if camera else tuple(REFERENCES)
        allowed = ["body"] if camera else list(REFERENCES)
        if isinstance(given, str) or not given or any(name not in allowed for name in given):
            why = " where pixels are observed, which show nothing else" if camera else ""
            raise ScenarioError(f"references = {given!r}: must be a list of some of {', '.join(allowed)}{why}")
        return tuple(REFERENCES[name] for name in given)

    @property
    def weights(self) -> PointingWeights:
        """With what `reward_weights` replaces."""
        return PointingWeights(**checked_numbers("reward_weights", self.reward_weights, PointingWeights._fields))

    @property
    def largest_error_deg(self) -> float:
        """Error that counts as pointing [deg]."""
        return TOLERANCE_DEG[self.observation] if self.tolerance_deg is None else self.tolerance_deg

    @property
    def largest_start_deg(self) -> float:
        """Largest attitude error at the start [deg]."""
        return START_DEG[self.observation] if self.start_deg is None else self.start_deg


def _within(name: str, value: object, low: float, high: float) -> None:
    if not is_number(value) or not low <= float(value) <= high:  # type: ignore[arg-type]
        raise ScenarioError(f"{name} = {value!r}: must be a number from {low:g} to {high:g}")
