"""The simulation of one flight: a batch of one, by names.

Every control period the state is read, the forces of the coming hold are evaluated at its middle, the behaviour names the
targets, guidance turns them into references, the controller answers with torques, and the swarm is stepped with all of it held;
see `swarm_mj.simulator.loop`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np

from swarm_mj.errors import SimulationError
from swarm_mj.mission.behaviors import Behavior, Targets
from swarm_mj.simulator.batch import FlightBatch, FlightSetup
from swarm_mj.simulator.fault_injection import NOTHING, FaultInjection
from swarm_mj.simulator.faults.impact import ImpactWatch
from swarm_mj.simulator.faults.schedule import Event
from swarm_mj.simulator.faults.state import FaultModel
from swarm_mj.simulator.propulsion import Propulsion
from swarm_mj.simulator.record import Progress, Record, Recorder
from swarm_mj.simulator.state import FlightState, InitialState
from swarm_mj.smallbody.environment import Environment
from swarm_mj.smallbody.shape import ShapeModel
from swarm_mj.spacecraft.control.base import Controller
from swarm_mj.spacecraft.control.force import ForceLaw
from swarm_mj.spacecraft.model import SwarmModel
from swarm_mj.spacecraft.properties import SpacecraftProperties
from swarm_mj.typing import Array, Mask

_ONE = np.ones(1, np.bool_)


class Simulation:
    """A swarm in flight.

    Args:
        model: The compiled swarm, with its mass properties and wheel limits; its `stepper` says who steps.
        environment: Gravity, rotation, Sun and Earth.
        behavior: Who points at what.
        controller: The attitude control law.
        control_period: How long torques and forces are held [s]; a whole multiple of the model's timestep.
        gravity_gradient_torque: Whether the torque of the central field acts; the field must know its `gm`.
        fault_model: What may go wrong; None: nothing, all is as planned.
        force_law: Who asks the thrusters for forces; None: nobody, and they stay shut.
        shape: The body, to look for impacts while `run` flies; None: nobody looks.
        quickest_slews: Whether turns to new targets go by the quickest profile, see `Slews`, and not by the law's gains.

    Attributes:
        setup: What a `FlightBatch` of more such flights takes.
        batch: The batch of one that flies.
        state: The flight's arrays.
        impact_watch: Who looks for impacts; None: nobody.

    Raises:
        ScenarioError: The control period is no whole multiple of the timestep.
        PluginError: A plug-in does not fit what is asked of it.
    """

    def __init__(
        self,
        model: SwarmModel,
        *,
        environment: Environment,
        behavior: Behavior,
        controller: Controller,
        control_period: float = 0.5,
        gravity_gradient_torque: bool = False,
        fault_model: FaultModel | None = None,
        force_law: ForceLaw | None = None,
        shape: ShapeModel | None = None,
        quickest_slews: bool = False,
    ) -> None:
        if fault_model is None and model.properties.n_wheels != 3:
            fault_model = NOTHING  # telemetry then tells of every wheel
        self.setup = FlightSetup(
            model=model,
            environment=environment,
            period=control_period,
            gravity_gradient=gravity_gradient_torque,
            fault_model=fault_model,
            quickest_slews=quickest_slews,
        )
        self.batch = FlightBatch(self.setup, 1, controller, [behavior], force_law)
        self.state: FlightState = self.batch.state(0)
        self.impact_watch = None if shape is None else ImpactWatch(shape, environment, control_period)
        self._copy: mujoco.MjData | None = None

    @property
    def model(self) -> SwarmModel:
        """The compiled swarm; a copy of its own where faults or dispersions change it."""
        return self.state.model

    @property
    def properties(self) -> SpacecraftProperties:
        """Mass properties and wheel limits, as planned."""
        return self.model.properties

    @property
    def environment(self) -> Environment:
        """The body's surroundings; with dispersed gravity, those drawn at the last reset."""
        return self.state.environment

    @property
    def data(self) -> mujoco.MjData:
        """MuJoCo's state, live; where the kernel steps, a copy that is brought up to date now."""
        if self.state.data is not None:
            return self.state.data
        if self._copy is None:
            self._copy = mujoco.MjData(self.model.mjmodel)
        s = self.state
        angles = np.zeros_like(s.wheel_speed)
        self.model.set_state(
            self._copy, np.hstack((s.r_N, s.q_BN, angles)), np.hstack((s.v_N, s.omega_B, s.wheel_speed))
        )
        self._copy.time = self.time
        return self._copy

    @property
    def period(self) -> float:
        """Control period [s]."""
        return self.batch.period

    @property
    def behavior(self) -> Behavior:
        """Who points at what; another one may take over in flight, without memory."""
        return self.batch.behaviors[0]

    @behavior.setter
    def behavior(self, behavior: Behavior) -> None:
        self.batch.behaviors = [behavior]

    @property
    def controller(self) -> Controller:
        """The attitude control law; another one may take over in flight, without memory."""
        controller = self.batch.controller
        assert controller is not None
        return controller

    @controller.setter
    def controller(self, controller: Controller) -> None:
        self.batch.controller = controller

    @property
    def force_law(self) -> ForceLaw | None:
        """Who asks the thrusters for forces; another one may take over in flight, without memory.

        Raises:
            PluginError: The spacecraft have no thrusters.
            SimulationError: They cannot push as the law needs.
        """
        return self.batch.force_law

    @force_law.setter
    def force_law(self, law: ForceLaw | None) -> None:
        self.batch.force_law = law

    @property
    def injection(self) -> FaultInjection | None:
        """What goes wrong; None: nothing can."""
        return self.batch.injection(0)

    @property
    def propulsion(self) -> Propulsion | None:
        """The thrusters; None: there are none."""
        return self.batch.propulsion(0)

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
        """Spacecraft that no longer work, a copy, shape (n,); they drift on."""
        return self.state.lost.copy()

    @property
    def camera_on(self) -> Mask:
        """Spacecraft that can take pictures, shape (n,)."""
        on: Mask = ~self.batch.blind[0]
        return on

    @property
    def events(self) -> list[Event]:
        """What went wrong so far, in order of time."""
        return [] if self.injection is None else self.injection.faults.events

    @property
    def motor_torque(self) -> Array:
        """Torques of the motors, without friction in the bearings, of all wheels in order, shape (n w,) [N m]."""
        return (self.state.motor if self.injection is None else self.injection.faults.wheels.motor).ravel()

    @property
    def stepper(self) -> str:
        """Who steps: mujoco or kernel."""
        return self.model.stepper

    def known(self) -> tuple[Array, Array] | None:
        """Attitudes (n, 4) and body rates (n, 3) [rad/s] as the flight software has them now; None where it has the truth."""
        q, omega = self.state.q_BN[None].copy(), self.state.omega_B[None].copy()
        return (q[0], omega[0]) if self.batch.know(_ONE, q, omega)[0] else None

    def reset(self, initial: InitialState) -> None:
        """Put the swarm at its start and forget everything; faults and dispersions are drawn from the state's seed."""
        self.batch.reset(0, initial)
        if self.impact_watch is not None:
            self.impact_watch.reset()

    def get_state(self) -> dict[str, Any]:
        """All that the flight is between two control periods, a copy that can be pickled; `set_state` goes on from it.

        Raises:
            SimulationError: The flight has not begun, or its thrusters fire, whose tanks and programme are not saved.
        """
        return self.batch.get_state(0)

    def set_state(self, saved: dict[str, Any]) -> None:
        """Go on from what `get_state` of such a simulation gave, bit for bit; impacts are watched for anew."""
        self.batch.set_state(0, saved)
        if self.impact_watch is not None:
            self.impact_watch.reset()

    def ask_again(self) -> None:
        """Have the behaviour asked at the next decision, because it or the state has been told something new."""
        self.batch.ask_again()

    def decide(self) -> Targets:
        """Read the state and set forces and motor torques for the coming hold, if that has not been done.

        Raises:
            SimulationError: The state is no longer finite.
        """
        self._must(self.batch.decide)
        return self.state.targets

    def advance(self) -> None:
        """Integrate one control period with everything held; decides first where that has not been done."""
        self.fly(1)

    def step(self) -> None:
        """Fly one control period: decide and advance.

        Raises:
            SimulationError: The state is no longer finite.
        """
        self.fly(1)

    def fly(self, periods: int) -> None:
        """Decide and advance so many control periods; a decision that was made stands.

        Raises:
            SimulationError: The state is no longer finite.
        """
        self._must(self.batch.fly, periods)

    def _must(self, fly: Callable[..., bool], *arguments: int) -> None:
        if not fly(*arguments):
            raise SimulationError(self.batch.causes[0])

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
