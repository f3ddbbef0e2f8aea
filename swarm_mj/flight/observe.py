"""What the swarm saw during a flight: its pictures judged, cell by cell."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
import xarray as xr

from swarm_mj.dataflow.delivery import Delivery
from swarm_mj.mission.target import TargetRegion
from swarm_mj.observation.camera import CameraModel
from swarm_mj.observation.capture import (
    Picture,
    PictureSchedule,
    ground_sampling_distance,
    limits_of,
    observe,
    pictures,
    sight,
    watching,
)
from swarm_mj.observation.coverage import CoverageMap
from swarm_mj.observation.observer import Observer, make_observer
from swarm_mj.observation.smear import Motion, smear_px
from swarm_mj.scenarios.itinerary import visit_times
from swarm_mj.scenarios.schema import Scenario
from swarm_mj.simulator.telemetry import VARIABLES, working
from swarm_mj.smallbody.environment import Environment
from swarm_mj.spacecraft.attitude.mrp import dcm
from swarm_mj.typing import Array, Ints, Mask

Progress = Callable[[float], None]

#: How pictures are judged where only whole cells count, whichever observer there is.
WHOLE_NOTE = "whole faces by geometry: three corners in the field of view, and 16 points that nothing hides"


class Observed(Protocol):
    """What must be known of a flight besides its telemetry to judge its pictures: a `Plan` has it."""

    @property
    def scenario(self) -> Scenario:
        """Camera, criterion and times of the pictures."""

    @property
    def environment(self) -> Environment:
        """Rotation of the body, and the Sun."""

    @property
    def region(self) -> TargetRegion:
        """The target."""

    @property
    def n(self) -> int:
        """Number of spacecraft."""

    @property
    def n_observers(self) -> int:
        """Number of spacecraft that observe; they come first."""


@dataclass(frozen=True, kw_only=True)
class ObservationResult:
    """What the swarm saw.

    Attributes:
        coverage: By the scenario's criterion.
        passage: Over the whole passage inside the imaging region.
        observer: Name of the observer that measured it.
        note: Why that one.
        images: Number of pictures judged.
        gsd_m: Finest ground sampling distance at which each cell counts by the scenario's criterion [m], NaN where it does not,
            shape (n,); None where the flight was read back.
        smear_px: Smear of each cell in the sharpest picture of the visit that has it in the field of view [px], NaN where none
            has, shape (n,); None where the camera has no exposure or the flight was read back.
        delivery: What of it reaches Earth; None where that was not computed.
    """

    coverage: CoverageMap
    passage: CoverageMap
    observer: str
    note: str
    images: int
    gsd_m: Array | None = None
    smear_px: Array | None = None
    delivery: Delivery | None = None


def camera_from(scenario: Scenario) -> CameraModel:
    """The scenario's camera."""
    camera = scenario.camera
    return CameraModel(
        half_angle_deg=camera.half_angle_deg,
        shape=camera.shape,
        resolution_px=camera.resolution_px,
        detector_ifov=camera.detector_ifov_rad,
        exposure_s=camera.exposure_s or 0.0,
    )


def schedule_from(scenario: Scenario, period_s: float) -> PictureSchedule:
    """When pictures that count are taken, by the scenario, in instants of a clock with this period [s]."""
    return PictureSchedule.by_clock(
        period_s,
        interval_s=scenario.observation.interval_s,
        visits_s=visit_times(scenario),
        visit_only=scenario.observation.criterion == "visit",
    )


def observer_from(scenario: Scenario, region: TargetRegion) -> Observer:
    """The scenario's observer of a target; close it after use.

    Raises:
        ObserverError: It is not available here.
    """
    observation = scenario.observation
    return make_observer(region, camera_from(scenario), kind=observation.observer, occlusion=observation.occlusion)


