"""The simulation of one flight: a batch of one, by names, and its samples.

Every control period the state is read, the forces of the coming hold are evaluated at its middle, the behaviour names the
targets, guidance turns them into references, the controller answers with torques, and the swarm is stepped with all of it held;
see `swarm_mj.simulator.loop`.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Protocol

import mujoco
import numpy as np
from numpy.typing import NDArray

from swarm_mj.errors import ScenarioError, SimulationError
from swarm_mj.io import interruption
from swarm_mj.mission.behaviors import Behavior, TargetKind, Targets
from swarm_mj.scenarios.schema import is_multiple
from swarm_mj.simulator.batch import FlightBatch
from swarm_mj.simulator.faults.injection import NOTHING, FaultInjection
from swarm_mj.simulator.faults.schedule import Event
from swarm_mj.simulator.flight_setup import FlightSetup
from swarm_mj.simulator.flights import NEVER
from swarm_mj.simulator.instruments import Instruments
from swarm_mj.simulator.propulsion import Propulsion
from swarm_mj.simulator.slots import Peak, Resting, Slot
from swarm_mj.simulator.state import FlightState, InitialState
from swarm_mj.smallbody.environment import Environment
from swarm_mj.smallbody.impact import CompanionWatch, ImpactWatch
from swarm_mj.smallbody.rotation import sub_point
from swarm_mj.smallbody.shape import ShapeModel
from swarm_mj.spacecraft.control.base import Controller
from swarm_mj.spacecraft.control.force import ForceLaw
from swarm_mj.spacecraft.model import SwarmModel
from swarm_mj.spacecraft.properties import SpacecraftProperties
from swarm_mj.typing import Array, Mask

Progress = Callable[[float], None]

_LOS = int(Slot.LOS)  # NumPy takes twice as long for a member of an enumeration
#: How often progress is told of in one flight, at least.
NEWS = 100
#: Compiled code flies on for about so long [s] before Python looks up: to be interrupted, and to tell of the progress.
SLICE_S = 0.25


@dataclass(frozen=True)
class FlightSamples:
    """Raw samples of a flight; `telemetry.dataset` describes them."""

    time: Array  #: shape (t,) [s]
    #: by the names of telemetry, and attitudes and references as quaternions `q_BN` and `q_RN`, shape (t, n, ...)
    samples: dict[str, NDArray[Any]]
    #: over every control period, not only the samples: largest wheel speed [rad/s], largest motor torque [N m], and the
    #: time in which a wheel limit cut a torque [s], shape (n, 3)
    peaks: Array
    sensors_err: bool = False  #: whether the control law was given anything else than the truth
    instruments: Instruments | None = None  #: what spacecraft from a file add: sensors and joints


class Navigator(Protocol):
    """Who finds out where the spacecraft are, at times of its own.

    Attributes:
        due: Tick at which it looks next.
    """

    due: int

    def reset(self, simulation: Simulation) -> None:
        """Begin a flight."""

    def look(self, simulation: Simulation) -> None:
        """Look at the present instant, and write what is known less the truth into `Flights`."""

    def sampled(self, simulation: Simulation) -> dict[str, NDArray[Any]]:
        """What is sampled of it, by the names of telemetry."""

    def record(self) -> list[dict[str, Any]]:
        """What it did in the flight, as plain data."""


class Simulation:
    """A swarm in flight.

    Args:
        setup: What is flown, and what may go wrong.
        behavior: Who points at what.
        controller: The attitude control law.
        force_law: Who asks the thrusters for forces; None: nobody, and they stay shut.
        shape: The body, to look for impacts while `run` flies; None: nobody looks.
        navigator: Who finds out where the spacecraft are while `run` flies; None: they know.

    Attributes:
        setup: What a `FlightBatch` of more such flights takes.
        batch: The batch of one that flies.
        state: The flight's arrays.
        impact_watch: Who looks for impacts; None: nobody.
        companion_watch: The same of the companion; None: nobody, or there is none.

    Raises:
        SwarmError: See `FlightBatch`.
    """

    def __init__(
        self,
        setup: FlightSetup,
        behavior: Behavior,
        controller: Controller,
        *,
        force_law: ForceLaw | None = None,
        shape: ShapeModel | None = None,
        navigator: Navigator | None = None,
    ) -> None:
        if setup.fault_model is None and setup.properties.n_wheels != 3:
            setup = replace(setup, fault_model=NOTHING)  # telemetry then tells of every wheel
        self.setup = setup
        self.batch = FlightBatch(setup, 1, controller, [behavior], force_law)
        self.state: FlightState = self.batch.state(0)
        self.impact_watch = None if shape is None else ImpactWatch(shape, setup.environment, setup.period)
        companion = None if shape is None else setup.environment.companion
        self.companion_watch = None if companion is None else CompanionWatch(companion, setup.period)
        self.navigator = navigator
        self._copy: mujoco.MjData | None = None

    @property
    def watches(self) -> list[ImpactWatch]:
        """All who look for impacts."""
        return [watch for watch in (self.impact_watch, self.companion_watch) if watch is not None]

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
        return [] if self.injection is None else self.injection.events

    @property
    def stepper(self) -> str:
        """Who steps: mujoco or kernel."""
        return self.model.stepper

    def reset(self, initial: InitialState) -> None:
        """Put the swarm at its start and forget everything; faults and dispersions are drawn from the state's seed."""
        self.batch.reset(0, initial)
        for watch in self.watches:
            watch.reset()
        if self.navigator is not None:
            self.navigator.reset(self)

    def get_state(self) -> dict[str, Any]:
        """All that the flight is between two control periods, a copy that can be pickled; `set_state` goes on from it.

        Raises:
            SimulationError: The flight has not begun, or its thrusters fire, whose tanks and programme are not saved.
        """
        return self.batch.get_state(0)

    def set_state(self, saved: dict[str, Any]) -> None:
        """Go on from what `get_state` of such a simulation gave, bit for bit; impacts are watched for anew."""
        self.batch.set_state(0, saved)
        for watch in self.watches:
            watch.reset()

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

    def run(self, duration: float, interval: float, progress: Progress | None = None) -> FlightSamples:
        """Fly from the present state and sample.

        Args:
            duration: [s], a whole multiple of `interval`.
            interval: Time between samples [s], a whole multiple of the control period.
            progress: Called with the time reached [s], about a hundred times, or several times a second.

        Raises:
            ScenarioError: One is no multiple of the other.
            SimulationError: A spacecraft hit the body or the state is no longer finite; the message gives time and spacecraft.
                Where faults are flown, the spacecraft is lost instead and the others fly on.
        """
        return Recorder(self, duration, interval, progress).fly()


