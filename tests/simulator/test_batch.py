"""Flights together and alone, put back and taken up again, in compiled code and in Python: the same, mostly bit for bit."""

import importlib
import json
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from swarm_mj.errors import PluginError, ScenarioError, SimulationError
from swarm_mj.flight.fly import fault_model_from, initial_state, make_simulation
from swarm_mj.mission.behaviors import AdaptableRoles, TargetKind, Targets
from swarm_mj.scenarios.constants import EROS_GM
from swarm_mj.simulator.faults.injection import NOTHING
from swarm_mj.simulator.slots import Resting, Slot
from swarm_mj.simulator.state import Release
from swarm_mj.smallbody.gravity.compiled import compiled_field, write_attraction
from swarm_mj.smallbody.gravity.point_mass import PointMass
from swarm_mj.smallbody.gravity.polyhedron import CELL_NUMBERS, Polyhedron
from swarm_mj.smallbody.shape_harmonics import build_shape
from swarm_mj.spacecraft.control.compiled import CompiledLaw
from swarm_mj.spacecraft.control.feedback import MrpFeedback
from swarm_mj.spacecraft.control.sliding_mode import MrpSlidingMode

from .flying import DISPERSIONS, FAULTS, KERNEL, angle, batch_of, fly, near_polyhedron, numbers_of, plan_of, start_of

STEPPERS = pytest.mark.parametrize("stepper", ["mujoco", "kernel"])
SLEWS = "control.slew=time_optimal"


def fly_alike(flights, periods):
    for each in flights:
        each.fly(periods)
    return [numbers_of(getattr(each, "batch", each).flights) for each in flights]


@pytest.mark.parametrize(
    ("name", "overrides"),
    [
        ("eros-quick", [KERNEL]),
        ("eros-quick", []),
        ("eros-quick", [KERNEL, SLEWS]),
        ("eros-config2", [KERNEL, *DISPERSIONS, FAULTS]),
        ("eros-config2", [*DISPERSIONS, FAULTS, "spacecraft.wheel_layout=pyramid"]),
    ],
    ids=["kernel", "mujoco", "slews", "faults", "faults mujoco pyramid"],
)
def test_a_flight_of_five_is_that_flown_alone_to_the_bit_and_so_when_it_is_taken_up_again(name, overrides):
    plan = plan_of(name, *overrides)
    starts = [start_of(plan, seed) for seed in range(5)]
    together, alone = batch_of(plan, starts), batch_of(plan, starts[2:3])
    for periods in (7, 1, 20):
        assert together.fly(periods) and alone.fly(periods)
    together.decide()  # a decision that was made stands
    assert np.array_equal(numbers_of(together.flights, 2)[:6], numbers_of(alone.flights)[:6])
    saved = alone.get_state(0)
    assert alone.fly(40) and together.fly(40)
    assert np.array_equal(numbers_of(together.flights, 2), numbers_of(alone.flights))
    assert not np.array_equal(together.flights.q_BN[1], together.flights.q_BN[2])
    other = batch_of(plan, starts[:2])
    other.fly(3)
    other.set_state(1, saved)
    assert other.fly(40, np.array([False, True]))
    assert np.array_equal(numbers_of(other.flights, 1), numbers_of(alone.flights))
    if any("faults" in each for each in overrides):
        # Attitudes that the software knows are the same, too, and not the truth.
        known = [np.zeros((len(b.flights.tick), plan.n, 4)) for b in (together, alone)]
        for batch, q in zip((together, alone), known, strict=True):
            assert batch.know(np.ones(batch.count, bool), q, np.zeros((batch.count, plan.n, 3))).all()
        assert np.array_equal(known[0][2], known[1][0]) and not np.array_equal(known[1][0], alone.flights.q_BN[0])
        assert together.flights.lost[:, 0].all()


def test_a_saved_state_goes_on_in_another_simulation_whose_behaviour_and_law_remember():
    plan = plan_of("eros-quick", KERNEL)
    law = MrpFeedback(integral_gain=0.01)
    one, other = fly(plan, 25, controller=law), fly(plan, 3, controller=law)
    other.set_state(one.get_state())
    before, after = fly_alike((one, other), 30)
    assert np.array_equal(before, after) and other.tick == 55


