"""Who looks where and who speaks to Earth at an instant, from the pictures that each still has to take."""

from __future__ import annotations

from bisect import bisect_left

import numpy as np

from swarm_mj.mission.behaviors import TargetKind, Targets
from swarm_mj.typing import Array, Ints

#: Pictures still to be taken, in order of time: pairs (slot, aim).
Pictures = tuple[tuple[int, int], ...]
#: Of a spacecraft that knows no relay.
NOBODY = -1


def next_picture(pictures: Pictures, slot: int) -> tuple[int, int] | None:
    """The first picture in a slot or later; None where none is left."""
    n = bisect_left(pictures, (slot,))
    return pictures[n] if n < len(pictures) else None


def targets_for(pictures: tuple[Pictures, ...], slot: int, relay: Ints, aims_A: Array) -> Targets:
    """One line of sight per spacecraft: at the next picture's aim; without one at Earth, or at the relay.

    Args:
        pictures: Of each spacecraft, as it knows them itself.
        slot: The next one.
        relay: Whom each takes for the relay, itself to speak to Earth, or `NOBODY`, which has it look at the body, shape (n,).
        aims_A: Shape (m, 3) [m].
    """
    n = len(pictures)
    kind, spacecraft, vector = np.zeros(n, np.int64), np.zeros(n, np.int64), np.zeros((n, 3))
    for j in range(n):
        coming = next_picture(pictures[j], slot)
        if coming is not None:
            kind[j], vector[j] = TargetKind.SURFACE, aims_A[coming[1]]
        elif relay[j] == j:
            kind[j] = TargetKind.EARTH
        elif relay[j] == NOBODY:
            kind[j] = TargetKind.ASTEROID
        else:
            kind[j], spacecraft[j] = TargetKind.SPACECRAFT, relay[j]
    return Targets(kind, spacecraft, vector)
