"""The arguments of SwarmObserve-v1, checked."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from math import isqrt
from typing import Any

from pydantic import ValidationError

from swarm_mj import __version__
from swarm_mj.errors import ScenarioError
from swarm_mj.scenarios.explaining import explained
from swarm_mj.scenarios.schema_faults import Dispersions

from ..arguments import checked_count, checked_share, checked_truth, is_number, is_whole
from ..observe.rewards import RewardScales, checked_scales
from .catalogue import DEFAULT_COUNT, chosen_missions
from .draws import Randomisation
from .mission import DECISION_S, DURATION_S, PERIOD_S, check_patches
from .pool import MissionPool

#: Most spacecraft that an episode may have: more find no visiting points of their own.
MOST_SPACECRAFT = 12
#: Of a scenario's `dispersions` those that act in flight; the others are what `randomise` draws.
DISPERSIONS = (
    *("mass_percent", "inertia_percent", "wheel_coulomb_n_m", "wheel_viscous_n_m_s", "gravity_percent"),
    *("harmonics_percent", "gyro_angular_random_walk_deg_sqrt_h", "gyro_bias_deg_h"),
    *("gyro_rate_random_walk_deg_h_sqrt_h", "star_tracker_noise_arcsec", "star_tracker_bias_arcsec", "delay_s"),
)
OBSERVATIONS = ("flat", "entities")


@dataclass(frozen=True, kw_only=True)
class MissionConfig:
    """What makes one environment different from another; `SwarmObserveV1Env` explains each argument.

    Attributes:
        missions: Names of missions, how many of them, or "all".
        split: `train` or `test`.
        max_spacecraft: Most spacecraft of an episode.
        patches: Number of patches K of a target, a square number.
        candidates: How many of the best patches each spacecraft chooses among; None for all, and everything is shown.
        decision_s: Length of a step [s].
        observation: `flat` or `entities`.
        randomise: Replaces distributions by name.
        dispersions: What differs from flight to flight within the spacecraft, see `DISPERSIONS`.
        reward_weights: Replaces weights of reward terms by name.
        complete: Seen share of what is lit that counts as complete [%].
        horizon_terminates: Whether the duration ends a flight as terminated.

    Raises:
        ScenarioError: A value is not allowed.
    """

    missions: Any = DEFAULT_COUNT
    split: str = "train"
    max_spacecraft: int = 3
    patches: int = 16
    candidates: int | None = None
    decision_s: float = DECISION_S
    observation: str = "flat"
    randomise: Mapping[str, Any] | None = None
    dispersions: Mapping[str, float] | None = None
    reward_weights: Mapping[str, float] | None = None
    complete: float = 99.9
    horizon_terminates: bool = False

    def __post_init__(self) -> None:
        """Refuse what is not allowed."""
        most = checked_count("max_spacecraft", self.max_spacecraft)
        if most > MOST_SPACECRAFT:
            raise ScenarioError(f"max_spacecraft = {most}: must be at most {MOST_SPACECRAFT}")
        chosen = chosen_missions(self.missions, self.split)
        _check_patches(self.patches)
        for spec in chosen:
            check_patches(spec, self.patches)
        checked_candidates(self.candidates, self.patches)
        checked_scales(self.reward_weights)
        checked_share(self.complete)
        checked_truth("horizon_terminates", self.horizon_terminates)
        _check_dispersions(self.dispersions)
        if self.observation not in OBSERVATIONS:
            raise ScenarioError(f"observation = {self.observation!r}: must be one of {', '.join(OBSERVATIONS)}")
        step = self.decision_s
        if not is_number(step) or step < PERIOD_S or step % PERIOD_S or DURATION_S % step:
            raise ScenarioError(
                f"decision_s = {step!r}: must be a whole number of seconds that divides {DURATION_S:g} s, such as 20, 30 or 40"
            )
        Randomisation(self.randomise, tuple(spec.name for spec in chosen), most)

    @property
    def weights(self) -> RewardScales:
        """Of the reward terms."""
        return checked_scales(self.reward_weights)

    @cached_property
    def fingerprint(self) -> str:
        """Digest of all that must agree where the state of a flight is taken up."""
        names = [spec.name for spec in chosen_missions(self.missions, self.split)]
        rest = [
            sorted((self.dispersions or {}).items()),
            self.max_spacecraft,
            self.patches,
            self.candidates,
            float(self.decision_s),
            list(map(repr, self.weights)),
        ]
        text = json.dumps([__version__, names, rest, repr(self.complete), bool(self.horizon_terminates)])
        return hashlib.sha256(text.encode()).hexdigest()

    def make_pool(self) -> MissionPool:
        """The missions."""
        return MissionPool(
            chosen_missions(self.missions, self.split),
            spacecraft=self.max_spacecraft,
            patches=self.patches,
            step_s=float(self.decision_s),
            dispersions=dict(self.dispersions or {}),
            reward_weights=self.reward_weights,
            complete=self.complete,
            horizon_terminates=self.horizon_terminates,
        )


def checked_candidates(count: Any, patches: int) -> int | None:
    """How many patches each spacecraft chooses among; None for all.

    Args:
        count: As given.
        patches: Number of patches of a target.

    Raises:
        ScenarioError: There are not so many.
    """
    if count is None:
        return None
    if not is_whole(count) or not 1 <= count <= patches:
        raise ScenarioError(
            f"candidates = {count!r}: must be a whole number, at least 1 and at most patches = {patches}, or None for all; "
            "choose among fewer, or among all"
        )
    return int(count)


def _check_patches(count: Any) -> None:
    """Refuse what is no square number."""
    if not is_whole(count) or count < 1 or isqrt(count) ** 2 != count:
        raise ScenarioError(f"patches = {count!r}: must be a whole square number such as 4, 9, 16 or 25")


def _check_dispersions(given: Any) -> None:
    """Refuse what does not act in flight, and values that a scenario would not take."""
    if given is not None and not isinstance(given, Mapping):
        raise ScenarioError(f"dispersions = {given!r}: must be a mapping; there are {', '.join(DISPERSIONS)}")
    for name in given or {}:
        if name not in DISPERSIONS:
            raise ScenarioError(f"dispersions: {name!r} is not drawn here; there are {', '.join(DISPERSIONS)}")
    try:
        Dispersions.model_validate(dict(given or {}))
    except ValidationError as error:
        first = error.errors()[0]
        raise ScenarioError(explained({**first, "loc": ("dispersions", *first["loc"])}).strip()) from None
