"""What goes wrong in one flight: faults that are due, what they and dispersions change, and the list of what happened.

A flight without faults and dispersions has none of it. All is drawn by `reset` from a seed, so that a flight replays bit by
bit.
"""

from __future__ import annotations

from collections.abc import Callable
from copy import deepcopy
from typing import Any

import numpy as np

from swarm_mj.mission.behaviors import SwarmView, Targets
from swarm_mj.scenarios.schema_faults import (
    CameraOff,
    CommunicationsLost,
    Dispersions,
    SensorDelay,
    SpacecraftLost,
    WheelFriction,
    WheelLost,
    WheelStuck,
    WheelWeakened,
)
from swarm_mj.simulator.faults.dispersions import (
    Dispersed,
    disperse_environment,
    dispersed_inertia,
    draw_spacecraft,
    unscaled,
)
from swarm_mj.simulator.faults.relay_election import Succession, relay_of
from swarm_mj.simulator.faults.schedule import AT_DEPLOYMENT, RELAY, Event, FaultModel, ScheduledFault, draw_schedule
from swarm_mj.simulator.flights import NEVER, Conditions, World, arrays_of, fill, row_of, rows_of
from swarm_mj.simulator.mujoco import write_masses
from swarm_mj.simulator.sensors import NOISE_ROWS, SENSOR_FAULTS, Sensing, can_err, most_readings
from swarm_mj.simulator.slots import Resting, Slot
from swarm_mj.simulator.state import FlightState
from swarm_mj.simulator.wheel_drive import healthy_wheels, reallocate, set_fault
from swarm_mj.smallbody.environment import Environment
from swarm_mj.smallbody.gravity.spherical_harmonics import SphericalHarmonics
from swarm_mj.smallbody.rotation import sub_point
from swarm_mj.spacecraft.attitude.estimation import first_knowledge
from swarm_mj.spacecraft.properties import SpacecraftProperties
from swarm_mj.typing import Array

#: Numbers beyond this are no state of a spacecraft, whatever their unit; a sum of finite ones may overflow.
_ABSURD = 1e100
#: What is due so little later than a control period begins [s] happens with it: the difference is rounding.
EARLY_S = 1e-9
#: Lists of what has happened and will happen, which change in flight.
_LISTS = ("events", "_agenda", "_notices", "_endings", "_due_relay", "_succession")
WHEEL_FAULTS = (WheelLost, WheelStuck, WheelWeakened, WheelFriction)
NOTHING = FaultModel(faults=(), dispersions=Dispersions(), duration_s=0.0)


def conditions_for(fault_model: FaultModel, properties: SpacecraftProperties, world: World, count: int) -> Conditions:
    """Space for what a fault model can make of E flights."""
    given, faults, n, w = fault_model.dispersions, fault_model.faults, len(world.inertia_B), properties.n_wheels
    sensors = fault_model.sensors
    rows, readings = NOISE_ROWS if can_err(sensors, faults) else 0, most_readings(sensors, faults, world.period)
    series = world.field.series.shape
    return Conditions(
        field_factor=np.ones(count),
        series=np.zeros((count, *series) if given.harmonics_percent > 0.0 else (0, 0, 0, 3, 2)),
        wheels=rows_of(healthy_wheels(properties, world.inertia_B, *np.zeros((2, n, w))), count),
        senses=np.zeros(count, np.bool_),
        knowledge=rows_of(first_knowledge(n, rows, readings), count),
        camera_on=np.ones((count, n), np.bool_),
        known_lost=np.zeros((count, n), np.bool_),
    )


