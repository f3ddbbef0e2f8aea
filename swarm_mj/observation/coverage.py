"""What a swarm has observed so far, the observed share of the target, P_TO, and why ground is not observed.

AAS 19-144, equations 1 and 2: F_TO is the union over the swarm of the target faces each spacecraft observed, and
P_TO = 100 A(F_TO) / A(F_T).

Of each cell that several pictures show, `KeptPictures` has the one by which it is kept: what is told of the cell, its ground
sampling distance and light, holds for that picture, and the data of that picture are sent.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swarm_mj.dataflow.tiles import grade
from swarm_mj.errors import MissionError
from swarm_mj.typing import Array, Indices, Ints, Mask


class Cause(IntEnum):
    """Why a cell does not count in a picture: the first condition that it does not fulfil, in this order, or none.

    Hidden is what the body stands before, or its companion; dark is what the Sun does not reach, in the companion's shadow too.
    Two are told of a whole flight alone: that a camera was off, and that a cell was lit at no picture time that counts, so that
    no picture could show it.
    """

    NO_PICTURE = 0
    OUT_OF_VIEW = 1
    FACES_AWAY = 2
    OBLIQUE = 3
    COARSE = 4
    BLURRED = 5
    HIDDEN = 6
    DARK = 7
    CAMERA_OFF = 8
    NEVER_LIT = 9
    NONE = 10


#: In words of a table.
WORDS = {
    Cause.NO_PICTURE: "no picture taken",
    Cause.OUT_OF_VIEW: "out of view",
    Cause.FACES_AWAY: "faces away",
    Cause.OBLIQUE: "too oblique",
    Cause.COARSE: "too coarse",
    Cause.BLURRED: "blurred",
    Cause.HIDDEN: "hidden",
    Cause.DARK: "dark",
    Cause.CAMERA_OFF: "camera off",
    Cause.NEVER_LIT: "never lit",
}


def shares(area: Array, why: NDArray[np.int8]) -> dict[Cause, float]:
    """Shares of the target that are not observed [%] by cause, the largest first; of cells' `area` [m^2] and `Cause`, (n,)."""
    share = 100.0 / area.sum() * np.bincount(why, area, len(Cause))
    found = sorted((cause for cause in WORDS if share[cause] > 0.0), key=lambda cause: -share[cause])
    return {cause: float(share[cause]) for cause in found}


ROUND_OFF = 1e-6  # [0.01 %] error of a sum of areas, which is no unseen ground


def percent_text(percent: float) -> str:
    """A share of the target [%] in words: only what was all observed reads 100.00 %."""
    return f"{percent_digits(percent)} %"


def percent_digits(percent: float) -> str:
    """A share of the target [%] as `rounded_down`."""
    return f"{rounded_down(percent):.2f}"


def rounded_up_digits(percent: float) -> str:
    """A bound, or a share of the target that is missing [%], rounded up: with the rest as it is written it is all."""
    return f"{100.0 - rounded_down(100.0 - percent):.2f}"


def rounded_down(percent: ArrayLike) -> Array:
    """Shares of the target [%] to hundredths, as they are written."""
    return np.asarray(np.floor(100.0 * np.asarray(percent) + ROUND_OFF) / 100.0)


@dataclass(eq=False)
class CoverageMap:
    """What a swarm has observed so far.

    Attributes:
        area: Area of each cell [m^2], shape (n,).
        n_spacecraft: Number of spacecraft.
        first_seen_by_s: First time [s] at which each spacecraft observed each cell, NaN for never, shape (N, n).
    """

    area: Array
    n_spacecraft: int
    first_seen_by_s: Array = field(init=False)

    def __post_init__(self) -> None:
        """Start with nothing observed."""
        self.first_seen_by_s = np.full((self.n_spacecraft, len(self.area)), np.nan)

    def add(self, t: float, spacecraft: int, seen: Mask) -> None:
        """Add the picture of a spacecraft, from 0, and the cells observed in it, shape (n,), in any order of time [s].

        Raises:
            MissionError: The spacecraft or the number of cells does not fit.
        """
        if not 0 <= spacecraft < self.n_spacecraft:
            raise MissionError(f"spacecraft {spacecraft} is not one of the {self.n_spacecraft}, counted from 0")
        if np.shape(seen) != self.area.shape:
            raise MissionError(f"picture of {np.shape(seen)} cells does not fit a target of {len(self.area)}")
        row = self.first_seen_by_s[spacecraft]
        row[seen] = np.fmin(row[seen], t)

    @property
    def seen_by(self) -> Mask:
        """Cells that each spacecraft observed, shape (N, n)."""
        return ~np.isnan(self.first_seen_by_s)

    @property
    def seen(self) -> Mask:
        """Cells that the swarm observed, F_TO, shape (n,)."""
        return np.asarray(np.any(self.seen_by, axis=0))

    @property
    def first_seen_s(self) -> Array:
        """Time [s] at which each cell was first observed, NaN for never, shape (n,)."""
        return np.fmin.reduce(self.first_seen_by_s, axis=0, initial=np.nan)

    @property
    def percent(self) -> float:
        """P_TO [%]."""
        return self._percent(self.seen)

    def percent_of(self, cells: Indices, area: Array) -> float:
        """Observed share of some cells, by number, of the areas of these cells [%]."""
        return 100.0 * float(area[self.seen[cells]].sum() / area.sum())

    @property
    def percent_by_spacecraft(self) -> Array:
        """Share of the target that each spacecraft observed [%], shape (N,)."""
        return np.array([self._percent(seen) for seen in self.seen_by])

    def percent_over_time(self, times: ArrayLike) -> Array:
        """P_TO [%] at given times [s], pictures taken at that very time included; same shape as `times`."""
        seen = self.seen
        order = np.argsort(self.first_seen_s[seen])
        total = np.concatenate([[0.0], np.cumsum(self.area[seen][order])])
        total[-1] = self.area[seen].sum()  # the same rounding as in `percent`
        count = np.searchsorted(self.first_seen_s[seen][order], np.asarray(times, dtype=np.float64), side="right")
        return 100.0 * (total[count] / self.area.sum())

    def _percent(self, seen: Mask) -> float:
        return 100.0 * float(self.area[seen].sum() / self.area.sum())


