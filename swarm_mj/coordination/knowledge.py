"""What each spacecraft knows of the others, and nothing else: whom it has heard of when, what they have seen, who relays.

Row i of every array is what spacecraft i knows. Rows change by what i sees itself and by messages that arrive, never by what is
true elsewhere. A message carries the sender's whole row: news travels through others, and a lost message costs time only.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from swarm_mj.coordination.allocation.auction import STAMP_BITS, Claims
from swarm_mj.typing import Array, Ints, Mask

#: Of the head of a message: number of the sender, length, check sum [bit].
HEAD_BITS = 64


class Report(NamedTuple):
    """A message: all that its sender knows."""

    heard_s: Array  #: when what it knows of each was true [s], shape (n,)
    held: Mask  #: what it knows each to hold pictures of, shape (n, cells)
    stands: Mask  #: who, as far as it knows, speaks to Earth, shape (n,)
    claims: Claims | None  #: what it thinks of the auction; None where none is held


class Knowledge:
    """What n spacecraft know during one flight.

    Args:
        n: Spacecraft.
        cells: Of the target.
        silence_s: After which one that is not heard of counts as lost [s].

    Attributes:
        heard_s: When what i knows of j was true [s], shape (n, n).
        held: Whether i knows that j holds a picture of a cell, shape (n, n, cells).
        stands: Whether i knows that j speaks to Earth, shape (n, n).
    """

    def __init__(self, n: int, cells: int, silence_s: float) -> None:
        self.silence_s = silence_s
        self.heard_s = np.zeros((n, n))
        self.held = np.zeros((n, n, cells), np.bool_)
        self.stands = np.zeros((n, n), np.bool_)

    def alive(self, i: int, t: float) -> Mask:
        """Whom i does not take for lost at a time [s], itself among them, shape (n,)."""
        living: Mask = t - self.heard_s[i] <= self.silence_s + 1e-9
        living[i] = True
        return living

    def seen(self, i: int, t: float) -> Mask:
        """Cells of which, as far as i knows, somebody who is not lost holds a picture, shape (cells,)."""
        return np.asarray(self.held[i, self.alive(i, t)].any(axis=0))

    def report(self, i: int, t: float, claims: Claims | None) -> tuple[Report, int]:
        """What i says, and how long that is [bit]."""
        self.heard_s[i, i] = t
        n, cells = self.held.shape[1:]
        bits = HEAD_BITS + n * (STAMP_BITS + cells + 1)
        return Report(self.heard_s[i].copy(), self.held[i].copy(), self.stands[i].copy(), claims), bits

    def hear(self, i: int, report: Report) -> None:
        """A message has reached i: what is newer counts, what has been seen stays seen."""
        newer = report.heard_s > self.heard_s[i]
        newer[i] = False
        self.stands[i, newer] = report.stands[newer]
        self.heard_s[i, newer] = report.heard_s[newer]
        self.held[i] |= report.held

    def elect(self, i: int, t: float, order: Ints) -> int:
        """Whom i takes for the relay now: of those alive one that stands before one that does not, then the first in order.

        Where it is i itself, it stands from now on; where it is not, it steps down.

        Args:
            i: Who elects.
            t: Now [s].
            order: Place of each in the succession that all know beforehand, shape (n,).
        """
        living = np.flatnonzero(self.alive(i, t))
        leader = int(living[np.lexsort((order[living], ~self.stands[i, living]))[0]])
        self.stands[i, i] = leader == i
        return leader
