"""What the episodes have come to so far: cells seen, data aboard and delivered, spacecraft lost."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from swarm_mj.compilation import allocation_free, jittable
from swarm_mj.typing import Array, Ints, Mask


class EpisodeTotals(NamedTuple):
    """Totals of E episodes of n spacecraft over targets of up to C cells.

    Attributes:
        target: Cells that can count: those in the light of the flight, shape (E, C).
        seen: Of these, the ones that the swarm has seen, shape (E, C).
        first_by: By whom, -1 for nobody, shape (E, C).
        area: Seen, shape (E,) [m^2].
        stored: Aboard each spacecraft, shape (E, n) [bit].
        seen_bit: Brought by pictures, whatever became of it, shape (E,) [bit].
        lost_bit: Of that, what found no room aboard and is gone, shape (E,) [bit].
        delivered: Received by Earth from each spacecraft, shape (E, n) [bit].
        closed: Whose link was closed at the end of the last step, shape (E, n).
        lost: Spacecraft that are no more, shape (E, n).
    """

    target: Mask
    seen: Mask
    first_by: Ints
    area: Array
    stored: Array
    seen_bit: Array
    lost_bit: Array
    delivered: Array
    closed: Mask
    lost: Mask


def no_totals(count: int, n: int, cells: int) -> EpisodeTotals:
    """Of that many episodes, spacecraft and cells, before anything has happened."""
    return EpisodeTotals(
        target=np.zeros((count, cells), np.bool_),
        seen=np.zeros((count, cells), np.bool_),
        first_by=np.full((count, cells), -1, np.int64),
        area=np.zeros(count),
        stored=np.zeros((count, n)),
        seen_bit=np.zeros(count),
        lost_bit=np.zeros(count),
        delivered=np.zeros((count, n)),
        closed=np.zeros((count, n), np.bool_),
        lost=np.zeros((count, n), np.bool_),
    )


def reset_totals(totals: EpisodeTotals, e: int) -> None:
    """Forget what episode e had come to."""
    for values in totals:
        values[e] = 0
    totals.first_by[e] = -1


def with_room_for(totals: EpisodeTotals, cells: int) -> EpisodeTotals:
    """The same with room for targets of so many cells."""
    missing = cells - totals.seen.shape[1]
    if missing <= 0:
        return totals
    wider = no_totals(len(totals.area), totals.lost.shape[1], cells)
    for name in ("target", "seen", "first_by"):
        getattr(wider, name)[:, :-missing] = getattr(totals, name)
    return totals._replace(target=wider.target, seen=wider.seen, first_by=wider.first_by)


@jittable
def free_storage(totals: EpisodeTotals, e: int, j: int, storage_bit: float) -> float:
    """What spacecraft j of episode e can still hold of `storage_bit` [bit]."""
    return max(0.0, storage_bit - totals.stored[e, j])


@allocation_free
def record_cells(
    totals: EpisodeTotals, e: int, j: int, new: Mask, area: float, bits: float, storage_bit: float
) -> None:
    """Enter what a picture of spacecraft j of episode e has brought: cells that are new, shape (C,), their area [m^2] and data.

    Whole bits count [bit]; what is beyond `storage_bit`, the most that the spacecraft holds, is gone.
    """
    for i in range(new.shape[0]):
        if new[i]:
            totals.seen[e, i] = True
            totals.first_by[e, i] = j
    totals.area[e] += area
    bits = np.floor(bits)
    kept = min(bits, free_storage(totals, e, j, storage_bit))
    totals.stored[e, j] += kept
    totals.seen_bit[e] += bits
    totals.lost_bit[e] += bits - kept
