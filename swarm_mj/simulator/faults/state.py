"""One flight in which things go wrong: the faults that are due, what they change, and the list of what happened.

The simulation asks this object at every control period; where a scenario has no faults and no dispersions there is none, and
nothing is asked. All state lies here and is drawn anew by `reset` from a seed, so that a flight replays bit by bit.
"""

from __future__ import annotations

from copy import deepcopy
from dataclasses import dataclass
from typing import Any

import numpy as np

from swarm_mj.mission.behaviors import Targets
from swarm_mj.scenarios.schema_faults import (
    CameraOff,
    CommunicationsLost,
    Dispersions,
    Fault,
    SensorDelay,
    SpacecraftLost,
    WheelFriction,
    WheelLost,
    WheelStuck,
    WheelWeakened,
)
from swarm_mj.simulator.faults.deployment import in_flight
from swarm_mj.simulator.faults.dispersions import Dispersed, disperse_environment, dispersed_inertia, draw_spacecraft
from swarm_mj.simulator.faults.relay_election import Succession, relay_of
from swarm_mj.simulator.faults.schedule import RELAY, Event, ScheduledFault, draw_schedule
from swarm_mj.simulator.faults.sensing import SENSOR_FAULTS, Sensing
from swarm_mj.simulator.faults.wheel_set import WheelSet
from swarm_mj.simulator.flights import Conditions, wheels_of_flight
from swarm_mj.smallbody.environment import Environment
from swarm_mj.spacecraft.properties import SpacecraftProperties
from swarm_mj.typing import Array, Mask

#: Lists of what has happened and will happen, which change in flight.
_LISTS = ("events", "_agenda", "_notices", "_endings", "_due_relay", "_succession")
#: What is due so little later than a control period begins [s] happens with it: the difference is rounding.
EARLY_S = 1e-9
WHEEL_FAULTS = (WheelLost, WheelStuck, WheelWeakened, WheelFriction)


@dataclass(frozen=True, kw_only=True)
class FaultModel:
    """What a scenario says may go wrong.

    Attributes:
        faults: See `swarm_mj.scenarios.schema_faults`.
        dispersions: The same.
        duration_s: Of the flight [s].
        election: Rule by which the swarm replaces a lost relay; None: by none, or by what its behaviour knows.
    """

    faults: tuple[Fault, ...]
    dispersions: Dispersions
    duration_s: float
    election: str | None = "medoid"


