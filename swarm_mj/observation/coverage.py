"""What a swarm has observed so far, and the observed share of the target, P_TO.

AAS 19-144, equations 1 and 2: F_TO is the union over the swarm of the target faces each spacecraft observed, and
P_TO = 100 A(F_TO) / A(F_T).
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from swarm_mj.errors import MissionError
from swarm_mj.typing import Array, Indices, Mask


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
        """Add one picture, in any order of time.

        Args:
            t: Time of the picture [s].
            spacecraft: Who took it, from 0.
            seen: Cells observed in it, shape (n,).

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

    def percent_of(self, cells: Indices) -> float:
        """Observed share of the area of some cells, by number [%]."""
        return 100.0 * float(self.area[cells][self.seen[cells]].sum() / self.area[cells].sum())

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
