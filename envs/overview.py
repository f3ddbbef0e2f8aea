"""The picture of an episode, for the single and the multi-agent environment alike."""

from __future__ import annotations

from typing import Any

import numpy as np

from swarm_mj.mission.behaviors import TargetKind
from swarm_mj.observation.capture import watching
from swarm_mj.typing import Pixels

from .batch import Flybys
from .state import state_of


class EpisodePicture:
    """Draws flight 0 of some flybys; holds one OpenGL context from the first picture until closed.

    Args:
        flybys: The flights.
        width: Of the picture [px].
        height: Of the picture [px].
    """

    def __init__(self, flybys: Flybys, width: int, height: int) -> None:
        self._flybys, self._size = flybys, (width, height)
        self._overview: Any = None

    def draw(self) -> Pixels:
        """The overview, shape (height, width, 3); the flights are only read.

        Raises:
            ObserverError: OpenGL cannot be loaded.
        """
        setting, flights = self._flybys.setting, self._flybys.flights
        if self._overview is None:
            from .rendering import Overview

            self._overview = Overview(setting.plan, setting.simulation, *self._size)
        kind, lost = flights.kind[0], self._flybys.books.lost[0]
        imaging = watching(setting.plan.n_observers, kind, ~(lost | flights.blind[0]))
        talking = np.isin(kind, (TargetKind.SPACECRAFT, TargetKind.EARTH)) & ~lost
        picture: Pixels = self._overview.draw(
            setting.simulation,
            state_of(self._flybys, 0),
            imaging,
            talking,
            kind=kind.copy(),
            tracked=flights.index[0].copy(),
            seen=self._flybys.books.seen[0],
            lost=lost.copy(),
        )
        return picture

    def close(self) -> None:
        """Release the OpenGL context; may be called again."""
        if self._overview is not None:
            self._overview.close()
        self._overview = None
