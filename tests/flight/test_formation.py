"""Formations in whole flights: against DOP853, against the impulse that errors need, and what a reader is told."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from swarm_mj.dataflow.contacts import Contacts
from swarm_mj.errors import ScenarioError
from swarm_mj.figures.curves import compose_formation
from swarm_mj.flight.coordination import crosslinks_left
from swarm_mj.flight.fly import make_simulation, simulate
from swarm_mj.flight.formation import formation_law
from swarm_mj.flight.plan import make_plan
from swarm_mj.mission.trajectories import PlannedBurn
from swarm_mj.records.formation import formation_findings, formation_summary
from swarm_mj.scenarios.loading import load_scenario, parse_overrides
from swarm_mj.spacecraft.control.force import ForceView

GAS = "spacecraft.thrusters={}"


def planned(name, formation, *more, level=1):
    return make_plan(
        load_scenario(name, parse_overrides([GAS, f"swarm={{class: {level}, formation: {formation}}}", *more]))
    )


def test_a_flight_is_that_of_the_same_law_by_dop853():
    plan = planned(
        "bennu-slow",
        "{shape: cartesian, start_s: 10, dead_band_m: 0, bandwidth_rad_s: 0.05}",
        "duration_s=50",
        "design.time_of_flight_s=45",
        "telemetry.interval_s=0.5",
        "spacecraft.thrusters.min_impulse_bit_n_s=0",
    )
    flown = simulate(plan)
    simulation = make_simulation(plan)
    law, memory = formation_law(simulation), None
    start = simulation.model.state(simulation.data)[1][:, :3]
    r, v = np.broadcast_to(plan.deployment.r0_N, (plan.n, 3)), start
    gained, mass = np.zeros((plan.n, 3)), flown["mass_kg"].values
    for k in range(100):
        view = ForceView(
            t=0.5 * k,
            period=0.5,
            r_BN_N=r.copy(),
            v_BN_N=v.copy(),
            q_BN=np.tile([1.0, 0, 0, 0], (plan.n, 1)),
            mass=mass[k],
            propellant=flown["propellant_kg"].values[k],
            delta_v_N=gained,
            working=np.ones(plan.n, bool),
        )
        force, memory = law.forces(view, memory)
        np.testing.assert_allclose(force, flown["thrust_N"].values[k], atol=2e-4)
        push = force / mass[k][:, None]
        gained = gained + 0.5 * push

        def rhs(t, y, push=push):
            x, u = y.reshape(2, plan.n, 3)
            return np.concatenate((u.ravel(), (plan.environment.acceleration_N(t, x) + push).ravel()))

        y = solve_ivp(rhs, (0.5 * k, 0.5 * k + 0.5), np.concatenate((r.ravel(), v.ravel())), method="DOP853").y[:, -1]
        r, v = y.reshape(2, plan.n, 3)
    assert np.linalg.norm(gained, axis=1).max() > 0.25
    np.testing.assert_allclose(flown["r_BN_N"].values[-1], r, atol=0.05)


@pytest.fixture(scope="module")
def dispersed():
    """Configuration 2 with deployment errors that the plan's formation takes away, and the same without a formation."""
    more = ["dispersions={deployment_velocity_m_s: 0.1}", "duration_s=700"]
    plan = planned("eros-config2", "{dead_band_m: 0}", *more, level=2)
    free = make_plan(load_scenario("eros-config2", parse_overrides([GAS, *more])))
    return plan, simulate(plan), simulate(free)


def test_the_formation_is_held_through_the_flyby_for_what_its_errors_need(dispersed):
    plan, flown, free = dispersed
    times, deployment = flown["time"].values, plan.deployment
    error = flown["formation_error"].values
    before, at_arrival = error[times == 60.0][0], error[times == 600.0][0]
    assert before.max() > 15.0 and at_arrival.max() < 0.1
    adrift = np.linalg.norm(free["r_BN_N"].values[times == 600.0][0] - deployment.destination_N, axis=1)
    assert adrift.max() > 150.0
    w, z, most = 0.02, 1.0, 0.055 / plan.properties.mass
    for j in range(plan.n):  # one line, by hand: the feedback, cut at what thrusters give
        speed = np.linalg.norm(flown["v_BN_N"].values[0, j] - deployment.v0_N[j])
        e, spent = 60.0 * speed, 0.0
        for _ in range(12_000):
            a = np.clip(-w * w * e - 2.0 * z * w * speed, -most, most)
            e, speed, spent = e + 0.05 * speed, speed + 0.05 * a, spent + 0.05 * abs(a)
        assert flown["delta_v_m_s"].values[-1, j] == pytest.approx(spent, rel=0.03, abs=3e-3)


def test_the_summary_tells_how_it_was_held_and_the_figure_shows_it(dispersed):
    plan, flown, free = dispersed
    told = formation_summary(flown)["formation"]
    assert told["held_s"] == [60.0, 700.0] and told["error_m_final"]["sc1"] < 0.1
    assert told["most_needed_m_s2"]["sc1"] < 1e-9 < told["thrust_m_s2"]
    assert formation_findings({"formation": told}) == [] == formation_findings(formation_summary(free))
    axes = compose_formation(plan, flown, None).axes
    lines = {line.get_label(): line for line in axes[0].get_lines()}
    assert lines["sc2"].get_ydata()[-1] == pytest.approx(max(flown["formation_error"].values[-1, 1], 0.01))


