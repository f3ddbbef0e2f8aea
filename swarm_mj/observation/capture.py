"""Taking pictures and judging them: who takes one when, from where, and which cells of the target count as observed in it.

The picture loop: at even times and at the arrival (`PictureSchedule`), each observer that looks at the body with a working
camera (`takes_picture`) takes one picture from where it is (`pictures`). The criterion: a cell counts when it keeps the limits
(`keeps_limits`), shows enough of itself (`shows_enough`) and is lit (`lit_cells`), see `judge`. Of cells that do not count it
tells the cause.

A recorded flight, one watched live, the designer's candidates and the environment of reinforcement learning all come here.
What is marked `jittable` takes arrays in NumPy and numbers in compiled kernels: one statement, one arithmetic.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import lru_cache
from math import cos, inf, radians
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swarm_mj.compilation import jittable
from swarm_mj.errors import MissionError
from swarm_mj.mission.behaviors import TargetKind, looks_at_body
from swarm_mj.mission.target import TargetRegion
from swarm_mj.observation.camera import CameraModel, CameraMotion, CameraPose, Motion, camera_pose, motion_blur_px
from swarm_mj.observation.companion import Shade
from swarm_mj.observation.coverage import Cause
from swarm_mj.observation.observer import Observer
from swarm_mj.observation.raycast import WHOLE_SAMPLES, RayTracer, barycentric_samples, sampled_fraction, shown_whole
from swarm_mj.scenarios.schema_imaging import Observation
from swarm_mj.spacecraft.attitude.algebra import dot, relative_dcm, times
from swarm_mj.typing import Array, Ints, Mask

#: Least share of a cell that is any part of it at all: the least number above nothing.
ANY_PART = float(np.nextafter(0.0, 1.0))
#: Shadow rays start this far off the surface, over the body's largest radius, so as not to meet the cell itself.
SHADOW_LIFT = 1e-5


@dataclass(frozen=True, kw_only=True)
class PictureSchedule:
    """When pictures are taken, in instants of a clock that counts from 0 at the epoch.

    Attributes:
        every: Instants from one picture to the next.
        arrivals: The instant of each observer's arrival, at which it always takes one.
        arrival_only: Whether there is none besides.
        listed: Instants of each observer's pictures, at which and no others they are taken; None: as the others say.
    """

    every: int
    arrivals: tuple[int, ...]
    arrival_only: bool = False
    listed: tuple[frozenset[int], ...] | None = None

    @classmethod
    def by_clock(
        cls, period_s: float, *, interval_s: float, arrivals_s: ArrayLike, arrival_only: bool = False
    ) -> PictureSchedule:
        """The schedule of pictures every `interval_s` and at arrivals [s], all whole multiples of the clock's period [s]."""
        arrivals = tuple(round(float(t) / period_s) for t in np.atleast_1d(arrivals_s))
        return cls(every=round(interval_s / period_s), arrivals=arrivals, arrival_only=arrival_only)

    def due(self, tick: Any) -> Any:
        """Whether pictures of anybody are due at an instant, or an array of them."""
        if self.listed is not None:
            return np.isin(tick, list(frozenset().union(*self.listed)))
        return np.isin(tick, self.arrivals) | ((not self.arrival_only) & (tick % self.every == 0))

    def takers(self, tick: int, n: int) -> Mask:
        """Whose pictures are due at an instant, of n spacecraft of which the observers are the first, shape (n,)."""
        if self.listed is not None:
            return np.array([j < len(self.listed) and tick in self.listed[j] for j in range(n)])
        who = np.full(n, not self.arrival_only and tick % self.every == 0)
        # Of a flight by files there may be fewer than the scenario has observers.
        who[: len(self.arrivals)] |= np.array(self.arrivals[:n]) == tick
        return who

    def ticks(self, last: int) -> Ints:
        """All instants up to `last` at which pictures are due, in order."""
        return np.flatnonzero(self.due(np.arange(last + 1)))


@jittable
def takes_picture(spacecraft: Any, n_observers: Any, kind: Any, camera_on: Any) -> Any:
    """Whether spacecraft take a picture when one is due.

    Args:
        spacecraft: Number, from 0; those from `n_observers` on are there for communications only.
        n_observers: Number of observers.
        kind: `TargetKind` of what its +z tracks.
        camera_on: Whether the spacecraft and its camera work.
    """
    return (spacecraft < n_observers) & looks_at_body(kind) & camera_on


