"""What episodes of `SwarmPointing-v0` share, where spacecraft are and one free gyrostat; and what is drawn."""

from __future__ import annotations

from functools import cached_property
from math import acos, cos, pi, radians, sin
from typing import Any, NamedTuple

import numpy as np
from gymnasium import spaces

from swarm_mj.errors import ScenarioError
from swarm_mj.flight.plan import Plan, make_plan
from swarm_mj.flight.refusals import refuse_turned_cameras_and_companions
from swarm_mj.mission.behaviors import TargetKind
from swarm_mj.scenarios.loading import load_scenario
from swarm_mj.scenarios.schema import Scenario, is_multiple
from swarm_mj.simulator.state import InitialState
from swarm_mj.spacecraft.attitude.algebra import normalised, product
from swarm_mj.spacecraft.attitude.mrp import mrp_from_quaternion
from swarm_mj.typing import Array, Ints

from ..arguments import record_of
from ..pixels import IMAGE_SPACE, BodyPictures
from ..snapshots import digest
from .config import PointingConfig
from .flights import flyby_states, setup_of_one
from .steps import PointingConstants, PointingLayout

#: Instants of the flyby at which an episode may begin are so far apart [s].
GRID_S = 10.0
#: Draws of a spacecraft begin with this number, so that they differ from those of its flight.
OWN = 1
#: Of the scenario, whatever it says: the observed state is the true one.
FLOWN = {"physics.stepper": "kernel", "spacecraft.sensors": "ideal"}


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
        refuse_turned_cameras_and_companions(given, "SwarmPointing-v0")
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
        told = ("scenario", "overrides", "references", "reward_weights")
        rest = {name: value for name, value in vars(config).items() if name not in told}
        return digest("pointing", self.given.model_dump(mode="json"), rest, config.kinds, config.weights)

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
