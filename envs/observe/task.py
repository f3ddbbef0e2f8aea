"""What every episode of an environment shares: plan, patches, observer, scales; made once, never changed."""

from __future__ import annotations

import hashlib
import json
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np

from swarm_mj import __version__
from swarm_mj.flight.fly import make_simulation
from swarm_mj.flight.observe import camera_from, criterion_from, schedule_from
from swarm_mj.flight.plan import Plan, antennas_from, make_plan
from swarm_mj.mission.target import automatic_cell_size, whole_body
from swarm_mj.observation.capture import ObservationCriterion
from swarm_mj.observation.horizon import HorizonObserver
from swarm_mj.observation.horizon_kernels import Scene, make_scene
from swarm_mj.observation.observer import Observer, make_observer
from swarm_mj.scenarios.schema import Scenario
from swarm_mj.simulator.simulation import Simulation
from swarm_mj.smallbody.occultation import Occluder, occluder_of
from swarm_mj.typing import Mask

from ..arguments import checked_scenario, checked_step, record_of, refuse_extra_targets, step_of
from .config import EnvConfig
from .kinematics import BodyRotation
from .observations import ObservationConstants, ObservationLayout
from .patches import Patches, make_patches, make_sphere_patches
from .pictures import PictureConstants
from .radio import RadioConstants, earth_rates, swarm_rates
from .rewards import HazardLimits, RewardConstants, RewardScales, checked_scales
from .step import StepConstants

#: Data aboard below this share of the nominal volume count as delivered.
NOTHING_STORED = 1e-9


