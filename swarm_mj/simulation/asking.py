"""Asks a behaviour for targets, and not again before its answer may have changed."""

from __future__ import annotations

from typing import Any

from swarm_mj.mission.behaviors import Behavior, SteadyBehavior, SwarmView, Targets

#: Most control periods for which a behaviour is not asked.
LONGEST_REST = 1_000_000


class Asking:
    """One flight's behaviour, its memory and the tick at which it must be asked again.

    Args:
        behavior: Who points at what.
        period: Time between two decisions [s].

    Attributes:
        behavior: The behaviour.
        due: Tick from which on the last answer is not known to hold.
    """

    def __init__(self, behavior: Behavior, period: float) -> None:
        self.behavior, self._period = behavior, period
        self._steady = behavior if isinstance(behavior, SteadyBehavior) else None
        self.reset()

    def reset(self) -> None:
        """Forget everything: a new flight begins."""
        self._memory: Any = None
        self.due = 0

    def ask(self, view: SwarmView, tick: int) -> Targets:
        """Targets at the instant of a view."""
        targets, self._memory = self.behavior.targets(view, self._memory)
        rest = 0.0 if self._steady is None else self._steady.steady_for(view, self._memory) / self._period
        self.due = tick + max(1, int(min(rest, LONGEST_REST)))
        return targets