class FaultState:
    """The faults of one flight.

    Args:
        fault_model: What may go wrong.
        properties: Of every spacecraft as planned.
        environment: The body's surroundings as planned.
        n: Number of spacecraft.
        period: Control period [s].
        conditions: Receives what wheels and sensors are like, see `Conditions`.
        flight: Number of the flight there.
        lost: Receives who no longer works, shape (n,).
        speed_margin: See `WheelSet`.

    Attributes:
        lost: Spacecraft that no longer work, shape (n,).
        camera_on: Cameras that work, shape (n,).
        events: What happened, in order of time.
        environment: The surroundings in truth.
        mass: True masses, shape (n,) [kg].
        inertia_B: True inertias, shape (n, 3, 3) [kg m^2].
        wheels: See `WheelSet`.
        sensing: See `Sensing`.
    """

    def __init__(
        self,
        fault_model: FaultModel,
        *,
        properties: SpacecraftProperties,
        environment: Environment,
        n: int,
        period: float,
        conditions: Conditions,
        flight: int,
        lost: Mask,
        speed_margin: float = 0.0,
    ) -> None:
        self._fault_model, self._properties, self._planned = fault_model, properties, environment
        self._n, self._period, self._speed_margin = n, period, speed_margin
        self._conditions, self._flight, self.lost = conditions, flight, lost
        self.camera_on, self._known_lost = np.ones(n, np.bool_), np.zeros(n, np.bool_)
        self._succession = None if fault_model.election is None else Succession(fault_model.election)
        self._drawn: tuple[int, tuple[ScheduledFault, ...], Dispersed, Environment] | None = None
        self.reset(0, ())

    def reset(self, seed: int, deployment: tuple[Event, ...]) -> None:
        """Begin a flight.

        Args:
            seed: Of the scenario.
            deployment: What went wrong when the swarm was deployed.
        """
        given = self._fault_model.dispersions
        if self._drawn is None or self._drawn[0] != seed:
            self._drawn = seed, *self._draw(seed)
            ratio = self._drawn[2]
            self.mass = ratio.mass_ratio * self._properties.mass
            inertia_B = dispersed_inertia(self._properties.inertia_B, ratio.second_moment_ratio)
            self.inertia_B = ratio.mass_ratio[:, None, None] * inertia_B
        _, schedule, drawn, self.environment = self._drawn
        conditions, flight = self._conditions, self._flight
        self.wheels = WheelSet(
            self._properties,
            self.inertia_B,
            drawn.coulomb,
            drawn.viscous,
            wheels_of_flight(conditions, flight),
            self._speed_margin,
        )
        self.sensing = Sensing(given, drawn, schedule, seed, self._period, conditions, flight)
        self.lost[:], self.camera_on[:], self._known_lost[:] = False, True, False
        if self._succession is not None:
            self._succession.reset()
        self.events: list[Event] = []
        self._agenda = in_flight(schedule)
        self._notices: list[tuple[float, ScheduledFault]] = []
        self._endings: list[ScheduledFault] = []
        self._due_relay: list[ScheduledFault] = []
        for event in deployment:
            self.events.append(event)
            if event.kind == "missed_deployment":
                self.lost[event.spacecraft] = self._known_lost[event.spacecraft] = True

    def _draw(self, seed: int) -> tuple[tuple[ScheduledFault, ...], Dispersed, Environment]:
        """What a seed alone decides."""
        model, n, w = self._fault_model, self._n, len(self._properties.wheel_axes_B)
        return (
            draw_schedule(model.faults, seed, n=n, n_wheels=w, duration_s=model.duration_s),
            draw_spacecraft(model.dispersions, seed, n=n, n_wheels=w, period_s=self._period),
            disperse_environment(self._planned, model.dispersions, seed),
        )

    def get_state(self) -> dict[str, Any]:
        """What has become of what `reset` drew, a copy; who is lost is saved with the flight's arrays."""
        return {
            "lists": deepcopy([getattr(self, name) for name in _LISTS]),
            "flags": (self.camera_on.copy(), self._known_lost.copy()),
            "wheels": self.wheels.get_state(),
            "sensing": self.sensing.get_state(),
        }

    def set_state(self, state: dict[str, Any]) -> None:
        """Go on from what `get_state` gave, after a `reset` with the seed of that flight."""
        for name, value in zip(_LISTS, deepcopy(state["lists"]), strict=True):
            setattr(self, name, value)
        self.camera_on[:], self._known_lost[:] = state["flags"]
        self.wheels.set_state(state["wheels"])
        self.sensing.set_state(state["sensing"])

    def happen(self, t: float, wheel_speed: Array) -> None:
        """Let everything happen that is due at `t` [s].

        Args:
            t: Time of the control period that begins; faults fall on the first one at or after their time.
            wheel_speed: Shape (n, w) [rad/s].
        """
        now = t + EARLY_S
        while self._agenda and self._agenda[0].time_s <= now:
            self._begin(t, self._agenda.pop(0), wheel_speed)
        for entry in [e for e in self._endings if e.over_s <= now]:
            self._endings.remove(entry)
            self._end(t, entry)
        for moment, entry in [notice for notice in self._notices if notice[0] <= now]:
            self._notices.remove((moment, entry))
            self._notice(t, entry)

    def next_s(self) -> float:
        """When the next thing is due that `happen` knows of [s]; infinite: nothing is."""
        agenda = [entry.time_s for entry in self._agenda[:1]]
        return min(
            [*agenda, *(e.over_s for e in self._endings), *(moment for moment, _ in self._notices)], default=np.inf
        )

    def _begin(self, t: float, entry: ScheduledFault, wheel_speed: Array) -> None:
        fault, j = entry.fault, entry.spacecraft
        if j == RELAY:
            self._due_relay.append(entry)
            return
        if self.lost[j]:
            return
        if isinstance(fault, SpacecraftLost):
            self._lose(t, j, fault.kind, "", fault.detection_s)
            return
        if isinstance(fault, CameraOff):
            self.camera_on[j] = False
            detail = "no pictures"
        elif isinstance(fault, WHEEL_FAULTS):
            detail = self.wheels.fail(entry, wheel_speed[j])
            if isinstance(fault, WheelLost | WheelStuck):
                self._notices.append((t + fault.detection_s, entry))
        else:
            assert isinstance(fault, (*SENSOR_FAULTS, SensorDelay))
            detail = self.sensing.fail(j, fault)
        self.events.append(Event(t, j, fault.kind, detail))
        if np.isfinite(entry.over_s):
            self._endings.append(entry)

    def _end(self, t: float, entry: ScheduledFault) -> None:
        fault, j = entry.fault, entry.spacecraft
        if isinstance(fault, CameraOff):
            self.camera_on[j] = True
        elif isinstance(fault, WHEEL_FAULTS):
            self.wheels.recover(entry)
        else:
            self.sensing.recover(j, fault)
        if not self.lost[j]:
            self.events.append(Event(t, j, "over", fault.kind))

    def _notice(self, t: float, entry: ScheduledFault) -> None:
        j = entry.spacecraft
        if isinstance(entry.fault, WheelLost | WheelStuck):
            detail = self.wheels.reallocate(entry)
            if not self.lost[j]:
                self.events.append(Event(t, j, "detected", f"{entry.fault.kind}: {detail}"))
        elif not self._known_lost[j]:
            self._known_lost[j] = True
            self.events.append(Event(t, j, "detected", "the swarm knows that it is lost"))

    def _lose(self, t: float, j: int, kind: str, detail: str, detection_s: float = 0.0) -> None:
        self.lost[j] = True
        self.events.append(Event(t, j, kind, detail or "silent, no torque, no pictures"))
        if detection_s > 0.0:
            entry = ScheduledFault(
                t, j, (), np.inf, t + detection_s, SpacecraftLost(kind="spacecraft_lost", spacecraft="any")
            )
            self._notices.append((t + detection_s, entry))
        else:
            self._known_lost[j] = True

    def give_up(self, t: float, j: int, kind: str, detail: str) -> None:
        """A spacecraft's flight is over: it hit the body, or diverged."""
        if self.lost[j]:
            self.events.append(Event(t, j, kind, detail))
        else:
            self._lose(t, j, kind, detail)

    @property
    def redirects(self) -> bool:
        """Whether `redirect` may have to do anything before something else happens."""
        return bool(self._due_relay) or bool(self.lost.any())

    def redirect(self, t: float, targets: Targets, r_BN_N: Array) -> Targets:
        """Lose the relay if it is due, and give lost relays a successor; see `succession`."""
        while self._due_relay and (relay := relay_of(targets, self.lost)) is not None:
            fault: Any = self._due_relay.pop(0).fault
            assert isinstance(fault, CommunicationsLost)
            self._lose(t, relay, fault.kind, "", fault.detection_s)
        if self._succession is None or not self._known_lost.any() or self._known_lost.all():
            return targets
        targets, elected = self._succession.redirect(targets, r_BN_N, self._known_lost)
        for relay, successor in elected:
            self.events.append(Event(t, successor, "elected", f"relays in place of sc{relay + 1}"))
        return targets
