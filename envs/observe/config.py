"""The arguments of SwarmObserve-v0, checked."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import cached_property
from math import isqrt
from threading import Lock
from typing import Any, get_args

from pydantic import ValidationError

from swarm_mj.errors import ScenarioError
from swarm_mj.flight.plan import unchecked_behavior
from swarm_mj.observation.observer import ObserverKind
from swarm_mj.scenarios.explaining import explained
from swarm_mj.scenarios.schema import Scenario

from ..arguments import (
    checked_count,
    checked_numbers,
    checked_share,
    checked_step,
    checked_truth,
    checked_whole,
    is_number,
    is_whole,
)
from ..pixels import LIGHTS
from ..snapshots import digest
from .catalogue import DEFAULT_COUNT, MissionSpec, chosen_missions
from .draws import Randomisation
from .flybys import DECISION_S, DURATION_S, PERIOD_S, check_patches
from .mission import Mission, Target, environment_scenario, make_flyby, make_own
from .rewards import TERMS, RewardWeights

#: Most spacecraft that an episode over the catalogue may have: more find no visiting points of their own; and how many it has
#: where nothing else is asked for.
MOST_SPACECRAFT, SPACECRAFT = 12, 3
#: Of a scenario's `dispersions` those that act in flight; the others are what `randomise` draws.
DISPERSIONS = (
    *("mass_percent", "inertia_percent", "wheel_coulomb_n_m", "wheel_viscous_n_m_s", "gravity_percent"),
    "harmonics_percent",
)
OBSERVATIONS = ("entities", "flat", "pixels")
#: What is to be seen: the target, or the whole body; and what agents of the multi-agent environment know.
TARGETS, KNOWLEDGE = get_args(Target), ("full", "graph")
#: What only flybys of the catalogue have.
OF_CATALOGUE = ("missions", "split", "max_spacecraft", "dispersions", "sensors")


@dataclass(frozen=True, kw_only=True)
class EnvConfig:
    """What makes one environment different from another; `SwarmObserveEnv` explains each argument.

    Raises:
        ScenarioError: A value is not allowed.
    """

    missions: Any = DEFAULT_COUNT
    split: str = "train"
    scenario: Any = None
    target: Target = "scenario"
    max_spacecraft: int | None = None
    patches: int = 16
    candidates: int | None = None
    decision_s: float = DECISION_S
    observation: str = "entities"
    camera_half_angle_deg: float | None = None
    light: str = "sun"
    knowledge: str = "full"
    randomise: Mapping[str, Any] | None = None
    dispersions: Mapping[str, float] | None = None
    sensors: Any = "ideal"
    observer: ObserverKind = "horizon"
    reward_weights: Mapping[str, float] | None = None
    complete: float = 99.9
    horizon_terminates: bool = False

    def __post_init__(self) -> None:
        """Refuse what is not allowed."""
        named = ("observation", OBSERVATIONS), ("knowledge", KNOWLEDGE), ("target", TARGETS), ("light", LIGHTS)
        for name, allowed in named:
            if getattr(self, name) not in allowed:
                raise ScenarioError(f"{name} = {getattr(self, name)!r}: must be one of {', '.join(allowed)}")
        angle = self.camera_half_angle_deg
        if angle is not None and not (is_number(angle) and 0.0 < angle < 90.0):
            raise ScenarioError(f"camera_half_angle_deg = {angle!r}: must be a number above 0 and below 90, or None")
        if self.observation != "pixels" and (angle is not None or self.light != "sun"):
            raise ScenarioError(
                f"observation = {self.observation!r}: shows no pictures, and camera_half_angle_deg and light nothing; leave "
                "them out, or give observation='pixels'"
            )
        if self.observer not in get_args(ObserverKind):
            raise ScenarioError(f"observer = {self.observer!r}: must be one of {', '.join(get_args(ObserverKind))}")
        _ = self.weights
        checked_share(self.complete)
        checked_truth("horizon_terminates", self.horizon_terminates)
        if self.scenario is None:
            self._check_catalogue()
        else:
            self._check_own()
        checked_candidates(self.candidates, self.patches)
        _ = self.laws

    def _check_catalogue(self) -> None:
        if self.target != "scenario":
            raise ScenarioError(
                f"target = {self.target!r}: needs scenario=; flybys of the catalogue have targets of their own"
            )
        if self.observer != "horizon":
            raise ScenarioError(
                f"observer = {self.observer!r}: needs scenario=; the light of the catalogue's flybys is told by horizon maps"
            )
        if checked_count("max_spacecraft", self.spacecraft) > MOST_SPACECRAFT:
            raise ScenarioError(f"max_spacecraft = {self.spacecraft}: must be at most {MOST_SPACECRAFT}")
        _check_square(self.patches)
        for spec in self._specs:
            check_patches(spec, self.patches)
        _ = _acting(self.dispersions, self.sensors)
        step = self.decision_s
        if not is_number(step) or step < PERIOD_S or step % PERIOD_S or DURATION_S % step:
            raise ScenarioError(
                f"decision_s = {step!r}: must be a whole number of seconds that divides {DURATION_S:g} s, such as 20, 30 or 40"
            )

    def _check_own(self) -> None:
        for name in OF_CATALOGUE:
            if getattr(self, name) != self.__dataclass_fields__[name].default:
                raise ScenarioError(
                    f"{name} = {getattr(self, name)!r}: scenario= says that itself; leave one of them out"
                )
        if self.target == "scenario":
            _check_square(self.patches)
        checked_step(self._own, self.decision_s, "decision_s")

    @cached_property
    def _own(self) -> Scenario:
        """The scenario of one's own."""
        return environment_scenario(self.scenario)

    @cached_property
    def _specs(self) -> tuple[MissionSpec, ...]:
        return chosen_missions(self.missions, self.split)

    @property
    def names(self) -> tuple[str, ...]:
        """Of the missions."""
        return tuple(spec.name for spec in self._specs) if self.scenario is None else (self._own.name,)

    @cached_property
    def spacecraft(self) -> int:
        """Most spacecraft of an episode, n."""
        if self.scenario is None:
            return SPACECRAFT if self.max_spacecraft is None else self.max_spacecraft
        behavior = unchecked_behavior(self._own)
        return len(self._own.design.visiting_points) + behavior.dedicated_communications

    @cached_property
    def laws(self) -> Randomisation:
        """What is drawn for an episode."""
        return Randomisation(self.randomise, self.names, self.spacecraft, own=self.scenario is not None)

    @property
    def weights(self) -> RewardWeights:
        """Of the reward terms."""
        return RewardWeights(**checked_numbers("reward_weights", self.reward_weights, TERMS))

    @property
    def duration_s(self) -> float:
        """Of a flight [s]."""
        return DURATION_S if self.scenario is None else float(self._own.duration_s)

    @property
    def decisions(self) -> int:
        """Of a flight."""
        return round(self.duration_s / self.decision_s)

    @cached_property
    def fingerprint(self) -> str:
        """Digest of all that must agree where the state of a flight is taken up."""
        # What an episode is, once drawn, does not depend on the first three; the others are told by a scenario.
        apart = (
            "split",
            "observation",
            "camera_half_angle_deg",
            "light",
            "randomise",
            "dispersions",
            "sensors",
            "scenario",
        )
        told = {item.name: getattr(self, item.name) for item in fields(self) if item.name not in apart}
        told |= {"missions": self.names, "max_spacecraft": self.spacecraft, "decision_s": float(self.decision_s)}
        scenario = _acting(self.dispersions, self.sensors) if self.scenario is None else self._own
        return digest(told | {"reward_weights": self.weights}, scenario.model_dump(mode="json"))

    def make_mission(self, number: int) -> Mission:
        """One of the missions, by its number in `names`."""
        shared: dict[str, Any] = {"patches": self.patches, "observer": self.observer, "complete": self.complete}
        shared |= {"step_s": float(self.decision_s), "weights": self.weights}
        if self.scenario is not None:
            return make_own(self._own, target=self.target, **shared)
        shared |= {"dispersions": self.dispersions, "sensors": self.sensors}
        return make_flyby(self._specs[number], spacecraft=self.spacecraft, **shared)


