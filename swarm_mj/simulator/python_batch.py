"""Many flights, each a `Simulation` of its own, behind the interface of `CompiledBatch`: slower, but they fly everything."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from swarm_mj.errors import SimulationError
from swarm_mj.mission.behaviors import Targets
from swarm_mj.simulator.compiled_batch import PARKED
from swarm_mj.simulator.loop_state import InitialState
from swarm_mj.simulator.simulation import Simulation
from swarm_mj.typing import Array, Mask


class PythonBatch:
    """E flights of one swarm; see `CompiledBatch` for the attributes.

    Args:
        simulations: One for each flight; behaviour, control law and what may go wrong are theirs.
    """

    def __init__(self, simulations: Sequence[Simulation]) -> None:
        self.simulations = list(simulations)
        first = self.simulations[0]
        self.model, self.environment, self.period = first.model, first.environment, first.period
        self.n, self.count = self.model.n, len(self.simulations)
        count, n = self.count, self.n
        self.kind, self.index = np.zeros((count, n), np.int64), np.zeros((count, n), np.int64)
        self.vector, self.torque_B, self.sigma_BR = (np.zeros((count, n, 3)) for _ in range(3))
        self.tick, self.finite, self.effort = np.zeros(count, np.int64), np.ones(count, np.bool_), np.zeros(count)
        self.lost, self.blind = np.zeros((count, n), np.bool_), np.zeros((count, n), np.bool_)
        self.causes = [""] * count

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
        """Motor torques, a copy, shape (E, 3 n) [N m]."""
        return np.array([simulation.state.motor_torque for simulation in self.simulations])

    def read(self, r: Array, v: Array, q: Array, omega: Array, wheel: Array) -> None:
        """Copy positions and velocities in N [m, m/s], attitudes, body rates and wheel speeds [rad/s], shape (E, n, ...)."""
        for e, simulation in enumerate(self.simulations):
            qpos, qvel = simulation.model.state(simulation.data)
            r[e], q[e] = qpos[:, :3], qpos[:, 3:7]
            v[e], omega[e], wheel[e] = qvel[:, :3], qvel[:, 3:6], qvel[:, 6:]

    def know(self, live: Mask, q: Array, omega: Array) -> Mask:
        """Put what the flight software has of attitudes and rates in the place of the truth, where sensors are not perfect.

        Args:
            live: Which flights, shape (E,); their states must be finite.
            q: Attitudes q_BN, shape (E, n, 4).
            omega: Body rates, shape (E, n, 3) [rad/s].

        Returns:
            Flights whose sensors are not perfect, shape (E,).
        """
        imperfect = np.zeros(self.count, np.bool_)
        for e in np.flatnonzero(live):
            known = self.simulations[e].known()
            if known is not None:
                q[e], omega[e], imperfect[e] = *known, True
        return imperfect

    def reset(self, e: int, initial: InitialState) -> None:
        """Put one flight at its start and forget everything about it."""
        self.simulations[e].reset(initial)
        self.tick[e], self.finite[e], self.effort[e], self.causes[e] = 0, True, 0.0, ""
        self.lost[e], self.blind[e] = self.simulations[e].lost, False

    def park(self, e: int, j: int) -> None:
        """Put a spacecraft that is no more where it disturbs nothing: far out, at rest."""
        qpos, qvel = (part.reshape(self.n, -1).copy() for part in self.model.state(self.simulations[e].data))
        qpos[j, :3], qvel[j] = (PARKED * (1.0 + j), 0.0, 0.0), 0.0
        self.place(e, qpos, qvel)

    def place(self, e: int, qpos: Array, qvel: Array) -> None:
        """Put one flight into a state, shape (n, 7 + w) and (n, 6 + w); see `SwarmModel.state`."""
        self.model.set_state(self.simulations[e].data, qpos, qvel)
        self.simulations[e].ask_again()

    def hold(self, targets: Targets | None, torque_B: Array | None) -> None:
        """Have all behaviours asked at the next decision; what holds they and the control laws are told by others."""
        for simulation in self.simulations:
            simulation.ask_again()

    def decide(self, live: Mask) -> bool:
        """Set forces and motor torques of the coming hold; see `CompiledBatch.decide`."""
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

    def fly(self, periods: int, live: Mask) -> bool:
        """Decide and advance so many control periods of the live flights; one that is not finite stops."""
        flying, fine = live, True
        for _ in range(periods):
            if not self.decide(flying):
                flying, fine = flying & self.finite, False
            self.advance(flying)
        return fine

    def advance(self, live: Mask | None) -> None:
        """Let MuJoCo integrate one control period of the live flights, None for all, with everything held."""
        for e in range(self.count) if live is None else np.flatnonzero(live):
            self.simulations[e].advance()
            self.tick[e] += 1
