"""What the swarm saw during a flight: its pictures judged, cell by cell."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import xarray as xr

from swarm_mj.flight.fly import asteroid_attitudes
from swarm_mj.flight.plan import Plan
from swarm_mj.observation.camera import CameraModel
from swarm_mj.observation.coverage import CoverageMap, ObservationCriterion, observe
from swarm_mj.observation.observer import make_observer
from swarm_mj.scenarios.schema import Scenario
from swarm_mj.simulator.telemetry import OBSERVING
from swarm_mj.spacecraft.attitude.mrp import dcm

Progress = Callable[[float], None]


@dataclass(frozen=True, kw_only=True)
class ObservationResult:
    """What the swarm saw.

    Attributes:
        coverage: By the scenario's criterion.
        passage: Over the whole passage inside the imaging region.
        observer: Name of the observer that measured it.
        note: Why that one.
        images: Number of pictures judged.
    """

    coverage: CoverageMap
    passage: CoverageMap
    observer: str
    note: str
    images: int


def camera_from(scenario: Scenario) -> CameraModel:
    """The scenario's camera."""
    camera = scenario.camera
    return CameraModel(
        half_angle_deg=camera.half_angle_deg,
        shape=camera.shape,
        resolution_px=camera.resolution_px,
        detector_ifov=camera.detector_ifov_rad,
    )


def criterion_from(scenario: Scenario) -> ObservationCriterion:
    """When a face counts as observed, by the scenario."""
    observation = scenario.observation
    return ObservationCriterion(
        min_fraction=observation.min_fraction,
        any_pixel=observation.any_pixel,
        max_emission_deg=observation.max_emission_deg,
        max_range_m=observation.max_range_m,
        max_gsd_m=observation.max_gsd_m,
        max_incidence_deg=observation.max_incidence_deg,
        shadows=observation.shadows,
    )


def observe_flight(plan: Plan, telemetry: xr.Dataset, progress: Progress | None = None) -> ObservationResult:
    """Measure what the observers' cameras saw during a flight.

    A spacecraft takes a picture every `observation.interval_s` while it tracks the asteroid, and one at the instant of the
    visit. A dedicated communications spacecraft takes none.

    Args:
        plan: The plan that was flown.
        telemetry: Its telemetry.
        progress: Called with the number of pictures judged.

    Raises:
        ObserverError: The requested observer is not available here.
    """
    scenario = plan.scenario
    criterion = criterion_from(scenario)
    passage = CoverageMap(plan.region.area, plan.n)
    visit = CoverageMap(plan.region.area, plan.n)
    pictures = _pictures(plan, telemetry)
    r_BN_N, C_BN, C_AN = telemetry["r_BN_N"].values, dcm(telemetry["sigma_BN"].values), asteroid_attitudes(telemetry)
    times = telemetry["time"].values
    observation = scenario.observation
    observer = make_observer(
        plan.region, camera_from(scenario), kind=observation.observer, occlusion=observation.occlusion
    )
    try:
        for count, (k, j) in enumerate(pictures):
            sun_A = C_AN[k] @ plan.environment.sun.at(times[k])
            seen = observe(observer, C_AN[k] @ r_BN_N[k, j], C_BN[k, j] @ C_AN[k].T, criterion, sun_A)
            passage.add(times[k], j, seen)
            if k == visit_sample(scenario):
                visit.add(times[k], j, seen)
            if progress is not None:
                progress(count + 1)
    finally:
        observer.close()
    return ObservationResult(
        coverage=passage if scenario.observation.criterion == "passage" else visit,
        passage=passage,
        observer=observer.name,
        note=observer.note,
        images=len(pictures),
    )


def visit_sample(scenario: Scenario) -> int:
    """Number of the telemetry sample at the instant of the visit."""
    return round(scenario.design.time_of_flight_s / scenario.telemetry.interval_s)


def picture_count(plan: Plan, telemetry: xr.Dataset) -> int:
    """Number of pictures that `observe_flight` will judge."""
    return len(_pictures(plan, telemetry))


def _pictures(plan: Plan, telemetry: xr.Dataset) -> list[tuple[int, int]]:
    """Sample and spacecraft of every picture, in order of time."""
    scenario = plan.scenario
    every = round(scenario.observation.interval_s / scenario.telemetry.interval_s)
    samples = sorted({*range(0, telemetry.sizes["time"], every), visit_sample(scenario)})
    observing = np.isin(telemetry["mode"].values[:, : plan.n_observers], OBSERVING)
    if "camera_on" in telemetry:
        observing &= telemetry["camera_on"].values[:, : plan.n_observers] == 1
    return [(k, j) for k in samples for j in range(plan.n_observers) if observing[k, j]]


def add_coverage(telemetry: xr.Dataset, result: ObservationResult) -> None:
    """Add the observed share of the target over time to the telemetry."""
    telemetry["coverage_percent"] = (
        "time",
        result.coverage.percent_over_time(telemetry["time"].values),
        {"units": "percent", "frame": "none", "long_name": "observed share of the target's area, P_TO, whole swarm"},
    )
