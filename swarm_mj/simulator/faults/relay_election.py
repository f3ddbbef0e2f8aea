"""Who takes over when the spacecraft that relays to Earth is lost.

The rule needs nothing from the behaviour that named the relay, and so holds for every configuration and plug-in: whoever
should track the lost one tracks its successor; the successor, where it should track the lost one, tracks Earth instead. In
Configuration 1 an observer so becomes what an elected spacecraft of Configuration 2 is: it observes inside the imaging
region and relays outside.
"""

from __future__ import annotations

import numpy as np

from swarm_mj.mission.behaviors import ELECTIONS, TargetKind, Targets
from swarm_mj.typing import Array, Mask


class Succession:
    """Remembers who stands in for whom during one flight.

    Args:
        election: Rule of the election among those that are left, see `AdaptableRoles`.
    """

    def __init__(self, election: str = "medoid") -> None:
        self._elect = ELECTIONS[election]
        self._successor: dict[int, int] = {}

    def reset(self) -> None:
        """Forget all elections."""
        self._successor.clear()

    def redirect(self, targets: Targets, r_BN_N: Array, lost: Mask) -> tuple[Targets, list[tuple[int, int]]]:
        """Targets without lost spacecraft, as far as anybody is left.

        Args:
            targets: As the behaviour named them; left as they are.
            r_BN_N: Positions, shape (n, 3) [m].
            lost: Which spacecraft the swarm knows to be lost, shape (n,).

        Returns:
            The targets, and elections held just now: the lost one and its successor.
        """
        vain = (targets.kind == TargetKind.SPACECRAFT) & ~lost & lost[targets.spacecraft]
        if not vain.any():
            return targets, []
        kind, index, elected = targets.kind.copy(), targets.spacecraft.copy(), []
        for j in np.flatnonzero(vain):
            relay = int(index[j])
            successor = self._successor.get(relay)
            if successor is None or lost[successor]:
                successor = self._successor[relay] = self._vote(r_BN_N, lost)
                elected.append((relay, successor))
            if successor == j:
                kind[j], index[j] = TargetKind.EARTH, 0
            else:
                index[j] = successor
        return Targets(kind, index, targets.vector), elected

    def _vote(self, r_BN_N: Array, lost: Mask) -> int:
        left = np.flatnonzero(~lost)
        return int(left[self._elect(r_BN_N[left])])


def relay_of(targets: Targets, lost: Mask) -> int | None:
    """The spacecraft that relays to Earth now: one that tracks Earth, or one that others track; None: there is none.

    Args:
        targets: Of all spacecraft.
        lost: Those that do not count, shape (n,).
    """
    earthward = np.flatnonzero((targets.kind == TargetKind.EARTH) & ~lost)
    if len(earthward):
        return int(earthward[0])
    tracked = targets.spacecraft[(targets.kind == TargetKind.SPACECRAFT) & ~lost]
    heard = tracked[~lost[tracked]]
    return int(heard[0]) if len(heard) else None
