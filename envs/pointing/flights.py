"""What SwarmPointing-v0 takes from the simulator: a batch of single gyrostats, and where a swarm is along its flyby."""

from __future__ import annotations

import numpy as np

from swarm_mj.errors import ScenarioError, SimulationError
from swarm_mj.flight.fly import make_simulation
from swarm_mj.flight.plan import Plan
from swarm_mj.simulator.batch import FlightBatch
from swarm_mj.simulator.flight_setup import FlightSetup
from swarm_mj.simulator.loop import Stage
from swarm_mj.simulator.slots import Slot
from swarm_mj.spacecraft.attitude.guidance import pointing_error
from swarm_mj.spacecraft.model import build_model
from swarm_mj.typing import Array, Mask


class PointingFlights(FlightBatch):
    """E flights of one spacecraft each, their motors held; what is read of them is of the last decision."""

    def turn(self, torque_B: Array, ticks: int, live: Mask) -> Array:
        """Fly on with torques of the wheels on the body held, shape (E, 1, 3) [N m].

        Returns:
            Sum of the squares of the motor torques, shape (E,) [N^2 m^2].
        """
        self.flights.effort[:] = 0.0
        self.hold(None, torque_B)
        self.fly(ticks, live)
        effort = self.flights.effort.copy()
        self.guide(live)
        return effort

    def aim(self, e: int, kind: int, vector: Array) -> None:
        """Give flight e another reference, which `guide` follows."""
        f = self.flights
        f.kind[e], f.spacecraft[e], f.vector[e], f.stage[e] = kind, 0, vector, Stage.BEGIN

    def guide(self, live: Mask) -> None:
        """Bring the readings up to date."""
        if not self.decide(live):
            raise SimulationError("; ".join(cause for cause in self.causes if cause))

    def reading(self, slot: Slot) -> Array:
        """A vector of each flight, shape (E, 3)."""
        return np.asarray(self.flights.work[:, slot, 0])

    @property
    def error(self) -> Array:
        """Angle between +z and the line of sight [rad], shape (E,)."""
        return np.asarray(pointing_error(self.flights.q_BN[:, 0], self.reading(Slot.LOS)))


def flyby_states(plan: Plan, grid: int, last: int) -> tuple[Array, Array]:
    """Positions and velocities of a swarm in N every `grid` control periods up to the `last`, shape (starts, n, 3) [m, m/s].

    Raises:
        ScenarioError: The scenario has faults or dispersions.
    """
    swarm, name = make_simulation(plan), plan.scenario.name
    if swarm.injection is not None:
        raise ScenarioError(
            f"scenario = {name}: SwarmPointing-v0 knows no faults and dispersions; leave faults and dispersions out"
        )
    rows = []
    for tick in range(0, last + 1, grid):
        if tick:
            swarm.fly(grid)
        rows.append((swarm.state.r_N.copy(), swarm.state.v_N.copy()))
    return np.array([r for r, _ in rows]), np.array([v for _, v in rows])


def setup_of_one(plan: Plan) -> FlightSetup:
    """A swarm of one free gyrostat in the plan's surroundings."""
    scenario = plan.scenario
    model = build_model(
        1,
        shape=plan.shape,
        properties=plan.properties,
        timestep=scenario.physics.timestep_s,
        geometry=False,
        stepper=scenario.physics.stepper,
    )
    return FlightSetup(
        model=model,
        environment=plan.environment,
        period=scenario.control.period_s,
        gravity_gradient=scenario.perturbations.gravity_gradient_torque,
    )