def watching(n_observers: int, kind: Any, camera_on: Any = True, *, turns: bool = False) -> Mask:
    """The same for all spacecraft, which are the last axis of `kind` and `camera_on`, shape (..., n).

    Cameras that turn by themselves (`camera.gimbal`) look at the body while the spacecraft holds a direction, too.
    """
    kind = np.where(turns & (np.asarray(kind) == TargetKind.DIRECTION), TargetKind.ASTEROID, kind)
    return np.asarray(takes_picture(np.arange(np.shape(kind)[-1]), n_observers, kind, camera_on))


class Picture(NamedTuple):
    """One picture.

    Attributes:
        t: Time past the epoch [s].
        spacecraft: Who takes it, from 0.
        r_A: Position of the camera in A [m], shape (3,).
        C_CA: Rotation from A to the camera frame, which is the spacecraft's B, shape (3, 3).
        sun_A: Direction to the Sun in A, of any length, shape (3,).
        motion: How the camera moves relative to the body; None where that is not known.
        exposure_s: Of the picture [s]; None: the camera's.
    """

    t: float
    spacecraft: int
    r_A: Array
    C_CA: Array
    sun_A: Array
    motion: CameraMotion | None = None
    exposure_s: float | None = None

    def exposed(self, exposure_s: float | None) -> Picture:
        """The picture with an exposure of its own [s], if it is given."""
        if exposure_s is None:
            return self
        motion = None if self.motion is None else self.motion._replace(exposure_s=exposure_s)
        return self._replace(motion=motion, exposure_s=exposure_s)

    @property
    def pose(self) -> CameraPose:
        """Of the camera, in A."""
        return CameraPose(self.r_A, self.C_CA)


def pictures(
    t: float, who: Mask, r_BN_N: Array, C_BN: Array, C_AN: Array, sun_N: Array, moving: Motion | None = None
) -> Iterator[Picture]:
    """The pictures of one instant, in order of the spacecraft.

    Args:
        t: Time past the epoch [s].
        who: Who takes one, see `watching`, shape (n,).
        r_BN_N: Positions [m], shape (n, 3).
        C_BN: Rotations from N to B, shape (n, 3, 3).
        C_AN: Rotation from N to A, shape (3, 3).
        sun_N: Position of the Sun relative to the body [m], shape (3,).
        moving: How spacecraft and the body move, where motion blur matters.
    """
    j = np.flatnonzero(who)
    sun_A = np.array(times(C_AN, sun_N))
    for spacecraft, r_A, C_CA in zip(j, *camera_poses(r_BN_N[j], C_BN[j], C_AN), strict=True):
        motion = moving and moving.of(int(spacecraft), r_BN_N[spacecraft], C_BN[spacecraft], C_AN)
        yield Picture(t, int(spacecraft), r_A, C_CA, sun_A, motion)


def camera_poses(r_BN_N: Array, C_BN: Array, C_AN: Array) -> tuple[Array, Array]:
    """Positions in A [m], shape (n, 3), and rotations C_CA from A to the camera frames, shape (n, 3, 3), of n cameras.

    From the spacecraft's positions [m], shape (n, 3), their `C_BN`, shape (n, 3, 3), for a camera's frame is B, and `C_AN`.
    """
    C_CA = np.empty(C_BN.shape)
    relative_dcm(C_BN.transpose(1, 2, 0), C_AN, C_CA.transpose(1, 2, 0))
    return np.column_stack(times(C_AN, r_BN_N.T)), C_CA


class Limits(NamedTuple):
    """The criterion, `Observation` but for the light, and a camera in numbers. Limits hold at a cell's centroid.

    Attributes:
        min_cos_emission: Least cosine of the emission angle.
        max_range: [m].
        max_gsd: Largest ground sampling distance [m].
        max_motion_blur: Largest motion of the image during the exposure [px].
        pixel_angle: Width of a pixel at unit distance [rad].
        min_share: Least visible share of a cell.
        max_pixel_area: Largest area of ground that a pixel may cover [m^2].
    """

    min_cos_emission: float
    max_range: float
    max_gsd: float
    max_motion_blur: float
    pixel_angle: float
    min_share: float
    max_pixel_area: float


