"""The simulation of one flight: MuJoCo integrates in N while gravity, behaviour, guidance and control act on it.

Every control period the state is read, the forces of the coming hold are evaluated at its middle, the behaviour names the
targets, guidance turns them into references, the controller answers with torques, and MuJoCo steps on with all of it held.
Where `why_not_compiled` finds nothing against it, compiled code does all of this from one question to the behaviour to the
next; else `python_loop` does it call by call, from the same kernels and to the same bits.
"""

from __future__ import annotations

from copy import copy
from dataclasses import replace

import mujoco
import numpy as np

from swarm_mj.errors import PluginError, SimulationError
from swarm_mj.mission.behaviors import Behavior, SwarmView, Targets
from swarm_mj.plugins import name_of
from swarm_mj.simulator import python_loop
from swarm_mj.simulator.compiled_flight import CompiledFlight
from swarm_mj.simulator.fast import world
from swarm_mj.simulator.fast.flight_kernels import ADVANCE, DECIDE, NO_SUCH_TARGET, NOT_FINITE
from swarm_mj.simulator.fast.flights import NEVER, World
from swarm_mj.simulator.fast.integrator import Integrator
from swarm_mj.simulator.fault_injection import NOTHING, FaultInjection
from swarm_mj.simulator.faults.impact import ImpactWatch
from swarm_mj.simulator.faults.schedule import Event
from swarm_mj.simulator.faults.state import FaultModel
from swarm_mj.simulator.loop_state import InitialState, LoopState, Release, SavedFlight
from swarm_mj.simulator.plugin_calls import BehaviorCalls, ControllerCalls, no_such_target, view_of
from swarm_mj.simulator.propulsion import Propulsion
from swarm_mj.simulator.recorder import Progress, Record, Recorder
from swarm_mj.simulator.slews import Slews
from swarm_mj.smallbody.environment import Environment
from swarm_mj.smallbody.shape import ShapeModel
from swarm_mj.spacecraft.control.base import Controller
from swarm_mj.spacecraft.control.force import ForceLaw
from swarm_mj.spacecraft.model import SwarmModel
from swarm_mj.spacecraft.properties import SpacecraftProperties
from swarm_mj.typing import Array, Mask


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
        force_law: Who asks the thrusters for forces; None: nobody, and they stay shut.
        shape: The body, to look for impacts while `run` flies; None: nobody looks.
        quickest_slews: Whether turns to new targets go by the quickest profile, see `Slews`, and not by the law's gains.
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
        force_law: ForceLaw | None = None,
        shape: ShapeModel | None = None,
        quickest_slews: bool = False,
        compiled: bool = True,
    ) -> None:
        if fault_model is None and properties.n_wheels != 3:
            fault_model = NOTHING
        if fault_model is not None or properties.thrusters is not None:
            # Masses and limits are drawn for this flight alone, and tanks run empty.
            model = replace(model, mjmodel=copy(model.mjmodel))
        self.state = LoopState(
            model,
            properties=properties,
            environment=environment,
            period=control_period,
            gravity_gradient=gravity_gradient_torque,
        )
        self.injection = None if fault_model is None else FaultInjection(self.state, fault_model)
        self.propulsion = None if properties.thrusters is None else Propulsion(self.state, properties.thrusters)
        self.slews = Slews(self.state) if quickest_slews else None
        self.impact_watch = None if shape is None else ImpactWatch(shape, environment, control_period)
        self._integrator = Integrator(model, self.state.data)
        self._behaviors, self._law = BehaviorCalls([behavior], control_period), ControllerCalls(controller)
        self._compiled = compiled
        self._world: World | None = None
        self._compiled_flight = CompiledFlight(self.state, self._integrator, self.injection)
        self._gave_up = False
        self._release: Release | None = None
        self._initial: InitialState | None = None
        if force_law is not None:
            self._set_force_law(force_law)

    @property
    def model(self) -> SwarmModel:
        """The compiled swarm; a copy of its own where faults or dispersions change it."""
        return self.state.model

    @property
    def properties(self) -> SpacecraftProperties:
        """Mass properties and wheel limits, as planned."""
        return self.state.properties

    @property
    def environment(self) -> Environment:
        """The body's surroundings; with dispersed gravity, those drawn at the last reset."""
        return self.state.environment

    @property
    def data(self) -> mujoco.MjData:
        """MuJoCo's state, live."""
        return self.state.data

    @property
    def period(self) -> float:
        """Control period [s]."""
        return self.state.period

    @property
    def behavior(self) -> Behavior:
        """Who points at what; another one may take over in flight, without memory."""
        return self._behaviors.behaviors[0]

    @behavior.setter
    def behavior(self, behavior: Behavior) -> None:
        self._behaviors = BehaviorCalls([behavior], self.period)

    @property
    def controller(self) -> Controller:
        """The attitude control law; another one may take over in flight, without memory."""
        return self._law.controller

    @controller.setter
    def controller(self, controller: Controller) -> None:
        self._law = ControllerCalls(controller)
        fit = self._compiled and not self.why_not_compiled(controller)
        self._world = world.make_world(self.state, controller) if fit else None
        self.ask_again()  # what was decided in Python is not known to compiled code

    @property
    def force_law(self) -> ForceLaw | None:
        """Who asks the thrusters for forces; another one may take over in flight, without memory.

        Raises:
            PluginError: The spacecraft have no thrusters.
            SimulationError: They cannot push as the law needs.
        """
        return None if self.propulsion is None else self.propulsion.law

    @force_law.setter
    def force_law(self, law: ForceLaw | None) -> None:
        self._set_force_law(law)
        self.controller = self._law.controller  # compiled code knows no forces

    def _set_force_law(self, law: ForceLaw | None) -> None:
        if self.propulsion is not None:
            self.propulsion.law = law
        elif law is not None:
            raise PluginError(
                f"the force law {name_of(law)}: the spacecraft have no thrusters; give spacecraft.thrusters, or "
                "SpacecraftProperties(thrusters=...)"
            )

    def why_not_compiled(self, controller: Controller | None) -> str:
        """What of this flight compiled code does not know, in words; empty if it can fly it.

        Args:
            controller: The control law; None where torques are held.
        """
        if self.model.own is not None:
            return f"a spacecraft of its own file, {self.model.own.path.name}"
        if self.slews is not None:
            return "the quickest slews (control.slew = time_optimal)"
        if self.force_law is not None:
            return "thrusters"
        return world.why_not_compiled(self.state, controller)

    @property
    def tick(self) -> int:
        """Control periods flown."""
        return self.state.tick

    @property
    def time(self) -> float:
        """Seconds past the epoch, counted in whole control periods."""
        return self.state.time

    @property
    def lost(self) -> Mask:
        """Spacecraft that no longer work, shape (n,); they drift on."""
        return np.zeros(self.model.n, np.bool_) if self.injection is None else self.injection.faults.lost

    @property
    def camera_on(self) -> Mask:
        """Spacecraft that can take pictures, shape (n,)."""
        working = ~self.lost & self.state.released
        return working if self.injection is None else self.injection.faults.camera_on & working

    @property
    def events(self) -> list[Event]:
        """What went wrong so far, in order of time."""
        return [] if self.injection is None else self.injection.faults.events

    @property
    def motor_torque(self) -> Array:
        """Torques of the motors, without friction in the bearings, of all wheels in order, shape (n w,) [N m]."""
        return self.state.motor_torque if self.injection is None else self.injection.faults.wheels.motor.ravel()

    @property
    def stepper(self) -> str:
        """How the flight is stepped: fast, or mj_step."""
        return self._integrator.stepper

    @property
    def why_mj_step(self) -> str:
        """Why the flight is stepped by `mj_step`; empty where it is not."""
        return self._integrator.why

    def known(self) -> tuple[Array, Array] | None:
        """Attitudes (n, 4) and body rates (n, 3) [rad/s] as the flight software has them now; None where it has the truth.

        The controller is given the same by the decision that follows; asking ahead of it changes nothing in the flight.
        """
        if self.injection is None:
            return None
        return self.injection.known_now(self.time, self.tick, *self.model.state(self.data))

    def reset(self, initial: InitialState) -> None:
        """Put the swarm at its start and forget everything; faults and dispersions are drawn from the state's seed."""
        if self.propulsion is not None:
            self.propulsion.refill()
        if self.injection is not None:
            self.injection.reset(initial.seed, initial.deployment)
        if self.propulsion is not None:
            self.propulsion.reset()
        if self.impact_watch is not None:
            self.impact_watch.reset()
        self.state.reset(initial)
        self._release, self._initial, self._gave_up = initial.release, initial, False
        self._behaviors.reset(0)
        self.controller = self._law.controller

    def get_state(self) -> SavedFlight:
        """All that the flight is between two control periods, a copy that can be pickled; `set_state` goes on from it.

        Raises:
            SimulationError: The flight has not begun, or its thrusters fire, whose tanks and programme are not saved.
        """
        if self._initial is None:
            raise SimulationError("the flight has not begun, so that it has no state; call reset first")
        if self.force_law is not None:
            raise SimulationError(
                f"the state of a flight cannot be taken while thrusters fly the force law {name_of(self.force_law)}; leave "
                "trajectory.corrections and spacecraft.thrusters out"
            )
        return SavedFlight(
            initial=self._initial,
            loop=self.state.get_state(),
            behavior=self._behaviors.get_state(0),
            law=self._law.get_state(),
            faults=None if self.injection is None else self.injection.get_state(),
            slews=None if self.slews is None else self.slews.get_state(),
        )

    def set_state(self, saved: SavedFlight) -> None:
        """Go on from what `get_state` of such a simulation gave, bit for bit; impacts are watched for anew."""
        self.reset(saved.initial)
        self.state.set_state(saved.loop)
        self._behaviors.set_state(0, saved.behavior)
        self._law.set_state(saved.law)
        if self.injection is not None:
            self.injection.set_state(saved.faults)
        if self.slews is not None:
            self.slews.set_state(saved.slews)

    def ask_again(self) -> None:
        """Have the behaviour asked at the next decision, because it or the state has been told something new."""
        self._behaviors.due[0] = 0

    def decide(self) -> Targets:
        """Read the state and set forces and motor torques for the coming hold.

        Raises:
            SimulationError: The state is no longer finite.
        """
        self._let_go()
        if self._world is not None and self._ask() and self._fly(self._world, DECIDE, NEVER):
            return self.state.targets
        return python_loop.decide(self.state, self._behaviors, self._law, self.injection, self.propulsion, self.slews)

    def advance(self) -> None:
        """Let MuJoCo integrate one control period with everything held."""
        if self._world is not None and self._compiled_code_may():
            self._fly(self._world, ADVANCE, NEVER)
        else:
            self._integrator.step(self.state.timesteps)
            self.state.tick += 1
            if self.propulsion is not None:
                self.propulsion.burn()

    def step(self) -> None:
        """Fly one control period: decide and advance.

        Raises:
            SimulationError: The state is no longer finite.
        """
        self.fly(1)

    def fly(self, periods: int) -> None:
        """Decide and advance so many control periods: the same as calling `decide` and `advance` in turn, but faster.

        Raises:
            SimulationError: The state is no longer finite.
        """
        end = self.tick + periods
        while self.tick < end:
            self._let_go()
            if self._world is not None and self._ask():
                next_release = NEVER if self._release is None else self._release.next_after(self.tick)
                self._fly(self._world, DECIDE | ADVANCE, min(end, int(self._behaviors.due[0]), next_release))
            else:
                self.decide()
                self.advance()

    def _let_go(self) -> None:
        """Release those whose time has come; the behaviour is asked anew, for they fly elsewhere from now on."""
        if self._release is not None and self.state.let_go(self._release):
            self.ask_again()

    def _compiled_code_may(self) -> bool:
        """Whether compiled code may fly on: not where the flight of a spacecraft is over, or where something diverged."""
        return not self._gave_up and (self.injection is None or not self.injection.faults.resting)

    def _ask(self) -> bool:
        """Let happen what is due, ask the behaviour if that is due, set the targets; whether compiled code may fly on."""
        state, injection = self.state, self.injection
        if not self._compiled_code_may():
            return False
        if state.tick < self._behaviors.due[0] and (injection is None or state.tick < injection.due):
            return True
        q, v = state.rows()
        if not (np.isfinite(q).all() and np.isfinite(v).all()):
            return self._give_up()
        view = view_of(state.time, state.environment.C_AN(state.time), q, v)
        state.set_targets(self._targets(view) if injection is None else injection.aim(view, self._targets))
        return True

    def _targets(self, view: SwarmView) -> Targets:
        return self._behaviors.ask(0, view, self.state.tick)

    def _give_up(self) -> bool:
        """Leave a flight that diverged to Python, which loses the spacecraft and flies on; never true.

        Raises:
            SimulationError: The flight knows no faults, and so loses nobody.
        """
        if self.injection is None:
            raise SimulationError(self._divergence())
        self._gave_up = True
        return False

    def _fly(self, compiled_world: World, part: int, until: int) -> bool:
        """Let compiled code do what it is asked to, see `flight_kernels.fly`; whether it could."""
        outcome = self._compiled_flight.fly(compiled_world, part, until)
        if outcome == NO_SUCH_TARGET:
            raise PluginError(no_such_target(self.state.targets))
        return outcome != NOT_FINITE or self._give_up()

    def run(self, duration: float, interval: float, progress: Progress | None = None) -> Record:
        """Fly from the present state and sample.

        Args:
            duration: [s], a whole multiple of `interval`.
            interval: Time between samples [s], a whole multiple of the control period.
            progress: Called with the time reached [s], about a hundred times, or several times a second.

        Raises:
            SimulationError: A spacecraft hit the body or the state is no longer finite; the message gives time and spacecraft.
                Where faults are flown, the spacecraft is lost instead and the others fly on.
        """
        return Recorder(self, duration, interval, progress).fly()

    def _divergence(self) -> str:
        return python_loop.divergence(self.state, self.controller)
