"""Candidates judged by the criterion on a target: what each sees, and beforehand what it could see at most."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import closing
from functools import partial
from typing import NamedTuple, Self

import numpy as np

from swarm_mj.designer.candidates.flights import CandidateFlights
from swarm_mj.designer.candidates.pictures import (
    ImagingModel,
    Poses,
    Progress,
    picture_numbers,
    poses_of,
    shares_as_they_come,
)
from swarm_mj.mission.target import TargetRegion
from swarm_mj.observation.capture import ObservationCriterion, cells_that_count, lit_cells
from swarm_mj.observation.reach import cells_of, in_reach, reach_of
from swarm_mj.observation.smear import CameraMotion, smear_px
from swarm_mj.typing import Array, Indices, Mask


class Watcher(NamedTuple):
    """A candidate: its flight's number among flights, from 0."""

    flights: CandidateFlights
    number: int

    @property
    def pictures(self) -> Indices:
        """The times of the pictures that count, by number."""
        return picture_numbers(self.flights, self.number, self.flights.counts)

    @property
    def poses(self) -> Poses:
        """Of these pictures."""
        return poses_of(self.flights, self.number, self.flights.counts)


class Judge:
    """Judges candidates on one target; close it after use.

    Args:
        region: The target.
        imaging_model: How pictures are judged.
        criterion: What counts in them.
        workers: Processes; default: one per core.
    """

    def __init__(
        self,
        region: TargetRegion,
        imaging_model: ImagingModel,
        criterion: ObservationCriterion,
        workers: int | None = None,
    ) -> None:
        self.region, self.imaging_model, self.criterion, self.workers = region, imaging_model, criterion, workers
        self._observer = imaging_model.open(region)
        self._reach, self._cells = reach_of(self._observer, criterion), cells_of(region)
        self._lit: dict[tuple[int, int], Mask] = {}
        self._all_lit = np.ones((1, region.n_cells), dtype=np.bool_)

    def seen(self, watchers: Sequence[Watcher], *, progress: Progress | None = None) -> Iterator[tuple[int, Mask]]:
        """Whether each sees each cell, of one watcher after the other as they are done: its number and shape (cells,).

        Args:
            watchers: Who.
            progress: Called with the number of watchers done, parts of one included.
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
                    seen |= cells_that_count(
                        self._observer,
                        self.criterion,
                        watcher.flights.r_A[k, watcher.number],
                        partial(self._light, watcher.flights, int(k)),
                        partial(share.__getitem__, row),
                        partial(self._smear, watcher, int(k)),
                    )
                yield j, seen

    def could_see(self, watcher: Watcher) -> Mask:
        """The cells that a watcher could see if the body hid nothing, and perhaps a few more, shape (cells,)."""
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
            self._lit[key] = lit_cells(self._observer, self.criterion, sun_A)
        return self._lit[key]

    def _smear(self, watcher: Watcher, k: int) -> Array:
        """Smear of every cell in a picture of a candidate, which turns as it is commanded [px]."""
        flights, j = watcher.flights, watcher.number
        motion = CameraMotion(flights.v_A[k, j], flights.omega_C[k, j])
        return smear_px(self.region, self._observer.camera, flights.r_A[k, j], flights.C_CA[k, j], motion)

    def close(self) -> None:
        """Release what the observer holds."""
        self._observer.close()

    def __enter__(self) -> Self:
        """Use as a context manager."""
        return self

    def __exit__(self, *error: object) -> None:
        """Close."""
        self.close()
