"""A mission as a task for agents: its plan, patches, camera and scales, worked out once and never changed.

A mission is a flyby of the catalogue, or one of a user's own: a scenario. Lengths of what agents are shown go with its imaging
altitude H, times with that in which its swarm flies as far as H, areas with that of its target.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from math import radians, tan
from typing import Any, Literal

import numpy as np

from swarm_mj.dataflow.link_budget import RateTable, rate_at
from swarm_mj.errors import MissionError, ScenarioError
from swarm_mj.flight.fly import initial_state, make_simulation
from swarm_mj.flight.observe import camera_from, schedule_from
from swarm_mj.flight.plan import Plan, make_plan
from swarm_mj.flight.refusals import refuse_known_states, refuse_sequence, refuse_turned_cameras_and_companions
from swarm_mj.mission.deployment import planned_paths
from swarm_mj.mission.target import TargetRegion, automatic_cell_size, whole_body
from swarm_mj.observation.capture import lit_cells
from swarm_mj.observation.horizon import HorizonObserver
from swarm_mj.observation.horizon_kernels import Scene, make_scene
from swarm_mj.observation.observer import Observer, ObserverKind, make_observer
from swarm_mj.scenarios.loading import load_scenario
from swarm_mj.scenarios.schema import Scenario
from swarm_mj.scenarios.schema_imaging import Observation
from swarm_mj.simulator.flight_setup import FlightSetup
from swarm_mj.simulator.state import InitialState
from swarm_mj.smallbody.occultation import occluder_of
from swarm_mj.spacecraft.attitude.algebra import Vector, cross
from swarm_mj.typing import Array, Mask

from ..arguments import refuse_extra_targets
from .catalogue import MissionSpec
from .draws import EpisodeDraw
from .flybys import (
    CROSSING_S,
    EARTH_BIT_S,
    NOMINAL_BIT,
    SWARM_BIT_S,
    TIME_OF_FLIGHT_S,
    flyby,
    release_table,
    release_velocities,
)
from .kinematics import BodyRotation
from .patches import Patches, make_patches, make_sphere_patches
from .pictures import PictureConstants, cells_in_reach, cells_in_view, cells_passed
from .radio import RadioConstants, radio_constants
from .rewards import RewardWeights
from .tables import TableConstants

Target = Literal["scenario", "body"]
#: Share of a cell that the Sun of a catalogued flyby must reach.
LIT_SHARE = 0.5
#: Share of the target that the yardstick is at least, so that no episode is about a few cells.
LEAST_YARDSTICK = 0.2
#: Of the integration of the planned paths.
PATH_TOLERANCE = 1e-9


@dataclass(frozen=True, eq=False, kw_only=True)
class Mission:
    """A mission, ready to fly.

    Attributes:
        name: Of the catalogue, or of the scenario.
        plan: What is flown.
        patches: Parts of the target.
        criterion: What counts as seen.
        observer: Judges the pictures.
        scene: The same for compiled code; None where pictures are judged one by one.
        setup: What its flights share.
        altitude_m: Imaging altitude H [m].
        half_width_m: Of the target, across [m].
        crossing_s: Time in which the swarm flies as far as H [s].
        axes_A: Of the frame in which places are told, as rows, shape (3, 3): east, north and up at the target's middle; those
            of A for a whole body.
        centre_A: Its origin, shape (3,) [m]: the target's middle, or the body's centre.
        step_s: Length of a decision [s].
        bits_per_pixel: Data of a picture.
        earth_bit_s: Most that Earth hears, of all spacecraft together [bit/s].
        weights: Of the reward terms.
        complete: Seen share of what can count from which on all is seen [%].
        radio: Of the links.
        v0_N: Velocities at release to each point of a table of ways from each of `ALTITUDES`, shape (P, 3, 3) [m/s]; None: the
            scenario's own paths are flown.
    """

    name: str
    plan: Plan
    patches: Patches
    criterion: Observation
    observer: Observer
    scene: Scene | None
    setup: FlightSetup
    altitude_m: float
    half_width_m: float
    crossing_s: float
    axes_A: Array
    centre_A: Array
    step_s: float
    bits_per_pixel: float
    earth_bit_s: float
    weights: RewardWeights
    complete: float
    radio: RadioConstants
    v0_N: Array | None

    @property
    def drawn_light(self) -> bool:
        """Whether the Sun is drawn for each flight and stands still over the target; else it is where it is at the epoch."""
        return self.v0_N is not None

    @property
    def duration_s(self) -> float:
        """Of a flight [s]."""
        return float(self.plan.scenario.duration_s)

    @property
    def period_s(self) -> float:
        """Of control [s]."""
        return float(self.plan.scenario.control.period_s)

    @property
    def ticks(self) -> int:
        """Control periods in a decision."""
        return round(self.step_s / self.period_s)

    @property
    def last_tick(self) -> int:
        """Control periods in a flight."""
        return round(self.duration_s / self.period_s)

    @cached_property
    def is_due(self) -> Mask:
        """Whether qualifying images are taken, by control instant, counted from 0, shape (last_tick + 1,)."""
        scenario = self.plan.scenario
        return schedule_from(scenario, scenario.control.period_s).due(np.arange(self.last_tick + 1))

    @property
    def interval_s(self) -> float:
        """Between two pictures; things fail on their clock [s]."""
        return float(self.plan.scenario.observation.interval_s)

    @cached_property
    def is_stop(self) -> Mask:
        """Whether links are judged, by control instant: at pictures, and as often where there are but those of the arrivals."""
        return self.is_due | (np.arange(self.last_tick + 1) % round(self.interval_s / self.period_s) == 0)

    @cached_property
    def nominal_bit(self) -> float:
        """Volume of the whole target seen straight down from the imaging altitude [bit]."""
        footprint = (self.altitude_m * self.observer.camera.pixel_angle) ** 2
        return float(self.plan.region.total_area / footprint * self.bits_per_pixel)

    @property
    def sun_changes(self) -> bool:
        """Whether a cell's light must be judged at every picture."""
        return not self.drawn_light and self.criterion.needs_sun

    def start(self, draw: EpisodeDraw) -> InitialState:
        """A flight as it was drawn, at its release."""
        plan = self.plan
        if self.v0_N is None:
            scenario = plan.scenario.model_copy(update={"seed": draw.seed})
            begins = initial_state(replace(plan, scenario=scenario))
            error_m_s = draw.release_error * self.altitude_m / plan.scenario.design.time_of_flight_s
            return replace(
                begins,
                v_BN_N=begins.v_BN_N + error_m_s,
                sigma_BN=np.where(np.isnan(draw.sigma_BN), begins.sigma_BN, draw.sigma_BN),
                omega_BN_B=np.where(np.isnan(draw.omega_BN_B), begins.omega_BN_B, draw.omega_BN_B),
            )
        error_m_s = draw.release_error * self.altitude_m / TIME_OF_FLIGHT_S
        return InitialState(
            r_BN_N=np.repeat(plan.deployment.r0_N[None], plan.n, axis=0),
            v_BN_N=self.velocity_N(draw.visiting_point, draw.altitude, draw.speed) + error_m_s,
            sigma_BN=draw.sigma_BN,
            omega_BN_B=draw.omega_BN_B,
            wheel_speed=np.zeros((plan.n, plan.properties.n_wheels)),
            seed=draw.seed,
        )

    def velocity_N(self, point: Array, altitude: Array, speed: float) -> Array:
        """Velocities at release of n spacecraft by the table of ways, shape (n, 3) [m/s].

        Args:
            point: Place in the list of visiting points, 0 to 1, shape (n,).
            altitude: Over the imaging altitude, shape (n,).
            speed: Over that of the mission; the way to where the target has turned until then is taken as straight.
        """
        assert self.v0_N is not None, "the scenario's own paths are flown"
        count = len(self.v0_N)
        which = np.minimum((point * count).astype(np.int64), count - 1)
        spin_N = self.plan.environment.spin_N
        return np.asarray(release_velocities(self.v0_N, which, altitude, speed, self.plan.deployment.r0_N, spin_N))

    def sun_A(self, draw: EpisodeDraw) -> Array:
        """Direction of the Sun over the target as it was drawn, a unit vector, shape (3,)."""
        up, level = np.sin(draw.sun_elevation), np.cos(draw.sun_elevation)
        east, north, out = self.axes_A
        return np.asarray(up * out + level * (np.sin(draw.sun_azimuth) * east + np.cos(draw.sun_azimuth) * north))

    def lit(self, sun_A: Array) -> Mask:
        """Cells that the drawn Sun lights as the criterion asks: high enough, and half of each past the body, shape (C,)."""
        # Any axes will do about the line of sight.
        sun: Vector = (sun_A[0], sun_A[1], sun_A[2])
        aside = np.array(cross(sun, (0.0, 0.0, 1.0) if abs(sun[2]) < 0.9 else (1.0, 0.0, 0.0)))
        aside /= np.linalg.norm(aside)
        right: Vector = (aside[0], aside[1], aside[2])
        C_CA = np.array([right, cross((-sun[0], -sun[1], -sun[2]), right), -sun_A])
        scene, samples, highest = self._lighting
        high = self.plan.region.normal_A @ sun_A >= np.cos(radians(self.criterion.max_incidence_deg))
        return np.asarray(high & cells_in_view(scene, sun_A, C_CA, samples, highest))

    @cached_property
    def _lighting(self) -> tuple[Scene, int, Array]:
        """The scene, the least number of a cell's sample points that the Sun must reach, and each cell's highest horizon."""
        assert self.scene is not None
        highest = self.scene.horizon.highest
        samples = next(k for k in range(1, highest.shape[1] + 1) if k / highest.shape[1] >= LIT_SHARE)
        return self.scene, samples, highest.max(axis=1).astype(np.float64)

    def lit_at(self, t: float) -> Mask:
        """Cells with the light that the scenario's criterion asks for at a time past the epoch [s], shape (C,)."""
        sun_A = self.plan.environment.C_AN(t) @ self.plan.environment.sun.at(t)
        return lit_cells(self.observer, self.criterion, sun_A)

    def yardstick_area(self, target: Mask, present: int, start: InitialState | None = None) -> float:
        """Area that straight paths from the release pass, if nothing fails, at least `LEAST_YARDSTICK` of the target [m^2].

        Args:
            target: Cells that can count, shape (C,).
            present: How many spacecraft fly, the first ones.
            start: Of a flight of the catalogue; those of a scenario of one's own pass what their planned paths do.
        """
        area = self.patches.cell_area
        if self.scene is None:
            return float(area.sum())
        if start is None or self.v0_N is None:
            found = self._passed[:present].any(axis=0) & target
        else:
            r, v = (np.ascontiguousarray(part[:present]) for part in (start.r_BN_N, start.v_BN_N))
            found = cells_in_reach(self.scene, self.rotation, r, v, self.duration_s, self.interval_s, target)
        return max(float(area[found].sum()), LEAST_YARDSTICK * float(area.sum()))

    @cached_property
    def _passed(self) -> Mask:
        """Cells that each observer on its planned path passes within reach of at some picture, shape (n_observers, C)."""
        environment = self.plan.environment
        times: Array = np.flatnonzero(self.is_due) * np.float64(self.period_s)
        try:
            r_N, _ = planned_paths(environment.acceleration_N, self.plan.deployment, times, rtol=PATH_TOLERANCE)
        except MissionError:  # A path that ends at the body is straight there.
            deployment = self.plan.deployment
            r_N = deployment.r0_N + times[:, None, None] * deployment.v0_N
        r_A = np.array([r @ environment.C_AN(t).T for r, t in zip(r_N, times, strict=True)])
        lit = np.ones((len(times), self.plan.region.n_cells), np.bool_)
        if self.criterion.needs_sun:
            lit = np.array([self.lit_at(float(t)) for t in times])
        return np.asarray(cells_passed(self.scene, r_A[:, : self.plan.n_observers], lit))

    @property
    def rotation(self) -> BodyRotation:
        """How the body turns."""
        environment = self.plan.environment
        return BodyRotation(
            C_PN=np.ascontiguousarray(environment.C_PN),
            phase0=float(environment.phase0),
            spin_rate=float(environment.spin_rate),
        )

    @property
    def pictures(self) -> PictureConstants:
        """See `take_pictures`."""
        storage = float(self.plan.scenario.data.storage_bit)
        return PictureConstants(self.plan.n_observers, float(self.bits_per_pixel), storage)

    @property
    def tables(self) -> TableConstants:
        """See `write_tables`."""
        plan, patches, region, camera = self.plan, self.patches, self.plan.region, self.observer.camera
        earth, sun = plan.environment.earth, plan.environment.sun
        lowest = np.cos(radians(self.criterion.max_incidence_deg)) if self.criterion.needs_sun else -2.0
        return TableConstants(
            axes_A=self.axes_A,
            centre_A=self.centre_A,
            altitude_m=self.altitude_m,
            crossing_s=self.crossing_s,
            spin_rate=float(plan.environment.spin_rate),
            step_s=float(self.step_s),
            duration_s=self.duration_s,
            half_width_m=self.half_width_m,
            half_angle=float(np.arctan(camera.tan_half_angle)),
            pixel_angle=float(camera.pixel_angle),
            max_gsd=float(plan.scenario.observation.max_gsd_m or np.inf),
            top_speed=float(plan.properties.max_wheel_speed),
            n_observers=plan.n_observers,
            patch_centre_A=patches.centre_A,
            patch_normal_A=patches.normals_A(region),
            patch_area=patches.area,
            total_area=float(sum(patches.area.tolist())),  # one after another, as compiled code would
            of_cell=patches.of_cell.astype(np.int64),
            cell_area=patches.cell_area,
            earth_bit_s=self.earth_bit_s,
            body=occluder_of(plan.shape),
            earth_r_N=np.array(earth.position, np.float64),
            earth_v_N=np.array(earth.velocity, np.float64),
            sun_r_N=np.array(sun.position, np.float64),
            sun_v_N=np.array(sun.velocity, np.float64),
            drawn_light=self.drawn_light,
            lowest_sun=float(lowest),
        )

    def close(self) -> None:
        """Release the observer."""
        self.observer.close()


