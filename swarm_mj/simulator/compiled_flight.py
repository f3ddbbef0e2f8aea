"""One flight handed to compiled code, stretch by stretch; between them stands what only Python can do."""

from __future__ import annotations

import numpy as np

from swarm_mj.simulator.fast import flight_kernels
from swarm_mj.simulator.fast.conditions import CONDITION
from swarm_mj.simulator.fast.flights import World
from swarm_mj.simulator.fast.integrator import Integrator
from swarm_mj.simulator.fault_injection import FaultInjection
from swarm_mj.simulator.loop_state import LoopState

#: All flights of a simulation: one.
_EVERY_FLIGHT = np.ones(1, np.bool_)


class CompiledFlight:
    """What compiled code is given of one flight.

    Args:
        state: Of the flight.
        integrator: Of its MjData.
        injection: Its faults; None: it has none.
    """

    def __init__(self, state: LoopState, integrator: Integrator, injection: FaultInjection | None) -> None:
        self._state, self._integrator, self._injection = state, integrator, injection
        self._conditions = np.zeros(1, CONDITION) if injection is None else injection.condition
        self._until = np.zeros(1, np.int64)

    def fly(self, world: World, part: int, until: int) -> int:
        """Let compiled code do a part of every control period until a tick, the next event, or the end of the drawn noise.

        Returns:
            See `flight_kernels.fly`.
        """
        state, injection, batch = self._state, self._injection, self._integrator.batch
        self._until[0] = until
        if injection is not None:
            self._until[0] = min(until, injection.due, state.tick + injection.faults.sensing.provide_noise())
        outcome: int = flight_kernels.fly(
            world, state.flights, batch, self._conditions, state.timesteps, part, _EVERY_FLIGHT, self._until
        )
        state.data.time = state.time
        return outcome
