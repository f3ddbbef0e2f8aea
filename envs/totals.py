"""What the episodes have come to so far: cells seen, data aboard and delivered, spacecraft lost."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from swarm_mj.typing import Array, Mask, kernel


class EpisodeTotals(NamedTuple):
    """Totals of E episodes of n spacecraft over a target of C cells.

    Attributes:
        seen: Cells that the swarm has seen, shape (E, C).
        first_seen: When, NaN for never, shape (E, C) [s].
        area: Seen area, in the order in which it was seen, shape (E,) [m^2].
        percent: Seen share of the target, summed over the cells, whatever their order, shape (E,) [%].
        stored: Aboard each spacecraft, shape (E, n) [bit].
        delivered: Received by Earth, shape (E,) [bit].
        closed: Whose link was closed at the end of the last step, shape (E, n).
        lost: Spacecraft that are no more, shape (E, n).
    """

    seen: Mask
    first_seen: Array
    area: Array
    percent: Array
    stored: Array
    delivered: Array
    closed: Mask
    lost: Mask


def no_totals(count: int, n: int, cells: int) -> EpisodeTotals:
    """Of that many episodes, spacecraft and cells, before anything has happened."""
    return EpisodeTotals(
        seen=np.zeros((count, cells), np.bool_),
        first_seen=np.full((count, cells), np.nan),
        area=np.zeros(count),
        percent=np.zeros(count),
        stored=np.zeros((count, n)),
        delivered=np.zeros(count),
        closed=np.zeros((count, n), np.bool_),
        lost=np.zeros((count, n), np.bool_),
    )


def reset_totals(totals: EpisodeTotals, e: int) -> None:
    """Forget what episode e had come to."""
    for values in totals:
        values[e] = 0
    totals.first_seen[e] = np.nan


@kernel
def record_cells(totals: EpisodeTotals, e: int, j: int, new: Mask, t: float, area: float, bits: float) -> None:
    """Enter what a picture of spacecraft j has brought.

    Args:
        totals: Written to.
        e: Episode.
        j: Spacecraft.
        new: Cells seen for the first time, shape (C,).
        t: Time of the picture [s].
        area: Of those cells [m^2].
        bits: Their data [bit].
    """
    for i in range(new.shape[0]):
        if new[i]:
            totals.seen[e, i] = True
            totals.first_seen[e, i] = t
    totals.area[e] += area
    totals.stored[e, j] += bits
