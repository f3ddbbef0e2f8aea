"""Faults, dispersions and fourth wheels of the flights of a `CompiledBatch`, each with a model of its own."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from swarm_mj.mission.behaviors import SwarmView, Targets
from swarm_mj.simulator.fast import flight_kernels
from swarm_mj.simulator.fast.conditions import CONDITION, noise_left
from swarm_mj.simulator.fast.flights import Flights, one_of
from swarm_mj.simulator.fast.integrator import Integrator
from swarm_mj.simulator.fast.plain_data import Data, make_datas, own_model
from swarm_mj.simulator.fault_injection import FaultInjection
from swarm_mj.simulator.loop_state import InitialState, LoopState
from swarm_mj.simulator.simulation import Simulation
from swarm_mj.spacecraft.model import SwarmModel
from swarm_mj.typing import Array, Ints, Mask


class BatchConditions:
    """What goes wrong in E flights.

    Args:
        simulation: One of them, which knows faults.
        flights: Their arrays.

    Attributes:
        datas: Their MjData.
        records: The MjData for compiled code, shape (E,).
        conditions: The conditions for compiled code, shape (E,).
        due: Ticks at which something has to be done before compiled code may fly on, shape (E,).
        scheduled: Whether the scenario has faults that happen in flight.
        redirects: Flights in which the swarm may aim elsewhere than it is told, because of losses, shape (E,).
    """

    def __init__(self, simulation: Simulation, flights: Flights) -> None:
        count, self._period = len(flights.tick), simulation.period
        assert simulation.injection is not None
        fault_model = simulation.injection.fault_model
        self.scheduled = len(fault_model.faults) > 0
        models = [own_model(simulation.state.model, simulation.stepper) for _ in range(count)]
        self.datas = make_datas(models, simulation.stepper)
        own = zip(models, self.datas, strict=True)
        states = [_state(simulation, *each, one_of(flights, e)) for e, each in enumerate(own)]
        self._injections = [FaultInjection(state, fault_model) for state in states]
        self._integrators = [Integrator(state.model, data) for state, data in zip(states, self.datas, strict=True)]
        self.records = np.concatenate([integrator.batch for integrator in self._integrators])
        self.conditions = np.zeros(count, CONDITION)
        self.due, self.redirects = np.zeros(count, np.int64), np.ones(count, np.bool_)
        self._starts: list[tuple[int, Any]] = [(0, ())] * count
        self._dry, self._no_matter = np.zeros(count, np.bool_), np.zeros(count, np.int64)

    def reset(self, e: int, initial: InitialState) -> None:
        """Begin a flight: what it is like and what will happen is drawn from the seed of its start."""
        self._starts[e] = initial.seed, initial.deployment
        self._injections[e].reset(*self._starts[e])
        self._publish(e)

    def rewind(self, e: int) -> None:
        """Begin the same flight again."""
        self._injections[e].rewind(self._starts[e][1])
        self._publish(e)

    def _publish(self, e: int) -> None:
        self.conditions[e], self.due[e] = self._injections[e].condition[0], 0
        self.redirects[e] = True

    def get_state(self, e: int) -> Any:
        """What has become of a flight, a copy."""
        return self._starts[e], self._injections[e].get_state()

    def set_state(self, e: int, state: Any) -> None:
        """Go on from what `get_state` gave."""
        self._starts[e], saved = state
        self._injections[e].reset(*self._starts[e])
        self._injections[e].set_state(saved)
        self._publish(e)

    def aim(self, e: int, view: SwarmView, ask: Callable[[SwarmView], Targets]) -> Targets:
        """See `FaultInjection.aim`."""
        targets = self._injections[e].aim(view, ask)
        self.due[e], self.redirects[e] = self._injections[e].due, self._injections[e].faults.redirects
        return targets

    def condition_of(self, e: int) -> tuple[Mask, Mask]:
        """Spacecraft lost, and cameras that take no pictures, shape (n,)."""
        faults = self._injections[e].faults
        return faults.lost, ~faults.camera_on | faults.lost

    def limit(self, live: Mask, tick: Ints, until: Ints) -> Ints:
        """How far compiled code may fly, shape (E,): to the next event, and as far as noise has been drawn."""
        until = np.minimum(until, self.due)
        self.provide_noise(live)
        noise_left(self.conditions, live, tick, until, self._dry)
        return until

    def provide_noise(self, live: Mask) -> None:
        """Draw the noise of the sensors of live flights, shape (E,), that have none left."""
        if noise_left(self.conditions, live, self.due, self._no_matter, self._dry):
            for e in np.flatnonzero(self._dry).tolist():
                self._injections[e].faults.sensing.provide_noise()

    def know(self, live: Mask, tick: Ints, wheel_speed: Array, q: Array, omega: Array) -> Mask:
        """See `Batch.know`, and `FaultInjection.known_now` of one flight.

        Args:
            live: Which flights, shape (E,).
            tick: Control periods flown, shape (E,).
            wheel_speed: Shape (E, n, w) [rad/s].
            q: True attitudes, replaced, shape (E, n, 4).
            omega: True rates, replaced, shape (E, n, 3) [rad/s].
        """
        own: Mask = live & (self.conditions["sense"] != 0)
        for e in np.flatnonzero(own & (tick >= self.due)).tolist():
            # A sensor that fails at this instant has failed before it is read.
            self._injections[e].faults.happen(int(tick[e]) * self._period, wheel_speed[e])
        self.provide_noise(own)
        flight_kernels.sense_flights(self.conditions, own, tick, self._period, q, omega)
        return own


def _state(simulation: Simulation, model: SwarmModel, data: Data, flights: Flights) -> LoopState:
    """One more flight like a simulation's."""
    like, given = simulation.state, simulation.injection
    assert given is not None
    return LoopState(
        model,
        properties=like.properties,
        environment=given.planned,
        period=like.period,
        gravity_gradient=like.gradient_gm > 0.0,
        flights=flights,
        data=data,
    )
