"""Candidates' pictures of a target, computed in parallel and kept on disk, and judged: what each sees, or could see at most.

The visible share of every cell in every picture depends on the mesh, the target, the camera, the observer and the poses, and
on nothing else; its cache is keyed by a hash of just these. One file holds one candidate, so an interrupted computation goes
on where it stopped.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from swarm_mj.designer.candidates.flights import CandidateFlights
from swarm_mj.flight.observe import LooksTaken, screen_of
from swarm_mj.io import interruption
from swarm_mj.io.cache import cache_folder, hash_of, load_array, store_array
from swarm_mj.io.machine import usable_cores
from swarm_mj.io.workers import Runner, run_jobs
from swarm_mj.mission.target import TargetRegion
from swarm_mj.observation.camera import CameraModel, CameraMotion, CameraPose, motion_blur_px
from swarm_mj.observation.capture import (
    Picture,
    ground_sampling_distance,
    judge,
    limits_of,
    lit_cells,
    screened,
    sight,
    visible_share,
)
from swarm_mj.observation.companion import Screen, Shade
from swarm_mj.observation.coverage import Cause
from swarm_mj.observation.observer import Observer, ObserverKind, make_observer
from swarm_mj.observation.quality import Looks
from swarm_mj.observation.reach import cells_of, in_reach, reach_of
from swarm_mj.scenarios.schema import Scenario
from swarm_mj.scenarios.schema_imaging import Observation
from swarm_mj.scenarios.schema_quality import QualityClass
from swarm_mj.typing import Array, Indices, Ints, Mask

Progress = Callable[[float], None]
#: Of a series of pictures: positions in A [m], shape (t, 3), and rotations C_CA, shape (t, 3, 3).
Poses = tuple[Array, Array]

#: With fewer pictures than these, starting processes takes longer than judging them here.
MIN_PARALLEL = 1000
#: Pictures that are judged at one go: between two of them there is progress, and an interruption is heard.
PART = 16

#: Raise when the meaning of a stored picture changes.
CACHE_VERSION = 2


@dataclass(frozen=True, kw_only=True)
class ImagingModel:
    """How pictures are judged.

    Attributes:
        camera: The camera.
        kind: Which observer.
        occlusion: Whether the body hides what lies behind it.
        whole: Whether only whole cells count.
    """

    camera: CameraModel
    kind: ObserverKind = "auto"
    occlusion: bool = True
    whole: bool = False

    def open(self, region: TargetRegion) -> Observer:
        """An observer of the region; close it after use."""
        return make_observer(region, self.camera, kind=self.kind, occlusion=self.occlusion)


def shares_as_they_come(
    poses: Sequence[Poses],
    region: TargetRegion,
    imaging_model: ImagingModel,
    *,
    workers: int | Runner | None,
    progress: Progress | None = None,
) -> Generator[tuple[int, Array]]:
    """Visible share of every cell in every picture of one series after the other: first of those that are kept.

    Args:
        poses: The series, see `poses_of`.
        region: The target whose cells are judged; need not be the one that the candidates visit.
        imaging_model: How pictures are judged.
        workers: Processes; default: one per core. One runs in this process. Or who runs jobs elsewhere.
        progress: Called with the number of series done, parts of one included.

    Yields:
        The number of the series from 0, and its array (pictures, cells).
    """
    folder = cache_folder() / "pictures" / _key(region, imaging_model)
    missing: dict[int, Poses] = {}
    done = 0.0
    for j, job in enumerate(poses):
        share = load_array(_file(folder, job), (len(job[0]), region.n_cells), np.float64)
        if share is None:
            missing[j] = job
        else:
            done += 1.0
            yield j, share
    if progress is not None:
        progress(done)
    unfinished = {j: (np.empty((len(r_A), region.n_cells)), len(r_A)) for j, (r_A, _) in missing.items()}
    for (j, first), part in _compute(region, imaging_model, missing, workers):
        share, left = unfinished[j]
        share[first : first + len(part)] = part
        unfinished[j] = share, left - len(part)
        done += len(part) / len(share) if len(share) else 1.0
        if left == len(part):
            store_array(_file(folder, missing[j]), share)
            del unfinished[j]
            yield j, share
        if progress is not None:
            progress(done)


def _file(folder: Path, job: Poses) -> Path:
    return folder / f"{hash_of(*job)}.npy"


def picture_numbers(flights: CandidateFlights, candidate: int, at: Mask) -> Indices:
    """The times, by number, at which a candidate takes a picture, of those in a mask of shape (t,)."""
    return np.flatnonzero(flights.observing[:, candidate] & at)


def poses_of(flights: CandidateFlights, candidate: int, at: Mask) -> Poses:
    """Where a candidate's pictures are taken, and how the camera is turned then."""
    k = picture_numbers(flights, candidate, at)
    return flights.r_A[k, candidate], flights.C_CA[k, candidate]


