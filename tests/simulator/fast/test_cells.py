"""Flights in the field of a polyhedron whose sums they share: exact, and bit for bit those flown alone and in Python."""

from dataclasses import replace

import numpy as np
import pytest

from swarm_mj.flight.fly import fault_model_from, initial_state, make_simulation
from swarm_mj.flight.plan import make_plan
from swarm_mj.mission.behaviors import TargetKind, Targets
from swarm_mj.scenarios.constants import EROS_GM
from swarm_mj.scenarios.loading import load_scenario
from swarm_mj.simulator.compiled_batch import CompiledBatch
from swarm_mj.simulator.simulation import Simulation
from swarm_mj.simulator.slots import Slot
from swarm_mj.smallbody.gravity.polyhedron import Polyhedron
from swarm_mj.smallbody.shape_harmonics import build_eros

KERNEL = ["physics.wheels=gyrostat", "physics.stepper=kernel"]
SUNLIT = ["perturbations.solar_tide=true", "perturbations.solar_radiation_pressure=true"]


@pytest.fixture(scope="module")
def eros():
    return Polyhedron(build_eros(6), gm=EROS_GM)


def plan_of(eros, *overrides):
    plan = make_plan(load_scenario("eros-config2", list(overrides)))
    return replace(plan, environment=replace(plan.environment, gravity=eros))


def twin(plan, *, compiled):
    made = make_simulation(plan)
    simulation = Simulation(
        made.model,
        properties=plan.properties,
        environment=plan.environment,
        behavior=made.behavior,
        controller=plan.controller,
        control_period=made.period,
        fault_model=fault_model_from(plan.scenario),
        compiled=compiled,
    )
    simulation.reset(initial_state(plan))
    return simulation


def batch_of(plan, directions_N):
    """Flights from one start that look in other directions, shape (E, n, 3)."""
    count = len(directions_N)
    batch = CompiledBatch(make_simulation(plan), count, plan.controller)
    for e in range(count):
        batch.reset(e, initial_state(plan))
    kinds = np.full((count, plan.n), int(TargetKind.DIRECTION))
    batch.hold(Targets(kinds, np.zeros_like(kinds), directions_N), None)
    return batch


def some_directions(count, n):
    directions = np.random.default_rng(5).standard_normal((count, n, 3))
    return directions / np.linalg.norm(directions, axis=-1, keepdims=True)


@pytest.mark.parametrize("overrides", [[], [*KERNEL, *SUNLIT], ["dispersions.gravity_percent=5"]])
def test_compiled_flights_share_sums_and_are_those_decided_in_python_to_the_last_bit(eros, overrides):
    plan = plan_of(eros, *overrides)
    quick, slow = (twin(plan, compiled=compiled) for compiled in (True, False))
    assert quick._world is not None and slow._world is None and quick._world.field.cell > 0.0
    quick.fly(80)
    slow.fly(80)
    for name in ("qpos", "qvel"):
        assert np.array_equal(getattr(quick.data, name), getattr(slow.data, name))


def test_flights_of_a_batch_are_those_flown_alone_whoever_flew_before(eros):
    plan = plan_of(eros, *SUNLIT)
    directions = some_directions(3, plan.n)
    together, swapped = batch_of(plan, directions), batch_of(plan, directions[::-1].copy())
    for batch in (together, swapped):
        assert batch.fly(60, np.ones(3, bool))
    for e in range(3):
        alone = batch_of(plan, directions[e : e + 1])
        assert alone.fly(60, np.ones(1, bool))
        for flown in (together.qpos[e], swapped.qpos[2 - e]):
            assert np.array_equal(flown, alone.qpos[0])


def test_the_second_flight_takes_no_sums_although_its_places_differ_in_their_last_digits(eros):
    plan = plan_of(eros)
    batch = batch_of(plan, some_directions(2, plan.n))
    cells = batch._world.cells
    assert batch.fly(400, np.array([True, False]))
    first = cells[:400].copy()
    assert batch.fly(400, np.array([False, True]))
    one, other = (batch._q[e, :, :3] for e in range(2))
    assert not np.array_equal(one, other) and np.abs(one - other).max() < 1e-8
    changed = (cells[:400] != first).any(axis=-1).mean()
    assert changed < 2e-3 and (first[:, :, 6] != 0.0).all()


def test_flights_are_pulled_as_the_sums_say_and_end_where_they_lead(eros, monkeypatch):
    """A whole flyby, with the sums taken at every place, and in cells."""
    plan = plan_of(eros)
    directions = some_directions(1, plan.n)
    shared = batch_of(plan, directions)
    with monkeypatch.context() as patched:
        patched.setattr(Polyhedron, "in_cells", property(lambda self: self))
        exact = batch_of(plan, directions)
    assert shared._world.field.cell > 0.0 == exact._world.field.cell
    worst = 0.0
    for _ in range(30):
        for batch in (shared, exact):
            assert batch.fly(100, np.ones(1, bool))
        R_A, a_N = shared.work[0, Slot.R_A], shared.work[0, Slot.A]
        expected = np.linalg.norm(eros.acceleration(R_A), axis=1)
        C_mid = shared._flights.C_mid[0]
        error = np.linalg.norm(a_N @ C_mid.T - eros.acceleration(R_A), axis=1) / expected
        worst = max(worst, float(error.max()))
    assert worst < 1e-12
    off = np.abs(shared._q[0, :, :3] - exact._q[0, :, :3]).max()
    assert 0.0 < off < 1e-6