def test_a_leader_is_followed_over_the_radios_and_replaced_when_it_is_lost():
    plan = planned(
        "eros-config2",
        "{reference: leader}",
        "dispersions={deployment_velocity_m_s: 0.1}",
        "faults=[{kind: spacecraft_lost, spacecraft: sc1, at_s: 100}]",
        "duration_s=600",
        "telemetry.interval_s=10",
        level=2,
    )
    flown = simulate(plan)
    told = formation_summary(flown)["formation"]
    # sc1 is heard of last at 90 s or before, and then silent for 45 s.
    assert {tuple(row[1:]) for row in told["leaders"]} >= {
        ("sc2", "sc2"),
        ("sc3", "sc2"),
        ("sc4", "sc2"),
        ("sc5", "sc2"),
    }
    assert all(100.0 < row[0] <= 146.0 for row in told["leaders"])
    error = flown["formation_error"].values[-1, 1:]
    assert error.max() < 10.0 and flown["formation_bits"].values[-1, 0] < flown["formation_bits"].values[-1, 1]
    assert flown["thrust_N"].values[flown["time"].values > 100.0][:, 0].max() == 0.0


def test_what_a_formation_says_takes_its_time_from_the_crosslink():
    plan = planned(
        "eros-observe",
        "{reference: mean, start_s: 60, message_s: 10}",
        "duration_s=150",
        "design.time_of_flight_s=140",
        "swarm.message_loss=0",
        level=2,
    )
    flown = simulate(plan)
    told = formation_summary(flown)["formation"]
    # So near, all is heard at the radio's highest rate, 115.2 kbit/s.
    assert (
        told["messages_airtime_s"] == pytest.approx(told["messages_bit"] / 115.2e3, rel=1e-6)
        and told["messages_bit"] > 0
    )
    edges, n = np.linspace(0.0, 150.0, 6), plan.n
    contacts = Contacts(
        edges_s=edges,
        swarm_bit=np.full((5, n, n), 10**9),
        earth_bit=np.zeros((5, n), np.int64),
        peak_bit=np.zeros((5, n, n + 1), np.int64),
        station=np.zeros((5, n), np.int64),
        light_time_s=np.zeros(5),
        why_swarm=np.zeros((5, n, n), np.int8),
        why_earth=np.zeros((5, n), np.int8),
        distance_m=np.zeros((5, n, n)),
    )
    left = crosslinks_left(contacts, flown, plan.scenario)
    spent = np.diff(np.interp(edges, flown["time"].values, flown["formation_airtime"].values.sum(axis=1)))
    np.testing.assert_allclose(1.0 - left.swarm_bit[:, 0, 1] / 1e9, spent / 30.0, atol=1e-8)


def test_a_reader_is_told_why_a_formation_was_not_held():
    def findings(*more):
        plan = planned(
            "bennu-slow",
            "{shape: cartesian, start_s: 60, min_separation_m: 0}",
            "duration_s=200",
            "design.time_of_flight_s=150",
            "telemetry.interval_s=10",
            *more,
        )
        return formation_findings({"formation": formation_summary(simulate(plan))["formation"]})

    weak = findings("spacecraft.thrusters.thrust_n=1e-9", "spacecraft.thrusters.min_impulse_bit_n_s=0")
    assert "thrusters cannot hold the formation: sc1" in weak[0] and "raise spacecraft.thrusters.thrust_n" in weak[0]
    empty = findings("spacecraft.thrusters.propellant_kg=0.001")
    assert any("sc1: the tank is empty" in text and "propellant_kg" in text for text in empty)
    slow = findings("spacecraft.thrusters.thrust_n=0.005")
    assert any(text.startswith("sc1 is ") and "thrust_n" in text for text in slow)


@pytest.mark.parametrize(
    ("formation", "more", "words"),
    [
        ("{shape: cartesian, offsets_m: [[0, 0, 0]]}", (), "1 places for 4 spacecraft"),
        ("{bandwidth_rad_s: 2}", (), "bandwidth_rad_s = 2: must be at most 0.5 with"),
    ],
)
def test_a_formation_that_does_not_fit_the_plan_is_refused(formation, more, words):
    plan = planned("bennu-slow", formation, *more)
    with pytest.raises(ScenarioError, match=words):
        make_simulation(plan)


def test_burns_and_a_formation_do_not_go_together():
    plan = planned("bennu-slow", "{}")
    burns = (PlannedBurn(0, 100.0, np.array([0.1, 0.0, 0.0])),)
    with pytest.raises(ScenarioError, match="swarm.formation: a plan with burns"):
        make_simulation(replace(plan, deployment=replace(plan.deployment, burns=burns)))


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        (["swarm={class: 1, formation: {}}"], "swarm.formation: is held by thrusters"),
        ([GAS, "swarm={class: 0, formation: {}}"], "class 0 coordinates no movement"),
        (["spacecraft.thrusters={layout: four_z}", "swarm={class: 1, formation: {}}"], "pushes along one axis"),
        ([GAS, "swarm={class: 1, formation: {start_s: 9000}}"], "must be before the flight's end"),
        ([GAS, "swarm={class: 1, formation: {offsets_m: [[0, 0, 0]]}}"], "shape = planned takes none"),
        ([GAS, "swarm={class: 1, formation: {shape: natural, offset_rates_m_s: [[0, 0, 0]]}}"], "needs offsets_m"),
    ],
)
def test_keys_that_do_not_fit_together_are_refused(settings, words):
    with pytest.raises(ScenarioError, match=words):
        load_scenario("bennu-slow", parse_overrides(settings))
