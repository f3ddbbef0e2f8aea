"""The picture of an episode: the overview of `swarm-mj video`, drawn from the state of a flight under way."""

from __future__ import annotations

import numpy as np

from swarm_mj.flight.plan import Plan
from swarm_mj.mission.behaviors import TargetKind
from swarm_mj.rendering.frame import Instant
from swarm_mj.rendering.live import Trail, planned_path
from swarm_mj.rendering.picture import Drawing
from swarm_mj.simulator.simulation import Simulation
from swarm_mj.typing import Ints, Mask, Pixels

from .state import SwarmState


class Overview:
    """Draws the swarm; holds one OpenGL context until closed.

    Args:
        plan: The mission.
        simulation: A flight of it; the state to draw comes with each picture.
        width: Of the picture [pixel].
        height: Of the picture [pixel].

    Raises:
        ObserverError: OpenGL cannot be loaded here.
    """

    def __init__(self, plan: Plan, simulation: Simulation, width: int, height: int) -> None:
        self._plan, self._trail = plan, Trail(plan)
        self._drawing = Drawing(plan, planned_path(plan), width=width, height=height)

    def draw(
        self,
        simulation: Simulation,
        state: SwarmState,
        observing: Mask,
        talking: Mask,
        *,
        kind: Ints | None = None,
        tracked: Ints | None = None,
        seen: Mask | None = None,
        lost: Mask | None = None,
    ) -> Pixels:
        """A picture, shape (height, width, 3). The simulation is only read.

        Args:
            simulation: The flight.
            state: The swarm.
            observing: Who takes pictures of the body, shape (n,).
            talking: Who uses its radio, shape (n,); the others hold their attitude.
            kind: `TargetKind` of what each +z tracks, shape (n,); None: taken from the two above.
            tracked: Spacecraft tracked, from 0, shape (n,); given together with `kind`.
            seen: Cells observed so far, shape (n_cells,); None: not drawn.
            lost: Spacecraft that no longer work, shape (n,); None: all work.
        """
        if kind is None or tracked is None:
            # Whom a spacecraft talks to is not known here; the line along its +z shows it.
            told = [observing, talking]
            kind = np.select(told, [TargetKind.ASTEROID, TargetKind.EARTH], TargetKind.DIRECTION).astype(np.int64)
            tracked = np.full(len(kind), -1)
        instant = Instant(
            t=state.t,
            r_BN_N=state.r_BN_N,
            C_BN=state.C_BN,
            C_AN=state.C_AN,
            kind=kind,
            tracked=tracked,
            link=None,
            seen=np.zeros(self._plan.region.n_cells, np.bool_) if seen is None else seen,
            trail_N=self._trail.to(state.t, state.r_BN_N),
            lost=lost,
        )
        return self._drawing.draw(instant)

    def close(self) -> None:
        """Release the OpenGL context."""
        self._drawing.close()
