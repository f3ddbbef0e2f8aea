"""Plug-ins that answer something else than their protocols say are named, and nothing of theirs reaches compiled code."""

import copy
import pickle
from dataclasses import replace

import numpy as np
import pytest

from swarm_mj import plugins
from swarm_mj.errors import PluginError, ScenarioError, SimulationError
from swarm_mj.flight.fly import initial_state, make_simulation
from swarm_mj.mission.behaviors import AdaptableRoles, Targets
from swarm_mj.simulator.batch import FlightBatch
from swarm_mj.simulator.flight_setup import FlightSetup
from swarm_mj.simulator.simulation import Simulation
from swarm_mj.spacecraft.control.compiled import CompiledLaw
from swarm_mj.spacecraft.control.sliding_mode import MrpSlidingMode

N = 2


def fly(plan, periods=3, *, control_period=None, **changed):
    made = make_simulation(plan)
    parts = {"behavior": made.behavior, "controller": plan.controller, "environment": plan.environment, **changed}
    environment, period = parts.pop("environment"), control_period or made.period
    setup = FlightSetup(model=made.model, environment=environment, period=period)
    simulation = Simulation(setup, **parts)
    simulation.reset(initial_state(plan))
    simulation.fly(periods)
    return simulation


class Law:
    """Answers what it is told to."""

    def __init__(self, answer):
        self.answer = answer

    def torque(self, inputs, memory):
        return self.answer(inputs.sigma_BR), None


class Behaviour:
    dedicated_communications = False

    def __init__(self, answer, rest=0.0):
        self.answer, self.rest = answer, rest

    def targets(self, view, memory):
        return self.answer(view), memory

    def steady_for(self, view, memory):
        return self.rest


class Field:
    def __init__(self, answer):
        self.answer = answer

    def acceleration(self, r_A):
        return self.answer(r_A)


def asteroid(view, n=N):
    return Targets(np.zeros(n, np.int64), np.zeros(n, np.int64), np.zeros((n, 3)))


def fail(*_):
    raise KeyError("boom")


LAWS = [
    (lambda s: np.zeros((2 * len(s), 3)), r"a torque that has shape \(4, 3\): must be \(2, 3\)"),
    (lambda s: np.zeros((1, 3)), r"has shape \(1, 3\): must be \(2, 3\)"),
    (lambda s: np.zeros((len(s), 2)), r"has shape \(2, 2\)"),
    (lambda s: np.zeros(6), r"has shape \(6,\)"),
    (lambda s: None, r"has shape \(\)"),
    (lambda s: 1j * s, "holds complex128: must be numbers"),
    (lambda s: [[0.0], [0.0, 1.0, 2.0]], r"must be an array of shape \(2, 3\)"),
    (fail, r"failed in torque: KeyError: 'boom' \(test_plugin_calls.py, line \d+\)"),
]


@pytest.mark.parametrize(("answer", "words"), LAWS)
def test_a_law_that_answers_no_torques_is_named(answer, words, quick_plan):
    with pytest.raises(PluginError, match=rf"the control law .*test_plugin_calls\.Law .*{words}"):
        fly(quick_plan, controller=Law(answer))


def test_a_law_that_does_not_return_two_things_is_told_what_to_return(quick_plan):
    law = Law(None)
    law.torque = lambda inputs, memory: inputs.sigma_BR[0]
    with pytest.raises(PluginError, match=r"Law answers array.*: torque must return \(torque_B, memory\)"):
        fly(quick_plan, controller=law)


def test_torques_as_lists_integers_or_in_another_order_are_taken(quick_plan):
    flown = [
        fly(quick_plan, 20, controller=Law(answer)).data.qpos.copy()
        for answer in (
            lambda s: -1e-3 * s,
            lambda s: (-1e-3 * s).tolist(),
            lambda s: np.asfortranarray(-1e-3 * s),
        )
    ]
    assert np.array_equal(flown[0], flown[1]) and np.array_equal(flown[0], flown[2])
    fly(quick_plan, controller=Law(lambda s: np.zeros((N, 3), np.int32)))


BEHAVIOURS = [
    (lambda v: asteroid(v, 1), r"targets whose kind has shape \(1,\): must be \(2,\)"),
    (lambda v: asteroid(v, 5), r"targets whose kind has shape \(5,\): must be \(2,\)"),
    (lambda v: asteroid(v)._replace(spacecraft=[0]), r"targets whose spacecraft has shape \(1,\)"),
    (lambda v: asteroid(v)._replace(vector=np.zeros(3)), r"targets whose vector has shape \(3,\): must be \(2, 3\)"),
    (lambda v: asteroid(v)._replace(kind=np.zeros(N)), "targets whose kind holds float64: must be whole numbers"),
    (lambda v: None, r"answers .*: targets must return \(Targets, memory\)"),
    (lambda v: Targets(np.full(N, 3), np.zeros(N, int), np.full((N, 3), np.nan)), r"vector is \[nan, nan, nan\] for"),
    (lambda v: asteroid(v)._replace(kind=[0, 7]), "aims at what is not there"),
    (fail, "failed in targets: KeyError: 'boom'"),
]