def test_who_is_released_later_is_carried_pushed_and_then_turned():
    plan = plan_of("eros-quick", KERNEL)
    start, n = initial_state(plan), plan.n
    push, spin = np.array([[0.0] * 3, [0.1, -0.2, 0.3]]), np.full((n, 3), 0.02)
    release = Release(np.array([0, 11]), push, spin)
    start = replace(start, v_BN_N=np.tile(start.v_BN_N[0], (n, 1)), omega_BN_B=np.zeros((n, 3)), release=release)
    batch = batch_of(plan, [start, replace(start, release=None)])
    batch.fly(11)
    f = batch.flights
    np.testing.assert_allclose(f.q_BN[0, 1], start.q_BN[1], rtol=1e-14)
    assert not f.motor[0, 1].any() and f.motor[0, 0].any()
    assert np.array_equal(f.q_BN[0, 0], f.q_BN[1, 0])
    assert np.array_equal(f.r_N[0], f.r_N[1]) and batch.blind[0].tolist() == [False, True]
    batch.decide()
    np.testing.assert_allclose(f.v_N[0, 1] - f.v_N[1, 1], push[1], rtol=1e-12)
    assert np.array_equal(f.omega_B[0, 1], spin[1]) and f.released.all() and not batch.blind.any()
    batch.fly(1)
    assert f.motor[0, 1].any() and angle(f.q_BN[0, 1], start.q_BN[1]) > 1e-3


#: Flown by a process in which Numba compiles nothing; prints the numbers of the state.
IN_PYTHON = """
import json, sys
from swarm_mj.spacecraft.control.compiled import LawFunction
LawFunction.__call__ = lambda law, *arguments: law._function(*arguments)
from tests_flying import fly, numbers_of, plan_of
name, *overrides = sys.argv[2:]
print(json.dumps(numbers_of(fly(plan_of(name, *overrides), int(sys.argv[1])).batch.flights).tolist()))
"""


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


class Proportional:
    """A law of a user's own, compiled or not."""

    def __init__(self, *, compiled=True):
        self.calls, self._compiled = 0, compiled

    def torque(self, inputs, memory):
        self.calls += 1
        return -0.02 * (0.1 * inputs.sigma_BR + inputs.omega_BR_B), None

    def compiled(self):
        return CompiledLaw(write_proportional, [0.02]) if self._compiled else None


class InPython:
    """A law or a field that compiled code does not know."""

    def __init__(self, plug_in):
        self.plug_in = plug_in

    def torque(self, inputs, memory):
        return self.plug_in.torque(inputs, memory)

    def acceleration(self, r_A):
        return self.plug_in.acceleration(r_A)


@STEPPERS
@pytest.mark.parametrize("law", [MrpSlidingMode(), MrpSlidingMode(rate_limit=None), MrpFeedback(), Proportional()])
def test_a_law_in_python_flies_what_its_compiled_form_flies(law, stepper):
    plan = plan_of("eros-quick", f"physics.stepper={stepper}")
    quick, slow = fly_alike([fly(plan, controller=each) for each in (law, InPython(law))], 60)
    np.testing.assert_allclose(quick, slow, rtol=1e-9, atol=1e-9)


def test_a_law_that_is_offered_for_compiled_code_is_not_called_in_flight():
    law = Proportional()
    simulation = fly(plan_of("eros-quick", KERNEL), controller=law)
    called = law.calls
    simulation.fly(20)
    assert law.calls == called and simulation.tick == 20
    simulation.controller = InPython(law)
    simulation.fly(20)
    assert law.calls == called + 21  # it is tried once


@STEPPERS
@pytest.mark.parametrize("gravity", ["harmonics", "point mass", "polyhedron"])
def test_gravity_in_python_pulls_as_the_compiled_field_does(gravity, stepper):
    plan = plan_of("eros-quick", f"physics.stepper={stepper}", "perturbations.solar_tide=true")
    plan = near_polyhedron(plan) if gravity == "polyhedron" else plan
    world = plan.environment
    world = replace(world, gravity=PointMass(EROS_GM)) if gravity == "point mass" else world
    flights = [fly(plan, environment=each) for each in (world, replace(world, gravity=InPython(world.gravity)))]
    quick, slow = fly_alike(flights, 60)
    np.testing.assert_allclose(quick, slow, rtol=1e-8, atol=1e-9)
    one, other = (flight.state.r_N for flight in flights)
    np.testing.assert_allclose(one, other, rtol=1e-12)