class Shown(NamedTuple):
    """Cells that count in a picture.

    Attributes:
        t: Time of the picture [s].
        spacecraft: Who took it, from 0.
        cells: Their numbers.
    """

    t: float
    spacecraft: int
    cells: Ints


@dataclass(eq=False)
class KeptPictures:
    """The picture by which each spacecraft keeps each cell.

    `best`: the one of the finest grade of ground sampling distance; of several the nearest to the arrival, which is the best of
    most other cells too, so that few pictures are sent. `first`: the first that counts. `all`: as `best`, and the others are
    sent beside it.

    Attributes:
        n_cells: Number of cells.
        n_spacecraft: Number of spacecraft.
        rule: One of the three.
        taken_s: When each spacecraft took the picture by which it keeps each cell [s], NaN where it has none, shape (N, n).
        gsd_m: Ground sampling distance in it [m], likewise.
        incidence_deg: Angle between the cell's normal and the Sun then [deg], likewise.
        every: All pictures with what counts in them, by `all` alone.
    """

    n_cells: int
    n_spacecraft: int
    rule: Literal["best", "first", "all"] = "best"
    taken_s: Array = field(init=False)
    gsd_m: Array = field(init=False)
    incidence_deg: Array = field(init=False)
    every: list[Shown] = field(init=False, default_factory=list)

    def __post_init__(self) -> None:
        """Start with none."""
        self.taken_s, self.gsd_m, self.incidence_deg = np.full((3, self.n_spacecraft, self.n_cells), np.nan)

    def add(self, shown: Shown, gsd_m: Array, incidence_deg: Array, arrival_s: float) -> None:
        """Add a picture, in order of time.

        Args:
            shown: What counts in it.
            gsd_m: At these cells [m].
            incidence_deg: Of the Sun on them [deg].
            arrival_s: When its spacecraft is at its visiting point [s].
        """
        j, cells = shown.spacecraft, shown.cells
        better = np.isnan(self.taken_s[j, cells])
        if self.rule != "first":
            held, new = grade(self.gsd_m[j, cells]), grade(gsd_m)
            nearer = abs(shown.t - arrival_s) < np.abs(self.taken_s[j, cells] - arrival_s)
            better |= (new < held) | ((new == held) & nearer)
        if self.rule == "all" and len(cells):
            self.every.append(shown)
        chosen = cells[better]
        self.taken_s[j, chosen] = shown.t
        self.gsd_m[j, chosen], self.incidence_deg[j, chosen] = gsd_m[better], incidence_deg[better]

    def pictures(self) -> list[Shown]:
        """The pictures that are sent, with the cells that are sent of each, in order of spacecraft and time."""
        if self.rule == "all":
            return sorted(self.every, key=lambda shown: (shown.spacecraft, shown.t))
        return [
            Shown(float(t), j, np.flatnonzero(row == t))
            for j, row in enumerate(self.taken_s)
            for t in np.unique(row[~np.isnan(row)])
        ]

    def by_best(self, values: Array) -> Array:
        """Of values of each copy, shape (N, n), those of the finest ground sampling distance in the swarm, shape (n,)."""
        nobody = np.isnan(self.gsd_m).all(axis=0)
        finest = np.where(np.isnan(self.gsd_m), np.inf, self.gsd_m).argmin(axis=0)
        return np.where(nobody, np.nan, values[finest, np.arange(self.n_cells)])
