"""What every episode of an environment shares: plan, patches, observer, rates, scales; made once, never changed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from swarm_mj.errors import ScenarioError
from swarm_mj.flight.fly import make_simulation
from swarm_mj.flight.observe import camera_from, criterion_from, schedule_from
from swarm_mj.flight.plan import Plan, antennas_from, make_plan
from swarm_mj.observation.capture import ObservationCriterion
from swarm_mj.observation.horizon import HorizonObserver
from swarm_mj.observation.horizon_kernels import Scene, make_scene
from swarm_mj.observation.observer import Observer, ObserverKind, make_observer
from swarm_mj.scenarios.schema import Scenario
from swarm_mj.simulator.simulation import Simulation
from swarm_mj.typing import Mask

from .actions import check_level
from .arguments import checked_scenario, checked_share, checked_step, is_number
from .observations import Readings
from .patches import Patches, make_patches
from .rewards import checked_weights
from .step_kernels import Mission


@dataclass(frozen=True, kw_only=True)
class Radio:
    """Data rates.

    Attributes:
        bits_per_pixel: Of a picture, after compression.
        swarm_rate_bit_s: From a spacecraft to the one it tracks [bit/s].
        earth_rate_bit_s: To Earth, which hears one spacecraft at a time [bit/s].

    Raises:
        ScenarioError: A value is not positive.
    """

    bits_per_pixel: float = 1.0
    swarm_rate_bit_s: float = 1e5
    earth_rate_bit_s: float = 8e3

    def __post_init__(self) -> None:
        """Refuse impossible rates."""
        for name, value in vars(self).items():
            if not (is_number(value) and value > 0.0):
                raise ScenarioError(f"{name} = {value!r}: must be a positive number")


@dataclass(eq=False, kw_only=True)
class Setting:
    """Arguments of the environment, checked, and what follows from them; see `SwarmObserveEnv` for their meaning.

    Attributes:
        plan: The mission.
        patches: Parts of the target.
        readings: Layout of an observation.
        observer: Judges the pictures.
        scene: The same for the compiled look; None where pictures are judged one by one.
        ticks: Control periods in a step.
        is_due: Whether pictures that count are taken, by control instant, counted from 0.
        last_tick: Of the flight.
        nominal_bit: Volume of the whole target seen straight down from the imaging altitude [bit].
        mission: Numbers for the compiled loops.
        simulation: One flight; the batch takes model and constants from it.
    """

    scenario: str | Path | Scenario = "eros-observe"
    control: str = "role"
    step_s: float = 10.0
    n_patches: int = 16
    observer_kind: ObserverKind = "horizon"
    complete: float = 99.9
    reward_weights: Mapping[str, float] | None = None
    radio: Radio = field(default_factory=Radio)

    def __post_init__(self) -> None:
        """Check the arguments and work out everything that the episodes share."""
        check_level(self.control)
        self.weights = checked_weights(self.reward_weights)
        checked_share(self.complete)
        given = checked_scenario(self.scenario)
        self.ticks, self.last_tick = checked_step(given, self.step_s)
        self.plan: Plan = make_plan(given)
        self.patches: Patches = make_patches(self.plan.region, self.n_patches)
        self.criterion: ObservationCriterion = criterion_from(given)
        self.observer: Observer = make_observer(
            self.plan.region, camera_from(given), kind=self.observer_kind, occlusion=given.observation.occlusion
        )
        self.scene: Scene | None = None
        if isinstance(self.observer, HorizonObserver):
            self.scene = make_scene(self.observer, self.criterion)
        self.readings = Readings(self.plan, self.n_patches)
        footprint = (given.design.imaging_altitude_m * self.observer.camera.pixel_angle) ** 2
        self.nominal_bit = self.plan.region.total_area / footprint * self.radio.bits_per_pixel
        self.simulation: Simulation = make_simulation(self.plan)
        self.mission = self._mission()
        self.is_due: Mask = schedule_from(given, given.control.period_s).due(np.arange(self.last_tick + 1))

    def _mission(self) -> Mission:
        plan, radio, environment = self.plan, self.radio, self.plan.environment
        scenario = plan.scenario
        numbers = [
            plan.shape.max_radius,
            radio.swarm_rate_bit_s,
            radio.earth_rate_bit_s,
            radio.bits_per_pixel,
            scenario.safety.min_separation_m,
            scenario.safety.separation_grace_s,
            plan.properties.max_wheel_speed,
            self.readings.position_scale,
            self.readings.velocity_scale,
            environment.spin_rate,
            scenario.duration_s,
            self.nominal_bit,
            plan.region.total_area,
            plan.n_observers,
        ]
        return Mission(
            vertices=plan.shape.vertices,
            faces=plan.shape.faces,
            box=np.array([plan.shape.vertices.min(axis=0), plan.shape.vertices.max(axis=0)]),
            antennas=antennas_from(scenario).numbers,
            numbers=np.array(numbers, np.float64),
            earth=np.array([environment.earth.position, environment.earth.velocity], np.float64),
            C_PN=np.ascontiguousarray(environment.C_PN),
            phase0=float(environment.phase0),
            patch=self.patches.of_cell.astype(np.int64),
            cell_area=self.patches.cell_area,
            patch_area=self.patches.area,
        )

    def close(self) -> None:
        """Release the observer."""
        self.observer.close()


def make_setting(
    scenario: str | Path | Scenario = "eros-observe",
    control: str = "role",
    *,
    step_s: float = 10.0,
    patches: int = 16,
    observer: ObserverKind = "horizon",
    complete: float = 99.9,
    reward_weights: Mapping[str, float] | None = None,
    bits_per_pixel: float = 1.0,
    swarm_rate_bit_s: float = 1e5,
    earth_rate_bit_s: float = 8e3,
) -> Setting:
    """The setting of an environment's arguments, which `SwarmObserveEnv` documents."""
    radio = Radio(bits_per_pixel=bits_per_pixel, swarm_rate_bit_s=swarm_rate_bit_s, earth_rate_bit_s=earth_rate_bit_s)
    return Setting(
        scenario=scenario,
        control=control,
        step_s=step_s,
        n_patches=patches,
        observer_kind=observer,
        complete=complete,
        reward_weights=reward_weights,
        radio=radio,
    )