@pytest.mark.parametrize(("answer", "words"), BEHAVIOURS)
def test_a_behaviour_that_answers_no_targets_is_told_what_is_wrong(answer, words, quick_plan):
    with pytest.raises(PluginError, match=words):
        fly(quick_plan, behavior=Behaviour(answer))


@pytest.mark.parametrize("rest", [np.nan, None, "soon", np.zeros(2)])
def test_a_behaviour_that_rests_for_no_time_is_named(rest, quick_plan):
    with pytest.raises(PluginError, match=r"Behaviour answers .*: steady_for must return a number of seconds"):
        fly(quick_plan, behavior=Behaviour(asteroid, rest))


@pytest.mark.parametrize("rest", [-1.0, -np.inf, np.inf, 0, 1e300])
def test_any_number_of_seconds_is_a_time_to_rest(rest, quick_plan):
    assert fly(quick_plan, behavior=Behaviour(asteroid, rest)).tick == 3


@pytest.mark.parametrize(
    ("answer", "words"),
    [
        (lambda r: np.zeros((1, 3)), r"an acceleration that has shape \(1, 3\): must be \(2, 3\)"),
        (lambda r: np.zeros(3), r"has shape \(3,\)"),
        (fail, "failed in acceleration: KeyError: 'boom'"),
    ],
)
def test_a_gravity_field_that_answers_no_accelerations_is_named(answer, words, quick_plan):
    with pytest.raises(PluginError, match=rf"the gravity field .*Field .*{words}"):
        fly(quick_plan, environment=replace(quick_plan.environment, gravity=Field(answer)))


class Compiled(Law):
    """A law whose compiled form is what it is told to be."""

    def __init__(self, function, numbers=(1e-3,)):
        super().__init__(lambda sigma: -1e-3 * sigma)
        self.offer = CompiledLaw(function, numbers)

    def compiled(self):
        return self.offer


def write_right(sigma_BR, b, c, d, e, f, g, h, numbers, torque_B):
    torque_B[:] = -numbers[0] * sigma_BR


def write_other(sigma_BR, b, c, d, e, f, g, h, numbers, torque_B):
    torque_B[:] = numbers[0] * sigma_BR


def write_nothing(sigma_BR, b, c, d, e, f, g, h, numbers, torque_B):
    pass


def write_beyond(sigma_BR, b, c, d, e, f, g, h, numbers, torque_B):
    torque_B[:] = -numbers[1] * sigma_BR


def write_and_raise(sigma_BR, b, c, d, e, f, g, h, numbers, torque_B):
    raise ValueError("boom")


@pytest.mark.parametrize(
    ("function", "words"),
    [
        (write_other, "CompiledLaw gives the torque .* where torque gives"),
        (write_nothing, r"CompiledLaw gives the torque \[nan, nan, nan\]"),
        (write_beyond, "failed in CompiledLaw.write_torque: IndexError"),
        (write_and_raise, "failed in CompiledLaw.write_torque: ValueError: boom"),
    ],
)
def test_a_compiled_law_that_is_not_the_law_is_found_out_before_it_flies(function, words, quick_plan):
    fly(quick_plan, controller=Compiled(write_right))
    with pytest.raises(PluginError, match=words):
        fly(quick_plan, 0, controller=Compiled(function))


def test_what_is_offered_must_be_a_law_with_a_row_of_numbers(quick_plan):
    law = Compiled(write_right)
    law.offer = (write_right, [1e-3])
    with pytest.raises(PluginError, match="compiled must return a CompiledLaw or None"):
        fly(quick_plan, 0, controller=law)
    for numbers, words in (["a"], "give a row of numbers"), (1e-3, r"shape \(\): give a row"):
        with pytest.raises(PluginError, match=words):
            fly(quick_plan, 0, controller=Compiled(write_right, numbers))


def write_late(sigma_BR, b, c, d, e, f, g, h, numbers, torque_B):
    torque_B[:] = -numbers[0] * sigma_BR
    if abs(sigma_BR[1, 0]) > 0.04:  # more than errors of which a law is tried
        torque_B[1, 2] = np.nan