def limits_of(criterion: Observation, camera: CameraModel, region: TargetRegion) -> Limits:
    """The criterion in numbers, for pictures of a target by one camera."""
    emission = criterion.max_emission_deg
    return Limits(
        min_cos_emission=cos(radians(emission)) if emission < 90.0 else 0.0,
        max_range=criterion.max_range_m or inf,
        max_gsd=criterion.max_gsd_m or inf,
        max_motion_blur=criterion.max_motion_blur_px or inf,
        pixel_angle=camera.pixel_angle,
        min_share=ANY_PART if criterion.any_pixel else criterion.min_fraction,
        max_pixel_area=region.typical_area / criterion.min_pixels if criterion.min_pixels else inf,
    )


@jittable
def keeps_limits(limits: Limits, distance: Any, height: Any, motion_blur: Any = 0.0) -> Any:
    """Whether cells keep the limits of emission angle, range, ground sampling distance, pixels and motion blur.

    Args:
        limits: In numbers.
        distance: From the cell's centroid to the camera [m].
        height: Of the camera above the plane of the cell [m].
        motion_blur: Motion of the cell's image during the exposure [px], see `motion_blur_px`; 0 is its least, for bounds.
    """
    cos_emission = height / distance
    return (
        (cos_emission > 0.0)
        & (cos_emission >= limits.min_cos_emission)
        & (distance <= limits.max_range)
        & (distance * limits.pixel_angle <= limits.max_gsd * cos_emission)
        & ((distance * limits.pixel_angle) ** 2 <= limits.max_pixel_area * cos_emission)
        & (motion_blur <= limits.max_motion_blur)
    )


def ground_sampling_distance(limits: Limits, distance: Array, height: Array) -> Array:
    """Ground covered by a pixel [m], obliquity included, at cells by distance and height of the camera [m] (`sight`)."""
    return distance * limits.pixel_angle * (distance / height)


@jittable
def shows_enough(limits: Limits, share: Any) -> Any:
    """Whether the visible share of cells suffices."""
    return share >= limits.min_share


@jittable
def pixels_on(limits: Limits, area: Any, distance: Any, height: Any) -> Any:
    """Pixels that cells of some area [m^2] take up: over the square of the ground sampling distance, foreshortened."""
    gsd = distance * limits.pixel_angle
    return area * (height / distance) / (gsd * gsd)


def sight(region: TargetRegion, r_A: Array, cells: Any = slice(None)) -> tuple[Array, Array]:
    """Distance of a camera at `r_A` [m] from the centroids of cells, and its height above their planes [m]."""
    to_camera = tuple((r_A - region.centroid_A[cells]).T)
    return np.sqrt(dot(to_camera, to_camera)), dot(to_camera, tuple(region.normal_A[cells].T))


def incidence(region: TargetRegion, sun_A: ArrayLike) -> Array:
    """Angle between each cell's normal and the Sun [rad], shape (n,); `sun_A` points to it, of any length, shape (3,).

    Raises:
        MissionError: The direction is not three finite numbers, or zero.
    """
    return np.arccos(np.clip(region.normal_A @ _unit(sun_A), -1.0, 1.0))


def lit(
    region: TargetRegion,
    sun_A: ArrayLike,
    *,
    max_incidence_deg: float = 90.0,
    tracer: RayTracer | None = None,
    samples: int = 16,
    among: Mask | None = None,
    shade: Shade | None = None,
) -> Mask:
    """Tell which cells the Sun lights, a point at infinity; the body itself and its companion cast shadows. Shape (n,).

    Args:
        region: The target.
        sun_A: Direction to the Sun in A, of any length, shape (3,).
        max_incidence_deg: Largest angle between normal and Sun at which a cell counts as lit [deg].
        tracer: Ray tracer over the region's mesh, to have shadows: a cell is lit when at least half of its sample
            points see the Sun. None ignores shadows.
        samples: Sample points per cell, a square number.
        among: Cells that are asked about, shape (n,); the others count as dark. None: all.
        shade: The companion, where shadows are asked for; None: there is none.

    Raises:
        MissionError: The direction is not three finite numbers, or zero; or `samples` is not a square number.
    """
    sun = _unit(sun_A)
    angle = incidence(region, sun)
    result = (angle < np.pi / 2.0) & (angle <= np.radians(max_incidence_deg)) & (True if among is None else among)
    if tracer is None or not result.any():
        return result
    chosen = np.flatnonzero(result)
    lift = SHADOW_LIFT * region.mesh.max_radius * region.normal_A[chosen, None]
    points = (barycentric_samples(samples) @ region.corners_A[chosen] + lift).reshape(-1, 3)
    free = tracer.first_hit(points, np.broadcast_to(sun, points.shape)) < 0
    if shade is not None and shade.may_shade(sun, region.mesh.max_radius):
        free &= ~shade.shades(points, sun)
    result[chosen] = free.reshape(len(chosen), samples).mean(axis=1) >= 0.5
    return result


