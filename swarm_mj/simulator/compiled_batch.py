"""Many flights of one swarm at once: bit for bit what `Simulation` flies, whole stretches of each in compiled code.

The flights share model, gravity and control law; each has its own MjData, time and targets, and is flown as far as it goes
before the next one is: its data stays in the processor's cache. What compiled code cannot fly (gravity fields of a user's own,
control laws without compiled arithmetic) is named by `Simulation.why_not_compiled`; `PythonBatch` serves for it, with
the same interface.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
from numba import types

from swarm_mj.errors import PluginError, SimulationError
from swarm_mj.mission.behaviors import Behavior, SwarmView, Targets
from swarm_mj.simulator.batch import Batch
from swarm_mj.simulator.batch_conditions import BatchConditions
from swarm_mj.simulator.fast import flight_kernels
from swarm_mj.simulator.fast.bound_calls import BoundCall
from swarm_mj.simulator.fast.conditions import CONDITION, noise_left
from swarm_mj.simulator.fast.flight_kernels import (
    ADVANCE,
    DECIDE,
    FINE,
    NO_SUCH_TARGET,
    NOT_FINITE,
    WHOLE,
)
from swarm_mj.simulator.fast.flights import NEVER
from swarm_mj.simulator.fast.integrator import Integrator
from swarm_mj.simulator.fast.plain_data import make_datas, reset_data, restore_data, saved_data
from swarm_mj.simulator.fast.world import make_world
from swarm_mj.simulator.loop_state import InitialState
from swarm_mj.simulator.plugin_calls import BehaviorCalls, divergence_of, view_of
from swarm_mj.simulator.simulation import Simulation
from swarm_mj.simulator.slots import Slot
from swarm_mj.spacecraft.control.base import Controller
from swarm_mj.typing import Array, Ints, Mask

#: Ticks of a flight for which the flights of a batch share what gravity is where they are; memory comes as it is used.
REMEMBERED = 16_384


class CompiledBatch(Batch):
    """E flights of one swarm, which share control law and environment; faults and dispersions are drawn from their seeds.

    A flight with faults whose state or torque is no longer finite has diverged; `Simulation` would lose that spacecraft alone.

    Args:
        simulation: One flight as it would fly alone: model, environment, spacecraft and control period are taken from it.
        count: Number of flights E.
        controller: The control law; None where torques are held, see `hold`.
        behaviors: Who points at what in each flight; None where targets are held, see `hold`.

    Attributes:
        qpos: A copy of positions in N [m], attitudes and wheel angles (zero where wheels are momentum states), shape
            (E, n (7 + w)).
        qvel: A copy of velocities in N [m/s], body rates and wheel speeds relative to the hub [rad/s], shape (E, n (6 + w)).

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
        why = simulation.why_not_compiled(controller)
        if why:
            raise SimulationError(f"a batch of flights knows nothing of {why}; use PythonBatch")
        super().__init__(simulation.state, count)
        self._timesteps, self._controller = simulation.state.timesteps, controller
        self._world = make_world(simulation.state, controller, remembered=REMEMBERED)
        self._wrong = None if simulation.injection is None else BatchConditions(simulation, self._flights)
        self.senses = self._wrong is not None
        if self._wrong is None:
            self._datas = make_datas([self.model] * count, simulation.stepper)
            self._integrator = Integrator(self.model, *self._datas)
            self._records, self._conditions = self._integrator.batch, np.zeros(count, CONDITION)
        else:
            self._datas = list(self._wrong.datas)
            self._records, self._conditions = self._wrong.records, self._wrong.conditions
        self._behaviors = None if behaviors is None else BehaviorCalls(behaviors, self.period)
        self._shared = (self._world, self._flights, self._records, self._conditions, self._timesteps)
        free = (types.int64, types.boolean[::1], types.int64[::1])
        self._call = BoundCall(flight_kernels.fly, self._shared, free)
        self._everyone, self._nobody = np.ones(count, np.bool_), np.zeros(count, np.bool_)
        self._never = np.full(count, NEVER, np.int64)
        self.qpos, self.qvel = self._flights.qpos, self._flights.qvel
        self._q, self._v = self.qpos.reshape(count, self.n, -1), self.qvel.reshape(count, self.n, -1)
        self._held: Targets | None = None

    @property
    def ctrl(self) -> Array:
        """Torques of motors and bearings of the coming hold, a copy, shape (E, n w) [N m]."""
        return np.array([data.ctrl for data in self._datas])

    @property
    def work(self) -> Array:
        """Vectors of the last decision, see `Slot`, shape (E, slots, n, 3)."""
        return self._flights.work

    @property
    def q_BN(self) -> Array:
        """Attitudes at the last decision, shape (E, n, 4)."""
        return self._flights.q_BN

    @property
    def line_of_sight_N(self) -> Array:
        """Unit vectors to the targets at the last decision, shape (E, n, 3)."""
        return self.work[:, Slot.LOS]

    @property
    def C_AN(self) -> Array:
        """Rotations from N to A at the last decision, shape (E, 3, 3)."""
        return self._flights.C_AN

    def rows(self, e: int) -> tuple[Array, Array]:
        """See `Batch.rows`."""
        return self._q[e], self._v[e]

    def place(self, e: int, qpos: Array, qvel: Array) -> None:
        """See `Batch.place`."""
        self.model.set_state(self._datas[e], qpos, qvel)
        # Read back, as rounding leaves it where wheels are momentum states.
        self._q[e], self._v[e] = self.model.state(self._datas[e])
        if self._behaviors is not None:
            self._behaviors.due[e] = 0
        if self._wrong is not None:
            self._wrong.due[e] = 0

    def _start(self, e: int, initial: InitialState) -> None:
        if self._wrong is not None:
            self._wrong.reset(e, initial)
            self.lost[e], self.blind[e] = self._wrong.condition_of(e)[0], False
        reset_data(self._datas[e])
        self.place(e, *initial.rows(self.model.properties.n_wheels))
        if self._behaviors is not None:
            self._behaviors.reset(e)

    def rewind(self, e: int, initial: InitialState) -> None:
        """See `Batch.rewind`; a decision moves nothing, so that only what it asked for is taken back."""
        if self._behaviors is not None:
            self.reset(e, initial)
            return
        if self._wrong is not None:
            self._wrong.rewind(e)
            self.lost[e], self.blind[e] = self._wrong.condition_of(e)[0], False
        self._datas[e].ctrl[:], self._datas[e].xfrc_applied[:] = 0.0, 0.0
        self._forget(e)

    def _own_state(self, e: int) -> Any:
        behavior = None if self._behaviors is None else self._behaviors.get_state(e)
        wrong = None if self._wrong is None else self._wrong.get_state(e)
        return {"data": saved_data(self._datas[e]), "behavior": behavior, "wrong": wrong}

    def _take_own_state(self, e: int, state: Any) -> None:
        if self._wrong is not None:
            self._wrong.set_state(e, state["wrong"])
        restore_data(self._datas[e], state["data"])
        if self._behaviors is not None:
            self._behaviors.set_state(e, state["behavior"])

    def read(self, r: Array, v: Array, q: Array, omega: Array, wheel: Array) -> None:
        """See `Batch.read`."""
        flight_kernels.split_states(self._q, self._v, r, v, q, omega, wheel)

    def know(self, live: Mask, q: Array, omega: Array) -> Mask:
        """See `Batch.know`."""
        if self._wrong is None:
            return self._nobody
        return self._wrong.know(live, self.tick, self._v[:, :, 6:], q, omega)

    def hold(self, targets: Targets | None, torque_B: Array | None) -> None:
        """See `Batch.hold`."""
        if self._behaviors is not None:
            self._behaviors.due[:] = 0
        if self._wrong is not None and targets is not None:
            self._wrong.due[self._wrong.redirects] = 0
        if targets is not None:
            self.kind[:], self.index[:], self.vector[:] = self._held = targets
        if torque_B is not None:
            self.torque_B[:] = torque_B

    def decide(self, live: Mask) -> bool:
        """See `Batch.decide`."""
        self._ask(live)
        return self._judge(self._fly(DECIDE, live, self._never), live)

    def advance(self, live: Mask | None) -> None:
        """See `Batch.advance`."""
        self._fly(ADVANCE, self._everyone if live is None else live, self._never)

    def fly(self, periods: int, live: Mask) -> bool:
        """See `Batch.fly`."""
        end, flying, fine = self.tick + periods, live.copy(), True
        while flying.any():
            self._ask(flying)
            fine &= self._judge(self._fly(WHOLE, flying, end), flying)
            flying &= self.finite & (self.tick < end)
        return fine

    def bound(self, part: int, live: Mask, until: Ints) -> BoundCall:
        """The flight as a call for other compiled code, which sees to it that noise is left (`bound_supply`).

        Args:
            part: WHOLE, DECIDE or ADVANCE.
            live: Which flights, shape (E,); read at every call.
            until: Ticks to fly to, shape (E,); read at every call.

        Raises:
            SimulationError: Behaviours or faults of the scenario are asked on the way, which is Python's.
        """
        if self._behaviors is not None or (self._wrong is not None and self._wrong.scheduled):
            raise SimulationError("compiled code asks no behaviours, and knows nothing of the scenario's faults")
        return BoundCall(flight_kernels.fly, (*self._shared, part, live, until))

    def bound_supply(self, live: Mask, until: Ints) -> BoundCall:
        """`noise_left` of these flights, arguments as of `bound`: `until` comes down to as far as noise has been drawn."""
        return BoundCall(noise_left, (self._conditions, live, self.tick, until, np.zeros(self.count, np.bool_)))

    def bound_sense(self, live: Mask, q: Array, omega: Array) -> BoundCall:
        """`know` of these flights as a call for other compiled code, which sees to it that noise is left."""
        return BoundCall(
            flight_kernels.sense_flights, (self._conditions, live, self.tick, float(self.period), q, omega)
        )

    def provide_noise(self, live: Mask) -> None:
        """Draw the noise of the sensors of live flights, shape (E,), that have none left."""
        if self._wrong is not None:
            self._wrong.provide_noise(live)

    def find_causes(self, live: Mask) -> None:
        """Say why flights have diverged, in `causes`."""
        for e in np.flatnonzero(live & ~self.finite):
            self.causes[e] = self._divergence(int(e))

    def _fly(self, part: int, live: Mask, until: Ints) -> int:
        if part == WHOLE and self._behaviors is not None:
            until = np.minimum(until, self._behaviors.due)
        if part & DECIDE and self._wrong is not None:
            until = self._wrong.limit(live, self.tick, until)
        outcome: int = self._call(part, live, until)
        return outcome

    def _ask(self, live: Mask) -> None:
        """Let happen what is due, and ask the behaviours of live flights whose answers may not hold any more."""
        if self._behaviors is None and self._wrong is None:
            return
        due = self._never if self._behaviors is None else self._behaviors.due
        if self._wrong is not None:
            due = np.minimum(due, self._wrong.due)
        for e in np.flatnonzero(live & (self.tick >= due)).tolist():
            t = int(self.tick[e]) * self.period
            view = view_of(t, self.environment.C_AN(t), self._q[e], self._v[e])
            if self._wrong is None:
                targets = self._targets(e, view)
            else:
                targets = self._wrong.aim(e, view, partial(self._targets, e))
                self.lost[e], self.blind[e] = self._wrong.condition_of(e)
            self.kind[e], self.index[e], self.vector[e] = targets

    def _targets(self, e: int, view: SwarmView) -> Targets:
        if self._behaviors is not None:
            return self._behaviors.ask(e, view, int(self.tick[e]))
        held = (self.kind, self.index, self.vector) if self._held is None else self._held
        return Targets(*(part[e] for part in held))

    def _judge(self, answer: int, live: Mask) -> bool:
        if answer == NO_SUCH_TARGET:
            raise PluginError("the behaviour aims at what is not there: an unknown kind, or a spacecraft that is not")
        if answer == NOT_FINITE:
            self.find_causes(live)
        return bool(answer == FINE)

    def _divergence(self, e: int) -> str:
        state, t = np.hstack((self._q[e], self._v[e])), float(self.tick[e] * self.period)
        return divergence_of(state, self.torque_B[e], self._controller, self.model.names, t)
