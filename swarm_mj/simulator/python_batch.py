"""Many flights, each a `Simulation` of its own: slower than `CompiledBatch`, but they fly everything."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from swarm_mj.errors import SimulationError
from swarm_mj.mission.behaviors import Targets
from swarm_mj.simulator.batch import Batch
from swarm_mj.simulator.loop_state import InitialState
from swarm_mj.simulator.simulation import Simulation
from swarm_mj.typing import Array, Mask


class PythonBatch(Batch):
    """E flights of one swarm, one after the other.

    Args:
        simulations: One for each flight; behaviour, control law and what may go wrong are theirs.

    Attributes:
        simulations: As given.
    """

    def __init__(self, simulations: Sequence[Simulation]) -> None:
        self.simulations = list(simulations)
        super().__init__(self.simulations[0].state, len(self.simulations))

    @property
    def qpos(self) -> Array:
        """MuJoCo's positions, a copy, shape (E, nq)."""
        return np.array([simulation.data.qpos for simulation in self.simulations])

    @property
    def qvel(self) -> Array:
        """MuJoCo's velocities, a copy, shape (E, nv)."""
        return np.array([simulation.data.qvel for simulation in self.simulations])

    @property
    def ctrl(self) -> Array:
        """Motor torques of the coming hold, a copy, shape (E, n w) [N m]."""
        return np.array([simulation.state.motor_torque for simulation in self.simulations])

    def rows(self, e: int) -> tuple[Array, Array]:
        """See `Batch.rows`."""
        return self.simulations[e].state.rows()

    def place(self, e: int, qpos: Array, qvel: Array) -> None:
        """See `Batch.place`."""
        self.simulations[e].state.set_rows(qpos, qvel)
        self.simulations[e].ask_again()

    def _start(self, e: int, initial: InitialState) -> None:
        self.simulations[e].reset(initial)
        self.lost[e], self.blind[e] = self.simulations[e].lost, False

    def _own_state(self, e: int) -> Any:
        return self.simulations[e].get_state()

    def _take_own_state(self, e: int, state: Any) -> None:
        self.simulations[e].set_state(state)

    def read(self, r: Array, v: Array, q: Array, omega: Array, wheel: Array) -> None:
        """See `Batch.read`."""
        for e in range(self.count):
            qpos, qvel = self.rows(e)
            r[e], q[e] = qpos[:, :3], qpos[:, 3:7]
            v[e], omega[e], wheel[e] = qvel[:, :3], qvel[:, 3:6], qvel[:, 6:]

    def know(self, live: Mask, q: Array, omega: Array) -> Mask:
        """See `Batch.know`."""
        imperfect = np.zeros(self.count, np.bool_)
        for e in np.flatnonzero(live):
            known = self.simulations[e].known()
            if known is not None:
                q[e], omega[e], imperfect[e] = *known, True
        return imperfect

    def hold(self, targets: Targets | None, torque_B: Array | None) -> None:
        """Have all behaviours asked at the next decision; what holds they and the control laws are told by others."""
        for simulation in self.simulations:
            simulation.ask_again()

    def decide(self, live: Mask) -> bool:
        """See `Batch.decide`."""
        for e in np.flatnonzero(live):
            simulation = self.simulations[e]
            try:
                targets = simulation.decide()
            except SimulationError as error:
                self.finite[e], self.causes[e] = False, str(error)
                continue
            self.kind[e], self.index[e], self.vector[e] = targets
            self.lost[e], self.blind[e] = simulation.lost, ~simulation.camera_on
            self.sigma_BR[e] = simulation.state.inputs.sigma_BR
            self.effort[e] += float((simulation.motor_torque**2).sum())
        return bool(self.finite[live].all())

    def advance(self, live: Mask | None) -> None:
        """See `Batch.advance`."""
        for e in range(self.count) if live is None else np.flatnonzero(live):
            self.simulations[e].advance()
            self.tick[e] += 1

    def fly(self, periods: int, live: Mask) -> bool:
        """See `Batch.fly`."""
        flying, fine = live, True
        for _ in range(periods):
            if not self.decide(flying):
                flying, fine = flying & self.finite, False
            self.advance(flying)
        return fine
