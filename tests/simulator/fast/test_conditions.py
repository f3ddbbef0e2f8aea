"""Faults and dispersions in compiled code against the same flights decided in Python, alone and in batches."""

from dataclasses import replace

import numpy as np
import pytest

from swarm_mj.flight.fly import fault_model_from, initial_state, make_simulation
from swarm_mj.flight.plan import make_plan
from swarm_mj.mission.behaviors import TargetKind, Targets
from swarm_mj.scenarios.loading import load_scenario
from swarm_mj.simulator.compiled_batch import CompiledBatch
from swarm_mj.simulator.python_batch import PythonBatch
from swarm_mj.simulator.simulation import Simulation

KERNEL = ["physics.wheels=gyrostat", "physics.stepper=kernel"]
#: Everything that is drawn, and every kind of fault at instants on and between control periods.
DISPERSIONS = [
    "dispersions.mass_percent=5",
    "dispersions.inertia_percent=5",
    "dispersions.wheel_coulomb_n_m=2e-5",
    "dispersions.gravity_percent=5",
    "dispersions.harmonics_percent=10",
    "dispersions.delay_s=2",
    "dispersions.attitude_deg=5",
    "perturbations.gravity_gradient_torque=true",
]
FAULTS = """faults=[
    {kind: wheel_stuck, spacecraft: sc1, wheel: 2, at_s: 3.2, detection_s: 4},
    {kind: wheel_weakened, spacecraft: sc2, wheel: 1, at_s: 5, duration_s: 9},
    {kind: gyro_bias, spacecraft: sc3, bias_deg_h: [900, -300, 100], at_s: 7.7},
    {kind: sensor_delay, spacecraft: sc4, delay_s: 1.5, at_s: 10, duration_s: 20},
    {kind: star_tracker_noise, spacecraft: sc2, sigma_arcsec: 60, at_s: 11, duration_s: 5},
    {kind: camera_off, spacecraft: sc3, at_s: 12, duration_s: 5},
    {kind: spacecraft_lost, spacecraft: sc1, at_s: 30.1},
    {kind: communications_lost, at_s: 20, detection_s: 2}]"""


def plan_of(*overrides, scenario="eros-config2"):
    return make_plan(load_scenario(scenario, list(overrides)))


def twin(plan, *, compiled, behavior=None, seed=None):
    """A simulation of a plan at its start."""
    scenario = plan.scenario
    made = make_simulation(plan)
    simulation = Simulation(
        made.model,
        properties=plan.properties,
        environment=plan.environment,
        behavior=behavior or made.behavior,
        controller=plan.controller,
        control_period=made.period,
        gravity_gradient_torque=scenario.perturbations.gravity_gradient_torque,
        fault_model=fault_model_from(scenario),
        compiled=compiled,
    )
    simulation.reset(start_of(plan, scenario.seed if seed is None else seed))
    return simulation


class Held:
    """Targets that somebody else writes."""

    def __init__(self, targets):
        self.held = targets

    def targets(self, view, memory):
        return self.held, memory

    def steady_for(self, view, memory):
        return np.inf


def hear_the_relay(n):
    """All listen to the fourth, which talks to Earth until it is lost."""
    kind = np.full(n, int(TargetKind.SPACECRAFT))
    kind[3] = int(TargetKind.EARTH)
    return Targets(kind, np.full(n, 3), np.zeros((n, 3)))


def start_of(plan, seed):
    return initial_state(replace(plan, scenario=plan.scenario.model_copy(update={"seed": seed})))