def _compute(
    region: TargetRegion, imaging_model: ImagingModel, jobs: dict[int, Poses], workers: int | Runner | None
) -> Iterator[tuple[tuple[int, int], Array]]:
    """Judge candidates in parts: pairs of (candidate, number of its first picture) and shares, as they finish."""
    parts = {
        (j, first): (r_A[first : first + PART], C_CA[first : first + PART])
        for j, (r_A, C_CA) in jobs.items()
        for first in range(0, max(len(r_A), 1), PART)
    }
    if callable(workers):
        yield from workers(parts.items(), _judge, setup=_opened, arguments=(region, imaging_model))
        return
    workers = min(workers or usable_cores(), len(parts))
    if workers > 1 and sum(len(r_A) for r_A, _ in jobs.values()) >= MIN_PARALLEL:
        yield from run_jobs(parts.items(), _judge, workers=workers, setup=_opened, arguments=(region, imaging_model))
    elif parts:
        with closing(imaging_model.open(region)) as observer:
            for key, part in parts.items():
                interruption.check()
                yield key, _judge((observer, imaging_model.whole), *part)


def _opened(region: TargetRegion, imaging_model: ImagingModel) -> tuple[Observer, bool]:
    """An observer of the region, and whether only whole cells count."""
    return imaging_model.open(region), imaging_model.whole


def _judge(judge: tuple[Observer, bool], r_A: Array, C_CA: Array) -> Array:
    observer, whole = judge
    shares = np.empty((len(r_A), observer.region.n_cells))
    for k in range(len(r_A)):
        shares[k] = visible_share(observer, r_A[k], C_CA[k], whole=whole)
    return shares


def _key(region: TargetRegion, imaging_model: ImagingModel) -> str:
    with closing(imaging_model.open(region)) as observer:
        name = observer.name
    camera = imaging_model.camera
    text = f"{CACHE_VERSION} {name} {imaging_model.occlusion} {camera.half_angle_deg!r} {camera.shape} {camera.resolution_px}"
    if min(camera.sides) != 1.0:
        text += f" {camera.sides}"
    if imaging_model.whole:
        text += " whole"
    return hash_of(text, region.vertices, region.faces, region.target, region.parent)


class Watcher(NamedTuple):
    """A candidate: its flight's number among flights, from 0."""

    flights: CandidateFlights
    number: int

    @property
    def pictures(self) -> Indices:
        """The times of the qualifying images, by number."""
        return picture_numbers(self.flights, self.number, self._counts)

    @property
    def poses(self) -> Poses:
        """Of these pictures."""
        return poses_of(self.flights, self.number, self._counts)

    @property
    def _counts(self) -> Mask:
        return self.flights.counts & self.flights.settled[:, self.number]