def _unit(sun_A: ArrayLike) -> Array:
    sun = np.asarray(sun_A, dtype=np.float64)
    if sun.shape != (3,) or not np.isfinite(sun).all() or not sun.any():
        raise MissionError(f"direction to the Sun must be three finite numbers, not all zero, got {sun_A!r}")
    return sun / np.linalg.norm(sun)


def lit_cells(observer: Observer, criterion: Observation, sun_A: ArrayLike, shade: Shade | None = None) -> Mask:
    """Cells that are lit as the criterion asks, shape (n,); `shade` as for `lit`."""
    region, limit, tracer = observer.region, criterion.max_incidence_deg, observer.tracer
    if shade is None:
        packed = _lit_once(region, limit, tracer, np.asarray(sun_A, np.float64).tobytes())
        return np.unpackbits(packed, count=region.n_cells).view(np.bool_)
    return lit(region, sun_A, max_incidence_deg=limit, tracer=tracer, shade=shade)


@lru_cache(maxsize=10_000)
def _lit_once(region: TargetRegion, limit_deg: float, tracer: RayTracer, sun_A: bytes) -> NDArray[np.uint8]:
    """Worked out once for all candidates, kinds of a study, episodes and flights that see a target in one light; in bits."""
    return np.packbits(lit(region, np.frombuffer(sun_A), max_incidence_deg=limit_deg, tracer=tracer))


def visible_share(observer: Observer, r_A: ArrayLike, C_CA: ArrayLike, *, whole: bool) -> Array:
    """Visible share of every cell in a picture, shape (n,), from `r_A` [m], shape (3,), turned by `C_CA`, shape (3, 3).

    Where only `whole` cells count (`Observation.whole`), geometry decides, and others have a share of 0; else the observer.

    Raises:
        MissionError: The pose is impossible.
    """
    if not whole:
        return observer.visible_fraction(r_A, C_CA)
    tracer = observer.tracer if observer.occlusion else None
    return shown_whole(tracer, observer.region, observer.camera, camera_pose(r_A, C_CA)).astype(np.float64)


def screened(
    share: Array, observer: Observer, r_A: Array, shade: Shade | None, *, whole: bool, samples: int = WHOLE_SAMPLES
) -> Array:
    """Visible shares of all cells, shape (n,), less what a companion stands before, where the observer knows of hiding.

    The companion's part of a cell is taken for that of its part in view; of `whole` cells nothing may be hidden.
    """
    if shade is None or not observer.occlusion:
        return share
    cells, left = np.flatnonzero(share > 0.0), share.copy()
    hidden = shade.hidden_share(observer.region, cells, r_A, samples)
    left[cells] *= hidden == 0.0 if whole else 1.0 - hidden
    return left