class MissionPool:
    """The missions of an environment by number, made when they are first flown; a mission once made stays.

    Attributes:
        names: Of the missions, in their order.
    """

    def __init__(self, config: EnvConfig) -> None:
        self._config, self.names = config, config.names
        self._made: dict[int, Mission] = {}
        self._lock = Lock()

    def __len__(self) -> int:
        """Number of missions."""
        return len(self.names)

    def __getitem__(self, k: int) -> Mission:
        """Mission k."""
        with self._lock:
            if k not in self._made:
                self._made[k] = self._config.make_mission(k)
            return self._made[k]

    def close(self) -> None:
        """Release the observers."""
        for mission in self._made.values():
            mission.close()


def checked_candidates(count: Any, patches: int) -> int | None:
    """How many of the patches of a target each spacecraft chooses among; None for all.

    Raises:
        ScenarioError: It is no whole number from 1 to `patches`.
    """
    if count is None:
        return None
    must = (
        f"a whole number, at least 1 and at most patches = {patches}, or None for all; choose among fewer, or among all"
    )
    return checked_whole("candidates", count, 1, patches, must)


def _check_square(count: Any) -> None:
    """Refuse what is no square number."""
    if not is_whole(count) or count < 1 or isqrt(count) ** 2 != count:
        raise ScenarioError(f"patches = {count!r}: must be a whole square number such as 4, 9, 16 or 25")


def _acting(given: Any, sensors: Any) -> Scenario:
    """A scenario with these dispersions and sensors; refuses what does not act in flight, and values that it would not take."""
    if given is not None and not isinstance(given, Mapping):
        raise ScenarioError(f"dispersions = {given!r}: must be a mapping; there are {', '.join(DISPERSIONS)}")
    for name in given or {}:
        if name not in DISPERSIONS:
            raise ScenarioError(f"dispersions: {name!r} is not drawn here; there are {', '.join(DISPERSIONS)}")
    try:
        return Scenario(name="flyby", dispersions=dict(given or {}), spacecraft={"sensors": sensors})
    except ValidationError as error:
        raise ScenarioError(explained(error.errors()[0]).strip()) from None
