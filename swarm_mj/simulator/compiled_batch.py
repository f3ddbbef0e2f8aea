"""Many flights of one swarm at once: bit for bit what `Simulation` flies, whole stretches of each in compiled code.

The flights share model, gravity and control law; each has its own MjData, time and targets, and is flown as far as it goes
before the next one is: its data stays in the processor's cache. What compiled code cannot fly (other gravity fields, control
laws without compiled arithmetic, perturbations) is named by `Simulation.why_not_compiled`; `PythonBatch` serves for it, with
the same interface.
"""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np

from swarm_mj.errors import PluginError, SimulationError
from swarm_mj.mission.behaviors import Behavior, Targets
from swarm_mj.simulator.fast import flight_kernels
from swarm_mj.simulator.fast.flight_kernels import (
    ADVANCE,
    DECIDE,
    FINE,
    NEVER,
    NO_SUCH_TARGET,
    NOT_FINITE,
    WHOLE,
    allocate_flights,
)
from swarm_mj.simulator.fast.integrator import Integrator, timesteps_in
from swarm_mj.simulator.fast.kernels import Slot
from swarm_mj.simulator.fast.world import make_world
from swarm_mj.simulator.loop_state import InitialState
from swarm_mj.simulator.plugin_calls import BehaviorCalls, divergence_of, view_of
from swarm_mj.simulator.simulation import Simulation
from swarm_mj.spacecraft.control.base import Controller
from swarm_mj.spacecraft.model import NQ, NV
from swarm_mj.typing import Array, Ints, Mask

#: Where lost spacecraft stand, times their number [m].
PARKED = 1e7