def judge(
    observer: Observer,
    criterion: Observation,
    pose: CameraPose,
    light: Callable[[], Mask],
    share: Callable[[], Array],
    motion_blur: Callable[[], Array],
    shade: Shade | None = None,
) -> NDArray[np.int8]:
    """`Cause` why each cell does not count as observed in a picture; `Cause.NONE`: it counts. Shape (n,).

    Limits and light are judged at a cell's centroid, its share and shadows over its area. Cells of which too little lies in the
    field of view are out of view, whatever stands before them; those that the body, or its companion, hides more of are hidden.

    Args:
        observer: Who looks, at which target, through which camera.
        criterion: What counts.
        pose: Of the camera.
        light: Gives which cells are lit, see `lit_cells`; asked only where light matters and something is left to light.
        share: Gives the visible share of every cell, see `visible_share`; asked only where something is left to see.
        motion_blur: Gives the motion blur of every cell, see `motion_blur_px`; asked only where it matters.
        shade: The companion, of which `share` and `light` know; None: there is none.
    """
    region = observer.region
    limits = limits_of(criterion, observer.camera, region)
    distance, height = sight(region, pose.r_A)
    moved = motion_blur() if criterion.needs_motion else 0.0
    kept = keeps_limits(limits, distance, height, moved)
    shown = kept & shows_enough(limits, share()) if kept.any() else kept
    counts = shown & light() if criterion.needs_sun and shown.any() else shown
    sharp = moved <= limits.max_motion_blur
    steep = height >= limits.min_cos_emission * distance
    cause = np.select(
        [counts, shown, kept, ~(height > 0.0), ~steep, sharp],
        [Cause.NONE, Cause.DARK, Cause.HIDDEN, Cause.FACES_AWAY, Cause.OBLIQUE, Cause.COARSE],
        Cause.BLURRED,
    ).astype(np.int8)
    outside = ~counts & ~observer.camera.contains(pose.to_camera(region.centroid_A))
    cause[outside] = Cause.OUT_OF_VIEW
    cells = np.flatnonzero(cause == Cause.HIDDEN)
    cause[cells[~_hidden(observer, limits, pose, cells, shade)]] = Cause.OUT_OF_VIEW
    return cause


def _hidden(observer: Observer, limits: Limits, pose: CameraPose, cells: Ints, shade: Shade | None) -> Mask:
    """Which of some cells that show too little of themselves would show enough if no body hid them, shape (len(cells),)."""
    region, camera, samples = observer.region, observer.camera, observer.samples
    in_view = sampled_fraction(None, region, cells, camera, pose, samples)
    hidden = np.asarray(shows_enough(limits, in_view))
    if observer.counts_pixels:  # pixels may miss what samples find at the picture's edge
        less = sampled_fraction(observer.tracer, region, cells, camera, pose, samples) < in_view
        if shade is not None:
            less |= shade.hidden_share(region, cells, pose.r_A, WHOLE_SAMPLES) > 0.0
        hidden &= less
    return hidden


def observe(
    observer: Observer,
    r_A: ArrayLike,
    C_CA: ArrayLike,
    criterion: Observation,
    sun_A: ArrayLike | None = None,
    motion: CameraMotion | None = None,
    shade: Shade | None = None,
) -> Mask:
    """Take one picture and tell which cells count as observed in it, shape (n,); see `causes`."""
    return causes(observer, camera_pose(r_A, C_CA), criterion, sun_A, motion, shade=shade) == Cause.NONE


def causes(
    observer: Observer,
    pose: CameraPose,
    criterion: Observation,
    sun_A: ArrayLike | None = None,
    motion: CameraMotion | None = None,
    light: Callable[[], Mask] | None = None,
    shade: Shade | None = None,
) -> NDArray[np.int8]:
    """Take one picture and tell of each cell the `Cause` why it does not count as observed in it, or that it does, shape (n,).

    Args:
        observer: Who looks, at which target, through which camera.
        pose: Of the camera.
        criterion: What counts.
        sun_A: Direction to the Sun in A, of any length, shape (3,); needed unless light is ignored.
        motion: How the camera moves relative to the body; needed if the criterion limits motion blur.
        light: Gives which cells are lit, where that is known; None: it is worked out.
        shade: The companion at that time; None: there is none.

    Raises:
        MissionError: The pose is impossible, light is asked for without a Sun, or little motion blur without a motion.
    """

    def lit_now() -> Mask:
        if sun_A is None:
            raise MissionError("the observation criterion asks for sunlight: pass the direction to the Sun, sun_A")
        return lit_cells(observer, criterion, sun_A, shade)

    def share() -> Array:
        seen = visible_share(observer, pose.r_A, pose.C_CA, whole=criterion.whole)
        return screened(seen, observer, pose.r_A, shade, whole=criterion.whole)

    def motion_blur() -> Array:
        if motion is None:
            raise MissionError("the observation criterion limits motion blur: pass how the camera moves, motion")
        return motion_blur_px(observer.region, observer.camera, pose.r_A, pose.C_CA, motion)

    return judge(observer, criterion, pose, light or lit_now, share, motion_blur, shade)
