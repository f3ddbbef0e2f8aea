"""What faults and dispersions do to the arrays of one flight; a flight without them never comes here.

What goes wrong is decided by `FaultState`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from swarm_mj.mission.behaviors import SwarmView, Targets
from swarm_mj.scenarios.schema_faults import Dispersions
from swarm_mj.simulator.faults.dispersions import unscaled
from swarm_mj.simulator.faults.schedule import Event
from swarm_mj.simulator.faults.sensing import NOISE_ROWS, can_err, most_readings
from swarm_mj.simulator.faults.state import EARLY_S, FaultModel, FaultState
from swarm_mj.simulator.flights import NEVER, Conditions, World, allocate_conditions
from swarm_mj.simulator.mujoco import write_masses
from swarm_mj.simulator.slots import Resting, Slot
from swarm_mj.simulator.state import FlightState
from swarm_mj.simulator.world import SPEED_MARGIN
from swarm_mj.smallbody.gravity.spherical_harmonics import SphericalHarmonics
from swarm_mj.smallbody.rotation import sub_point
from swarm_mj.typing import Array

#: Numbers beyond this are no state of a spacecraft, whatever their unit; a sum of finite ones may overflow.
_ABSURD = 1e100
NOTHING = FaultModel(faults=(), dispersions=Dispersions(), duration_s=0.0)


def conditions_for(fault_model: FaultModel, world: World, count: int) -> Conditions:
    """Space for what a fault model can make of E flights."""
    n, w = len(world.inertia_B), len(world.wheel_axes_B)
    return allocate_conditions(
        count,
        n,
        w,
        noise_rows=NOISE_ROWS if can_err(fault_model.dispersions, fault_model.faults) else 0,
        readings=most_readings(fault_model.dispersions, fault_model.faults, world.period),
        series=world.field.series.shape if fault_model.dispersions.harmonics_percent > 0.0 else (),
    )


class FaultInjection:
    """Faults of one flight.

    Args:
        state: Of the flight; its model is changed, and must be its own.
        fault_model: What may go wrong.
        conditions: What compiled code is told of it.
        e: Number of the flight there.

    Attributes:
        state: As given.
        fault_model: As given.
        planned: The environment as planned.
        faults: What goes wrong.
        due: Tick at which something has to be done before compiled code may fly on.
    """

    def __init__(self, state: FlightState, fault_model: FaultModel, conditions: Conditions, e: int) -> None:
        self.state, self.fault_model, self.planned, self.due = state, fault_model, state.environment, 0
        self._conditions, self._e = conditions, e
        self.faults = FaultState(
            fault_model,
            properties=state.properties,
            environment=state.environment,
            n=state.model.n,
            period=state.period,
            speed_margin=SPEED_MARGIN,
            conditions=conditions,
            flight=e,
            lost=state.lost,
        )
        given = fault_model.dispersions
        self._disperses_mass = given.mass_percent > 0.0 or given.inertia_percent > 0.0

    def reset(self, seed: int, deployment: tuple[Event, ...]) -> None:
        """Begin a flight: draw from the seed what will happen and what the spacecraft are like."""
        state, faults = self.state, self.faults
        faults.reset(seed, deployment)
        state.environment, self.due = faults.environment, 0
        state.mass[:], state.inertia_B[:] = faults.mass, faults.inertia_B
        if self._disperses_mass and state.data is not None:
            write_masses(state.model, state.data, faults.mass, faults.inertia_B)
        field, factor = unscaled(state.environment.gravity)
        self._conditions.field_factor[self._e] = factor
        if len(self._conditions.series) and isinstance(field, SphericalHarmonics):
            self._conditions.series[self._e] = field.acceleration_series

    def get_state(self) -> dict[str, Any]:
        """What has become of the flight since `reset`, a copy."""
        return self.faults.get_state()

    def set_state(self, saved: dict[str, Any]) -> None:
        """Go on from what `get_state` gave, after a `reset` with the seed of that flight."""
        self.faults.set_state(saved)
        self.due = 0

    def aim(self, view: SwarmView, ask: Callable[[SwarmView], Targets]) -> Targets:
        """Let happen what is due, and ask for the targets that hold until the next event.

        Args:
            view: The instant.
            ask: Gives the targets of an instant.

        Returns:
            The targets; lost relays have successors.
        """
        faults = self.faults
        faults.happen(view.t, self.state.wheel_speed)
        seen = view._replace(working=~faults.lost, camera_on=faults.camera_on & ~faults.lost)
        targets = faults.redirect(view.t, ask(seen), view.r_BN_N)
        self.due = self._tick_of(faults.next_s())  # a relay lost just now is noticed later
        return targets

    def _tick_of(self, time_s: float) -> int:
        """The first control period that begins at or after a time."""
        if not np.isfinite(time_s):
            return NEVER
        period = self.state.period
        tick = max(0, int(time_s / period) - 2)
        while time_s > tick * period + EARLY_S:
            tick += 1
        return tick

    def provide_noise(self) -> None:
        """See that there is noise for the next reading of the sensors."""
        self.faults.sensing.provide_noise()

    def prepare_sensors(self) -> None:
        """Let sensors that fail at this instant fail, and see that there is noise, before they are read."""
        if self.state.tick >= self.due:
            self.faults.happen(self.state.time, self.state.wheel_speed)
        self.provide_noise()

    def diverged(self) -> None:
        """Give up the spacecraft whose states are not finite; each is held where it was at the last decision."""
        state = self.state
        numbers = np.hstack((state.r_N, state.v_N, state.q_BN, state.omega_B, state.wheel_speed))
        with np.errstate(invalid="ignore"):
            bad = np.flatnonzero(~(np.isfinite(numbers) & (np.abs(numbers) < _ABSURD)).all(axis=1))
        for j in bad:
            state.r_N[j], state.q_BN[j] = state.work[Slot.R, j], (1.0, 0.0, 0.0, 0.0)
            state.v_N[j], state.omega_B[j], state.wheel_speed[j] = 0.0, 0.0, 0.0
            self._rest(int(j), Resting.HELD, "diverged", "its state was not finite; held where it was")

    def without_torque(self) -> None:
        """Give up the spacecraft whose control law gives no finite torque."""
        state = self.state
        bad = ~np.isfinite(state.torque_B).all(axis=1)
        for j in np.flatnonzero(bad & ~state.lost):
            self._rest(int(j), Resting.HELD, "diverged", "its control law gave no finite torque; held where it was")
        state.torque_B[bad] = 0.0

    def impact(self, j: int, r_A: Array) -> None:
        """Record an impact; the spacecraft lies where it hit."""
        latitude, longitude = sub_point(r_A, np.eye(3))
        self.state.rest_A[j] = r_A
        self._rest(j, Resting.ON_THE_BODY, "impact", f"latitude {latitude:.2f} deg, longitude {longitude:.2f} deg")

    def _rest(self, j: int, how: Resting, kind: str, detail: str) -> None:
        """The flight of a spacecraft is over; the swarm learns of it at the next decision."""
        self.state.resting[j] = how
        self.faults.give_up(self.state.time, j, kind, detail)
        self.due = 0
        self.state.flights.due[0] = 0