def make_flyby(
    spec: MissionSpec,
    *,
    spacecraft: int,
    patches: int,
    observer: ObserverKind,
    dispersions: Mapping[str, float] | None,
    sensors: Any,
    step_s: float,
    weights: RewardWeights,
    complete: float,
) -> Mission:
    """Work a flyby of the catalogue out, by arguments of `SwarmObserveEnv`; tables come from the cache if they are there."""
    data, altitude, half_width = flyby(spec, spacecraft, patches)
    scenario = load_scenario(data | {"dispersions": dict(dispersions or {}), "spacecraft": {"sensors": sensors}})
    pixel = 2.0 * tan(radians(scenario.camera.half_angle_deg)) / scenario.camera.resolution_px * altitude
    plan = make_plan(scenario)
    region = plan.region
    return Mission(
        name=spec.name,
        **_judged(plan, make_patches(region, patches), observer),
        altitude_m=altitude,
        half_width_m=half_width,
        crossing_s=CROSSING_S,
        axes_A=np.ascontiguousarray(region.axes_A),
        centre_A=np.asarray(region.area @ region.centroid_A / region.total_area),
        bits_per_pixel=NOMINAL_BIT * (0.5 * pixel / half_width) ** 2,
        earth_bit_s=EARTH_BIT_S,
        radio=_radio(plan, EARTH_BIT_S, SWARM_BIT_S),
        v0_N=release_table(plan, altitude),
        step_s=step_s,
        weights=weights,
        complete=complete,
    )


