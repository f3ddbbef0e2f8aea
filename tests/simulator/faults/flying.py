"""Short flights for the tests of faults."""

from functools import cache

import mujoco
import numpy as np

from swarm_mj.flight.environment import environment_from, load_body_shape
from swarm_mj.flight.fly import simulate
from swarm_mj.flight.plan import make_plan
from swarm_mj.mission.behaviors import AdaptableRoles
from swarm_mj.scenarios.loading import load_scenario, parse_overrides
from swarm_mj.scenarios.schema import Scenario
from swarm_mj.simulator.faults.schedule import FaultModel
from swarm_mj.simulator.flight_setup import FlightSetup
from swarm_mj.simulator.simulation import Simulation
from swarm_mj.simulator.state import InitialState
from swarm_mj.spacecraft.model import build_model
from swarm_mj.spacecraft.properties import SpacecraftProperties


class NoTorque:
    def torque(self, inputs, memory):
        return np.zeros_like(inputs.sigma_BR), memory


class Constant:
    """The same body torque all the time."""

    def __init__(self, torque_B):
        self._torque = np.asarray(torque_B, float)

    def torque(self, inputs, memory):
        return np.tile(self._torque, (len(inputs.sigma_BR), 1)), memory


def fault(text):
    return f"faults=[{text}]"


@cache
def plan_of(name, overrides):
    """A plan whose sensors are ideal unless an override says otherwise."""
    return make_plan(load_scenario(name, parse_overrides(("spacecraft.sensors=ideal", *overrides))))


@cache
def fly(*overrides, name="eros-quick"):
    """Plan and telemetry of a flight; flown once for all tests."""
    plan = plan_of(name, overrides)
    return plan, simulate(plan)


def events_of(telemetry, kind=None):
    import json

    found = json.loads(telemetry.attrs.get("events", "[]"))
    return [e for e in found if kind in (None, e["kind"])]


def alone(
    controller, *, faults=(), dispersions=None, layout="orthogonal", stepper="mujoco", speed=0.0, rate=0.0, seed=0
):
    """One spacecraft far from the body, so that only its own torques act; wheels turn at `speed`, it at `rate` [rad/s]."""
    checked = Scenario.model_validate({"name": "x", "faults": list(faults), "dispersions": dispersions or {}})
    scenario = load_scenario("eros-quick")
    shape = load_body_shape(scenario.body)
    properties = SpacecraftProperties(wheel_layout=layout)
    setup = FlightSetup(
        model=build_model(1, shape=shape, properties=properties, stepper=stepper),
        environment=environment_from(scenario, shape),
        fault_model=FaultModel(faults=checked.faults, dispersions=checked.dispersions, duration_s=1200.0),
    )
    simulation = Simulation(setup, AdaptableRoles(1, 35e3), controller)
    simulation.reset(
        InitialState(
            r_BN_N=np.full((1, 3), 1e6),
            v_BN_N=np.zeros((1, 3)),
            sigma_BN=np.zeros((1, 3)),
            omega_BN_B=np.full((1, 3), rate),
            wheel_speed=np.full((1, properties.n_wheels), speed),
            seed=seed,
        )
    )
    return simulation


def momentum(simulation):
    """Angular momentum about the centre of mass in N, wheels included, from MuJoCo, shape (3,)."""
    model, data = simulation.model, simulation.data
    mujoco.mj_fwdPosition(model.mjmodel, data)
    mujoco.mj_fwdVelocity(model.mjmodel, data)
    mujoco.mj_subtreeVel(model.mjmodel, data)
    return data.subtree_angmom[model.hub_body][0].copy()
