"""Flights in compiled code against the same flights decided in Python, and control laws of one's own in compiled code."""

import importlib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from swarm_mj.errors import PluginError, ScenarioError, SimulationError
from swarm_mj.flight.fly import initial_state, make_simulation
from swarm_mj.flight.plan import make_plan
from swarm_mj.mission.behaviors import AdaptableRoles, TargetKind, Targets
from swarm_mj.scenarios.constants import EROS_GM
from swarm_mj.scenarios.loading import load_scenario
from swarm_mj.simulator.compiled_batch import CompiledBatch
from swarm_mj.simulator.simulation import Simulation
from swarm_mj.smallbody.gravity.compiled import compiled_field, write_attraction
from swarm_mj.smallbody.gravity.point_mass import PointMass
from swarm_mj.smallbody.gravity.polyhedron import CELL_NUMBERS, Polyhedron
from swarm_mj.smallbody.shape_harmonics import build_eros
from swarm_mj.spacecraft.control.base import ControlInput
from swarm_mj.spacecraft.control.compiled import CompiledLaw
from swarm_mj.spacecraft.control.feedback import MrpFeedback
from swarm_mj.spacecraft.control.sliding_mode import MrpSlidingMode


def plan_of(*overrides, scenario="eros-config2"):
    return make_plan(load_scenario(scenario, list(overrides)))


def twin(plan, *, compiled, controller=None, behavior=None):
    """A simulation of a plan at its start."""
    made = make_simulation(plan)
    simulation = Simulation(
        made.model,
        properties=plan.properties,
        environment=plan.environment,
        behavior=behavior or made.behavior,
        controller=controller or plan.controller,
        control_period=made.period,
        gravity_gradient_torque=plan.scenario.perturbations.gravity_gradient_torque,
        shape=plan.shape,
        compiled=compiled,
    )
    simulation.reset(initial_state(plan))
    return simulation


def records_are_equal(one, other):
    return all(
        np.array_equal(getattr(one, k), getattr(other, k)) for k in ("time", "vectors", "attitude", "aim", "peaks")
    )


class Proportional:
    """A law of a user's own."""

    def __init__(self, gain=0.02):
        self.gain = gain
        self.calls = 0

    def torque(self, inputs, memory):
        self.calls += 1
        return -self.gain * (0.1 * inputs.sigma_BR + inputs.omega_BR_B), None

    def compiled(self):
        return CompiledLaw(write_proportional, [self.gain])


def write_proportional(
    sigma_BR,
    omega_BR_B,
    omega_BN_B,
    omega_RN_B,
    domega_RN_B,
    wheel_momentum_B,
    inertia_B,
    inertia_effective_B,
    numbers,
    torque_B,
):
    for j in range(len(sigma_BR)):
        for k in range(3):
            torque_B[j, k] = -numbers[0] * (0.1 * sigma_BR[j, k] + omega_BR_B[j, k])


@pytest.mark.parametrize("wheels", ["bodies", "gyrostat"])
@pytest.mark.parametrize("scenario", ["eros-config1", "eros-config2"])
def test_compiled_flights_are_those_decided_in_python_to_the_last_bit(scenario, wheels):
    plan = plan_of(f"physics.wheels={wheels}", scenario=scenario)
    quick, slow = (twin(plan, compiled=compiled) for compiled in (True, False))
    assert quick._world is not None and slow._world is None
    # Past the edge of the imaging region, where targets change.
    one, other = quick.run(1100.0, 5.0), slow.run(1100.0, 5.0)
    assert len(np.unique(one.aim[:, 0])) > 1
    assert records_are_equal(one, other)
    assert quick.time == slow.time == 1100.0 and quick.data.time == pytest.approx(slow.data.time)


FORCES = {
    "tide": ["perturbations.solar_tide=true"],
    "pressure": ["perturbations.solar_radiation_pressure=true"],
    "gradient": ["perturbations.gravity_gradient_torque=true", "perturbations.solar_tide=true"],
    "point mass": [],
    "polyhedron": [],
}