class Late(Compiled):
    """Answers no number where the error is large."""

    def __init__(self):
        super().__init__(write_late)

    def torque(self, inputs, memory):
        torque_B = np.empty_like(inputs.sigma_BR)
        write_late(inputs.sigma_BR, *inputs[1:8], [1e-3], torque_B)
        return torque_B, None


def test_a_torque_that_is_not_finite_ends_the_flight_by_name_instead_of_turning_the_motors_up(quick_plan):
    with pytest.raises(SimulationError, match=r"test_plugin_calls\.Late gives sc2 the torque \[.*nan\] N m at t = 0 s"):
        fly(quick_plan, controller=Late())


class Keeper(AdaptableRoles):
    """Keeps the view of the time before, and writes into the one of now."""

    def targets(self, view, memory):
        targets, _ = super().targets(view, None)
        if memory is not None:
            self.moved.append(np.abs(view.r_BN_N - memory.r_BN_N).max())
        kept = view._replace(r_BN_N=view.r_BN_N.copy())
        view.r_BN_N[:] = 0.0
        return targets, kept


def test_views_belong_to_the_behaviour(quick_plan):
    behavior = Keeper(N, 3e4)
    object.__setattr__(behavior, "moved", [])
    object.__setattr__(behavior, "steady_for", lambda view, memory: 0.0)
    end = fly(quick_plan, 5, behavior=behavior).data.qpos.copy()
    assert len(behavior.moved) == 4 and min(behavior.moved) > 1.0
    assert np.array_equal(end, fly(quick_plan, 5, behavior=AdaptableRoles(N, 3e4)).data.qpos)


def test_what_a_law_keeps_of_its_inputs_stays_what_it_was(quick_plan):
    kept = []
    law = Law(lambda sigma: (kept.append((sigma, sigma.copy())), -1e-3 * sigma)[1])
    fly(quick_plan, 5, controller=law)
    assert all(np.array_equal(then, copied) for then, copied in kept)
    assert not np.array_equal(kept[0][0], kept[-1][0])


def test_a_dispersed_simulation_leaves_others_of_the_same_model_alone(quick_plan):
    from swarm_mj.scenarios.schema_faults import Dispersions
    from swarm_mj.simulator.faults.schedule import FaultModel

    made = make_simulation(quick_plan)
    given = FaultModel(faults=(), dispersions=Dispersions(mass_percent=5.0, inertia_percent=5.0), duration_s=10.0)
    masses, limits = made.model.mjmodel.body_mass.copy(), made.model.mjmodel.actuator_ctrlrange.copy()
    setup = FlightSetup(model=made.model, environment=quick_plan.environment, period=made.period, fault_model=given)
    other = Simulation(setup, made.behavior, MrpSlidingMode())
    other.reset(initial_state(quick_plan))
    assert not np.array_equal(other.model.mjmodel.body_mass, masses)
    assert np.array_equal(made.model.mjmodel.body_mass, masses)
    assert np.array_equal(made.model.mjmodel.actuator_ctrlrange, limits)


@pytest.mark.parametrize("again", [copy.deepcopy, pickle.dumps])
def test_a_simulation_cannot_be_copied_and_says_what_to_do(again, quick_plan):
    simulation = make_simulation(quick_plan)
    flights = FlightBatch(simulation.setup, 1)
    for whole in (simulation, flights):
        with pytest.raises(TypeError, match="cannot be copied or pickled; make another one"):
            again(whole)


@pytest.mark.parametrize("period", [0.7, 0.2, 0.0])
def test_a_control_period_must_be_a_whole_multiple_of_the_timestep(period, quick_plan):
    with pytest.raises(ScenarioError, match=r"control.period_s = .*: must be a whole multiple of .* timestep, 0.5 s"):
        fly(quick_plan, control_period=period or -1.0)


def test_samples_lie_on_control_periods(quick_plan):
    simulation = make_simulation(quick_plan)
    for duration, interval in ((3.0, 0.3), (3.0, 2.0), (3.0, 0.0)):
        with pytest.raises(ScenarioError, match="must be a whole multiple"):
            simulation.run(duration, interval)


def test_a_plug_in_that_lacks_what_its_group_asks_for_is_named(monkeypatch):
    monkeypatch.setattr(plugins, "find", lambda group, name: object)
    for group, members in plugins.MEMBERS.items():
        with pytest.raises(PluginError, match=rf"'mine' of {group}: builtins.object has no {members[0]}"):
            plugins.create(group, "mine", {})
    monkeypatch.setattr(plugins, "find", lambda group, name: fail)
    with pytest.raises(PluginError, match=r"'mine' of swarm_mj.gravity with parameters .*boom"):
        plugins.create(plugins.GRAVITY, "mine", {})
