"""What the swarm saw during a flight: its pictures judged, cell by cell."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import sqrt
from typing import Protocol

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from swarm_mj.dataflow.delivery import Delivery
from swarm_mj.flight.light import Turning, lit_sometime
from swarm_mj.mission.target import TargetRegion
from swarm_mj.observation.camera import CameraModel, Motion, motion_blur_px
from swarm_mj.observation.capture import (
    Limits,
    Picture,
    PictureSchedule,
    causes,
    ground_sampling_distance,
    incidence,
    limits_of,
    lit_cells,
    observe,
    pictures,
    sight,
    watching,
)
from swarm_mj.observation.companion import Screen, Shade
from swarm_mj.observation.coverage import Cause, CoverageMap, KeptPictures, Shown
from swarm_mj.observation.observer import Observer, make_observer
from swarm_mj.observation.photometry import body_surface, radiance_factors
from swarm_mj.observation.quality import Looks, PictureLooks, Quality, gather, looks_in_picture, quality_of
from swarm_mj.observation.radiometry import electrons, signal_to_noise
from swarm_mj.scenarios.itinerary import arrival_times
from swarm_mj.scenarios.schema import Scenario
from swarm_mj.scenarios.schema_imaging import Observation
from swarm_mj.scenarios.schema_quality import QualityClass
from swarm_mj.simulator.telemetry import VARIABLES, working
from swarm_mj.smallbody.environment import Environment
from swarm_mj.spacecraft.attitude.mrp import dcm
from swarm_mj.spacecraft.mounting import camera_attitudes
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
        why: `Cause` why each cell does not count by the scenario's criterion, in the picture that came nearest to that, (n,).
        kept: By which picture each spacecraft keeps each cell that counts by the scenario's criterion.
        motion_blur_px: Of each cell in the sharpest picture of the arrival that has it in the field of view [px], NaN where
            none has, shape (n,); None where the camera has no exposure or the flight was read back.
        quality: What the scenario's quality classes map, and the figures of the looks; None where it asks for no class or the
            flight was read back.
        delivery: What of it reaches Earth; None where that was not computed.
    """

    coverage: CoverageMap
    passage: CoverageMap
    observer: str
    note: str
    images: int
    why: NDArray[np.int8]
    kept: KeptPictures
    motion_blur_px: Array | None = None
    quality: Quality | None = None
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
        sides=camera.sides,
    )


def schedule_from(scenario: Scenario, period_s: float) -> PictureSchedule:
    """When qualifying images are taken, by the scenario, in instants of a clock with this period [s]."""
    schedule = PictureSchedule.by_clock(
        period_s,
        interval_s=scenario.observation.interval_s,
        arrivals_s=arrival_times(scenario),
        arrival_only=scenario.observation.criterion == "arrival",
    )
    if not scenario.observation.sequence:
        return schedule
    listed: list[set[int]] = [set() for _ in schedule.arrivals]
    for who, t, _ in sequence_of(scenario):
        listed[who].add(round(t / period_s))
    return replace(schedule, listed=tuple(frozenset(each) for each in listed))


