"""The simulation of one flight: MuJoCo integrates in N while gravity, behaviour, guidance and control act on it.

Every control period the state is read, the forces of the coming hold are evaluated at its middle, the behaviour names the
targets, guidance turns them into references, the controller answers with torques, and MuJoCo steps on with all of it held.
Where `why_not_compiled` finds nothing against it, compiled code does all of this from one question to the behaviour to the
next; else `deciding` does it call by call, from the same kernels and to the same bits.
"""

from __future__ import annotations

from copy import copy
from dataclasses import replace

import mujoco
import numpy as np

from swarm_mj.errors import PluginError, SimulationError
from swarm_mj.mission.behaviors import Behavior, Targets
from swarm_mj.simulator.asking import Asking, view_of
from swarm_mj.simulator.fast import flight_kernels
from swarm_mj.simulator.fast.flight_kernels import (
    ADVANCE,
    DECIDE,
    NEVER,
    NOT_FINITE,
    SENSELESS,
    WHOLE,
    World,
    no_flights,
)
from swarm_mj.simulator.fast.integrator import Integrator, timesteps_in
from swarm_mj.simulator.fast.world import SPEED_MARGIN, control_inputs, make_world, why_not_compiled
from swarm_mj.simulator.fault_injection import NOTHING, FaultInjection
from swarm_mj.simulator.faults.impact import ImpactWatch
from swarm_mj.simulator.faults.schedule import Event
from swarm_mj.simulator.faults.state import FaultModel
from swarm_mj.simulator.plugin_calls import divergence_of
from swarm_mj.simulator.python_loop import decide
from swarm_mj.simulator.recorder import Progress, Recorder
from swarm_mj.simulator.records import InitialState, Record
from swarm_mj.smallbody.environment import Environment
from swarm_mj.smallbody.shape import ShapeModel
from swarm_mj.spacecraft.attitude.mrp import quaternion_from_mrp
from swarm_mj.spacecraft.control.base import Controller
from swarm_mj.spacecraft.model import NQ, NV, SwarmModel
from swarm_mj.spacecraft.properties import SpacecraftProperties
from swarm_mj.typing import Array, Mask

#: The only flight of a simulation.
_THE_ONE = np.ones(1, np.bool_)


