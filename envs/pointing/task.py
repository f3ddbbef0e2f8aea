"""The arguments of `SwarmPointing-v0`; what episodes share, where spacecraft are and one free gyrostat; and what is drawn."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from math import acos, cos, pi, radians, sin
from typing import Any, NamedTuple

import numpy as np
from gymnasium import spaces

from swarm_mj import __version__
from swarm_mj.errors import ScenarioError
from swarm_mj.flight.plan import Plan, make_plan
from swarm_mj.io.cache import hash_of
from swarm_mj.mission.behaviors import TargetKind
from swarm_mj.scenarios.loading import ScenarioSource, checked_overrides, load_scenario
from swarm_mj.scenarios.schema import Scenario, is_multiple
from swarm_mj.simulator.state import InitialState
from swarm_mj.spacecraft.attitude.algebra import normalised, product
from swarm_mj.spacecraft.attitude.mrp import mrp_from_quaternion
from swarm_mj.typing import Array, Ints

from ..arguments import checked_count, checked_numbers, checked_rate, is_number, record_of
from ..pixels import IMAGE_SPACE, LIGHTS, BodyPictures
from .flights import flyby_states, setup_of_one
from .steps import PointingConstants, PointingLayout

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
#: Instants of the flyby at which an episode may begin are so far apart [s].
GRID_S = 10.0
#: Draws of a spacecraft begin with this number, so that they differ from those of its flight.
OWN = 1
#: Of the scenario, whatever it says: the observed state is the true one.
FLOWN = {"physics.stepper": "kernel", "spacecraft.sensors": "ideal"}


class PointingWeights(NamedTuple):
    """Weight of each reward term, in the order of their arrays."""

    precise: float = 80.0
    coarse: float = -40.0
    rate: float = -10.0
    effort: float = -5.0


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


class Draw(NamedTuple):
    """One episode before it begins.

    Attributes:
        spacecraft: Which of the swarm, from 0.
        tick: Control periods from the epoch to the start.
        initial: State at the start, of one spacecraft.
        kind: `TargetKind` of each hold, shape (H,).
        vector: Surface point in A [m] or direction in N of each hold, shape (H, 3).
    """

    spacecraft: int
    tick: int
    initial: InitialState
    kind: Ints
    vector: Array


class PointingTask:
    """One scenario as a task of attitude control, by the environment's arguments.

    Attributes:
        given: The scenario, overrides applied.
        plan: The mission, which says where each spacecraft of the swarm is.
        setup: A swarm of one.
        layout: Which numbers stand where in an observation.
        ticks: Control periods in a step.
        hold_ticks: The same in a hold.

    Raises:
        ScenarioError: An argument does not fit the scenario.
    """

    def __init__(self, config: PointingConfig) -> None:
        given = load_scenario(config.scenario, {**config.overrides, **FLOWN})
        self.config, self.given = config, given
        self.ticks, self.hold_ticks = _periods(given, "step_s", config.step_s), _periods(given, "hold_s", config.hold_s)
        if self.hold_ticks % self.ticks:
            raise ScenarioError(
                f"hold_s = {config.hold_s:g}: must be a whole multiple of step_s = {config.step_s:g} s; take one of it"
            )
        self.steps = config.holds * self.hold_ticks // self.ticks
        if self.duration_s > given.duration_s:
            raise ScenarioError(
                f"holds = {config.holds} of hold_s = {config.hold_s:g} s: longer than the scenario's duration_s = "
                f"{given.duration_s:g} s; shorten the holds"
            )
        self.plan: Plan = make_plan(given)
        period = given.control.period_s
        self._grid = max(1, round(GRID_S / period))
        last = round((given.duration_s - self.duration_s) / period)
        self._r, self._v = flyby_states(self.plan, self._grid, last)
        self.setup = setup_of_one(self.plan)
        self.layout = PointingLayout(config.observation)

    @cached_property
    def pictures(self) -> BodyPictures:
        """Draws what the cameras see."""
        return BodyPictures(self.plan, self.config.camera_half_angle_deg, self.config.light)

    @property
    def observation_space(self) -> spaces.Space[Any]:
        """Of one spacecraft: numbers, or a dict of them and pixels."""
        return (
            spaces.Dict({"image": IMAGE_SPACE, "state": self.layout.space}) if self.layout.camera else self.layout.space
        )

    @property
    def duration_s(self) -> float:
        """Length of an episode [s]."""
        return self.config.holds * self.config.hold_s

    @cached_property
    def fingerprint(self) -> str:
        """Digest of all that must agree where the state of an episode is taken up."""
        config = self.config
        rest = {name: value for name, value in vars(config).items() if name not in ("scenario", "reward_weights")}
        text = [__version__, "pointing", self.given.model_dump(mode="json"), rest, list(map(repr, config.weights))]
        return hash_of(json.dumps(text, default=str))

    @property
    def constants(self) -> PointingConstants:
        """See `assess`."""
        config, properties = self.config, self.plan.properties
        return PointingConstants(
            step_share=float(config.step_s / self.duration_s),
            tolerance=float(np.radians(config.largest_error_deg)),
            steady_steps=max(1, round(config.steady_s / config.step_s)),
            hold_steps=self.hold_ticks // self.ticks,
            steps=self.steps,
            max_wheel_speed=float(properties.max_wheel_speed),
            max_effort=float(self.ticks * 3 * properties.max_wheel_torque**2),
            scales=np.array(config.weights),
        )

    def draw(self, seed: int, spacecraft: int | None) -> Draw:
        """What an episode begins with.

        Args:
            seed: Of the flight; it says when the episode begins, and so for all of a swarm.
            spacecraft: Which of the swarm, from 0; None: the flight's seed says so.
        """
        config, properties = self.config, self.plan.properties
        shared = np.random.default_rng(seed)
        start = int(shared.integers(len(self._r)))
        one_of_them = int(shared.integers(self.plan.n))
        j = one_of_them if spacecraft is None else spacecraft
        rng = np.random.default_rng([seed, OWN, j])
        kind, vector = self._references(rng)
        tick, rate = start * self._grid, np.radians(config.rate_deg_s)
        q = self._attitude(rng, -self._r[start, j])
        initial = InitialState(
            r_BN_N=self._r[start, j][None],
            v_BN_N=self._v[start, j][None],
            sigma_BN=mrp_from_quaternion(q)[None],
            omega_BN_B=rng.uniform(-rate, rate, (1, 3)),
            wheel_speed=rng.uniform(-1.0, 1.0, (1, 3)) * config.wheel_share * properties.max_wheel_speed,
            seed=seed,
        )
        return Draw(j, tick, initial, kind, vector)

    def _references(self, rng: np.random.Generator) -> tuple[Ints, Array]:
        holds, kinds = self.config.holds, self.config.kinds
        kind = np.array([kinds[k] for k in rng.integers(len(kinds), size=holds)], np.int64)
        cell = rng.integers(self.plan.region.n_cells, size=holds)
        direction = rng.standard_normal((holds, 3))
        direction /= np.linalg.norm(direction, axis=1, keepdims=True)
        surface, held = kind == int(TargetKind.SURFACE), kind == int(TargetKind.DIRECTION)
        points = self.plan.region.centroid_A[cell]
        return kind, np.where(surface[:, None], points, np.where(held[:, None], direction, 0.0))

    def _attitude(self, rng: np.random.Generator, to_body_N: Array) -> Array:
        """An attitude with +z within the largest angle of the body's centre, evenly over the cap, and any roll; shape (4,)."""
        away = acos(1.0 - rng.uniform() * (1.0 - cos(radians(self.config.largest_start_deg))))
        azimuth, roll = rng.uniform(-pi, pi, 2).tolist()
        x, y, z = (to_body_N / np.linalg.norm(to_body_N)).tolist()
        # Half a turn about the bisector of +z and the direction; where there is none, about x.
        half = (x, y, 1.0 + z) if z > -1.0 + 1e-9 else (1.0, 0.0, 0.0)
        q = normalised((0.0, *half))
        for angle, axis in ((azimuth, 2), (away, 0), (roll, 2)):
            turn = [cos(0.5 * angle), 0.0, 0.0, 0.0]
            turn[1 + axis] = sin(0.5 * angle)
            q = product(q, (turn[0], turn[1], turn[2], turn[3]))
        return np.array(q)


def _within(name: str, value: object, low: float, high: float) -> None:
    if not is_number(value) or not low <= float(value) <= high:  # type: ignore[arg-type]
        raise ScenarioError(f"{name} = {value!r}: must be a number from {low:g} to {high:g}")


def _periods(given: Scenario, name: str, length_s: float) -> int:
    period = given.control.period_s
    if not is_multiple(length_s, period):
        raise ScenarioError(
            f"{name} = {length_s:g}: must be a whole multiple of control.period_s = {period:g} s; take one"
        )
    return round(length_s / period)


def make_pointing_task(**arguments: Any) -> PointingTask:
    """The task of an environment's arguments, which `SwarmPointingEnv` documents."""
    return PointingTask(record_of(PointingConfig, "SwarmPointing-v0", arguments))