@pytest.mark.parametrize("force", FORCES)
def test_every_force_is_the_same_in_compiled_code_to_the_last_bit(force):
    plan = plan_of("physics.wheels=gyrostat", "physics.stepper=kernel", *FORCES[force])
    plain = make_simulation(plan_of("physics.wheels=gyrostat", "physics.stepper=kernel"))
    if not FORCES[force]:
        gravity = PointMass(EROS_GM) if force == "point mass" else Polyhedron(build_eros(6), gm=EROS_GM)
        plan = replace(plan, environment=replace(plan.environment, gravity=gravity))
    quick, slow = (twin(plan, compiled=compiled) for compiled in (True, False))
    assert quick._world is not None and slow._world is None
    assert records_are_equal(quick.run(40.0, 1.0), slow.run(40.0, 1.0))
    plain.fly(80)
    assert not np.array_equal(plain.data.qpos, quick.data.qpos)  # what was asked for acts


@pytest.mark.parametrize("radii", [1.5, 15.9, 16.1, 20.0, 24.1, 1000.0])
def test_fields_in_kernels_pull_as_in_python_near_and_far(radii):
    body = Polyhedron(build_eros(6), gm=EROS_GM)
    r_A = radii * body.shape.max_radius * np.array([[0.6, 0.0, 0.8], [-0.48, 0.64, -0.6]])
    for gravity in (body, PointMass(EROS_GM), body.far_field):
        field, found = compiled_field(gravity), np.full((2, 3), np.nan)
        write_attraction(r_A, field, field.series, np.zeros((2, CELL_NUMBERS)), found)
        assert np.array_equal(found, gravity.acceleration(r_A))


def test_flights_that_start_alike_share_gravity_and_others_do_not():
    """The second flight of a batch is flown among others, and once more alone, bit for bit."""
    plan = plan_of("physics.wheels=gyrostat", "physics.stepper=kernel", "perturbations.solar_tide=true")
    start = initial_state(plan)
    moved = replace(start, r_BN_N=start.r_BN_N + 100.0)
    law, roles = plan.controller, [AdaptableRoles(plan.n, 3e4) for _ in range(3)]
    batch = CompiledBatch(make_simulation(plan), 3, law, roles)
    for e, each in enumerate((start, moved, start)):
        batch.reset(e, each)
    batch.fly(40, np.ones(3, bool))
    assert np.array_equal(batch.qpos[0], batch.qpos[2]) and not np.array_equal(batch.qpos[0], batch.qpos[1])
    alone = CompiledBatch(make_simulation(plan), 1, law, roles[:1])
    alone.reset(0, moved)
    alone.fly(40, np.ones(1, bool))
    assert np.array_equal(alone.qpos[0], batch.qpos[1]) and np.array_equal(alone.qvel[0], batch.qvel[1])


LOST_AT_ONCE = "faults=[{kind: spacecraft_lost, spacecraft: sc2, at_s: 0}]"


@pytest.mark.parametrize("overrides", [[], ["dispersions.star_tracker_noise_arcsec=30", LOST_AT_ONCE]])
def test_a_flight_that_was_put_back_after_its_first_decision_never_decided(overrides):
    plan = plan_of("physics.wheels=gyrostat", "physics.stepper=kernel", *overrides)
    batch, start, it = CompiledBatch(make_simulation(plan), 2, plan.controller), initial_state(plan), np.ones(2, bool)
    for e in range(2):
        batch.reset(e, start)
    batch.hold(Targets(*(np.array([part] * 2) for part in towards_x(plan.n))), None)
    assert batch.decide(np.array([True, False]))
    assert batch.effort[0] > 0.0 and np.any(batch.ctrl[0])
    batch.rewind(0, start)
    assert not np.any(batch.ctrl) and np.array_equal(batch.tick, [0, 0])
    assert not batch.lost.any()
    assert batch.fly(30, it)
    assert batch.lost.any() == bool(overrides)
    for part in (batch.qpos, batch.qvel, batch.effort, batch.lost):
        assert np.array_equal(part[0], part[1])