def environment_scenario(given: Any) -> Scenario:
    """A scenario of one's own as environments fly it: a name, a path, a dict or a `Scenario`, with the kernel stepper.

    Raises:
        ScenarioError: It cannot be read, or has several targets.
    """
    scenario = load_scenario(given)
    refuse_extra_targets(scenario)
    physics = scenario.physics.model_copy(update={"stepper": "kernel"})
    return scenario.model_copy(update={"physics": physics})


def make_own(
    scenario: Scenario,
    *,
    target: Target,
    patches: int,
    observer: ObserverKind,
    step_s: float,
    weights: RewardWeights,
    complete: float,
) -> Mission:
    """Work a scenario of one's own out, see `environment_scenario`: path, frame, scales and links are those of its plan.

    The other arguments are those of `SwarmObserveEnv`.

    Raises:
        ScenarioError: Compiled code cannot fly it; the message says why.
    """
    refuse_turned_cameras_and_companions(scenario, "SwarmObserve-v0")
    refuse_sequence(scenario, "SwarmObserve-v0")
    refuse_known_states(scenario, "SwarmObserve-v0")
    plan, design = make_plan(scenario), scenario.design
    whole = target == "body" or plan.region.kind == "body"
    if plan.region.is_wide and not whole:
        raise ScenarioError(
            f"target.region = {plan.region.kind}: reaches too far around the body to be told in patches about one place: must "
            "be a pyramid, a polygon within 75 deg of its middle, or body; or make the environment with target='body'"
        )
    if whole:
        plan = replace(plan, region=_whole_region(plan))
    region = plan.region
    parts = make_sphere_patches(region, patches) if whole else make_patches(region, patches)
    centre = np.zeros(3) if whole else np.asarray(region.area @ region.centroid_A / region.total_area)
    half_width = plan.shape.max_radius if whole else float(np.linalg.norm(centre)) * tan(region.side_half_angle)
    radio = _radio(plan, None, None)
    return Mission(
        name=scenario.name,
        **_judged(plan, parts, observer),
        altitude_m=float(design.imaging_altitude_m),
        half_width_m=float(half_width),
        crossing_s=float(design.imaging_altitude_m * design.time_of_flight_s / plan.mothership_distance),
        axes_A=np.eye(3) if whole else np.ascontiguousarray(region.axes_A),
        centre_A=centre,
        bits_per_pixel=scenario.data.bits_per_pixel / scenario.data.compression,
        earth_bit_s=_fastest_to_earth(plan, radio),
        radio=radio,
        v0_N=None,
        step_s=step_s,
        weights=weights,
        complete=complete,
    )