class Simulation:
    """A swarm in flight.

    Args:
        model: The compiled swarm.
        properties: The spacecraft's mass properties and wheel limits.
        environment: Gravity, rotation, Sun and Earth.
        behavior: Who points at what.
        controller: The attitude control law.
        control_period: How long torques and forces are held [s]; a whole multiple of the model's timestep.
        gravity_gradient_torque: Whether the torque of the central field acts; the field must know its `gm`.
        fault_model: What may go wrong; None: nothing, all is as planned.
        shape: The body, to look for impacts while `run` flies; None: nobody looks.
        compiled: Whether compiled code flies what it can; if not, every decision is made in Python, where it can be followed.

    Raises:
        ScenarioError: The control period is no whole multiple of the timestep.
        PluginError: A plug-in does not fit what is asked of it.
    """

    def __init__(
        self,
        model: SwarmModel,
        *,
        properties: SpacecraftProperties,
        environment: Environment,
        behavior: Behavior,
        controller: Controller,
        control_period: float = 0.5,
        gravity_gradient_torque: bool = False,
        fault_model: FaultModel | None = None,
        shape: ShapeModel | None = None,
        compiled: bool = True,
    ) -> None:
        if fault_model is None and properties.n_wheels != 3:
            fault_model = NOTHING
        if fault_model is not None:
            # Masses and limits are drawn for this flight alone.
            model = replace(model, mjmodel=copy(model.mjmodel))
        self.model, self.properties, self.environment = model, properties, environment
        self.period, self._controller = control_period, controller
        self.data = mujoco.MjData(model.mjmodel)
        self._hold = timesteps_in(control_period, model)
        self._gradient_gm = self._gm_of_field() if gravity_gradient_torque else 0.0
        self._allocate_arrays(model.n)
        self._watch = None if shape is None else ImpactWatch(shape, environment, control_period)
        self._adverse = None if fault_model is None else FaultInjection(self, fault_model, SPEED_MARGIN)
        self._integrator = Integrator(model, self.data)
        self._asking = Asking([behavior], control_period)
        self._compiled = compiled
        self._world: World | None = None
        self._controller_memory: Array | None = None
        kind, index = self._flight.targets[0, :2]
        self._targets = Targets(kind, index, self._flight.vector[0])  # none yet

    def _gm_of_field(self) -> float:
        gm = getattr(self.environment.gravity, "gm", None)
        if gm is None:
            raise PluginError("the gravity-gradient torque needs a gravity field with an attribute gm [m^3/s^2]")
        return float(gm)

    def _allocate_arrays(self, n: int) -> None:
        properties, environment = self.properties, self.environment
        axes = properties.wheel_axes_B
        self._flight = f = no_flights(1, n)
        self._work, self._peaks, self._aim = f.work[0], f.peaks[0], f.targets[0, 2:]
        self._qpos, self._qvel = f.qpos[0], f.qvel[0]
        self._q_BN, self._q_RN, self._C_AN, self._C_mid = f.q[0, 0], f.q[0, 1], f.C[0, 0], f.C[0, 1]
        self._restart = np.zeros(n, np.bool_)
        self._hub = np.ascontiguousarray(self.model.hub_body, np.int64)
        self._axes = np.ascontiguousarray(axes)
        self._allocation = -np.linalg.pinv(axes.T)
        gain = 1.0 / properties.wheel_spin_inertia + (1.0 / np.diag(properties.inertia_effective_B)).max()
        self._speed_gain = self.period * float(gain)
        self._spin_N = environment.spin_N
        self._C_PN = np.ascontiguousarray(environment.C_PN)
        self._q_P = _quaternion_of(self._C_PN)
        self._inputs = control_inputs(self._work, properties, self.period)

    @property
    def behavior(self) -> Behavior:
        """Who points at what; another one may take over in flight, without memory."""
        return self._asking.behaviors[0]

    @behavior.setter
    def behavior(self, behavior: Behavior) -> None:
        self._asking = Asking([behavior], self.period)

    @property
    def controller(self) -> Controller:
        """The attitude control law; another one may take over in flight, without memory."""
        return self._controller

    @controller.setter
    def controller(self, controller: Controller) -> None:
        self._controller, self._controller_memory = controller, None
        fit = self._compiled and not why_not_compiled(self, controller)
        self._world = make_world(self, controller) if fit else None

    @property
    def tick(self) -> int:
        """Control periods flown."""
        return int(self._flight.tick[0])

    @property
    def time(self) -> float:
        """Seconds past the epoch, counted in whole control periods."""
        return self.tick * self.period

    @property
    def lost(self) -> Mask:
        """Spacecraft that no longer work, shape (n,); they drift on."""
        return np.zeros(self.model.n, np.bool_) if self._adverse is None else self._adverse.flight.lost

    @property
    def camera_on(self) -> Mask:
        """Spacecraft that can take pictures, shape (n,)."""
        return ~self.lost if self._adverse is None else self._adverse.flight.camera_on & ~self.lost

    @property
    def events(self) -> list[Event]:
        """What went wrong so far, in order of time."""
        return [] if self._adverse is None else self._adverse.flight.events

    @property
    def motor_torque(self) -> Array:
        """Torques of the motors, without friction in the bearings, of all wheels in order, shape (n w,) [N m]."""
        return self.data.ctrl if self._adverse is None else self._adverse.flight.wheels.motor.ravel()

    def known(self) -> tuple[Array, Array] | None:
        """Attitudes (n, 4) and body rates (n, 3) [rad/s] as the flight software has them now; None where it has the truth.

        The controller is given the same by the decision that follows; asking ahead of it changes nothing in the flight.
        """
        if self._adverse is None:
            return None
        return self._adverse.known_now(self.time, self.tick, *self.model.state(self.data))

    def reset(self, initial: InitialState) -> None:
        """Put the swarm at its start and forget everything; faults and dispersions are drawn from the state's seed."""
        n, w = self.model.n, self.properties.n_wheels
        if self._adverse is not None:
            self._adverse.reset(initial.seed, initial.deployment)
        if self._watch is not None:
            self._watch.reset()
        mujoco.mj_resetData(self.model.mjmodel, self.data)
        qpos, qvel = np.zeros((n, NQ - 3 + w)), np.empty((n, NV - 3 + w))
        qpos[:, :3], qpos[:, 3:7] = initial.r_BN_N, quaternion_from_mrp(initial.sigma_BN)
        qvel[:, :3], qvel[:, 3:6], qvel[:, 6:] = initial.v_BN_N, initial.omega_BN_B, initial.wheel_speed
        self.model.set_state(self.data, qpos, qvel)
        self._flight.tick[0], self._aim[:], self._peaks[:] = 0, -1, 0.0
        self._asking.reset(0)
        self.controller = self._controller

    def ask_again(self) -> None:
        """Have the behaviour asked at the next decision, because it or the state has been told something new."""
        self._asking.due[0] = 0

    def decide(self) -> Targets:
        """Read the state and set forces and motor torques for the coming hold.

        Raises:
            SimulationError: The state is no longer finite.
        """
        if self._world is not None:
            self._ask()
            self._fly(DECIDE, NEVER)
            return self._targets
        return decide(self)

    def advance(self) -> None:
        """Let MuJoCo integrate one control period with everything held."""
        if self._world is not None:
            self._fly(ADVANCE, NEVER)
        else:
            self._integrator.step(self._hold)
            self._flight.tick[0] += 1

    def fly(self, periods: int) -> None:
        """Decide and advance so many control periods: the same as calling `decide` and `advance` in turn, but faster.

        Raises:
            SimulationError: The state is no longer finite.
        """
        end = self.tick + periods
        while self.tick < end:
            if self._world is None:
                self.decide()
                self.advance()
            else:
                self._ask()
                self._fly(WHOLE, min(end, int(self._asking.due[0])))

    def _ask(self) -> None:
        """Ask the behaviour if that is due, and set the targets that compiled code flies."""
        if self.tick < self._asking.due[0]:
            return
        t, (q, v) = self.time, self.model.state(self.data)
        if not (np.isfinite(q).all() and np.isfinite(v).all()):
            raise SimulationError(self._divergence())
        view = view_of(t, self.environment.C_AN(t), q, v)
        self._targets = targets = self._asking.ask(0, view, self.tick)
        kind, index = self._flight.targets[0, :2]
        kind[:], index[:], self._flight.vector[0] = targets

    def _fly(self, part: int, until: int) -> None:
        """Let compiled code do what it is asked to, see `flight_kernels.fly`."""
        swarms, ticks = self._integrator.swarms, np.array([until])
        answer = flight_kernels.fly(self._world, self._flight, swarms, self._hold, part, _THE_ONE, ticks)
        self.data.time = self.time
        if answer == SENSELESS:
            raise PluginError(self._aims_at_nothing(self._targets))
        if answer == NOT_FINITE:
            raise SimulationError(self._divergence())

    def run(self, duration: float, interval: float, progress: Progress | None = None) -> Record:
        """Fly from the present state and sample.

        Args:
            duration: [s], a whole multiple of `interval`.
            interval: Time between samples [s], a whole multiple of the control period.
            progress: Called with the time reached [s], about a hundred times.

        Raises:
            SimulationError: A spacecraft hit the body or the state is no longer finite; the message gives time and spacecraft.
                Where faults are flown, the spacecraft is lost instead and the others fly on.
        """
        return Recorder(self, duration, interval, progress).fly()

    def _aims_at_nothing(self, targets: Targets) -> str:
        return (
            f"the behaviour aims at what is not there: kinds {targets.kind.tolist()}, spacecraft "
            f"{targets.spacecraft.tolist()} of {self.model.n}, counted from 0"
        )

    def _divergence(self) -> str:
        state, torque_B = np.hstack(self.model.state(self.data)), self._flight.torque_B[0]
        return divergence_of(state, torque_B, self.controller, self.model.names, self.time)


def _quaternion_of(C_PN: Array) -> Array:
    quaternion = np.empty(4)
    mujoco.mju_mat2Quat(quaternion, np.ascontiguousarray(C_PN.T).ravel())
    return quaternion