def towards_x(n):
    return Targets(np.full(n, int(TargetKind.DIRECTION)), np.zeros(n, int), np.tile([1.0, 0.0, 0.0], (n, 1)))


@pytest.mark.parametrize("law", [MrpSlidingMode(), MrpSlidingMode(rate_limit=None), MrpFeedback(), Proportional()])
def test_a_compiled_law_writes_the_torques_of_the_law_in_python(law):
    plan = plan_of("control.controller=mrp_feedback")
    quick, slow = (twin(plan, compiled=compiled, controller=law) for compiled in (True, False))
    one, other = quick.run(60.0, 1.0), slow.run(60.0, 1.0)
    assert np.abs(one.vectors[:, 5]).max() > 0.0  # wheel torques
    assert records_are_equal(one, other)


def test_a_law_that_is_offered_for_compiled_code_is_not_called_in_flight():
    law = Proportional()
    simulation = twin(plan_of(), compiled=True, controller=law)
    called = law.calls
    simulation.fly(20)
    assert law.calls == called and simulation.tick == 20


def test_a_law_with_memory_is_flown_in_python():
    law = MrpFeedback(integral_gain=0.01)
    assert law.compiled() is None
    assert twin(plan_of(), compiled=True, controller=law)._world is None


def test_flying_a_stretch_is_deciding_and_advancing_in_turn():
    plan = plan_of()
    for compiled in (True, False):
        one, other = (twin(plan, compiled=compiled) for _ in range(2))
        one.fly(37)
        for _ in range(37):
            other.decide()
            other.advance()
        assert one.tick == other.tick == 37
        for name in ("qpos", "qvel", "ctrl", "xfrc_applied", "mocap_quat"):
            assert np.array_equal(getattr(one.data, name), getattr(other.data, name)), name


class Restless(AdaptableRoles):
    """The same, but it says that its answer lasts and counts how often it is asked."""

    asked = 0

    def targets(self, view, memory):
        type(self).asked += 1
        return super().targets(view, memory)


def test_a_behavior_is_asked_only_when_its_answer_may_have_changed():
    plan = plan_of()
    simulation = twin(plan, compiled=True, behavior=Restless(plan.n, plan.behavior.imaging_radius_m))
    Restless.asked = 0
    simulation.fly(40)
    assert 1 <= Restless.asked < 20
    before = Restless.asked
    simulation.ask_again()
    simulation.decide()
    assert Restless.asked == before + 1


def test_another_law_or_behavior_may_take_over_in_flight():
    plan = plan_of()
    one, other = (twin(plan, compiled=compiled) for compiled in (True, False))
    for simulation in (one, other):
        simulation.fly(10)
        simulation.controller = Proportional()
        simulation.behavior = AdaptableRoles(plan.n, 1e3)
        simulation.fly(10)
    assert np.array_equal(one.data.qvel, other.data.qvel)
    assert set(one.decide().kind.tolist()) != {0}


def test_a_state_that_is_set_from_outside_is_flown_on():
    plan = plan_of()
    one, other = (twin(plan, compiled=compiled) for compiled in (True, False))
    for simulation in (one, other):
        simulation.fly(3)
        qpos, qvel = (array.copy() for array in simulation.model.state(simulation.data))
        qvel[1, 3:6] += 0.05
        simulation.model.set_state(simulation.data, qpos, qvel)
        simulation.fly(3)
    assert np.array_equal(one.data.qpos, other.data.qpos)


