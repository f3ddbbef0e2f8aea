"""The missions of an environment, made when they are first flown, and the batches in which their episodes fly."""

from __future__ import annotations

from threading import Lock
from typing import Any

from .catalogue import MissionSpec
from .flights import MissionFlights
from .mission import Mission, make_mission


class MissionPool:
    """Named missions, made lazily; a mission once made stays.

    Args:
        specs: Which.
        arguments: What `make_mission` takes besides.

    Attributes:
        names: Of the missions, in their order.
    """

    def __init__(self, specs: tuple[MissionSpec, ...], **arguments: Any) -> None:
        self._specs, self._arguments = specs, arguments
        self._made: dict[int, Mission] = {}
        self._lock = Lock()
        self.names = tuple(spec.name for spec in specs)

    def __len__(self) -> int:
        """Number of missions."""
        return len(self._specs)

    def __getitem__(self, k: int) -> Mission:
        """Mission k."""
        with self._lock:
            if k not in self._made:
                self._made[k] = make_mission(self._specs[k], **self._arguments)
            return self._made[k]

    def close(self) -> None:
        """Release the observers."""
        for mission in self._made.values():
            mission.task.close()


class Seats:
    """Places for episodes in batches of their missions, taken and given back; batches of a mission are made as needed.

    Args:
        pool: The missions.
        size: Episodes in a batch.
    """

    def __init__(self, pool: MissionPool, size: int) -> None:
        self._pool, self._size = pool, size
        self.batches: list[MissionFlights] = []
        self._free: dict[int, list[tuple[int, int]]] = {}

    def take(self, mission: int) -> tuple[int, int]:
        """A free place: number of the batch, and of the episode in it."""
        free = self._free.setdefault(mission, [])
        if not free:
            self.batches.append(MissionFlights(self._pool[mission], self._size))
            k = len(self.batches) - 1
            free.extend((k, e) for e in range(self._size))
        # The lowest one, so that few batches are busy.
        place = min(free)
        free.remove(place)
        return place

    def give_back(self, mission: int, place: tuple[int, int]) -> None:
        """Let another episode have the place."""
        self._free[mission].append(place)