class Task:
    """One mission as a task for agents.

    Args:
        config: The environment's arguments.

    Attributes:
        config: The environment's arguments.
        given: Their scenario, overrides applied.
        step_s: Length of a step [s].
        plan: The mission.
        patches: Parts of the target.
        criterion: What counts as seen.
        observer: Judges the pictures.
        scene: The same for compiled code; None where pictures are judged one by one.
        observation_layout: Which numbers stand where in an observation.
        reward_scales: Weight of each reward term.
        nominal_bit: Volume of the whole target seen straight down from the imaging altitude [bit].
        ticks: Control periods in a step.
        last_tick: Control periods in the flight.
        is_due: Whether pictures that count are taken, by control instant, counted from 0, shape (last_tick + 1,).
        due_in_step: At which instants of a step that is so, by step, counted from its beginning; its end is `ticks`.
        simulation: One flight; a batch takes model and constants from it.

    Raises:
        ScenarioError: An argument does not fit the scenario.
    """

    def __init__(self, config: EnvConfig) -> None:
        given = checked_scenario(config.scenario, config.overrides)
        refuse_extra_targets(given)
        self.config, self.given = config, given
        self.step_s = step_of(given, config.control, config.step_s)
        self.ticks, self.last_tick = checked_step(given, self.step_s)
        self.plan: Plan = _planned(given, config.target)
        divide = make_patches if config.target == "scenario" else make_sphere_patches
        self.patches: Patches = divide(self.plan.region, config.patches)
        self.criterion: ObservationCriterion = criterion_from(given)
        self.observer: Observer = make_observer(
            self.plan.region, camera_from(given), kind=config.observer, occlusion=given.observation.occlusion
        )
        self.scene: Scene | None = None
        if isinstance(self.observer, HorizonObserver) and not (self.criterion.whole or self.criterion.needs_motion):
            self.scene = make_scene(self.observer, self.criterion)
        self.observation_layout = ObservationLayout(self.plan, config.patches)
        self.reward_scales: RewardScales = checked_scales(config.reward_weights)
        footprint = (given.design.imaging_altitude_m * self.observer.camera.pixel_angle) ** 2
        self.nominal_bit = self.plan.region.total_area / footprint * config.bits_per_pixel
        self.simulation: Simulation = make_simulation(self.plan)
        self.is_due: Mask = schedule_from(given, given.control.period_s).due(np.arange(self.last_tick + 1))
        starts = range(0, self.last_tick + 1, self.ticks)
        self.due_in_step = [np.flatnonzero(self.is_due[k : k + self.ticks + 1]).tolist() for k in starts]

    @cached_property
    def fingerprint(self) -> str:
        """Digest of all that must agree where the state of a flight is taken up."""
        config = self.config
        numbers = (self.step_s, config.patches, config.complete, config.bits_per_pixel, *self.reward_scales)
        rates = (config.swarm_rate_bit_s, config.earth_rate_bit_s)
        rest = [config.control, config.observer, bool(config.horizon_terminates), config.observability]
        rest += [config.target]
        text = json.dumps([__version__, self.given.model_dump(mode="json"), rest, list(map(repr, (*numbers, *rates)))])
        return hashlib.sha256(text.encode()).hexdigest()

    @property
    def occluder(self) -> Occluder:
        """The body as what hides and is hit."""
        return occluder_of(self.plan.shape)

    @property
    def body_rotation(self) -> BodyRotation:
        """How the body turns."""
        environment = self.plan.environment
        return BodyRotation(
            C_PN=np.ascontiguousarray(environment.C_PN),
            phase0=float(environment.phase0),
            spin_rate=float(environment.spin_rate),
        )

    @property
    def picture_constants(self) -> PictureConstants:
        """See `take_pictures`."""
        bits, storage = float(self.config.bits_per_pixel), float(self.plan.scenario.data.storage_bit)
        return PictureConstants(self.plan.n_observers, bits, storage)

    @property
    def radio_constants(self) -> RadioConstants:
        """See `transmit`."""
        plan, earth = self.plan, self.plan.environment.earth
        times = self.step_s * np.arange(self.last_tick // self.ticks + 1, dtype=np.float64)
        return RadioConstants(
            beams=antennas_from(plan.scenario).beams,
            earth_r_N=np.array(earth.position, np.float64),
            earth_v_N=np.array(earth.velocity, np.float64),
            step_s=float(self.step_s),
            swarm=swarm_rates(plan, self.config.swarm_rate_bit_s),
            earth_bit=earth_rates(plan, self.config.earth_rate_bit_s, times) * self.step_s,
            storage_bit=float(plan.scenario.data.storage_bit),
        )

    @property
    def hazard_limits(self) -> HazardLimits:
        """See `measure_hazards`."""
        safety = self.plan.scenario.safety
        return HazardLimits(
            max_wheel_speed=float(self.plan.properties.max_wheel_speed),
            min_separation_m=float(safety.min_separation_m),
            separation_grace_s=float(safety.separation_grace_s),
        )

    @property
    def observation_constants(self) -> ObservationConstants:
        """See `write_observations`."""
        layout, plan, patch = self.observation_layout, self.plan, self.patches.of_cell.astype(np.int64)
        return ObservationConstants(
            n_observers=plan.n_observers,
            position_m=float(layout.position_scale),
            velocity_m_s=float(layout.velocity_scale),
            wheel_speed_rad_s=float(plan.properties.max_wheel_speed),
            spin_rate=float(plan.environment.spin_rate),
            duration_s=float(plan.scenario.duration_s),
            nominal_bit=float(self.nominal_bit),
            target_area_m2=float(plan.region.total_area),
            cells=np.argsort(patch, kind="stable").astype(np.int64),
            first_cell=np.concatenate(([0], np.cumsum(np.bincount(patch, minlength=self.patches.count)))).astype(
                np.int64
            ),
            cell_area=self.patches.cell_area,
            patch_area=self.patches.area,
            low=layout.space.low,
            high=layout.space.high,
        )

    def step_constants(self, *, continues_after_impact: bool) -> StepConstants:
        """See `finish_step`."""
        return StepConstants(
            body=self.occluder,
            radio=self.radio_constants,
            limits=self.hazard_limits,
            observation=self.observation_constants,
            reward=self.reward_constants(continues_after_impact=continues_after_impact),
        )

    def reward_constants(self, *, continues_after_impact: bool) -> RewardConstants:
        """See `compute_rewards`."""
        plan, properties = self.plan, self.plan.properties
        torques = self.ticks * plan.n * len(properties.wheel_axes_B)
        return RewardConstants(
            scales=self.reward_scales,
            target_area_m2=float(plan.region.total_area),
            nominal_bit=float(self.nominal_bit),
            step_share=float(self.step_s / plan.scenario.duration_s),
            max_effort=float(torques * properties.max_wheel_torque**2),
            complete_percent=float(self.config.complete),
            empty_bit=float(NOTHING_STORED * self.nominal_bit),
            last_tick=self.last_tick,
            continues_after_impact=continues_after_impact,
        )

    def close(self) -> None:
        """Release the observer."""
        self.observer.close()


def _planned(given: Scenario, target: str) -> Plan:
    """The mission; for the whole body its paths are those to the scenario's own target."""
    plan = make_plan(given)
    if target == "scenario":
        return plan
    size = given.target.cell_size_m
    if size == "auto":
        size = automatic_cell_size(given.design.imaging_altitude_m, given.camera.half_angle_deg)
    return replace(plan, region=whole_body(plan.shape, cell_size_m=size))


def make_task(**arguments: Any) -> Task:
    """The task of an environment's arguments, which `SwarmObserveEnv` documents."""
    return Task(record_of(EnvConfig, "SwarmObserve-v0", arguments))