class Recorder:
    """Flies a simulation on from its present state, looking for impacts on the way; see `Simulation.run`."""

    def __init__(self, simulation: Simulation, duration: float, interval: float, progress: Progress | None) -> None:
        self._simulation, self._state, self._progress = simulation, simulation.state, progress
        period = self._state.period
        if not (interval > 0.0 and is_multiple(interval, period) and is_multiple(duration, interval)):
            raise ScenarioError(
                f"duration {duration:g} s, interval {interval:g} s: the duration must be a whole multiple of the interval, and "
                f"that one of the control period, {period:g} s"
            )
        self._time = sample_times(duration, interval) + self._state.time
        self._samples: dict[str, NDArray[Any]] = {}
        self._stride = round(interval / period)
        self._news_every = max(1, self._stride * (len(self._time) - 1) // NEWS)
        self._news_due = NEVER if progress is None else 0
        self._slice = 64
        gradient_gm, own = simulation.setup.gradient_gm, self._state.model.own
        self._instruments = None if own is None else Instruments(self._state, len(self._time), gradient_gm)

    def fly(self) -> FlightSamples:
        """Fly and record every sample."""
        state, start = self._state, self._state.tick
        self._navigate()
        for row in range(len(self._time)):
            self._fly_to(start + row * self._stride)
            if row == len(self._time) - 1:
                cut = state.peaks[:, Peak.CUT_HOLDS].copy()
            self._keep(row, self._decide())
        peaks = state.peaks.copy()
        peaks[:, Peak.CUT_HOLDS] = state.period * cut  # the hold of the last decision is not flown yet
        injection = self._simulation.injection
        sensors_err = injection is not None and injection.sensing.active
        return FlightSamples(self._time, self._samples, peaks, sensors_err, self._instruments)

    def _fly_to(self, end: int) -> None:
        """Fly on to the next sample, stopping where impacts are looked for and progress is told of."""
        state, watches, navigator = self._state, self._simulation.watches, self._simulation.navigator
        while state.tick < end:
            look = NEVER if navigator is None else navigator.due
            stop = min(end, state.tick + self._slice, self._news_due, look, *(watch.due for watch in watches))
            if stop > state.tick:
                self._fly_slice(stop - state.tick)
            self._navigate()
            if state.tick < end:
                self._decide()

    def _navigate(self) -> None:
        """Find out where the spacecraft are, where that is due, before the decision of the instant."""
        navigator = self._simulation.navigator
        if navigator is not None and self._state.tick >= navigator.due:
            navigator.look(self._simulation)
            self._simulation.ask_again()
            interruption.check()

    def _fly_slice(self, periods: int) -> None:
        """Fly on; the next slice is longer or shorter, so that one takes about `SLICE_S`, and ends with a word of progress."""
        start = time.perf_counter()
        self._simulation.fly(periods)
        took = time.perf_counter() - start
        if took > 2.0 * SLICE_S:
            self._slice = max(1, self._slice // 2)
        elif took < 0.5 * SLICE_S and periods == self._slice:
            self._slice *= 2
        interruption.check()
        if self._progress is not None and took > 0.5 * SLICE_S:
            self._progress(self._state.time)

    def _decide(self) -> Targets:
        state = self._state
        targets = self._simulation.decide()
        for watch in self._simulation.watches:
            if state.tick >= watch.due:
                self._look_for_impacts(watch)
        if self._progress is not None and state.tick >= self._news_due:
            self._news_due = state.tick + self._news_every
            self._progress(state.time)
        return targets

    def _look_for_impacts(self, watch: ImpactWatch) -> None:
        state, injection, work = self._state, self._simulation.injection, self._state.work
        flying = state.resting == Resting.FLYING
        hit = watch.look(state.tick, work[Slot.R], work[Slot.V], work[Slot.A], flying)
        if watch is self._simulation.companion_watch and hit.any():
            assert state.environment.companion is not None
            raise SimulationError(
                f"{state.model.names[int(np.argmax(hit))]} hits the companion, {state.environment.companion.name}, at t = "
                f"{state.time:g} s: its path crosses the surface, and the flight ends there. Change the mission"
            )
        for j in np.flatnonzero(hit):
            r_A = state.C_AN @ work[Slot.R, j]
            if injection is None or not injection.losses:
                latitude, longitude = sub_point(r_A, np.eye(3))
                raise SimulationError(
                    f"{state.model.names[j]} hits the body at t = {state.time:g} s, latitude {latitude:.1f} deg, longitude "
                    f"{longitude:.1f} deg: its path crosses the surface. Change the mission, or fly it with faults"
                )
            injection.impact(int(j), r_A)

    def _keep(self, row: int, targets: Targets) -> None:
        """Take a sample; forces and torques of the coming hold have been set."""
        if self._instruments is not None:
            self._instruments.keep(row)
        for name, values in self._instant(targets).items():
            if name not in self._samples:
                self._samples[name] = np.empty((len(self._time), *values.shape), values.dtype)
            self._samples[name][row] = values

    def _instant(self, targets: Targets) -> dict[str, NDArray[Any]]:
        """What is sampled, by the names of telemetry."""
        state, injection, propulsion = self._state, self._simulation.injection, self._simulation.propulsion
        found: dict[str, NDArray[Any]] = {
            "r_BN_N": state.r_N,
            "v_BN_N": state.v_N,
            "q_BN": state.q_BN,
            "omega_BN_B": state.omega_B,
            "q_RN": state.q_RN,
            "sigma_BR": state.work[Slot.SIGMA_BR],
            "line_of_sight_N": state.work[_LOS],
            "mode": targets.kind,
            "tracked_spacecraft": np.where(targets.kind == TargetKind.SPACECRAFT, targets.spacecraft, -1),
            "wheel_speed": state.wheel_speed,
            "wheel_torque": state.motor,
        }
        if injection is not None:
            sensing = injection.sensing
            found |= {
                "operational": ~injection.lost,
                "camera_on": injection.camera_on & ~injection.lost,
                "wheel_torque": injection.wheels.motor,
                "wheel_friction_torque": injection.wheels.bearing,
                "attitude_knowledge_error": sensing.knowledge_error(state.q_BN),
            }
            if sensing.estimating:
                found |= {"gyro_bias": sensing.gyro_bias, "gyro_bias_estimate": sensing.gyro_bias_estimate}
        if (navigator := self._simulation.navigator) is not None:
            found |= navigator.sampled(self._simulation)
        if propulsion is not None:
            found |= {
                "thrust_N": propulsion.force_N,
                "propellant_kg": propulsion.propellant,
                "mass_kg": propulsion.mass,
                "delta_v_m_s": propulsion.delta_v,
            }
        return found


def sample_times(duration: float, interval: float) -> Array:
    """Times from 0 to `duration` at every `interval` [s], both ends included."""
    return np.asarray(interval * np.arange(round(duration / interval) + 1), dtype=np.float64)