class Judge:
    """Judges candidates on one target; close it after use.

    Args:
        region: The target.
        imaging_model: How pictures are judged.
        criterion: What counts in them.
        workers: See `shares_as_they_come`.
    """

    def __init__(
        self,
        region: TargetRegion,
        imaging_model: ImagingModel,
        criterion: Observation,
        workers: int | Runner | None,
    ) -> None:
        self.region, self.imaging_model, self.criterion, self.workers = region, imaging_model, criterion, workers
        self.observer = imaging_model.open(region)
        self._looks: LooksTaken | None = None
        self._limits = limits_of(criterion, self.observer.camera, region)
        self._reach, self._cells = reach_of(self.observer, criterion), cells_of(region)
        self._lit: dict[tuple[int, int], Mask] = {}
        self._screens: dict[int, Screen | None] = {}
        self._all_lit = np.ones((1, region.n_cells), np.bool_)
        #: Why each cell is seen by none of those judged so far, in the picture that came nearest to it.
        self.why = np.full(region.n_cells, Cause.NO_PICTURE, np.int8)

    def keep_looks(self, scenario: Scenario, quality_class: QualityClass) -> None:
        """Keep from now on the looks of pictures for a quality class; their takers are the watchers' numbers."""
        self._looks = LooksTaken(scenario, self.observer, (quality_class,))

    @property
    def looks(self) -> Looks | None:
        """The looks that were kept, by cell; None where none are."""
        return None if self._looks is None else self._looks.gathered

    def _keep(self, watcher: Watcher, taker: int, k: int, cells: Ints) -> None:
        if self._looks is None:
            return
        flights, j, environment = watcher.flights, watcher.number, watcher.flights.plan.environment
        t, r_A = float(flights.times[k]), flights.r_A[k, j]
        sun_A = environment.C_AN(t) @ environment.sun.at(t)
        motion = CameraMotion(flights.v_A[k, j], flights.omega_C[k, j])
        gsd_m = ground_sampling_distance(self._limits, *sight(self.region, r_A, cells))
        self._looks.add(Picture(t, taker, r_A, flights.C_CA[k, j], sun_A, motion), cells, gsd_m)

    def seen(self, watchers: Sequence[Watcher], *, progress: Progress | None = None) -> Iterator[tuple[int, Mask]]:
        """Whether each sees each cell, of one watcher after the other as they are done: its number and shape (cells,).

        The number of watchers done, parts of one included, is told to `progress`.
        """
        shares = shares_as_they_come(
            [watcher.poses for watcher in watchers],
            self.region,
            self.imaging_model,
            workers=self.workers,
            progress=progress,
        )
        with closing(shares):
            for j, share in shares:
                watcher = watchers[j]
                seen = np.zeros(self.region.n_cells, dtype=np.bool_)
                for row, k in enumerate(watcher.pictures):
                    shade = self._shade_at(watcher.flights, int(k))
                    cause = judge(
                        self.observer,
                        self.criterion,
                        CameraPose(watcher.flights.r_A[k, watcher.number], watcher.flights.C_CA[k, watcher.number]),
                        partial(self._light, watcher.flights, int(k)),
                        partial(self._share, share[row], watcher.flights.r_A[k, watcher.number], shade),
                        partial(self._motion_blur, watcher, int(k)),
                        shade,
                    )
                    seen |= cause == Cause.NONE
                    self._keep(watcher, j, int(k), np.flatnonzero(cause == Cause.NONE))
                    np.maximum(self.why, cause, out=self.why)
                yield j, seen

    def could_see(self, watcher: Watcher) -> Mask:
        """The cells that a watcher could see if the body hid nothing, and perhaps a few more, shape (cells,)."""
        interruption.check()
        light = self._all_lit
        if self.criterion.needs_sun and len(watcher.pictures):
            light = np.stack([self._light(watcher.flights, int(k)) for k in watcher.pictures])
        return np.asarray(in_reach(self._cells, self._reach, *watcher.poses, light))

    def _light(self, flights: CandidateFlights, k: int) -> Mask:
        """Which cells are lit at one of the flights' times, worked out once for all candidates."""
        key = id(flights), k
        if key not in self._lit:
            environment, t = flights.plan.environment, float(flights.times[k])
            sun_A = environment.C_AN(t) @ environment.sun.at(t)
            self._lit[key] = lit_cells(self.observer, self.criterion, sun_A, self._shade_at(flights, k))
        return self._lit[key]

    def _shade_at(self, flights: CandidateFlights, k: int) -> Shade | None:
        """The companion at one of the flights' times; None: there is none."""
        if id(flights) not in self._screens:
            self._screens[id(flights)] = screen_of(flights.plan.environment)
        screen = self._screens[id(flights)]
        return None if screen is None else screen.at(float(flights.times[k]))

    def _share(self, share: Array, r_A: Array, shade: Shade | None) -> Array:
        return screened(share, self.observer, r_A, shade, whole=self.imaging_model.whole)

    def _motion_blur(self, watcher: Watcher, k: int) -> Array:
        """Motion blur of every cell in a picture of a candidate, which turns as it is commanded [px]."""
        flights, j = watcher.flights, watcher.number
        motion = CameraMotion(flights.v_A[k, j], flights.omega_C[k, j])
        return motion_blur_px(self.region, self.observer.camera, flights.r_A[k, j], flights.C_CA[k, j], motion)

    def close(self) -> None:
        """Release what the observer holds."""
        self.observer.close()