@pytest.mark.parametrize("radii", [1.5, 2.49, 2.51, 2.75, 3.01, 1000.0])
def test_fields_in_kernels_pull_as_in_python_near_and_far(radii):
    body = Polyhedron(build_shape("eros", 6), gm=EROS_GM)
    r_A = radii * body.shape.max_radius * np.array([[0.6, 0.0, 0.8], [-0.48, 0.64, -0.6]])
    for gravity in (body, PointMass(EROS_GM), body.far_field):
        field, found = compiled_field(gravity), np.full((2, 3), np.nan)
        write_attraction(r_A, field, field.elements, field.series, np.zeros((2, CELL_NUMBERS)), found)
        assert np.array_equal(found, gravity.acceleration(r_A))


def looking(plan, directions_N):
    """Flights from one start that look in other directions, shape (E, n, 3)."""
    batch = batch_of(plan, [initial_state(plan)] * len(directions_N))
    kinds = np.full(directions_N.shape[:2], int(TargetKind.DIRECTION))
    batch.hold(Targets(kinds, np.zeros_like(kinds), directions_N), None)
    return batch


def test_flights_near_a_polyhedron_share_its_sums_and_are_pulled_as_the_sums_say():
    plan = near_polyhedron(plan_of("eros-quick", KERNEL))
    directions = np.random.default_rng(5).standard_normal((3, plan.n, 3))
    together, swapped = looking(plan, directions), looking(plan, directions[::-1].copy())
    cells = together.world.cells
    assert together.fly(400, np.array([True, False, False]))
    first = cells[:400].copy()
    assert together.fly(400, np.array([False, True, True])) and swapped.fly(400)
    # The others take no sums of their own, although their places differ in the last digits.
    assert (cells[:400] != first).any(axis=-1).mean() < 2e-3 and (first[:, :, 6] != 0.0).all()
    for e in range(3):
        alone = looking(plan, directions[e : e + 1])
        alone.fly(400)
        for batch, row in ((together, e), (swapped, 2 - e)):
            assert np.array_equal(numbers_of(batch.flights, row), numbers_of(alone.flights))
    R_A, a_N, C_mid = together.flights.work[0, Slot.R_A], together.flights.work[0, Slot.A], together.flights.C_mid[0]
    expected = plan.environment.gravity.acceleration(R_A)
    assert np.linalg.norm(a_N @ C_mid.T - expected, axis=1).max() < 1e-12 * np.linalg.norm(expected, axis=1).min()


def test_inertias_that_are_drawn_are_what_the_motors_turn():
    """The rates reached from rest, times the true inertia, are the impulse of the torque."""
    plan = plan_of("eros-quick", KERNEL, "dispersions.inertia_percent=10", "dispersions.mass_percent=10")
    starts = [replace(start_of(plan, e), omega_BN_B=np.zeros((plan.n, 3))) for e in range(2)]
    batch, torque = batch_of(plan, starts, controller=None), np.full((2, plan.n, 3), (2e-5, -1e-5, 3e-5))
    batch.hold(None, torque)
    batch.fly(20)
    inertia = np.stack([batch.flights.inertia_B[e] for e in range(2)])
    inertia -= plan.properties.wheel_spin_inertia * np.eye(3)
    impulse = np.einsum("enij,enj->eni", inertia, batch.flights.omega_B)
    np.testing.assert_allclose(impulse, 10.0 * torque, rtol=2e-3)
    assert not np.allclose(inertia[0], inertia[1])


@STEPPERS
def test_a_decision_that_was_made_stands_until_it_is_flown(stepper):
    plan = plan_of("eros-quick", f"physics.stepper={stepper}")
    whole, parts = fly(plan, 37), fly(plan)
    for _ in range(37):
        parts.decide()
        effort = float(parts.batch.flights.effort[0])
        parts.decide()
        assert parts.batch.flights.effort[0] == effort
        parts.step()
    assert np.array_equal(numbers_of(whole.batch.flights), numbers_of(parts.batch.flights))