def _judged(plan: Plan, patches: Patches, kind: ObserverKind) -> dict[str, Any]:
    """Plan, patches, criterion, observer, scene and flights of a mission."""
    scenario = plan.scenario
    criterion = scenario.observation
    observer = make_observer(plan.region, camera_from(scenario), kind=kind, occlusion=scenario.observation.occlusion)
    mapped = isinstance(observer, HorizonObserver) and not (criterion.whole or criterion.needs_motion)
    return {
        "plan": plan,
        "patches": patches,
        "criterion": criterion,
        "observer": observer,
        "scene": make_scene(observer, criterion) if mapped else None,  # type: ignore[arg-type]
        "setup": make_simulation(plan).setup,
    }


def _radio(plan: Plan, earth_bit_s: float | None, swarm_bit_s: float | None) -> RadioConstants:
    """Of given rates, or None for those of the scenario's link budget."""
    spacing = float(plan.scenario.observation.interval_s)
    times = spacing * np.arange(-(-plan.scenario.duration_s // spacing) + 1, dtype=np.float64)
    return radio_constants(plan, times, swarm_rate_bit_s=swarm_bit_s, earth_rate_bit_s=earth_bit_s)


def _fastest_to_earth(plan: Plan, radio: RadioConstants) -> float:
    """What the best station that hears at some time hears over the distance at the epoch [bit/s]."""
    distance = float(np.linalg.norm(plan.environment.earth.at(0.0)))
    tables = [RateTable(*rows) for rows in zip(*radio.radios.earth, strict=True)]
    return max(float(rate_at(tables[k], distance)) for k in np.unique(radio.station) if k >= 0)


def _whole_region(plan: Plan) -> TargetRegion:
    """All of the body, in cells of the size that the scenario's target has."""
    scenario = plan.scenario
    size = scenario.target.cell_size_m
    if size == "auto":
        size = automatic_cell_size(scenario.design.imaging_altitude_m, scenario.camera.half_angle_deg)
    return whole_body(plan.shape, cell_size_m=size)
