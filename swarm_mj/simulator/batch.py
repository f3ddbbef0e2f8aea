"""E flights of one swarm, flown together by the one loop; `Simulation` is one of them with names.

`loop.run` flies as far as compiled code can; what a flight asks for on the way (plug-ins, faults, thrusters, MuJoCo's step of
spacecraft that are more than rigid) is done here. Who steps is `SwarmModel.stepper`: MuJoCo, or the kernel for gyrostats.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import deepcopy
from functools import partial
from typing import Any

import mujoco
import numpy as np

from swarm_mj.errors import PluginError, SimulationError
from swarm_mj.mission.behaviors import Behavior, SteadyBehavior, SwarmView, Targets
from swarm_mj.plugins import name_of
from swarm_mj.simulator.faults.injection import FaultInjection, conditions_for
from swarm_mj.simulator.flight_setup import FlightSetup, compiled_law_of, gravity_is_compiled, make_world
from swarm_mj.simulator.flights import NEVER, Flights, allocate_flights
from swarm_mj.simulator.loop import Ask, Stage, run, sense_flights
from swarm_mj.simulator.mujoco import MujocoStepper, own_copy
from swarm_mj.simulator.mujoco_step import MujocoFlight
from swarm_mj.simulator.plugin_calls import (
    Memory,
    ask_for_targets,
    ask_for_torque,
    ask_how_long,
    divergence_of,
    no_such_target,
)
from swarm_mj.simulator.propulsion import Propulsion
from swarm_mj.simulator.slews import Slews
from swarm_mj.simulator.slots import Slot
from swarm_mj.simulator.state import FlightState, InitialState
from swarm_mj.spacecraft.control.base import Controller
from swarm_mj.spacecraft.control.compiled import LawFunction, no_law
from swarm_mj.spacecraft.control.force import ForceLaw
from swarm_mj.spacecraft.model import SwarmModel
from swarm_mj.typing import Array, Ints, Mask

#: Where lost spacecraft stand, times their number [m].
PARKED = 1e7
#: Most control periods for which a behaviour is not asked.
LONGEST_REST = 1_000_000
#: Ticks of a flight for which the flights of a batch share cells of a polyhedron; memory comes as it is used.
REMEMBERED = 16_384


class FlightBatch:
    """E flights of one swarm of n spacecraft with w wheels; faults and dispersions of each are drawn from its start's seed.

    A flight as planned whose state is no longer finite is marked in `flights.finite` and stands still until it is reset; where
    faults are flown, the spacecraft is lost and the others fly on.

    Args:
        setup: What the flights share.
        count: Number of flights E.
        controller: The control law; None where torques are held, see `hold`.
        behaviors: Who points at what in each flight; None where targets are held, see `hold`.
        force_law: Who asks the thrusters for forces; None: nobody, and they stay shut.

    Attributes:
        setup: As given.
        count: Number of flights E.
        n: Number of spacecraft.
        environment: Gravity, rotation, Sun and Earth as planned.
        flights: The arrays of the flights, live; whoever changes a state in flight does it by `place`.
        conditions: What faults and dispersions make of them; None: nothing.
        causes: Why flights diverged, by flight.

    Raises:
        ScenarioError: The control period is no whole multiple of the timestep, or too long for the law.
        PluginError: A plug-in does not fit what is asked of it.
        SimulationError: The kernel is to step what only MuJoCo can.
    """

    def __init__(
        self,
        setup: FlightSetup,
        count: int,
        controller: Controller | None = None,
        behaviors: Sequence[Behavior] | None = None,
        force_law: ForceLaw | None = None,
    ) -> None:
        self.setup, self.count, self.n = setup, count, setup.model.n
        self.environment = setup.environment.in_cells()
        self.flights: Flights = allocate_flights(count, self.n, setup.properties.n_wheels)
        self.flights.mass[:], self.flights.inertia_B[:] = setup.properties.mass, setup.properties.inertia_B
        self.world = make_world(setup, self.environment, REMEMBERED if count > 1 else 0)
        self.conditions = None
        if setup.fault_model is not None:
            self.conditions = conditions_for(setup.fault_model, setup.properties, self.world, count)
        self.causes = [""] * count
        self._starts: list[InitialState | None] = [None] * count
        self._everyone = np.ones(count, np.bool_)
        self._memories = [Memory() for _ in range(count)]
        self._behaviors: list[Behavior] = list(behaviors or ())
        self._controller: Controller | None = None
        self._held = self._copied_targets()
        self._states: dict[int, FlightState] = {}
        self._make_parts()
        self._hooks: dict[int, Callable[[int], None]] = {
            Ask.PREPARE: self._prepare,
            Ask.DIVERGED: self._diverge,
            Ask.GRAVITY: self._attract,
            Ask.THRUST: self._thrust,
            Ask.NO_TARGET: self._refuse_targets,
            Ask.SLEW: lambda e: self._slews[e].follow(self._attitudes_known(e)),
            Ask.LAW: self._ask_law,
            Ask.TORQUE: self._give_up_torque,
            Ask.STEP: self._step,
        }
        self.controller = controller
        self.force_law = force_law

    def _make_parts(self) -> None:
        """What every flight has of its own beside the arrays: none of it where the kernel flies as planned."""
        setup, every = self.setup, range(self.count)
        model, faults, thrusters = setup.model, setup.fault_model, setup.properties.thrusters
        self._kernel = model.stepper == "kernel"
        if self._kernel and model.own is not None:
            raise SimulationError(
                f"physics.stepper = kernel flies the packaged CubeSat, not {model.own.path.name}; use physics.stepper: mujoco"
            )
        self._own_models = faults is not None or thrusters is not None
        self._keeps_states = not self._kernel or self._own_models or setup.minimum_time_slews
        self._steppers: list[MujocoStepper] = []
        if not self._kernel:
            timesteps, gm = self.world.timesteps, 0.0 if model.own is None else setup.gradient_gm
            self._steppers = [MujocoStepper(self.state(e), timesteps, gm) for e in every]
        self._injections: list[FaultInjection] = []
        if faults is not None and self.conditions is not None:
            self._injections = [FaultInjection(self.state(e), faults, self.conditions, e) for e in every]
        self._propulsion: list[Propulsion] = []
        if thrusters is not None:
            gradient = self.world.gradient_gm > 0.0
            self._propulsion = [Propulsion(self.state(e), thrusters, gradient=gradient) for e in every]
        self._slews = [Slews(self.state(e)) for e in every] if setup.minimum_time_slews else []
        self._intended = [Targets(*(part[e] for part in self._held)) for e in every] if thrusters else []

    def state(self, e: int) -> FlightState:
        """Flight e with names."""
        found = self._states.get(e)
        if found is None:
            setup = self.setup
            own = self._own_models and not self._kernel
            model = own_copy(setup.model, limits_by_loop=setup.fault_model is not None) if own else setup.model
            data = None if self._kernel else mujoco.MjData(model.mjmodel)
            found = FlightState(self.flights, e, model=model, environment=self.environment, world=self.world, data=data)
            if self._keeps_states:
                self._states[e] = found
        return found

    @property
    def model(self) -> SwarmModel:
        """The compiled swarm, as planned."""
        return self.setup.model

    @property
    def period(self) -> float:
        """Control period [s]."""
        return self.setup.period

    @property
    def senses(self) -> bool:
        """Whether sensors may be imperfect, so that `know` may give something else than the truth."""
        return self.conditions is not None

    @property
    def blind(self) -> Mask:
        """Spacecraft that take no pictures, a copy, shape (E, n)."""
        off: Mask = self.flights.lost | ~self.flights.released
        return off if self.conditions is None else off | ~self.conditions.camera_on

    def injection(self, e: int) -> FaultInjection | None:
        """What goes wrong in flight e; None: nothing can."""
        return self._injections[e] if self._injections else None

    def propulsion(self, e: int) -> Propulsion | None:
        """The thrusters of flight e; None: it has none."""
        return self._propulsion[e] if self._propulsion else None

    @property
    def controller(self) -> Controller | None:
        """The control law; another one may take over in flight, without memory."""
        return self._controller

    @controller.setter
    def controller(self, controller: Controller | None) -> None:
        law = None if controller is None else compiled_law_of(controller, self.world)
        self._controller = controller
        self._compiled_law: LawFunction
        self._compiled_law, numbers = (no_law(), np.zeros(0)) if law is None else law
        self.world = self.world._replace(law_numbers=numbers)
        self._law_in_python = controller is not None and law is None
        for memory in self._memories:
            memory.law = None
        self._note_what_is_asked()

    @property
    def behaviors(self) -> list[Behavior]:
        """Who points at what in each flight; others may take over in flight, without memory; none where targets are held."""
        return self._behaviors

    @behaviors.setter
    def behaviors(self, behaviors: Sequence[Behavior]) -> None:
        self._behaviors = list(behaviors)
        for memory in self._memories:
            memory.behavior = None
        self.ask_again()

    @property
    def force_law(self) -> ForceLaw | None:
        """Who asks the thrusters for forces; another one may take over in flight, without memory.

        Raises:
            PluginError: The spacecraft have no thrusters.
            SimulationError: They cannot push as the law needs.
        """
        return self._propulsion[0].law if self._propulsion else None

    @force_law.setter
    def force_law(self, law: ForceLaw | None) -> None:
        if law is not None and not self._propulsion:
            raise PluginError(
                f"the force law {name_of(law)}: the spacecraft have no thrusters; give spacecraft.thrusters, or "
                "SpacecraftProperties(thrusters=...)"
            )
        for propulsion in self._propulsion:
            propulsion.law = law
        self._note_what_is_asked()

    def _note_what_is_asked(self) -> None:
        """Tell compiled code what Python does in every period."""
        asks = 0 if gravity_is_compiled(self.environment) else Ask.GRAVITY
        asks |= Ask.SLEW if self._slews else 0
        asks |= Ask.LAW if self._law_in_python else 0
        asks |= Ask.THRUST if self.force_law is not None else 0
        self.world = self.world._replace(asks=int(asks))
        self.ask_again()

    def ask_again(self, which: Any = slice(None)) -> None:
        """Decide anew, and ask the behaviours first, because they or the states have been told something new."""
        self.flights.due[which], self.flights.stage[which] = 0, Stage.BEGIN

    def hold(self, targets: Targets | None, torque_B: Array | None) -> None:
        """Let targets, shape (E, n, ...), and torques [N m], shape (E, n, 3), hold where no behaviour and no law decides."""
        f = self.flights
        f.stage[:] = Stage.BEGIN
        if targets is not None:
            self._held = targets
            for array, values in zip((f.kind, f.spacecraft, f.vector), targets, strict=True):
                array[:] = values
            for e, injection in enumerate(self._injections):
                if injection.redirects:
                    f.due[e] = 0
            self._intended = [Targets(*(part[e] for part in targets)) for e in range(len(self._intended))]
        if torque_B is not None:
            f.torque_B[:] = torque_B
        if self._behaviors:
            self.ask_again()

    def _copied_targets(self) -> Targets:
        f = self.flights
        return Targets(f.kind.copy(), f.spacecraft.copy(), f.vector.copy())

    def reset(self, e: int, initial: InitialState) -> None:
        """Put one flight at its start and forget everything about it; its seed says what will go wrong."""
        state, injection, propulsion = self.state(e), self.injection(e), self.propulsion(e)
        self._starts[e], self.causes[e], self._memories[e] = initial, "", Memory()
        if propulsion is not None:
            propulsion.refill()
        state.mass[:], state.inertia_B[:] = self.setup.properties.mass, self.setup.properties.inertia_B
        if injection is not None:
            injection.reset(initial.seed, initial.deployment)
        if propulsion is not None:
            propulsion.reset()
        state.start(initial)
        if self._steppers:
            self._steppers[e].start()
        else:
            self._spin_up(e)

    def _spin_up(self, e: int) -> None:
        """Momenta of the wheels from their speeds."""
        f, axes = self.flights, self.world.wheel_axes_B
        f.momentum[e] = self.world.wheel_inertia * (f.wheel_speed[e] + f.omega_B[e] @ axes.T)

    def place(self, e: int, qpos: Array, qvel: Array) -> None:
        """Put one flight into a state; its behaviour is asked again.

        Args:
            e: Number of the flight.
            qpos: Positions in N [m] and attitudes, shape (n, 7) or, with wheel angles, more.
            qvel: Velocities in N [m/s], body rates and wheel speeds [rad/s], shape (n, 6 + w).
        """
        f = self.flights
        f.r_N[e], f.q_BN[e] = qpos[:, :3], qpos[:, 3:7]
        f.v_N[e], f.omega_B[e], f.wheel_speed[e] = qvel[:, :3], qvel[:, 3:6], qvel[:, 6:]
        self._write(e)
        self.ask_again(e)

    def _write(self, e: int) -> None:
        """Tell whoever steps that a state was changed."""
        if self._steppers:
            self._steppers[e].write()
        else:
            self._spin_up(e)

    def park(self, e: int, *which: int) -> None:
        """Put spacecraft that are no more where they disturb nothing: far out, at rest."""
        f = self.flights
        for j in which:
            f.r_N[e, j] = PARKED * (1.0 + j), 0.0, 0.0
            f.v_N[e, j], f.omega_B[e, j], f.wheel_speed[e, j] = 0.0, 0.0, 0.0
        self._write(e)
        self.ask_again(e)

    def get_state(self, e: int) -> dict[str, Any]:
        """All that one flight is between two control periods, copied, and can be pickled; for `set_state` of any such batch.

        Raises:
            SimulationError: The flight has not begun, or its thrusters fire, whose tanks and programme are not saved.
        """
        if self._starts[e] is None:
            raise SimulationError("the flight has not begun, so that it has no state; call reset first")
        if self.force_law is not None:
            raise SimulationError(
                f"the state of a flight cannot be taken while thrusters fly the force law {name_of(self.force_law)}; leave "
                "trajectory.corrections and spacecraft.thrusters out"
            )
        return {
            "start": self._starts[e],
            "cause": self.causes[e],
            "arrays": [array[e].copy() for array in self.flights],
            "memory": deepcopy(self._memories[e]),
            "parts": [part.get_state() for part in self._parts(e)],
        }

    def set_state(self, e: int, saved: dict[str, Any]) -> None:
        """Go on from what `get_state` gave, bit for bit."""
        self.reset(e, saved["start"])
        for part, state in zip(self._parts(e), saved["parts"], strict=True):
            part.set_state(state)
        for array, row in zip(self.flights, saved["arrays"], strict=True):
            array[e] = row
        self.causes[e], self._memories[e] = saved["cause"], deepcopy(saved["memory"])

    def _parts(self, e: int) -> list[Any]:
        """What flight e has of its own beside the arrays, and changes in flight."""
        return [parts[e] for parts in (self._steppers, self._injections, self._slews) if parts]

    def know(self, live: Mask, q: Array, omega: Array) -> Mask:
        """Put what the flight software has of attitudes and rates in the place of the truth, where sensors are not perfect.

        The controller is given the same by the decision that follows; asking ahead of it changes nothing in the flight.

        Args:
            live: Which flights, shape (E,); their states must be finite.
            q: Attitudes q_BN, shape (E, n, 4).
            omega: Body rates, shape (E, n, 3) [rad/s].

        Returns:
            Flights whose sensors are not perfect, shape (E,).
        """
        if self.conditions is None:
            return np.zeros(self.count, np.bool_)
        own: Mask = live & self.conditions.senses
        for e in np.flatnonzero(own).tolist():
            self._injections[e].prepare_sensors()
        sense_flights(self.world, self.flights, self.conditions, own, q, omega)
        return own

    def decide(self, live: Mask | None = None) -> bool:
        """Make the decision of the present tick, if it has not been made; see `advance`."""
        return self.advance(self.flights.tick.copy(), live, decide=True)

    def fly(self, periods: int, live: Mask | None = None) -> bool:
        """Fly so many control periods; see `advance`."""
        return self.advance(self.flights.tick + periods, live)

    def advance(self, until: Ints, live: Mask | None = None, *, decide: bool = False) -> bool:
        """Decide and step, until each flight has reached its tick; the only loop there is.

        Args:
            until: Ticks, shape (E,); a flight that has reached its own is left alone.
            live: Which flights, shape (E,); None: all.
            decide: Whether the decision of the last tick is made too; it then stands until it is flown.

        Returns:
            Whether all of them are finite.

        Raises:
            PluginError: A plug-in fails, answers something else than its protocol says, or aims at what is not there.
            SimulationError: A force or control law cannot be flown.
        """
        live, f = self._everyone if live is None else live, self.flights
        if self._steppers:
            for e in np.flatnonzero(live).tolist():
                alone = np.zeros(self.count, np.bool_)
                alone[e] = True
                self._run(self._steppers[e].flight, until, alone, decide)
        else:
            self._run(None, until, live, decide)
        if decide and self._steppers:
            for e in np.flatnonzero(live & f.finite).tolist():
                self._steppers[e].hold()  # for whoever looks at MuJoCo's data: sensors, viewers
        return bool(f.finite[live].all())

    def _run(self, mj: MujocoFlight | None, until: Ints, live: Mask, decide: bool) -> None:
        """The same of flights that the kernel steps, or of one that MuJoCo does."""
        f = self.flights
        while run(self.world, self._compiled_law, f, self.conditions, mj, until, live, decide):
            for e in np.flatnonzero(f.ask).tolist():
                self._hooks[int(f.ask[e])](e)

    def _prepare(self, e: int) -> None:
        """Let happen what is due before a decision, and ask for the targets that hold until the next such instant."""
        state, injection, initial, tick = self.state(e), self.injection(e), self._starts[e], int(self.flights.tick[e])
        release = None if initial is None else initial.release
        if release is not None and state.let_go(release):
            self._write(e)
            self.ask_again(e)
        if injection is not None:
            injection.sensing.provide_noise()
        if tick < self.flights.due[e]:
            return
        if not np.isfinite(state.numbers()).all():
            self._diverge(e)
            if not self.flights.finite[e]:
                return
        view, ask = state.view(), partial(self._targets, e)
        targets = ask(view) if injection is None else injection.aim(view, ask)
        state.aim_at(targets)
        if self._intended:
            self._intended[e] = Targets._make(part.copy() for part in targets)
        due = NEVER if release is None else release.next_after(tick)
        due = min(due, self._memories[e].due) if self._behaviors else due
        self.flights.due[e] = due if injection is None else min(due, injection.due)

    def _targets(self, e: int, view: SwarmView) -> Targets:
        if self._behaviors:
            behavior, memory, steady = self._behaviors[e], self._memories[e], 0.0
            targets, memory.behavior = ask_for_targets(behavior, view, memory.behavior)
            if isinstance(behavior, SteadyBehavior):
                steady = ask_how_long(behavior, view, memory.behavior)
            memory.due = int(self.flights.tick[e]) + max(1, int(min(steady / self.period, LONGEST_REST)))
            return targets
        # Where losses have had the swarm aim elsewhere, what was asked for stands in `_held` alone.
        return Targets(*(part[e] for part in self._held)) if self._injections else self.state(e).targets

    def _diverge(self, e: int) -> None:
        injection = self.injection(e)
        if injection is None or not injection.losses:
            self._mark_diverged(e)
        else:
            injection.diverged()
            self._write(e)

    def _mark_diverged(self, e: int) -> None:
        self.flights.finite[e] = False
        self.causes[e] = divergence_of(self.state(e), self._controller)

    def _attract(self, e: int) -> None:
        state = self.state(e)
        environment, r_A, C_mid = state.environment, state.work[Slot.R_A], state.C_mid
        attraction = environment.attraction_A(r_A)
        if environment.companion is not None:
            middle = state.time + 0.5 * state.period
            attraction = attraction + environment.companion.acceleration_N(middle, r_A @ C_mid) @ C_mid.T
        state.work[Slot.RHO] = attraction

    def _attitudes_known(self, e: int) -> Array:
        known = self.conditions is not None and bool(self.conditions.senses[e])
        return self.conditions.knowledge.q_BN[e] if self.conditions is not None and known else self.flights.q_BN[e]

    def _thrust(self, e: int) -> None:
        state = self.state(e)
        state.aim_at(self._propulsion[e].aim(state.time, self._intended[e]))
        self._propulsion[e].thrust(self._attitudes_known(e))

    def _refuse_targets(self, e: int) -> None:
        raise PluginError(no_such_target(self.state(e).targets))

    def _ask_law(self, e: int) -> None:
        assert self._controller is not None
        state, memory = self.state(e), self._memories[e]
        state.torque_B[:], memory.law = ask_for_torque(self._controller, state.control_input(), memory.law)

    def _give_up_torque(self, e: int) -> None:
        """Go on without the spacecraft to which the control law gives no finite torque."""
        injection = self.injection(e)
        if injection is None or not injection.losses:
            self._mark_diverged(e)
        else:
            injection.without_torque()

    def _step(self, e: int) -> None:
        self._steppers[e].step()
        self.flights.tick[e] += 1
        self.flights.stage[e] = Stage.BEGIN
