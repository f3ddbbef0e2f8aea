"""What became of the data of a flight, as plain arrays: what was aboard, sent, lost and delivered, and why not all of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from swarm_mj.mission.links import Obstacle
from swarm_mj.typing import Array, Ints, Mask

#: In words of a table, what keeps data aboard.
REASONS = {
    Obstacle.LOST: "lost with its spacecraft",
    Obstacle.ROLE: "nobody speaks to Earth",
    Obstacle.POINTING: "no attitude control",
    Obstacle.RANGE: "range",
    Obstacle.BEAM: "beam",
    Obstacle.BODY: "the body in between",
    Obstacle.STATION: "no station on Earth in view",
}
STORAGE, TIME = "storage", "time"


class Undelivered(NamedTuple):
    """A part of the map that was seen and does not arrive."""

    reason: str  #: one of `REASONS`, `STORAGE` or `TIME`
    area: float  #: [m^2]
    holders: tuple[int, ...]  #: spacecraft that saw it, numbers from 0


@dataclass(frozen=True, eq=False, kw_only=True)
class Delivery:
    """What became of the data of a flight; n spacecraft, T slots, q tiles, see `swarm_mj.dataflow.tiles`."""

    edges_s: Array  #: edges of the slots past the epoch [s], shape (T + 1,)
    light_time_s: Array  #: of the way to Earth in each slot, shape (T,)
    contact_bit: NDArray[np.int64]  #: most that i could send to j, shape (T, n, n)
    earth_contact_bit: NDArray[np.int64]  #: most that Earth could hear of i, shape (T, n)
    station: NDArray[np.int64]  #: number of the station that hears i best, -1 for none, shape (T, n)
    why_swarm: NDArray[np.int8]  #: `Obstacle` of each link, shape (T, n, n)
    why_earth: NDArray[np.int8]  #: `Obstacle` of each way to Earth, shape (T, n)
    #: of each to the nearest spacecraft that turns to Earth, 0 for those themselves, NaN where nobody does, shape (T, n)
    relay_distance_m: Array
    sent_bit: NDArray[np.int64]  #: sent from i to j, shape (T, n, n)
    earth_bit: NDArray[np.int64]  #: received by Earth from i, shape (T, n)
    aboard_bit: NDArray[np.int64]  #: aboard at each edge, shape (T + 1, n)
    lost_bit: NDArray[np.int64]  #: lost so far at each edge, in overflows and with spacecraft, shape (T + 1, n)
    tile_of_cell: NDArray[np.int64]  #: shape (cells,), -1 for what nobody saw
    tile_area: Array  #: [m^2], shape (q,)
    tile_bit: NDArray[np.int64]  #: as each spacecraft saw it, 0 where it did not, shape (n, q)
    tile_lost_bit: NDArray[np.int64]  #: what of each copy was lost with a spacecraft, shape (n, q)
    tile_overflow_bit: NDArray[np.int64]  #: what of each copy found no room aboard, shape (n, q)
    tile_ready_s: Array  #: when it was seen, NaN for never, shape (n, q)
    #: when the last bit of the finest copy of it that arrives is on Earth [s], NaN for never, shape (q,)
    tile_arrives_s: Array
    tile_origin: NDArray[np.int64]  #: spacecraft whose copy of it that is, -1 for none, shape (q,)
    #: received by Earth in the schedule that is proven best, shape (T, n); this and the next three are NaN where no proof was
    #: asked for
    best_earth_bit: Array
    best_share: Array  #: of each tile that arrives in that schedule, shape (q,)
    #: when at the earliest a schedule of these slots has all that was seen on Earth [s], NaN where none has
    best_full_s: Array
    #: no schedule delivers more [m^2], whatever its slots, at the rates of the sampled instants
    best_bound_area: Array
    #: elections after which others spoke to Earth than before, the first at the end of the flight [s], shape (e,)
    election_s: Array
    elected: Mask  #: who did from then on, shape (e, n)

    @property
    def n_slots(self) -> int:
        """T."""
        return len(self.light_time_s)

    @property
    def n(self) -> int:
        """Number of spacecraft."""
        return len(self.tile_bit)

    @property
    def relay(self) -> Ints:
        """Who spoke to Earth after the flight at any time, numbers from 0."""
        return np.flatnonzero(self.elected.any(axis=0))

    @property
    def arrived(self) -> Mask:
        """Tiles that arrive, shape (q,)."""
        return ~np.isnan(self.tile_arrives_s)

    @property
    def seen_bit(self) -> int:
        """Data of all pictures that were taken in the window."""
        return int(self.tile_bit.sum())

    @property
    def delivered_bit(self) -> int:
        """Received by Earth."""
        return int(self.earth_bit.sum())

    @property
    def delivered_area(self) -> float:
        """Of the tiles that arrive [m^2]."""
        return float(self.tile_area[self.arrived].sum())

    @property
    def complete(self) -> bool:
        """Whether all that was seen arrives."""
        return bool(self.arrived.all())

    @property
    def full_s(self) -> float:
        """When the last tile arrives [s past the epoch]; NaN where one does not, or nothing was seen."""
        return float(self.tile_arrives_s.max()) if len(self.tile_area) else float("nan")

    def delivered_of(self, values: Array) -> Array:
        """Of each cell what holds for the copy that arrives, NaN where none does, shape (cells,).

        Args:
            values: Of each spacecraft's copy, shape (n, cells).
        """
        origin = np.append(self.tile_origin, -1)[self.tile_of_cell]
        return np.where(origin < 0, np.nan, values[origin, np.arange(values.shape[1])])

    @property
    def arrives_s(self) -> Array:
        """When each cell arrives on Earth [s], NaN for never, shape (cells,)."""
        return np.append(self.tile_arrives_s, np.nan)[self.tile_of_cell]

    def delivered_area_over_time(self, times_s: Array) -> Array:
        """Area that has arrived by given times [m^2]."""
        order = np.argsort(self.tile_arrives_s)[: int(self.arrived.sum())]
        total = np.concatenate(([0.0], np.cumsum(self.tile_area[order])))
        return total[np.searchsorted(self.tile_arrives_s[order], times_s, side="right")]

    def undelivered(self) -> list[Undelivered]:
        """What was seen and does not arrive, by reason, largest area first."""
        areas, holders = dict[str, float](), dict[str, set[int]]()
        for q, reason in self.reasons().items():
            areas[reason] = areas.get(reason, 0.0) + float(self.tile_area[q])
            holders.setdefault(reason, set()).update(np.flatnonzero(self.tile_bit[:, q] > 0).tolist())
        rows = [Undelivered(reason, area, tuple(sorted(holders[reason]))) for reason, area in areas.items()]
        return sorted(rows, key=lambda row: -row.area)

    def reasons(self) -> dict[int, str]:
        """Why tiles do not arrive: one of `REASONS`, `STORAGE` or `TIME` by the number of the tile."""
        reach = self._reaches_earth()
        return {
            int(q): self._reason(np.flatnonzero(self.tile_bit[:, q] > 0), int(q), reach)
            for q in np.flatnonzero(~self.arrived)
        }

    def _reaches_earth(self) -> Mask:
        """Whether data aboard i at the start of slot t can reach Earth at all, shape (T + 1, n)."""
        reach = np.zeros((self.n_slots + 1, self.n), np.bool_)
        for t in range(self.n_slots - 1, -1, -1):
            handed_on = ((self.contact_bit[t] > 0) & reach[t + 1]).any(axis=1)
            reach[t] = reach[t + 1] | (self.earth_contact_bit[t] > 0) | handed_on
        return reach

    def _reason(self, holders: Ints, q: int, reach: Mask) -> str:
        """Why a tile does not arrive, from the copy that comes nearest to it."""
        gone = self.tile_lost_bit[holders, q] + self.tile_overflow_bit[holders, q]
        if (gone > 0).all():
            return REASONS[Obstacle.LOST] if self.tile_lost_bit[holders, q].any() else STORAGE
        slots = np.searchsorted(self.edges_s[:-1], self.tile_ready_s[holders, q] - 1e-6)
        if reach[slots, holders].any():
            return TIME
        why = [self._obstacle(int(j), int(slot)) for j, slot in zip(holders, slots, strict=True)]
        return REASONS[Obstacle(max(why))]

    def _obstacle(self, j: int, slot: int) -> int:
        """What most often keeps spacecraft j from Earth from a slot on, or from those that reach it."""
        if slot >= self.n_slots:
            return int(Obstacle.ROLE)
        speakers = np.flatnonzero(self.earth_contact_bit[slot:].any(axis=0))
        if not len(speakers):
            codes = self.why_earth[slot:][self.why_earth[slot:] > Obstacle.ROLE]
            return int(np.bincount(codes).argmax()) if len(codes) else int(Obstacle.ROLE)
        codes = np.concatenate((self.why_swarm[slot:, j, speakers].ravel(), self.why_earth[slot:, j]))
        codes = codes[codes > Obstacle.NONE]
        turned = codes[codes > Obstacle.ROLE]
        codes = turned if len(turned) else codes
        return int(np.bincount(codes).argmax()) if len(codes) else int(Obstacle.ROLE)
