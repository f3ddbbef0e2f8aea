"""Short flights of packaged scenarios for the tests of the loop."""

from dataclasses import replace
from functools import cache

import numpy as np

from swarm_mj.flight.fly import fault_model_from, initial_state, make_simulation
from swarm_mj.flight.plan import make_plan
from swarm_mj.mission.behaviors import TargetKind, Targets
from swarm_mj.scenarios.constants import EROS_GM
from swarm_mj.scenarios.loading import load_scenario, parse_overrides
from swarm_mj.simulator.batch import FlightBatch
from swarm_mj.simulator.flight_setup import FlightSetup
from swarm_mj.simulator.simulation import Simulation
from swarm_mj.smallbody.gravity.polyhedron import Polyhedron
from swarm_mj.smallbody.shape_harmonics import build_shape

KERNEL = "physics.stepper=kernel"
#: Everything that is drawn, and faults of every kind at instants on and between control periods.
DISPERSIONS = (
    "dispersions.mass_percent=5",
    "dispersions.inertia_percent=5",
    "dispersions.wheel_coulomb_n_m=2e-5",
    "dispersions.gravity_percent=5",
    "dispersions.harmonics_percent=10",
    "spacecraft.sensors=ideal",
    "spacecraft.sensors.delay_s=2",
    "dispersions.attitude_deg=5",
    "perturbations.gravity_gradient_torque=true",
)
FAULTS = """faults=[
    {kind: wheel_stuck, spacecraft: sc1, wheel: 2, at_s: 3.2, detection_s: 4},
    {kind: wheel_weakened, spacecraft: sc2, wheel: 1, at_s: 5, duration_s: 9},
    {kind: gyro_bias, spacecraft: sc3, bias_deg_h: [900, -300, 100], at_s: 7.7},
    {kind: sensor_delay, spacecraft: sc4, delay_s: 1.5, at_s: 10, duration_s: 20},
    {kind: star_tracker_noise, spacecraft: sc2, sigma_arcsec: 60, at_s: 11, duration_s: 5},
    {kind: camera_off, spacecraft: sc3, at_s: 12, duration_s: 5},
    {kind: spacecraft_lost, spacecraft: sc1, at_s: 30.1},
    {kind: communications_lost, at_s: 20, detection_s: 2}]"""


@cache
def plan_of(name, *overrides):
    return make_plan(load_scenario(name, parse_overrides(overrides)))


def near_polyhedron(plan):
    """The same plan in the field of a polyhedron."""
    return replace(plan, environment=replace(plan.environment, gravity=Polyhedron(build_shape("eros", 6), gm=EROS_GM)))


def fly(plan, periods=0, **parts):
    """A simulation of a plan, parts of it replaced, after so many periods."""
    made = make_simulation(plan)
    keys = {"behavior": made.behavior, "controller": plan.controller, "environment": plan.environment} | parts
    scenario = plan.scenario
    setup = FlightSetup(
        model=made.model,
        environment=keys.pop("environment"),
        period=keys.pop("control_period", made.period),
        gravity_gradient=scenario.perturbations.gravity_gradient_torque,
        fault_model=keys.pop("fault_model", fault_model_from(scenario)),
        minimum_time_slews=scenario.control.slew == "time_optimal",
    )
    simulation = Simulation(setup, force_law=made.force_law, **keys)
    simulation.reset(initial_state(plan))
    simulation.fly(periods)
    return simulation


def batch_of(plan, starts, controller="plan", behaviors=None):
    """Flights of a plan, each from its start; those without behaviours point at the body."""
    law = plan.controller if controller == "plan" else controller
    batch = FlightBatch(make_simulation(plan).setup, len(starts), law, behaviors)
    for e, start in enumerate(starts):
        batch.reset(e, start)
    if behaviors is None:
        kind = np.full((len(starts), plan.n), int(TargetKind.ASTEROID))
        batch.hold(Targets(kind, np.zeros_like(kind), np.zeros((*kind.shape, 3))), None)
    return batch


def start_of(plan, seed):
    """The start that a seed draws, with what goes wrong."""
    return initial_state(replace(plan, scenario=plan.scenario.model_copy(update={"seed": seed})))


def numbers_of(flights, e=0):
    """All that moves in a flight, one row."""
    parts = ("r_N", "v_N", "q_BN", "omega_B", "wheel_speed", "motor", "lost", "kind", "spacecraft", "tick", "effort")
    return np.concatenate([np.ravel(getattr(flights, name)[e]).astype(float) for name in parts])


def place(simulation, **changes):
    """Change the state of a flight, by the names of its arrays."""
    names = "r_N", "q_BN", "v_N", "omega_B", "wheel_speed"
    r, q, *motion = ((changes.get(name, getattr(simulation.state, name))).copy() for name in names)
    simulation.batch.place(0, np.hstack((r, q)), np.hstack(motion))


def angle(q, p):
    """Between attitudes, shape (...) [rad], accurate when small."""
    return 2.0 * np.minimum(np.linalg.norm(q - p, axis=-1), np.linalg.norm(q + p, axis=-1))
