"""Asks behaviours for targets, and not again before their answers may have changed."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from swarm_mj.mission.behaviors import Behavior, SteadyBehavior, SwarmView, Targets
from swarm_mj.simulator.plugin_calls import ask_for_targets, ask_how_long
from swarm_mj.typing import Array

#: Most control periods for which a behaviour is not asked.
LONGEST_REST = 1_000_000


class Asking:
    """The behaviours of E flights, their memories and the ticks at which they must be asked again.

    Args:
        behaviors: Who points at what, one for each flight.
        period: Time between two decisions [s].

    Attributes:
        behaviors: The behaviours.
        due: Ticks from which on the last answers are not known to hold, shape (E,).
    """

    def __init__(self, behaviors: Sequence[Behavior], period: float) -> None:
        self.behaviors, self._period = list(behaviors), period
        self._steady = [each if isinstance(each, SteadyBehavior) else None for each in self.behaviors]
        self._memories: list[Any] = [None] * len(self.behaviors)
        self.due = np.zeros(len(self.behaviors), np.int64)

    def reset(self, e: int) -> None:
        """Forget everything about a flight: a new one begins."""
        self._memories[e], self.due[e] = None, 0

    def ask(self, e: int, view: SwarmView, tick: int) -> Targets:
        """Targets of a flight at the instant of a view.

        Raises:
            PluginError: The behaviour fails, or answers something else than its protocol says.
        """
        targets, memory = ask_for_targets(self.behaviors[e], view, self._memories[e])
        steady, self._memories[e] = self._steady[e], memory
        rest = 0.0 if steady is None else ask_how_long(steady, view, memory) / self._period
        self.due[e] = tick + max(1, int(min(rest, LONGEST_REST)))
        return targets


def view_of(t: float, C_AN: Array, q: Array, v: Array) -> SwarmView:
    """What a behaviour is shown of a state, see `SwarmModel.state`; copied, for it may be kept."""
    q, v = q.copy(), v.copy()
    return SwarmView(t, q[:, :3], v[:, :3], C_AN, q[:, 3:7], v[:, 3:6], v[:, 6:])