class FaultInjection:
    """What goes wrong in one flight.

    Args:
        state: Of the flight; its model is changed, and must be its own.
        fault_model: What may go wrong.
        conditions: What compiled code is told of it.
        e: Number of the flight there.

    Attributes:
        losses: Whether who hits the body or diverges is lost, and the others fly on.
        lost: Spacecraft that no longer work, shape (n,).
        camera_on: Cameras that work, shape (n,).
        events: What happened, in order of time.
        wheels: How they are.
        sensing: Sensors, and what the flight software knows by them.
        due: Tick at which something has to be done before compiled code may fly on.
    """

    def __init__(self, state: FlightState, fault_model: FaultModel, conditions: Conditions, e: int) -> None:
        self._state, self._model, self._planned = state, fault_model, state.environment
        self._conditions, self._e, self.due, self.losses = conditions, e, 0, fault_model.losses
        self.lost, self.camera_on, self._known_lost = state.lost, conditions.camera_on[e], conditions.known_lost[e]
        self.wheels, self._knowledge = row_of(conditions.wheels, e), row_of(conditions.knowledge, e)
        self._succession = None if fault_model.election is None else Succession(fault_model.election)
        self._drawn: tuple[int, tuple[ScheduledFault, ...], Dispersed, Environment] | None = None
        self._draw(0)

    def _draw(self, seed: int) -> tuple[Dispersed, Environment]:
        """Draw from the seed what will happen and what the spacecraft are like, and forget what has happened."""
        state, model = self._state, self._model
        n, w, period = state.model.n, state.properties.n_wheels, state.period
        if self._drawn is None or self._drawn[0] != seed:
            self._drawn = (
                seed,
                draw_schedule(model.faults, seed, n=n, n_wheels=w, duration_s=model.duration_s),
                draw_spacecraft(model.dispersions, model.sensors, seed, n=n, n_wheels=w, period_s=period),
                disperse_environment(self._planned, model.dispersions, seed),
            )
        _, schedule, drawn, environment = self._drawn
        self.sensing = Sensing(model.sensors, drawn, schedule, seed, period, self._knowledge)
        self._conditions.senses[self._e] = self.sensing.active
        self.lost[:], self.camera_on[:], self._known_lost[:] = False, True, False
        if self._succession is not None:
            self._succession.reset()
        self.events: list[Event] = []
        self._agenda = [entry for entry in schedule if entry.fault.kind not in AT_DEPLOYMENT]
        self._notices: list[tuple[float, ScheduledFault]] = []
        self._endings: list[ScheduledFault] = []
        self._due_relay: list[ScheduledFault] = []
        return drawn, environment

    def reset(self, seed: int, deployment: tuple[Event, ...]) -> None:
        """Begin a flight.

        Args:
            seed: Of the scenario.
            deployment: What went wrong when the swarm was deployed.
        """
        state, conditions, given = self._state, self._conditions, self._model.dispersions
        (drawn, state.environment), self.due = self._draw(seed), 0
        for event in deployment:
            self.events.append(event)
            if event.kind == "missed_deployment":
                self.lost[event.spacecraft] = self._known_lost[event.spacecraft] = True
        inertia_B = dispersed_inertia(state.properties.inertia_B, drawn.second_moment_ratio)
        state.mass[:] = drawn.mass_ratio * state.properties.mass
        state.inertia_B[:] = drawn.mass_ratio[:, None, None] * inertia_B
        fill(self.wheels, healthy_wheels(state.properties, state.inertia_B, drawn.coulomb, drawn.viscous))
        if (given.mass_percent > 0.0 or given.inertia_percent > 0.0) and state.data is not None:
            write_masses(state.model, state.data, state.mass, state.inertia_B)
        field, conditions.field_factor[self._e] = unscaled(state.environment.gravity)
        if len(conditions.series) and isinstance(field, SphericalHarmonics):
            conditions.series[self._e] = field.acceleration_series

    @property
    def _arrays(self) -> list[Any]:
        """What becomes of the flight, beside its own arrays."""
        return arrays_of((self.wheels, self._knowledge, self.camera_on, self._known_lost))

    def get_state(self) -> dict[str, Any]:
        """What has become of what `reset` drew, a copy; who is lost is saved with the flight's arrays."""
        return {
            "lists": deepcopy([getattr(self, name) for name in _LISTS]),
            "rng": deepcopy(self.sensing.rng),
            "arrays": [array.copy() for array in self._arrays],
        }

    def set_state(self, saved: dict[str, Any]) -> None:
        """Go on from what `get_state` gave, after a `reset` with the seed of that flight."""
        for name, value in zip(_LISTS, deepcopy(saved["lists"]), strict=True):
            setattr(self, name, value)
        self.sensing.rng, self.due = deepcopy(saved["rng"]), 0
        for array, values in zip(self._arrays, saved["arrays"], strict=True):
            array[...] = values

    def aim(self, view: SwarmView, ask: Callable[[SwarmView], Targets]) -> Targets:
        """Let happen what is due, and ask for the targets that hold until the next event.

        Args:
            view: The instant.
            ask: Gives the targets of an instant.

        Returns:
            The targets; lost relays have successors.
        """
        self._happen()
        seen = view._replace(working=~self.lost, camera_on=self.camera_on & ~self.lost)
        targets = self._redirect(ask(seen), view.r_BN_N)
        self.due = self._next_tick()  # a relay lost just now is noticed later
        return targets

    def prepare_sensors(self) -> None:
        """Let sensors that fail at this instant fail, and see that there is noise, before they are read."""
        if self._state.tick >= self.due:
            self._happen()
        self.sensing.provide_noise()

    def _happen(self) -> None:
        """Let everything happen that is due: faults fall on the first control period at or after their time."""
        now = self._state.time + EARLY_S
        while self._agenda and self._agenda[0].time_s <= now:
            self._begin(self._agenda.pop(0))
        for entry in [e for e in self._endings if e.over_s <= now]:
            self._endings.remove(entry)
            self._end(entry)
        for moment, entry in [notice for notice in self._notices if notice[0] <= now]:
            self._notices.remove((moment, entry))
            self._notice(entry)

    def _next_tick(self) -> int:
        """The first control period that begins at or after the next thing that `_happen` knows of."""
        agenda = [entry.time_s for entry in self._agenda[:1]]
        endings, notices = (e.over_s for e in self._endings), (moment for moment, _ in self._notices)
        time_s, period = min([*agenda, *endings, *notices], default=np.inf), self._state.period
        if not np.isfinite(time_s):
            return NEVER
        tick = max(0, int(time_s / period) - 2)
        while time_s > tick * period + EARLY_S:
            tick += 1
        return tick

    def _tell(self, j: int, kind: str, detail: str) -> None:
        self.events.append(Event(self._state.time, j, kind, detail))

    def _begin(self, entry: ScheduledFault) -> None:
        fault, j = entry.fault, entry.spacecraft
        if j == RELAY:
            self._due_relay.append(entry)
        elif self.lost[j]:
            return
        elif isinstance(fault, SpacecraftLost):
            self._lose(j, fault.kind, "", fault.detection_s)
        else:
            self._tell(j, fault.kind, self._set(entry, active=True))
            if isinstance(fault, WheelLost | WheelStuck):
                self._notices.append((self._state.time + fault.detection_s, entry))
            if np.isfinite(entry.over_s):
                self._endings.append(entry)

    def _set(self, entry: ScheduledFault, active: bool) -> str:
        """Begin or end a fault of a camera, wheel or sensor; returns it in words."""
        fault, j = entry.fault, entry.spacecraft
        if isinstance(fault, CameraOff):
            self.camera_on[j] = not active
            return "no pictures"
        if isinstance(fault, WHEEL_FAULTS):
            return set_fault(self.wheels, entry, active, self._state.wheel_speed[j])
        assert isinstance(fault, (*SENSOR_FAULTS, SensorDelay))
        return self.sensing.set_fault(j, fault, active)

    def _end(self, entry: ScheduledFault) -> None:
        self._set(entry, active=False)
        if not self.lost[entry.spacecraft]:
            self._tell(entry.spacecraft, "over", entry.fault.kind)

    def _notice(self, entry: ScheduledFault) -> None:
        j = entry.spacecraft
        if isinstance(entry.fault, WheelLost | WheelStuck):
            detail = reallocate(self.wheels, entry, self._state.properties.wheel_axes_B)
            if not self.lost[j]:
                self._tell(j, "detected", f"{entry.fault.kind}: {detail}")
        elif not self._known_lost[j]:
            self._known_lost[j] = True
            self._tell(j, "detected", "the swarm knows that it is lost")

    def _lose(self, j: int, kind: str, detail: str, detection_s: float = 0.0) -> None:
        self.lost[j] = True
        self._tell(j, kind, detail or "silent, no torque, no pictures")
        if detection_s > 0.0:
            t = self._state.time
            loss = SpacecraftLost(kind="spacecraft_lost", spacecraft="any")
            self._notices.append((t + detection_s, ScheduledFault(t, j, (), np.inf, loss)))
        else:
            self._known_lost[j] = True

    @property
    def redirects(self) -> bool:
        """Whether targets may have to be others before something else happens."""
        return bool(self._due_relay) or bool(self.lost.any())

    def _redirect(self, targets: Targets, r_BN_N: Array) -> Targets:
        """Lose the relay if it is due, and give lost relays a successor; see `Succession`."""
        while self._due_relay and (relay := relay_of(targets, self.lost)) is not None:
            fault: Any = self._due_relay.pop(0).fault
            assert isinstance(fault, CommunicationsLost)
            self._lose(relay, fault.kind, "", fault.detection_s)
        if self._succession is None or not self._known_lost.any() or self._known_lost.all():
            return targets
        targets, elected = self._succession.redirect(targets, r_BN_N, self._known_lost)
        for relay, successor in elected:
            self._tell(successor, "elected", f"relays in place of sc{relay + 1}")
        return targets

    def diverged(self) -> None:
        """Give up the spacecraft whose states are not finite; each is held where it was at the last decision."""
        state = self._state
        numbers = state.numbers()
        with np.errstate(invalid="ignore"):
            bad = np.flatnonzero(~(np.isfinite(numbers) & (np.abs(numbers) < _ABSURD)).all(axis=1))
        for j in bad:
            state.r_N[j], state.q_BN[j] = state.work[Slot.R, j], (1.0, 0.0, 0.0, 0.0)
            state.v_N[j], state.omega_B[j], state.wheel_speed[j] = 0.0, 0.0, 0.0
            self._rest(int(j), Resting.HELD, "diverged", "its state was not finite; held where it was")

    def without_torque(self) -> None:
        """Give up the spacecraft whose control law gives no finite torque."""
        state = self._state
        bad = ~np.isfinite(state.torque_B).all(axis=1)
        for j in np.flatnonzero(bad & ~state.lost):
            self._rest(int(j), Resting.HELD, "diverged", "its control law gave no finite torque; held where it was")
        state.torque_B[bad] = 0.0

    def impact(self, j: int, r_A: Array) -> None:
        """Record an impact; the spacecraft lies where it hit."""
        latitude, longitude = sub_point(r_A, np.eye(3))
        self._state.rest_A[j] = r_A
        self._rest(j, Resting.ON_THE_BODY, "impact", f"latitude {latitude:.2f} deg, longitude {longitude:.2f} deg")

    def _rest(self, j: int, how: Resting, kind: str, detail: str) -> None:
        """The flight of a spacecraft is over; the swarm learns of it at the next decision."""
        self._state.resting[j] = how
        if self.lost[j]:
            self._tell(j, kind, detail)
        else:
            self._lose(j, kind, detail)
        self.due = 0
        self._state.flights.due[0] = 0