def sequence_of(scenario: Scenario) -> Iterator[tuple[int, float, float | None]]:
    """Pictures of `observation.sequence`: who takes each, from 0, at which sample [s], its own exposure [s]."""
    interval_s = scenario.telemetry.interval_s
    for picture in scenario.observation.sequence:
        t = interval_s * round(picture.seconds_after(scenario.epoch) / interval_s)
        everybody = range(len(scenario.design.visiting_points))
        for who in everybody if picture.spacecraft is None else (picture.spacecraft - 1,):
            yield who, t, picture.exposure_s


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
    arrival. A dedicated communications spacecraft takes none.

    Args:
        plan: The plan that was flown, or what is known of a flight that was flown elsewhere.
        telemetry: Its telemetry.
        progress: Called with the number of pictures judged.

    Raises:
        ObserverError: The requested observer is not available here.
    """
    scenario = plan.scenario
    criterion = scenario.observation
    passage, arrival = (CoverageMap(plan.region.weighted_area, plan.n) for _ in range(2))
    arrivals_s = telemetry["time"].values[arrival_samples(scenario)]
    observer = observer_from(scenario, plan.region)
    limits = limits_of(criterion, observer.camera, plan.region)
    kept = KeptPictures(plan.region.n_cells, plan.n, scenario.data.pictures)
    least_px, why = np.full(plan.region.n_cells, np.nan), np.full(plan.region.n_cells, Cause.NO_PICTURE, np.int8)
    arrival_only = scenario.observation.criterion == "arrival"
    screen = screen_of(plan.environment)
    images, light, looks = 0, _Light(observer, criterion, screen), LooksTaken(scenario, observer, criterion.classes)
    far, too_far = _too_far(plan, telemetry, limits), Cause.BLURRED if criterion.needs_motion else Cause.COARSE

    def all_that_matter() -> Iterator[Picture]:
        yield from flight_pictures(plan, telemetry, among=~far)
        # Those from too far away tell at most that.
        if not arrival_only and (why < too_far).any():
            yield from flight_pictures(plan, telemetry, among=far)

    try:
        for picture in all_that_matter():
            shade = light.shade_at(picture.t)
            lit_now = partial(light.at, picture)
            cause = causes(observer, picture.pose, criterion, motion=picture.motion, light=lit_now, shade=shade)
            images += 1
            if progress is not None:
                progress(images)
            seen = cause == Cause.NONE
            passage.add(picture.t, picture.spacecraft, seen)
            at_arrival = picture.t == arrivals_s[picture.spacecraft]
            if at_arrival:
                arrival.add(picture.t, picture.spacecraft, seen)
                least_px = np.fmin(least_px, _motion_blur_in(observer, picture))
            if at_arrival or not arrival_only:
                why = np.maximum(why, cause)
                if not seen.any():
                    continue
                cells = np.flatnonzero(seen)
                gsd_m = ground_sampling_distance(limits, *sight(plan.region, picture.r_A, cells))
                incidence_deg = np.degrees(incidence(plan.region, picture.sun_A)[cells])
                shown = Shown(picture.t, picture.spacecraft, cells)
                kept.add(shown, gsd_m, incidence_deg, float(arrivals_s[picture.spacecraft]))
                looks.add(picture, cells, gsd_m)
        for picture in flight_pictures(plan, telemetry, camera_on=False):
            if not arrival_only or picture.t == arrivals_s[picture.spacecraft]:
                would = observe(
                    observer,
                    picture.r_A,
                    picture.C_CA,
                    criterion,
                    picture.sun_A,
                    picture.motion,
                    light.shade_at(picture.t),
                )
                why[would & (why != Cause.NONE)] = Cause.CAMERA_OFF
        if criterion.needs_sun:
            ticks = schedule_from(scenario, scenario.telemetry.interval_s).ticks(telemetry.sizes["time"] - 1)
            tell_never_lit(why, observer, criterion, plan.environment, telemetry["time"].values[ticks], screen)
        images = picture_count(plan, telemetry)
        if progress is not None:
            progress(images)
    finally:
        observer.close()
    return ObservationResult(
        coverage=arrival if arrival_only else passage,
        passage=passage,
        observer=observer.name,
        note=WHOLE_NOTE if criterion.whole else observer.note,
        images=images,
        why=why,
        kept=kept,
        motion_blur_px=least_px if scenario.camera.exposure_s else None,
        quality=looks.quality(),
    )


def tell_never_lit(
    why: NDArray[np.int8],
    observer: Observer,
    criterion: Observation,
    around: Turning,
    times_s: Array,
    screen: Screen | None = None,
) -> None:
    """Change the `Cause` of the cells that do not count, shape (n,), where they are lit at none of some times [s]."""
    unseen = (why != Cause.NONE) & (why != Cause.CAMERA_OFF)
    limit, tracer = criterion.max_incidence_deg, observer.tracer
    ever = lit_sometime(observer.region, around, times_s, limit, tracer=tracer, among=unseen, screen=screen)
    why[unseen & ~ever] = Cause.NEVER_LIT


def screen_of(environment: Environment) -> Screen | None:
    """The companion as what hides and shades the target; None: there is none."""
    return None if environment.companion is None else Screen(environment.companion, environment)


class _Light:
    """Which cells are lit, and where the companion stands, worked out once for all pictures of an instant."""

    def __init__(self, observer: Observer, criterion: Observation, screen: Screen | None) -> None:
        self._observer, self._criterion, self._screen = observer, criterion, screen
        self._last: tuple[float, Mask] | None = None
        self._shade: tuple[float, Shade] | None = None

    def at(self, picture: Picture) -> Mask:
        """Of a picture, shape (n,)."""
        if self._last is None or self._last[0] != picture.t:
            shade = self.shade_at(picture.t)
            self._last = picture.t, lit_cells(self._observer, self._criterion, picture.sun_A, shade)
        return self._last[1]

    def shade_at(self, t: float) -> Shade | None:
        """The companion at a time [s]; None: there is none."""
        if self._screen is not None and (self._shade is None or self._shade[0] != t):
            self._shade = t, self._screen.at(t)
        return self._shade and self._shade[1]


class LooksTaken:
    """The looks of all pictures that count, where there are quality classes."""

    def __init__(self, scenario: Scenario, observer: Observer, classes: Sequence[QualityClass]) -> None:
        self._scenario, self._observer, self._classes = scenario, observer, classes
        self._pictures: list[PictureLooks] = []

    def add(self, picture: Picture, cells: Ints, gsd_m: Array) -> None:
        """Add a picture with the cells that count in it and their ground sampling distance [m], shape (k,)."""
        if not self._classes or not len(cells):
            return
        region, blur, snr = self._observer.region, self._motion_blur(picture, cells), self._snr(picture, cells)
        place = picture.spacecraft, picture.r_A, picture.sun_A
        self._pictures.append(looks_in_picture(region, *place, cells, gsd_m, motion_blur_px=blur, snr=snr))

    def _motion_blur(self, picture: Picture, cells: Ints) -> Array | float:
        region, camera = self._observer.region, self._observer.camera
        if picture.motion is None or not any("max_motion_blur_px" in each.needs for each in self._classes):
            return np.nan
        return motion_blur_px(region, camera, picture.r_A, picture.C_CA, picture.motion)[cells]

    def _snr(self, picture: Picture, cells: Ints) -> Array | float:
        region, camera, surface = self._observer.region, self._scenario.camera, body_surface(self._scenario.body)
        if surface is None or not any("min_snr" in each.needs for each in self._classes):
            return np.nan
        distance, range_m = (
            float(np.linalg.norm(picture.sun_A)),
            np.linalg.norm(picture.r_A - region.centroid_A[cells], axis=1),
        )
        to_camera = (picture.r_A - region.centroid_A[cells]) / range_m[:, None]
        to_sun, normal = picture.sun_A / distance, region.normal_A[cells]
        cosines = normal @ to_sun, np.einsum("ck,ck->c", normal, to_camera), to_camera @ to_sun
        reflectance = radiance_factors(surface, *cosines)
        if picture.exposure_s is not None:
            camera = camera.model_copy(update={"exposure_s": picture.exposure_s})
        return signal_to_noise(camera, electrons(camera, self._observer.camera.pixel_angle, reflectance, distance))

    def quality(self) -> Quality | None:
        """What they come to."""
        if not self._classes:
            return None
        return quality_of(self._classes, self.gathered)

    @property
    def gathered(self) -> Looks:
        """All of them, by cell."""
        return gather(self._pictures, self._observer.region.normal_A)


def _motion_blur_in(observer: Observer, picture: Picture) -> Array:
    """Motion blur of the cells whose near side is in a picture [px], NaN elsewhere, shape (n,)."""
    region, camera = observer.region, observer.camera
    if picture.motion is None:
        return np.full(region.n_cells, np.nan)
    _, height = sight(region, picture.r_A)
    shown = (height > 0.0) & camera.contains(picture.pose.to_camera(region.centroid_A))
    return np.where(shown, motion_blur_px(region, camera, picture.r_A, picture.C_CA, picture.motion), np.nan)


def _too_far(plan: Observed, telemetry: xr.Dataset, limits: Limits) -> Mask:
    """Where spacecraft are too far away for any cell to count, shape (time, n); at no arrival."""
    reach = min(limits.max_range, min(limits.max_gsd, sqrt(limits.max_pixel_area)) / limits.pixel_angle)
    far: Mask = np.linalg.norm(telemetry["r_BN_N"].values, axis=2) > reach + plan.region.mesh.max_radius
    far[arrival_samples(plan.scenario)] = False
    return far


def flight_pictures(
    plan: Observed, telemetry: xr.Dataset, *, camera_on: bool = True, among: Mask | None = None
) -> Iterator[Picture]:
    """All pictures of a flight, in order of time, or those of some instants, shape (time, n).

    With `camera_on` False those that are not taken, since a camera is off.
    """
    who, environment = watching_in(plan.scenario, telemetry, plan.n_observers, camera_on=camera_on), plan.environment
    schedule, r_BN_N = _passage(plan.scenario), telemetry["r_BN_N"].values
    C_CN, omega_CN_C = flown_cameras(plan.scenario, telemetry)
    interval_s = plan.scenario.telemetry.interval_s
    exposures = {(who, round(t / interval_s)): exposure for who, t, exposure in sequence_of(plan.scenario)}
    # Of a flight flown elsewhere no rates are known.
    rates = [] if omega_CN_C is None or "v_BN_N" not in telemetry else [telemetry["v_BN_N"].values, omega_CN_C]
    times_s = telemetry["time"].values
    for k in picture_samples(plan.scenario, telemetry).tolist():
        t = float(times_s[k])
        taking = who[k] & schedule.takers(k, plan.n) & (True if among is None else among[k])
        if not taking.any():
            continue
        moving = Motion(rates[0][k], rates[1][k], environment.spin_N) if len(rates) == 2 else None
        for picture in pictures(t, taking, r_BN_N[k], C_CN[k], environment.C_AN(t), environment.sun.at(t), moving):
            yield picture.exposed(exposures.get((picture.spacecraft, k)))


def flown_cameras(scenario: Scenario, telemetry: xr.Dataset) -> tuple[Array, Array | None]:
    """Attitudes and rates of the cameras of a flight, see `camera_attitudes`."""
    omega_BN_B = telemetry["omega_BN_B"].values if "omega_BN_B" in telemetry else None
    r_BN_N, C_BN = telemetry["r_BN_N"].values, dcm(telemetry["sigma_BN"].values)
    return camera_attitudes(scenario.camera, telemetry["time"].values, r_BN_N, C_BN, omega_BN_B)


def picture_count(plan: Observed, telemetry: xr.Dataset) -> int:
    """Number of pictures that `observe_flight` will judge."""
    who, schedule = watching_in(plan.scenario, telemetry, plan.n_observers), _passage(plan.scenario)
    return sum(
        int((who[k] & schedule.takers(k, plan.n)).sum()) for k in picture_samples(plan.scenario, telemetry).tolist()
    )


def watching_in(scenario: Scenario, telemetry: xr.Dataset, n_observers: int, *, camera_on: bool = True) -> Mask:
    """Who would take a picture at each sample, shape (time, n); or who would if its camera were not off."""
    works = working(telemetry) if "released" in telemetry else np.ones(telemetry["mode"].shape, np.bool_)
    on = telemetry["camera_on"].values == 1 if "camera_on" in telemetry else works
    turns = scenario.camera.gimbal is not None
    return watching(n_observers, telemetry["mode"].values, works & (on == camera_on), turns=turns)


def arrival_samples(scenario: Scenario) -> Ints:
    """Number of the telemetry sample at the arrival of each observer, shape (n_obs,)."""
    return np.array(schedule_from(scenario, scenario.telemetry.interval_s).arrivals)


def arrival_sample(scenario: Scenario) -> int:
    """The same of the last arrival, for what shows the swarm as a whole."""
    return int(arrival_samples(scenario).max())


def picture_samples(scenario: Scenario, telemetry: xr.Dataset) -> Ints:
    """Samples at which pictures are taken during the whole passage."""
    return _passage(scenario).ticks(telemetry.sizes["time"] - 1)


def _passage(scenario: Scenario) -> PictureSchedule:
    """The pictures of the whole passage, whatever counts."""
    return replace(schedule_from(scenario, scenario.telemetry.interval_s), arrival_only=False)


def add_coverage(telemetry: xr.Dataset, result: ObservationResult) -> None:
    """Add the observed share of the target over time to the telemetry."""
    percent = result.coverage.percent_over_time(telemetry["time"].values)
    telemetry["coverage_percent"] = VARIABLES["coverage_percent"].of(percent)