@pytest.mark.parametrize("compiled", [True, False])
def test_a_flight_that_diverges_says_who_and_when(compiled):
    simulation = twin(plan_of(), compiled=compiled)
    simulation.fly(4)
    qpos, qvel = (array.copy() for array in simulation.model.state(simulation.data))
    qvel[2, 4] = np.nan
    simulation.model.set_state(simulation.data, qpos, qvel)
    with pytest.raises(SimulationError, match=r"sc3 has a state that is not finite at t = 2 s"):
        simulation.fly(1)


def test_a_period_that_is_too_long_for_the_law_is_refused():
    with pytest.raises(ScenarioError, match="too long"):
        twin(plan_of(), compiled=True, controller=MrpFeedback(frequency=10.0))


class Offering(Proportional):
    """A law of which only the compiled part is given by the test."""

    def __init__(self, function, numbers=(1.0,)):
        super().__init__()
        self._offer = CompiledLaw(function, numbers)

    def compiled(self):
        return self._offer


def of_two(sigma_BR, torque_B):
    torque_B[:] = sigma_BR


def of_what_numba_lacks(a, b, c, d, e, f, g, h, numbers, torque_B):
    torque_B.flags_of_its_own()


@pytest.mark.parametrize(
    ("function", "reason"), [(of_two, "takes 2 arguments"), (of_what_numba_lacks, "flags_of_its_own")]
)
def test_a_law_that_cannot_be_compiled_is_refused_with_the_reason(function, reason):
    with pytest.raises(PluginError, match=rf"test_world\.{function.__name__} cannot be compiled.*{reason}"):
        twin(plan_of(), compiled=True, controller=Offering(function))


def test_numbers_of_a_law_must_be_a_row():
    with pytest.raises(PluginError, match=r"numbers has shape \(1, 2\): give a row"):
        twin(plan_of(), compiled=True, controller=Offering(write_proportional, [[1.0, 2.0]]))


def test_torques_of_the_builtin_laws_do_not_depend_on_who_calls_them():
    """One instant, without a flight."""
    rng, n = np.random.default_rng(0), 4
    vectors, inertia = rng.normal(scale=0.1, size=(6, n, 3)), np.tile(np.diag([0.08, 0.08, 0.013]), (n, 1, 1))
    inputs = ControlInput(*vectors, inertia, 0.999 * inertia, 0.5)
    for law in (MrpSlidingMode(), MrpFeedback()):
        expected, _ = law.torque(inputs, None)
        write_torque, numbers = law.compiled()
        found = np.empty((n, 3))
        write_torque(*inputs[:8], numbers, found)
        assert np.array_equal(found, expected)


def test_the_law_of_the_documentation_flies_as_it_stands_there(tmp_path, monkeypatch):
    page = (Path(__file__).parents[3] / "docs/how-to/control_law.md").read_text()
    (tmp_path / "law_of_the_page.py").write_text(page.split("```python\n")[2].split("```")[0])
    monkeypatch.syspath_prepend(tmp_path)
    law = importlib.import_module("law_of_the_page").Damper()
    quick, slow = (twin(plan_of(), compiled=compiled, controller=law) for compiled in (True, False))
    one, other = quick.run(600.0, 10.0), slow.run(600.0, 10.0)
    assert quick._world is not None and records_are_equal(one, other)
    # It does what it is for: errors of attitude die out.
    error = np.linalg.norm(one.vectors[:, 3], axis=-1).max(axis=-1)
    assert error[0] > 0.2 and error[-1] < 0.02


def test_a_compiled_law_that_takes_over_from_one_in_python_aims_where_that_one_aimed():
    plan = plan_of()
    one, other = (
        twin(plan, compiled=compiled, controller=MrpFeedback(integral_gain=0.01)) for compiled in (True, False)
    )
    for simulation in (one, other):
        simulation.fly(5)
        simulation.controller = MrpFeedback()
        simulation.fly(5)
    assert one._world is not None and np.array_equal(one.data.qvel, other.data.qvel)