class Counted(AdaptableRoles):
    asked = 0

    def targets(self, view, memory):
        type(self).asked += 1
        return super().targets(view, memory)


def test_a_behavior_is_asked_only_when_its_answer_may_have_changed():
    plan = plan_of("eros-config2", KERNEL)
    simulation = fly(plan, behavior=Counted(plan.n, plan.behavior.imaging_radius_m))
    Counted.asked = 0
    simulation.fly(40)
    before = Counted.asked
    assert 1 <= before < 20
    simulation.ask_again()
    simulation.decide()
    assert Counted.asked == before + 1


def test_another_law_or_behavior_may_take_over_in_flight():
    plan = plan_of("eros-quick", KERNEL)
    simulation, plain = fly(plan, 10), fly(plan, 20)
    simulation.controller, simulation.behavior = Proportional(), AdaptableRoles(plan.n, 1e3)
    assert set(simulation.decide().kind.tolist()) != {0}
    simulation.fly(10)
    assert not np.array_equal(simulation.state.omega_B, plain.state.omega_B)


@STEPPERS
def test_a_state_that_is_placed_is_flown_on_and_asked_about(stepper):
    plan = plan_of("eros-quick", f"physics.stepper={stepper}")
    one, other = fly(plan, 3), fly(plan, 3)
    for k, simulation in enumerate((one, other)):
        state = simulation.state
        omega = state.omega_B + 0.05 * k
        qpos, qvel = np.hstack((state.r_N, state.q_BN)), np.hstack((state.v_N, omega, state.wheel_speed))
        simulation.batch.place(0, qpos.copy(), qvel.copy())
        simulation.step()
    turned = other.state.omega_B - one.state.omega_B
    assert np.abs(turned).min() > 0.01 and angle(one.state.q_BN, other.state.q_BN).max() > 0.01
    np.testing.assert_allclose(one.state.omega_B, fly(plan, 4).state.omega_B, atol=1e-9)


class Lost:
    """A law that gives the second spacecraft no number from a time on; forty control periods of it."""

    def torque(self, inputs, memory):
        torque_B, tick = -1e-3 * inputs.sigma_BR, memory or 0
        torque_B[1, 2] = np.nan if tick >= 5 else torque_B[1, 2]
        return torque_B, tick + 1


@STEPPERS
def test_a_law_that_gives_one_spacecraft_no_number_loses_it_alone_with_faults_and_ends_the_flight_without(stepper):
    plan = plan_of("eros-quick", f"physics.stepper={stepper}", "spacecraft.sensors=ideal")
    with pytest.raises(SimulationError, match=r"test_batch\.Lost gives sc2 the torque \[.*nan\] N m at t = 2\.5 s"):
        fly(plan, 40, controller=Lost())
    simulation = fly(plan, 40, controller=Lost(), fault_model=NOTHING)
    assert simulation.lost.tolist() == [False, True] and simulation.state.resting[1] == Resting.HELD
    assert [(e.time_s, e.kind, e.spacecraft) for e in simulation.events][0] == (2.5, "diverged", 1)
    well = fly(plan, 40, controller=InPython(Well()))
    np.testing.assert_allclose(simulation.state.q_BN[0], well.state.q_BN[0], atol=1e-12)
    batch = batch_of(plan, [initial_state(plan)] * 2, Lost())
    assert not batch.fly(20, np.array([True, False])) and batch.flights.finite.tolist() == [False, True]
    assert "Lost gives sc2" in batch.causes[0] and batch.flights.tick.tolist() == [5, 0]
    batch.reset(0, initial_state(plan))
    assert batch.fly(5) and batch.causes == ["", ""]


class Well:
    def torque(self, inputs, memory):
        return -1e-3 * inputs.sigma_BR, memory


@STEPPERS
def test_a_state_that_is_not_finite_is_named_or_given_up(stepper):
    plan = plan_of("eros-quick", f"physics.stepper={stepper}")
    # Sensors that err are no reason to fly on without a spacecraft.
    for fault_model in (None, fault_model_from(plan.scenario), NOTHING):
        simulation = fly(plan, 4, fault_model=fault_model)
        s = simulation.state
        qpos, qvel = np.hstack((s.r_N, s.q_BN)), np.hstack((s.v_N, s.omega_B, s.wheel_speed))
        qvel[1, 4] = np.nan
        simulation.batch.place(0, qpos, qvel)
        if fault_model is not NOTHING:
            with pytest.raises(SimulationError, match=r"sc2 has a state that is not finite at t = 2 s"):
                simulation.fly(1)
            continue
        simulation.fly(10)
        assert simulation.lost.tolist() == [False, True] and np.isfinite(numbers_of(simulation.batch.flights)).all()