class CompiledBatch:
    """E flights of one swarm.

    Args:
        simulation: One flight as it would fly alone: model, environment, spacecraft and control period are taken from it.
        count: Number of flights E.
        controller: The control law; None where torques are held, see `hold`.
        behaviors: Who points at what in each flight; None where targets are held, see `hold`.

    Attributes:
        n: Number of spacecraft.
        qpos: A copy of positions in N [m], attitudes and wheel angles (zero where wheels are momentum states), shape (E, 10 n).
        qvel: A copy of velocities in N [m/s], body rates and wheel speeds relative to the hub [rad/s], shape (E, 9 n).
        kind: `TargetKind` values, shape (E, n).
        index: Spacecraft to follow, shape (E, n).
        vector: Surface point in A [m] or direction in N, shape (E, n, 3).
        torque_B: Torques on the bodies, shape (E, n, 3) [N m].
        tick: Control periods flown, shape (E,).
        finite: False where the flight has diverged, shape (E,).
        causes: Why, by flight.
        lost: Spacecraft lost to faults, of which a batch knows none, shape (E, n).
        blind: Spacecraft whose camera is off or that are lost; none in a batch, shape (E, n).
        effort: Sum of the squares of all motor torques since the caller last set it to zero, shape (E,) [N^2 m^2].

    Raises:
        SimulationError: Compiled code cannot fly this, see `Simulation.why_not_compiled`.
    """

    def __init__(
        self,
        simulation: Simulation,
        count: int,
        controller: Controller | None,
        behaviors: Sequence[Behavior] | None = None,
    ) -> None:
        self.model, self.environment, self.period = simulation.model, simulation.environment, simulation.period
        self.n, self.count = self.model.n, count
        if why := simulation.why_not_compiled(controller):
            raise SimulationError(f"a batch of flights knows nothing of {why}; use PythonBatch")
        self._hold, self._controller = timesteps_in(self.period, self.model), controller
        self._world = make_world(simulation.state, controller)
        self._datas = [mujoco.MjData(self.model.mjmodel) for _ in range(count)]
        self._integrator = Integrator(self.model, *self._datas)
        self._behaviors = None if behaviors is None else BehaviorCalls(behaviors, self.period)
        self._everyone, self._nobody = np.ones(count, np.bool_), np.zeros(count, np.bool_)
        self._never = np.full(count, NEVER, np.int64)
        self._flights = f = allocate_flights(count, self.n)
        self.qpos, self.qvel = f.qpos, f.qvel
        self._q, self._v = f.qpos.reshape(count, self.n, NQ), f.qvel.reshape(count, self.n, NV)
        self.kind, self.index, self.vector, self.torque_B = f.targets[:, 0], f.targets[:, 1], f.vector, f.torque_B
        self.tick, self.finite, self.effort = f.tick, f.finite, f.effort
        self.lost, self.blind = np.zeros((count, self.n), np.bool_), np.zeros((count, self.n), np.bool_)
        self.causes = [""] * count

    @property
    def ctrl(self) -> Array:
        """Motor torques, a copy, shape (E, 3 n) [N m]."""
        return np.array([data.ctrl for data in self._datas])

    @property
    def sigma_BR(self) -> Array:
        """Attitude errors at the last decision, shape (E, n, 3)."""
        return self._flights.work[:, Slot.SIGMA_BR]

    def read(self, r: Array, v: Array, q: Array, omega: Array, wheel: Array) -> None:
        """Copy positions and velocities in N [m, m/s], attitudes, body rates and wheel speeds [rad/s], shape (E, n, ...)."""
        flight_kernels.read(self._q, self._v, r, v, q, omega, wheel)

    def reset(self, e: int, initial: InitialState) -> None:
        """Put one flight at its start and forget everything about it."""
        f = self._flights
        mujoco.mj_resetData(self.model.mjmodel, self._datas[e])
        self.place(e, *initial.rows(3))
        f.tick[e], f.targets[e, 2:], f.finite[e], f.effort[e], f.peaks[e] = 0, -1, True, 0.0, 0.0
        self.causes[e] = ""
        if self._behaviors is not None:
            self._behaviors.reset(e)

    def park(self, e: int, j: int) -> None:
        """Put a spacecraft that is no more where it disturbs nothing: far out, at rest."""
        qpos, qvel = self._q[e].copy(), self._v[e].copy()
        qpos[j, :3], qvel[j] = (PARKED * (1.0 + j), 0.0, 0.0), 0.0
        self.place(e, qpos, qvel)

    def place(self, e: int, qpos: Array, qvel: Array) -> None:
        """Put one flight into a state, shape (n, 10) and (n, 9), see `qpos` and `qvel`."""
        self.model.set_state(self._datas[e], qpos, qvel)
        # Read back, as rounding leaves it where wheels are momentum states.
        self._q[e], self._v[e] = self.model.state(self._datas[e])
        if self._behaviors is not None:
            self._behaviors.due[e] = 0

    def hold(self, targets: Targets | None, torque_B: Array | None) -> None:
        """Let targets, shape (E, n, ...), and torques [N m], shape (E, n, 3), hold where no behaviour and no law decides.

        Behaviours, where there are any, are asked again, because they have been told something new.
        """
        if self._behaviors is not None:
            self._behaviors.due[:] = 0
        if targets is not None:
            self.kind[:], self.index[:], self.vector[:] = targets
        if torque_B is not None:
            self.torque_B[:] = torque_B

    def know(self, live: Mask, q: Array, omega: Array) -> Mask:
        """Put what the flight software has of attitudes in the place of the truth: in a batch they are the same."""
        return self._nobody

    def decide(self, live: Mask) -> bool:
        """Set forces and motor torques of the coming hold; a flight whose state is not finite is marked in `finite`.

        Args:
            live: Which flights, shape (E,).

        Returns:
            Whether all of them are finite.

        Raises:
            PluginError: A behaviour aims at what is not there.
        """
        self._ask(live)
        return self._judge(self._fly(DECIDE, live, self._never), live)

    def fly(self, periods: int, live: Mask) -> bool:
        """Decide and advance so many control periods of the live flights; one that is not finite stops.

        Returns:
            Whether all of them are finite.
        """
        end, flying, fine = self.tick + periods, live.copy(), True
        while flying.any():
            self._ask(flying)
            until = end if self._behaviors is None else np.minimum(end, self._behaviors.due)
            fine &= self._judge(self._fly(WHOLE, flying, until), flying)
            flying &= self.finite & (self.tick < end)
        return fine

    def advance(self, live: Mask | None) -> None:
        """Let MuJoCo integrate one control period of the live flights, None for all, with everything held."""
        self._fly(ADVANCE, self._everyone if live is None else live, self._never)

    def _fly(self, part: int, live: Mask, until: Ints) -> int:
        return flight_kernels.fly(self._world, self._flights, self._integrator.swarms, self._hold, part, live, until)

    def _ask(self, live: Mask) -> None:
        """Ask the behaviours of live flights whose answers may not hold any more."""
        if self._behaviors is None:
            return
        for e in np.flatnonzero(live & (self.tick >= self._behaviors.due)).tolist():
            tick = int(self.tick[e])
            t = tick * self.period
            view = view_of(t, self.environment.C_AN(t), self._q[e], self._v[e])
            self.kind[e], self.index[e], self.vector[e] = self._behaviors.ask(e, view, tick)

    def _judge(self, answer: int, live: Mask) -> bool:
        if answer == NO_SUCH_TARGET:
            raise PluginError("the behaviour aims at what is not there: an unknown kind, or a spacecraft that is not")
        if answer == NOT_FINITE:
            for e in np.flatnonzero(live & ~self.finite):
                self.causes[e] = self._divergence(int(e))
        return bool(answer == FINE)

    def _divergence(self, e: int) -> str:
        state, t = np.hstack((self._q[e], self._v[e])), float(self.tick[e] * self.period)
        return divergence_of(state, self.torque_B[e], self._controller, self.model.names, t)
