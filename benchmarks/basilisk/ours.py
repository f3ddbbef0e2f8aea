"""The flight in swarm_mj: a behaviour and a control law of its own, everything else as in every run."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from math import inf
from typing import ClassVar

import mujoco
import numpy as np
from numba import njit
from numpy.typing import NDArray

from benchmarks.basilisk.problem import DURATION_S, K_N_M, LEG_S, P_N_M_S, PERIOD_S, Flight, Problem
from swarm_mj.mission.behaviors import SwarmView, TargetKind, Targets
from swarm_mj.simulator.flight_setup import FlightSetup
from swarm_mj.simulator.kernel import turn_gyrostats
from swarm_mj.simulator.simulation import Simulation
from swarm_mj.spacecraft.attitude.algebra import combine, cross, put_vector, times, vector
from swarm_mj.spacecraft.control.base import ControlInput
from swarm_mj.spacecraft.control.compiled import CompiledLaw
from swarm_mj.spacecraft.model import Stepper, build_model

Array = NDArray[np.float64]


class Legs:
    """A new direction for every spacecraft at the start of every leg."""

    dedicated_communications: ClassVar[bool] = False

    def __init__(self, directions_N: Array) -> None:
        n = directions_N.shape[1]
        kind, none = np.full(n, int(TargetKind.DIRECTION)), np.zeros(n, np.int64)
        self._legs = [Targets(kind, none, np.ascontiguousarray(leg)) for leg in directions_N]

    def targets(self, view: SwarmView, memory: None) -> tuple[Targets, None]:
        """The directions of this leg."""
        return self._legs[self._leg(view.t)], None

    def steady_for(self, view: SwarmView, memory: None) -> float:
        """Until the next leg [s]."""
        leg = self._leg(view.t)
        return inf if leg + 1 == len(self._legs) else (leg + 1) * LEG_S - view.t

    def _leg(self, t: float) -> int:
        return min(int(t / LEG_S), len(self._legs) - 1)


class ScalarFeedback:
    """The law of the problem."""

    def torque(self, inputs: ControlInput, memory: None) -> tuple[Array, None]:
        """Torque on the bodies in B [N m]."""
        torque_B = np.empty_like(inputs.sigma_BR)
        _write_torque(*inputs[:8], np.array([K_N_M, P_N_M_S]), torque_B)
        return torque_B, None

    def compiled(self) -> CompiledLaw:
        """The same for compiled code."""
        return CompiledLaw(_write_torque, np.array([K_N_M, P_N_M_S]))


@njit(cache=True, nogil=True, error_model="numpy")
def _write_torque(
    sigma_BR: Array,
    omega_BR_B: Array,
    omega_BN_B: Array,
    omega_RN_B: Array,
    domega_RN_B: Array,
    wheel_momentum_B: Array,
    inertia_B: Array,
    inertia_effective_B: Array,
    numbers: Array,
    torque_B: Array,
) -> None:
    for j in range(sigma_BR.shape[0]):
        omega = vector(omega_BN_B, j)
        momentum = combine(1.0, times(inertia_B[j], omega), 1.0, vector(wheel_momentum_B, j))
        following = combine(1.0, vector(domega_RN_B, j), -1.0, cross(omega, vector(omega_RN_B, j)))
        feedback = combine(-numbers[0], vector(sigma_BR, j), -numbers[1], vector(omega_BR_B, j))
        forward = combine(1.0, cross(omega, momentum), 1.0, times(inertia_effective_B[j], following))
        put_vector(torque_B, j, combine(1.0, forward, 1.0, feedback))


@dataclass
class Swarm:
    """The flight in swarm_mj, flown stretch by stretch as `Simulation.run` does, without its records."""

    simulation: Simulation

    def fly_to(self, end: float) -> None:
        """Fly on until `end` [s]."""
        self.simulation.fly(round(end / PERIOD_S) - self.simulation.tick)

    def state(self) -> Flight:
        """Where the swarm is now, a flight of one sample."""
        state = self.simulation.state
        return Flight(
            r_N=state.r_N[None].copy(), attitude=state.q_BN[None].copy(), wheel_speed=state.wheel_speed[None].copy()
        )


def make(problem: Problem, timestep: float, stepper: Stepper) -> Simulation:
    """The simulation at its start."""
    model = build_model(
        problem.n,
        shape=problem.plan.shape,
        properties=problem.properties,
        timestep=timestep,
        stepper=stepper,
        geometry=False,
    )
    setup = FlightSetup(model=model, environment=problem.environment, period=PERIOD_S)
    simulation = Simulation(setup, Legs(problem.directions_N), ScalarFeedback())
    simulation.reset(problem.initial)
    return simulation


def fly(problem: Problem, timestep: float, stepper: Stepper = "mujoco") -> Flight:
    """Fly and record every control period."""
    record = make(problem, timestep, stepper).run(DURATION_S, PERIOD_S)
    found = record.samples
    return Flight(r_N=found["r_BN_N"], attitude=found["q_BN"], wheel_speed=found["wheel_speed"])


def stepping(problem: Problem, timestep: float, stepper: Stepper) -> Callable[[], object]:
    """A function that only steps for the time of the flight, with the first forces and no torques held."""
    simulation, steps = make(problem, timestep, stepper), round(DURATION_S / timestep)
    simulation.step()
    state, world = simulation.state, simulation.batch.world
    state.motor[:] = 0.0
    if stepper == "mujoco":
        simulation.data.ctrl[:] = 0.0
        return partial(mujoco.mj_step, simulation.model.mjmodel, simulation.data, nstep=steps)
    rotation = state.q_BN, state.omega_B, state.flights.momentum[0], state.wheel_speed, state.motor, state.torque_N
    body = state.inertia_B, world.wheel_axes_B, world.wheel_inertia
    return partial(turn_gyrostats, *rotation, *body, timestep, steps)


def ready(problem: Problem, timestep: float, stepper: Stepper) -> Callable[[], object]:
    """A function that flies the whole flight without recording it; set-up is done."""
    simulation = make(problem, timestep, stepper)
    return lambda: simulation.run(DURATION_S, DURATION_S)