@pytest.mark.parametrize(
    "overrides",
    [[*KERNEL, *DISPERSIONS, FAULTS], [*DISPERSIONS, FAULTS, "spacecraft.wheel_layout=pyramid"]],
    ids=["gyrostats", "pyramids"],
)
def test_a_flight_in_which_much_goes_wrong_is_that_decided_in_python_to_the_last_bit(overrides):
    plan = plan_of(*overrides)
    behavior = Held(hear_the_relay(plan.n))
    quick, slow = (twin(plan, compiled=compiled, behavior=behavior) for compiled in (True, False))
    assert quick._world is not None and slow._world is None
    one, other = quick.run(60.0, 1.0), slow.run(60.0, 1.0)
    for name in ("vectors", "attitude", "aim", "peaks"):
        assert np.array_equal(getattr(one, name), getattr(other, name)), name
    found, expected = one.faults.variables(), other.faults.variables()
    assert all(np.array_equal(found[name][1], expected[name][1]) for name in expected)
    assert quick.events == slow.events
    kinds = {event.kind for event in quick.events}
    assert {"wheel_stuck", "over", "detected", "spacecraft_lost", "communications_lost", "elected"} <= kinds


def knowledge(batch, n, wheels):
    parts = [np.zeros((batch.count, n, k)) for k in (3, 3, 4, 3, wheels)]
    batch.read(*parts)
    imperfect = batch.know(np.ones(batch.count, bool), parts[2], parts[3])
    return [imperfect, *parts]


@pytest.mark.parametrize("layout", [KERNEL, ["spacecraft.wheel_layout=pyramid"]], ids=["gyrostats", "pyramids"])
def test_a_batch_with_faults_flies_each_seed_as_python_does(layout):
    """Stretches end where somebody looks, events fall between, and one flight is taken up again from its saved state."""
    plan = plan_of(*layout, *DISPERSIONS, FAULTS)
    n, wheels, seeds, everybody = plan.n, plan.properties.n_wheels, (4, 9), np.ones(2, bool)
    held = hear_the_relay(n)
    singles = PythonBatch([twin(plan, compiled=False, behavior=Held(held)) for _ in seeds])
    batch = CompiledBatch(make_simulation(plan), 2, plan.controller)
    for flights in (singles, batch):
        for e, seed in enumerate(seeds):
            flights.reset(e, start_of(plan, seed))
    for periods in (7, 1, 40, 30):
        for flights in (singles, batch):
            flights.hold(Targets(*(np.array([part] * 2) for part in held)), None)
            assert flights.fly(periods, everybody)
        for one, other in zip(knowledge(singles, n, wheels), knowledge(batch, n, wheels), strict=True):
            assert np.array_equal(one, other)
        if periods == 40:
            saved = batch.get_state(0)
            batch.fly(3, everybody)
            batch.set_state(0, saved)
            batch.set_state(1, {**batch.get_state(1)})
            singles.fly(3, np.array([False, True]))
    for name in ("kind", "index", "lost", "blind", "tick"):
        assert np.array_equal(getattr(singles, name), getattr(batch, name)), name
    assert batch.lost[:, 3].all() and (batch.kind[:, [0, 1, 2, 4]] == int(TargetKind.EARTH)).any(axis=1).all()
    assert not np.array_equal(batch.qpos[0], batch.qpos[1])
    np.testing.assert_allclose(batch.effort, singles.effort, rtol=1e-12)


def test_inertias_that_are_drawn_are_what_the_motors_turn():
    """The rates reached from rest, times the true inertia, are the impulse of the torque."""
    plan = plan_of(*KERNEL, "dispersions.inertia_percent=10", "dispersions.mass_percent=10")
    batch = CompiledBatch(make_simulation(plan), 2, None)
    torque, spin = np.full((2, plan.n, 3), (2e-5, -1e-5, 3e-5)), plan.properties.wheel_spin_inertia
    for e in range(2):
        start = start_of(plan, e)
        batch.reset(e, replace(start, omega_BN_B=np.zeros((plan.n, 3))))
    batch.hold(hear_two(plan.n), torque)
    batch.fly(20, np.ones(2, bool))
    for e in range(2):
        twin_of = make_simulation(plan)
        twin_of.reset(start_of(plan, e))
        inertia = twin_of.injection.faults.inertia_B - spin * np.eye(3)
        _, qvel = batch.rows(e)
        impulse = np.einsum("nij,nj->ni", inertia, qvel[:, 3:6])
        np.testing.assert_allclose(impulse, 10.0 * torque[e], rtol=2e-3)


def hear_two(n):
    return Targets(*(np.array([part] * 2) for part in hear_the_relay(n)))