def test_the_kernel_refuses_a_spacecraft_of_ones_own_and_a_law_a_period_that_is_too_long():
    with pytest.raises(ScenarioError, match=r"physics\.stepper = kernel"):
        plan_of("eros-quick", KERNEL, "spacecraft.mjcf=some.xml")
    with pytest.raises(ScenarioError, match="too long"):
        fly(plan_of("eros-quick", KERNEL), controller=MrpFeedback(frequency=10.0))


class Offering(Proportional):
    """A law of which only the compiled part is given by the test."""

    def __init__(self, function):
        super().__init__()
        self._offer = CompiledLaw(function, [1.0])

    def compiled(self):
        return self._offer


def of_two(sigma_BR, torque_B):
    torque_B[:] = sigma_BR


def of_what_numba_lacks(a, b, c, d, e, f, g, h, numbers, torque_B):
    torque_B[:] = -0.02 * (0.1 * a + b)
    torque_B.flags.f_contiguous.of_its_own if numbers[0] < 0.0 else None  # noqa: B018


@pytest.mark.parametrize(
    ("function", "reason"),
    [(of_two, "failed in CompiledLaw.write_torque"), (of_what_numba_lacks, "cannot be compiled")],
)
def test_a_law_that_cannot_be_compiled_is_refused_with_the_reason(function, reason):
    with pytest.raises(PluginError, match=reason):
        fly(plan_of("eros-quick", KERNEL), controller=Offering(function))


def test_the_law_of_the_documentation_flies_as_it_stands_there(tmp_path, monkeypatch):
    page = (Path(__file__).parents[2] / "docs/how-to/control_law.md").read_text()
    (tmp_path / "law_of_the_page.py").write_text(page.split("```python\n")[2].split("```")[0])
    monkeypatch.syspath_prepend(tmp_path)
    law = importlib.import_module("law_of_the_page").Damper()
    plan = plan_of("eros-quick", KERNEL)
    one, other = (fly(plan, controller=each).run(600.0, 10.0) for each in (law, InPython(law)))
    assert angle(one.samples["q_BN"], other.samples["q_BN"]).max() < 1e-9
    # It does what it is for: errors of attitude die out.
    error = np.linalg.norm(one.samples["sigma_BR"], axis=-1).max(axis=-1)
    assert error[0] > 0.2 and error[-1] < 0.02


@pytest.mark.parametrize(
    "arguments",
    [("6", "eros-quick", KERNEL), ("10", "eros-config2", KERNEL, *DISPERSIONS, FAULTS)],
    ids=["as planned", "faults"],
)
def test_compiled_code_flies_what_the_same_functions_fly_in_python(arguments):
    """Contractions and the order of additions aside."""
    here = Path(__file__).parent
    code = IN_PYTHON.replace("tests_flying", "simulator.flying")
    environment = os.environ | {"NUMBA_DISABLE_JIT": "1", "PYTHONPATH": str(here.parent)}
    command = [sys.executable, "-c", code, *arguments]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, cwd=here.parents[1])
    assert done.returncode == 0, done.stderr[-2000:]
    periods, name, *overrides = arguments
    expected = numbers_of(fly(plan_of(name, *overrides), int(periods)).batch.flights)
    np.testing.assert_allclose(json.loads(done.stdout), expected, rtol=1e-10, atol=1e-11)


def test_a_made_simulation_is_one_flight_of_the_batch_that_its_setup_describes():
    plan = plan_of("eros-quick", KERNEL)
    simulation = make_simulation(plan)
    batch = batch_of(plan, [initial_state(plan)], behaviors=[plan.behavior])
    simulation.fly(30)
    batch.fly(30)
    assert np.array_equal(numbers_of(simulation.batch.flights), numbers_of(batch.flights))
