"""Candidates that need not be judged, because others see all that they could see at most.

A candidate whose reach (`observation.reach`) lies within what `fold` others see, who are judged, kept and no dearer, is left
out. In a design that uses it either one of those is free and does as well, or all are taken and it was not needed. So neither
the fewest spacecraft nor the trade-off against their cost changes, however many are left out at once: who stands in for them
stays. It is step 4 of `exact.reduce_problem`, taken before the pictures instead of after.

Those that reach farthest are judged first, in waves that double, and only earlier waves stand in: who is left out depends
neither on the number of processes nor on what is kept on disk.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from swarm_mj.compilation import kernel
from swarm_mj.designer.bitset import Words, is_subset, pack
from swarm_mj.typing import Array, Indices, Mask

#: Candidates in the first wave.
FIRST_WAVE = 16


class Thinning:
    """Whom to judge, wave by wave, and who need not be.

    Args:
        reach: What each candidate could see at most, shape (n, cells).
        sees: What each sees, shape (n, cells); to be filled in for the candidates of a wave before the next is asked for.
        fold: How many must stand in for one.
        cost: What each costs: nobody dearer stands in, shape (n,); None: cost does not matter.

    Attributes:
        stand_in: For each candidate that is left out so far who sees at least as much, both from 0.
    """

    def __init__(self, reach: Mask, sees: Mask, *, fold: int = 1, cost: Array | None = None) -> None:
        self.stand_in: dict[int, int] = {}
        self._reach, self._sees, self._fold = reach, sees, fold
        self._cost = np.zeros(len(reach)) if cost is None else np.asarray(cost, dtype=np.float64)

    def waves(self) -> Iterator[Indices]:
        """The candidates to judge, from 0."""
        left = np.argsort(-self._reach.sum(axis=1), kind="stable")
        size, stand_ins = FIRST_WAVE, np.zeros(len(left), np.int64)
        while len(left):
            wave, left = left[:size], left[size:]
            yield wave
            first = np.full(len(left), -1, np.int64)
            stand_ins[left] += count_stand_ins(
                pack(self._reach[left]), self._cost[left], pack(self._sees[wave]), self._cost[wave], first
            )
            enough = stand_ins[left] >= self._fold
            self.stand_in |= dict(zip(left[enough].tolist(), wave[first[enough]].tolist(), strict=True))
            left, size = left[~enough], 2 * size


@kernel
def count_stand_ins(reach: Words, cost: Array, sees: Words, their_cost: Array, first: Indices) -> Indices:
    """How many see all that each could see and cost no more, shape (n,); `first` gets the first of them, -1: none.

    Args:
        reach: What could be seen, packed, shape (n, words).
        cost: Shape (n,).
        sees: What others see, packed, shape (m, words).
        their_cost: Shape (m,).
        first: Shape (n,).
    """
    found = np.zeros(len(reach), np.int64)
    for j in range(len(reach)):
        for i in range(len(sees)):
            if their_cost[i] <= cost[j] and is_subset(reach[j], sees[i]):
                found[j] += 1
                if first[j] < 0:
                    first[j] = i
    return found
