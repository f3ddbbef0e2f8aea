"""The state of one flight with names, shapes, units and frames: what plug-ins, faults, thrusters and records work on.

Whoever takes part in a flight is handed one `FlightState` and works on the same arrays as compiled code; none of them knows
another one's inside.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import mujoco
import numpy as np

from swarm_mj.mission.behaviors import SwarmView, Targets
from swarm_mj.simulator.faults.schedule import Event
from swarm_mj.simulator.flights import NEVER, Flights, World
from swarm_mj.simulator.slots import Slot
from swarm_mj.smallbody.environment import Environment
from swarm_mj.spacecraft.attitude.mrp import quaternion_from_mrp
from swarm_mj.spacecraft.control.base import ControlInput
from swarm_mj.spacecraft.model import SwarmModel
from swarm_mj.spacecraft.properties import SpacecraftProperties
from swarm_mj.typing import Array, Ints

#: What a control law is given of the work array, in the order of `ControlInput`.
LAW_SLOTS = [Slot.SIGMA_BR, Slot.OMEGA_BR, Slot.OMEGA, Slot.OMEGA_R_B, Slot.DOMEGA_R_B, Slot.MOMENTUM]


class Release(NamedTuple):
    """How spacecraft leave the mothership in flight; until then they ride along without turning."""

    tick: Ints  #: control period at which each leaves, shape (n,); 0: it has left at the start
    push_N: Array  #: what the deployer adds to its velocity then, shape (n, 3) [m/s]
    omega_BN_B: Array  #: its body rate from then on, shape (n, 3) [rad/s]

    def next_after(self, tick: int) -> int:
        """Tick at which the next one leaves after an instant; `NEVER` where none does."""
        return int(self.tick[self.tick > tick].min(initial=NEVER))


@dataclass(frozen=True, kw_only=True)
class InitialState:
    """Where and how the swarm starts."""

    r_BN_N: Array  #: positions, shape (n, 3) [m]
    v_BN_N: Array  #: velocities, shape (n, 3) [m/s]
    sigma_BN: Array  #: attitudes as MRP, shape (n, 3)
    omega_BN_B: Array  #: body rates, shape (n, 3) [rad/s]
    wheel_speed: Array  #: relative to the hub, shape (n, w) [rad/s]
    seed: int = 0  #: of faults and dispersions, where the simulation has any
    deployment: tuple[Event, ...] = ()  #: what went wrong on the way to this state
    #: who leaves the mothership later; None: all have left. The states of those are the mothership's
    release: Release | None = None

    @property
    def q_BN(self) -> Array:
        """Attitudes as quaternions (w, x, y, z), shape (n, 4)."""
        return quaternion_from_mrp(self.sigma_BN)


class FlightState:
    """One flight of a swarm of n spacecraft: row e of `Flights`, its arrays under their names there, without the first axis.

    Args:
        flights: The arrays of all flights.
        e: Number of the flight.
        model: The compiled swarm.
        environment: Gravity, rotation, Sun and Earth.
        world: What the flights share.
        data: MuJoCo's state of this flight; None: MuJoCo does not step it.

    Attributes:
        flights: As given, with E = 1: views of this flight alone, for all whose names are not here.
        model: As given.
        environment: As given; fault injection replaces it at the start of a flight whose gravity is dispersed.
        data: As given.
        period: Between two decisions [s].
    """

    def __init__(
        self,
        flights: Flights,
        e: int,
        *,
        model: SwarmModel,
        environment: Environment,
        world: World,
        data: mujoco.MjData | None,
    ) -> None:
        self.flights = Flights._make(array[e : e + 1] for array in flights)
        self.model, self.environment, self.data = model, environment, data
        self.period, self._planned = world.period, (world.inertia_B, world.inertia_effective_B)
        f = self.flights
        self.r_N, self.v_N, self.q_BN, self.omega_B = f.r_N[0], f.v_N[0], f.q_BN[0], f.omega_B[0]
        self.wheel_speed, self.mass, self.inertia_B = f.wheel_speed[0], f.mass[0], f.inertia_B[0]
        self.released, self.lost, self.resting, self.rest_A = f.released[0], f.lost[0], f.resting[0], f.rest_A[0]
        self.restart, self.q_RN, self.C_AN, self.C_mid = f.restart[0], f.q_RN[0], f.C_AN[0], f.C_mid[0]
        self.work, self.torque_B, self.thrust_N = f.work[0], f.torque_B[0], f.thrust_N[0]
        self.torque_N, self.motor, self.peaks = f.torque_N[0], f.motor[0], f.peaks[0]

    @property
    def properties(self) -> SpacecraftProperties:
        """Mass properties and wheel limits of every spacecraft, as planned."""
        return self.model.properties

    @property
    def tick(self) -> int:
        """Control periods flown."""
        return int(self.flights.tick[0])

    @property
    def time(self) -> float:
        """Seconds past the epoch, counted in whole control periods."""
        return self.tick * self.period

    @property
    def targets(self) -> Targets:
        """Who points at what, live."""
        return Targets(self.flights.kind[0], self.flights.spacecraft[0], self.flights.vector[0])

    def aim_at(self, targets: Targets) -> None:
        """Point at other targets from the next decision on."""
        for present, new in zip(self.targets, targets, strict=True):
            present[:] = new

    def control_input(self) -> ControlInput:
        """What control laws are given; copied, for a law may keep it."""
        return ControlInput._make((*self.work[LAW_SLOTS], *self._planned, self.period))

    def known(self) -> tuple[Array, Array]:
        """Positions [m] and velocities [m/s] as the spacecraft know them, copies, shape (n, 3) each."""
        f = self.flights
        if not f.guessing[0]:
            return self.r_N.copy(), self.v_N.copy()
        return self.r_N + f.off_r_N[0] + (self.time - f.guessed_at[0]) * f.off_v_N[0], self.v_N + f.off_v_N[0]

    def view(self) -> SwarmView:
        """What a behaviour is shown; copied, for it may be kept."""
        r_N, v_N = self.known()
        return SwarmView(
            t=self.time,
            r_BN_N=r_N,
            v_BN_N=v_N,
            C_AN=self.environment.C_AN(self.time),
            q_BN=self.q_BN.copy(),
            omega_BN_B=self.omega_B.copy(),
            wheel_speed=self.wheel_speed.copy(),
        )

    def numbers(self) -> Array:
        """All that moves, a row for each spacecraft."""
        return np.hstack((self.r_N, self.v_N, self.q_BN, self.omega_B, self.wheel_speed))

    def start(self, initial: InitialState) -> None:
        """Put the swarm at its start."""
        f = self.flights
        for array in (f.tick, f.stage, f.ask, f.due, f.effort, f.peaks, f.thrust_N, f.torque_N, f.motor, f.resting):
            array[:] = 0
        f.finite[:], f.last_kind[:], f.last_spacecraft[:], f.guessing[:] = True, -1, -1, False
        self.r_N[:], self.v_N[:], self.q_BN[:] = initial.r_BN_N, initial.v_BN_N, initial.q_BN
        self.omega_B[:], self.wheel_speed[:] = initial.omega_BN_B, initial.wheel_speed
        self.work[Slot.R] = self.r_N
        self.released[:] = True if initial.release is None else initial.release.tick <= 0

    def let_go(self, release: Release) -> bool:
        """Push off those that leave the mothership now; whether anybody does."""
        due = ~self.released & (release.tick <= self.tick)
        if not due.any():
            return False
        self.v_N[due] += release.push_N[due]
        self.omega_B[due] = release.omega_BN_B[due]
        self.released[due], self.flights.last_kind[0, due] = True, -1
        return True
