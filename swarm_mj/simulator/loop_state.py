"""The state of one flight between two decisions: what the loop reads and writes, with names, shapes, units and frames.

Whoever takes part in a flight (the simulation, the Python loop, fault injection, the recorder, compiled code) is handed one
`LoopState` and works on the same arrays; none of them knows another one's inside.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, cast

import mujoco
import numpy as np

from swarm_mj.errors import PluginError
from swarm_mj.mission.behaviors import Targets
from swarm_mj.simulator.fast.flights import NEVER, Flights, allocate_flights
from swarm_mj.simulator.fast.integrator import timesteps_in
from swarm_mj.simulator.fast.plain_data import Data, restore_data, saved_data
from swarm_mj.simulator.faults.schedule import Event
from swarm_mj.simulator.slots import Slot
from swarm_mj.smallbody.environment import Environment
from swarm_mj.spacecraft.attitude.mrp import quaternion_from_mrp
from swarm_mj.spacecraft.control.base import ControlInput
from swarm_mj.spacecraft.model import NQ, NV, SwarmModel
from swarm_mj.spacecraft.properties import SpacecraftProperties
from swarm_mj.typing import Array, Ints

#: The wheel-speed limiter aims this far below the limit, for what the gyroscopic terms add within a hold.
SPEED_MARGIN = 1e-4
#: What a control law is given of the work array, in the order of `ControlInput`.
LAW_SLOTS = [Slot.SIGMA_BR, Slot.OMEGA_BR, Slot.OMEGA, Slot.OMEGA_R_B, Slot.DOMEGA_R_B, Slot.MOMENTUM]


class Release(NamedTuple):
    """How spacecraft leave the mothership in flight; until then they ride along without turning.

    Attributes:
        tick: Control period at which each leaves, shape (n,); 0: it has left at the start.
        push_N: What the deployer adds to its velocity then, shape (n, 3) [m/s].
        omega_BN_B: Its body rate from then on, shape (n, 3) [rad/s].
    """

    tick: Ints
    push_N: Array
    omega_BN_B: Array

    def next_after(self, tick: int) -> int:
        """When the next one leaves after an instant; `NEVER` where none does."""
        return int(self.tick[self.tick > tick].min(initial=NEVER))


@dataclass(frozen=True, kw_only=True)
class InitialState:
    """Where and how the swarm starts.

    Attributes:
        r_BN_N: Positions, shape (n, 3) [m].
        v_BN_N: Velocities, shape (n, 3) [m/s].
        sigma_BN: Attitudes as MRP, shape (n, 3).
        omega_BN_B: Body rates, shape (n, 3) [rad/s].
        wheel_speed: Relative to the hub, shape (n, w) [rad/s].
        seed: Of faults and dispersions, where the simulation has any.
        deployment: What went wrong on the way to this state.
        release: Who leaves the mothership later; None: all have left. The states of those are the mothership's.
    """

    r_BN_N: Array
    v_BN_N: Array
    sigma_BN: Array
    omega_BN_B: Array
    wheel_speed: Array
    seed: int = 0
    deployment: tuple[Event, ...] = ()
    release: Release | None = None

    def rows(self, w: int) -> tuple[Array, Array]:
        """The state as `SwarmModel.set_state` takes it for w wheels, shape (n, 7 + w) and (n, 6 + w); their angles are zero."""
        n = len(self.r_BN_N)
        qpos, qvel = np.zeros((n, NQ - 3 + w)), np.empty((n, NV - 3 + w))
        qpos[:, :3], qpos[:, 3:7] = self.r_BN_N, quaternion_from_mrp(self.sigma_BN)
        qvel[:, :3], qvel[:, 3:6], qvel[:, 6:] = self.v_BN_N, self.omega_BN_B, self.wheel_speed
        return qpos, qvel


class SavedFlight(NamedTuple):
    """What `Simulation.get_state` takes of a flight; only `Simulation.set_state` reads it.

    Attributes:
        initial: How the flight began, from which all that is drawn is drawn again.
        loop: See `LoopState.get_state`.
        behavior: What the behaviour remembers, and when it is asked next.
        law: What the control law remembers.
        faults: What has gone wrong; None: nothing can.
        slews: Those under way; None: the law turns as it does.
    """

    initial: InitialState
    loop: dict[str, Any]
    behavior: Any
    law: Any
    faults: Any
    slews: Any


class LoopState:
    """One flight of a swarm of n spacecraft.

    Args:
        model: The compiled swarm.
        properties: Mass properties and wheel limits of every spacecraft, as planned.
        environment: Gravity, rotation, Sun and Earth.
        period: Control period [s], a whole multiple of the model's timestep.
        gravity_gradient: Whether the torque of the central field acts; the field must know its `gm`.
        flights: Arrays for one flight, see `flights`; None: the flight gets its own.
        data: The state of its bodies; None: an MjData. In a `PlainData` no spacecraft can come to rest.

    Attributes:
        model: As given.
        properties: As given.
        environment: As given, gravity in cells, see `Environment.in_cells`; fault injection replaces it at the start of a
            flight whose gravity is dispersed.
        period: As given.
        timesteps: Of MuJoCo in a control period.
        gradient_gm: Gravitational parameter whose gradient turns the spacecraft [m^3/s^2]; 0: none does.
        data: MuJoCo's own state.
        flights: The arrays below as compiled code takes them, with one more axis in front, of length 1.
        qpos: The state in the layout of `kernels`, where MuJoCo does not hold it so, shape (n (7 + w),).
        qvel: The same of the velocities, shape (n (6 + w),).
        work: Vectors of the present decision, see `Slot`, shape (slots, n, 3).
        q_BN: Attitudes, shape (n, 4).
        q_RN: Reference attitudes, shape (n, 4).
        C_AN: Rotation from N to A at the decision, shape (3, 3).
        C_mid: The same at the middle of the hold, where forces are evaluated, shape (3, 3).
        earth_N: Position of Earth at the decision, shape (3,) [m].
        last_kind: `TargetKind` values of the last decision, shape (n,); -1: none yet.
        last_spacecraft: Spacecraft tracked at the last decision, shape (n,).
        released: Who has left the mothership, shape (n,); the others neither turn nor drive their wheels.
        restart: Whose target is another one than at the decision before, shape (n,).
        torque_B: What the control law asked of the wheels when compiled code or a diverging flight asked it, (n, 3) [N m].
        peaks: Largest wheel speed and motor torque, and how often a limit cut one, see `Peak`, shape (n, 3).
        targets: What the behaviour answered last.
        inputs: What control laws are given, as views of `work`.
        motor_torque: Of the wheels in order, shape (n w,) [N m]; MuJoCo's own `ctrl` where that holds nothing else.
        hub: Body ids of the hubs, shape (n,).
        wheel_axes_B: Rows, shape (w, 3).
        allocation: Maps a body torque to motor torques: minus the pseudo-inverse of the axes, shape (w, 3).
        speed_gain: Change of wheel speed in one hold per motor torque, at most [rad/s per N m].
        max_wheel_speed: At which the motors stop to accelerate a wheel, a little below the limit [rad/s].
        spin_N: Angular velocity of A in N, shape (3,) [rad/s].
        C_PN: Rotation from N to the pole frame, shape (3, 3).
        q_P: Attitude of the pole frame as MuJoCo's quaternion, shape (4,).

    Raises:
        ScenarioError: The control period is no whole multiple of the timestep.
        PluginError: The field does not know its gravitational parameter, and the gradient needs it.
    """

    def __init__(
        self,
        model: SwarmModel,
        *,
        properties: SpacecraftProperties,
        environment: Environment,
        period: float,
        gravity_gradient: bool = False,
        flights: Flights | None = None,
        data: Data | None = None,
    ) -> None:
        environment = environment.in_cells()
        self.model, self.properties, self.environment, self.period = model, properties, environment, period
        self.data = mujoco.MjData(model.mjmodel) if data is None else cast(mujoco.MjData, data)
        self.timesteps = timesteps_in(period, model)
        self.gradient_gm = _gm_of_field(environment) if gravity_gradient else 0.0
        self.flights = allocate_flights(1, model.n, properties.n_wheels) if flights is None else flights
        self._name_arrays()
        self._derive_constants()
        f = self.flights
        self.targets = Targets(f.kind[0], f.spacecraft[0], f.vector[0])  # none yet

    def _name_arrays(self) -> None:
        f = self.flights
        self.qpos, self.qvel, self.work, self.peaks, self.torque_B = (
            array[0] for array in (f.qpos, f.qvel, f.work, f.peaks, f.torque_B)
        )
        self.q_BN, self.q_RN, self.C_AN, self.C_mid, self.earth_N = (
            array[0] for array in (f.q_BN, f.q_RN, f.C_AN, f.C_mid, f.earth_N)
        )
        self.last_kind, self.last_spacecraft, self.restart = f.last_kind[0], f.last_spacecraft[0], f.restart[0]
        self.released = f.released[0]
        own = self.model.own is not None
        self.motor_torque = np.zeros(self.model.layout.ctrl.size) if own else self.data.ctrl

    def _derive_constants(self) -> None:
        properties, environment, n = self.properties, self.environment, self.model.n
        self.hub = np.ascontiguousarray(self.model.hub_body, np.int64)
        self.wheel_axes_B = np.ascontiguousarray(properties.wheel_axes_B)
        self.allocation = np.array(-np.linalg.pinv(properties.wheel_axes_B.T), np.float64, order="C")
        gain = 1.0 / properties.wheel_spin_inertia + (1.0 / np.diag(properties.inertia_effective_B)).max()
        self.speed_gain = self.period * float(gain)
        self.max_wheel_speed = (1.0 - SPEED_MARGIN) * properties.max_wheel_speed
        self.spin_N, self.C_PN = environment.spin_N, np.array(environment.C_PN, order="C")
        self.q_P = _quaternion_of(self.C_PN)
        inertia_B = np.repeat(properties.inertia_B[None], n, axis=0)
        inertia_effective_B = np.repeat(properties.inertia_effective_B[None], n, axis=0)
        vectors = [self.work[slot] for slot in LAW_SLOTS]
        self.inputs = control_input(vectors, inertia_B, inertia_effective_B, self.period)

    @property
    def tick(self) -> int:
        """Control periods flown."""
        return int(self.flights.tick[0])

    @tick.setter
    def tick(self, tick: int) -> None:
        self.flights.tick[0] = tick

    @property
    def time(self) -> float:
        """Seconds past the epoch, counted in whole control periods."""
        return self.tick * self.period

    def rows(self) -> tuple[Array, Array]:
        """Positions and velocities by spacecraft, see `SwarmModel.state`."""
        return self.model.state(self.data)

    def set_rows(self, qpos: Array, qvel: Array) -> None:
        """Write what `rows` gives."""
        self.model.set_state(self.data, qpos, qvel)

    def command_motors(self) -> None:
        """Hand `motor_torque` to MuJoCo, where that is another array."""
        if self.model.own is not None:
            self.data.ctrl[self.model.layout.ctrl.ravel()] = self.motor_torque

    def set_targets(self, targets: Targets) -> None:
        """Aim at other targets from the next decision on that compiled code makes."""
        self.targets, f = targets, self.flights
        f.kind[0], f.spacecraft[0], f.vector[0] = targets

    def reset(self, initial: InitialState) -> None:
        """Put the swarm at its start."""
        mujoco.mj_resetData(self.model.mjmodel, self.data)
        self.model.start(self.data, *initial.rows(self.properties.n_wheels))
        self.tick, self.last_kind[:], self.last_spacecraft[:], self.peaks[:] = 0, -1, -1, 0.0
        self.released[:] = True if initial.release is None else initial.release.tick <= 0

    def get_state(self) -> dict[str, Any]:
        """Arrays, targets and MuJoCo's state, copied."""
        return {
            "arrays": [array.copy() for array in (*self.flights, self.motor_torque)],
            "targets": [part.copy() for part in self.targets],
            "data": saved_data(self.data),
        }

    def set_state(self, state: dict[str, Any]) -> None:
        """Go on from what `get_state` gave."""
        restore_data(self.data, state["data"])
        for array, value in zip((*self.flights, self.motor_torque), state["arrays"], strict=True):
            array[:] = value
        self.targets = Targets(*(part.copy() for part in state["targets"]))

    def let_go(self, release: Release) -> bool:
        """Push off those that leave the mothership now; whether anybody does."""
        due = ~self.released & (release.tick <= self.tick)
        if not due.any():
            return False
        qpos, qvel = (rows.copy() for rows in self.rows())
        qvel[due, :3] += release.push_N[due]
        qvel[due, 3:6] = release.omega_BN_B[due]
        self.set_rows(qpos, qvel)
        self.released[due], self.last_kind[due] = True, -1
        return True


def control_input(
    vectors: Sequence[Array] | Array, inertia_B: Array, inertia_effective_B: Array, period: float
) -> ControlInput:
    """What control laws are given, from vectors in the order of `LAW_SLOTS`, shape (6, n, 3)."""
    sigma_BR, omega_BR, omega, omega_R, domega_R, momentum = vectors
    return ControlInput(sigma_BR, omega_BR, omega, omega_R, domega_R, momentum, inertia_B, inertia_effective_B, period)


def _gm_of_field(environment: Environment) -> float:
    gm = getattr(environment.gravity, "gm", None)
    if gm is None:
        raise PluginError("the gravity-gradient torque needs a gravity field with an attribute gm [m^3/s^2]")
    return float(gm)


def _quaternion_of(C_PN: Array) -> Array:
    quaternion = np.empty(4)
    mujoco.mju_mat2Quat(quaternion, np.ascontiguousarray(C_PN.T).ravel())
    return quaternion