def observe_flight(plan: Observed, telemetry: xr.Dataset, progress: Progress | None = None) -> ObservationResult:
    """Measure what the observers' cameras saw during a flight.

    A spacecraft takes a picture every `observation.interval_s` while it tracks the asteroid, and one at the instant of the
    visit. A dedicated communications spacecraft takes none.

    Args:
        plan: The plan that was flown, or what is known of a flight that was flown elsewhere.
        telemetry: Its telemetry.
        progress: Called with the number of pictures judged.

    Raises:
        ObserverError: The requested observer is not available here.
    """
    scenario = plan.scenario
    criterion = scenario.observation
    passage, visit = (CoverageMap(plan.region.area, plan.n) for _ in range(2))
    visits_s = telemetry["time"].values[visit_samples(scenario)]
    observer = observer_from(scenario, plan.region)
    limits = limits_of(criterion, observer.camera)
    gsd_m, least_px = (np.full(plan.region.n_cells, np.nan) for _ in range(2))
    visit_only = scenario.observation.criterion == "visit"
    images = 0
    try:
        for picture in flight_pictures(plan, telemetry):
            seen = observe(observer, picture.r_A, picture.C_CA, criterion, picture.sun_A, picture.motion)
            passage.add(picture.t, picture.spacecraft, seen)
            at_visit = picture.t == visits_s[picture.spacecraft]
            if at_visit:
                visit.add(picture.t, picture.spacecraft, seen)
                least_px = np.fmin(least_px, _smear_in(observer, picture))
            if at_visit or not visit_only:
                finest = ground_sampling_distance(limits, *sight(plan.region, picture.r_A, seen))
                gsd_m[seen] = np.fmin(gsd_m[seen], finest)
            images += 1
            if progress is not None:
                progress(images)
    finally:
        observer.close()
    return ObservationResult(
        coverage=visit if visit_only else passage,
        passage=passage,
        observer=observer.name,
        note=WHOLE_NOTE if criterion.whole else observer.note,
        images=images,
        gsd_m=gsd_m,
        smear_px=least_px if scenario.camera.exposure_s else None,
    )


def _smear_in(observer: Observer, picture: Picture) -> Array:
    """Smear of the cells whose near side is in a picture [px], NaN elsewhere, shape (n,)."""
    region, camera = observer.region, observer.camera
    if picture.motion is None:
        return np.full(region.n_cells, np.nan)
    _, height = sight(region, picture.r_A)
    shown = (height > 0.0) & camera.contains(picture.pose.to_camera(region.centroid_A))
    return np.where(shown, smear_px(region, camera, picture.r_A, picture.C_CA, picture.motion), np.nan)


def flight_pictures(plan: Observed, telemetry: xr.Dataset) -> Iterator[Picture]:
    """All pictures of a flight, in order of time."""
    who, environment = watching_in(telemetry, plan.n_observers), plan.environment
    r_BN_N, C_BN = telemetry["r_BN_N"].values, dcm(telemetry["sigma_BN"].values)
    schedule = _passage(plan.scenario)
    # Of a flight flown elsewhere no rates are known.
    rates = [telemetry[name].values for name in ("v_BN_N", "omega_BN_B") if name in telemetry]
    for k in picture_samples(plan.scenario, telemetry):
        t = float(telemetry["time"].values[k])
        taking = who[k] & schedule.takers(k, plan.n)
        moving = Motion(rates[0][k], rates[1][k], environment.spin_N) if len(rates) == 2 else None
        yield from pictures(t, taking, r_BN_N[k], C_BN[k], environment.C_AN(t), environment.sun.at(t), moving)


def picture_count(plan: Observed, telemetry: xr.Dataset) -> int:
    """Number of pictures that `observe_flight` will judge."""
    who, schedule = watching_in(telemetry, plan.n_observers), _passage(plan.scenario)
    return sum(
        int((who[k] & schedule.takers(k, plan.n)).sum()) for k in picture_samples(plan.scenario, telemetry).tolist()
    )


def watching_in(telemetry: xr.Dataset, n_observers: int) -> Mask:
    """Who would take a picture at each sample, shape (time, n)."""
    camera_on = working(telemetry) if "released" in telemetry else True
    if "camera_on" in telemetry:
        camera_on = camera_on & (telemetry["camera_on"].values == 1)
    return watching(n_observers, telemetry["mode"].values, camera_on)


def visit_samples(scenario: Scenario) -> Ints:
    """Number of the telemetry sample at the visit of each observer, shape (n_obs,)."""
    return np.array(schedule_from(scenario, scenario.telemetry.interval_s).visits)


def visit_sample(scenario: Scenario) -> int:
    """The same of the last visit, for what shows the swarm as a whole."""
    return int(visit_samples(scenario).max())


def picture_samples(scenario: Scenario, telemetry: xr.Dataset) -> Ints:
    """Samples at which pictures are taken during the whole passage."""
    return _passage(scenario).ticks(telemetry.sizes["time"] - 1)


def _passage(scenario: Scenario) -> PictureSchedule:
    """The pictures of the whole passage, whatever counts."""
    return replace(schedule_from(scenario, scenario.telemetry.interval_s), visit_only=False)


def add_coverage(telemetry: xr.Dataset, result: ObservationResult) -> None:
    """Add the observed share of the target over time to the telemetry."""
    percent = result.coverage.percent_over_time(telemetry["time"].values)
    telemetry["coverage_percent"] = VARIABLES["coverage_percent"].of(percent)
