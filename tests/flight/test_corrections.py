"""Corrections flown by thrusters in MuJoCo: they hit the visiting point, spread as covariance says, and know their limits."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from swarm_mj.errors import ScenarioError
from swarm_mj.flight.fly import make_simulation
from swarm_mj.flight.plan import make_plan
from swarm_mj.flight.trajectory_corrections import analyse_corrections
from swarm_mj.mission.trajectories import propagate
from swarm_mj.records.navigation import total_delta_v
from swarm_mj.scenarios.loading import load_scenario, parse_overrides
from swarm_mj.simulator.faults.dispersions import mothership_error

OFF = "dispersions.deployment_velocity_m_s=0.1"
ERRORS = (
    OFF,
    "navigation.position_m=5",
    "navigation.velocity_m_s=0.01",
    "dispersions.burn_magnitude_percent=5",
    "dispersions.burn_pointing_deg=3",
)
TWO = "trajectory.corrections=[{after_release_s: 60}, {before_arrival_s: 120}]"
ONE = "trajectory.corrections=[{after_release_s: 60}]"


def planned(name, *changes):
    thrusters = "spacecraft.thrusters={min_impulse_bit_n_s: 1.0e-4}"
    return make_plan(
        load_scenario(name, parse_overrides([thrusters, "physics.timestep_s=0.5", *changes])), check_separation=False
    )


def flown(plan, seed=0):
    """How far each is from its visiting point at the arrival, shape (n, 3) [m], and the simulation then."""
    simulation = make_simulation(replace(plan, scenario=plan.scenario.model_copy(update={"seed": seed})))
    while simulation.time < plan.deployment.arrival_s[0] - 1e-6:
        simulation.step()
    r_N = simulation.state.r_N
    return r_N - plan.deployment.destination_N, simulation


@pytest.fixture(scope="module")
def exact():
    """One correction that knows and burns exactly, and the same release without."""
    return flown(planned("eros-config1", OFF, ONE)), flown(planned("eros-config1", OFF))


def test_a_correction_brings_every_spacecraft_to_its_point(exact):
    (off, simulation), (uncorrected, _) = exact
    assert np.linalg.norm(uncorrected, axis=1).min() > 20.0
    assert np.linalg.norm(off, axis=1).max() < 0.25  # its shortest pulse is 1e-5 m/s, second order 0.1 m
    assert not simulation.injection.lost.any()


def test_it_burns_what_the_deployer_erred_by_and_what_that_did_meanwhile(exact):
    (_, simulation), (uncorrected, _) = exact
    # Without forces: the velocity error times 600 s is to be made good in the 540 s that are left, less half of the burn.
    least = np.linalg.norm(uncorrected, axis=1) / 540.0
    assert simulation.propulsion.delta_v == pytest.approx(least, rel=0.06)
    assert (simulation.propulsion.delta_v > least).all()


@pytest.mark.parametrize("name", ["eros-config1", "bennu-slow"])
def test_whole_flights_spread_as_linear_covariance_says(name):
    plan = planned(name, *ERRORS, TWO)
    covariance = analyse_corrections(plan).spread.at_arrival[-1, :, :3, :3]
    square, burnt = 0.0, []
    for seed in range(3):
        off, simulation = flown(plan, seed)
        square += np.einsum("ja,jab,jb->", off, np.linalg.inv(covariance), off)
        burnt.append(simulation.propulsion.delta_v)
    low, high = chi2.ppf((0.0005, 0.9995), 3 * 3 * plan.n)
    assert low < square < high
    expected = np.mean([of[0] for of in total_delta_v(analyse_corrections(plan)).values()])
    # Burns take time and so a little more; the mean of some 15 scatters by a tenth.
    assert np.mean(burnt) == pytest.approx(1.05 * expected, rel=0.3)


def test_the_same_seed_errs_alike_and_another_one_differently():
    plan = planned("bennu-slow", *ERRORS, ONE, "duration_s=700", "design.time_of_flight_s=300")
    first, again, other = (flown(plan, seed)[0] for seed in (1, 1, 2))
    assert np.array_equal(first, again)
    assert not np.isclose(first, other).any()


def test_who_is_lost_or_never_left_burns_nothing():
    faults = (
        "faults=[{kind: spacecraft_lost, spacecraft: sc1, at_s: 10}, {kind: missed_deployment, spacecraft: sc2}, "
        "{kind: spacecraft_lost, spacecraft: sc3, at_s: 62}]"
    )
    off, simulation = flown(planned("eros-config1", OFF, ONE, faults))
    burnt = simulation.propulsion.delta_v
    assert burnt[0] == burnt[1] == 0.0
    assert 0.0 < burnt[2] < 0.05 < burnt[3]  # lost in the middle of its burn
    assert np.linalg.norm(off[3:], axis=1).max() < 0.25


def test_an_empty_tank_ends_the_burn():
    small = "spacecraft.thrusters.propellant_kg=0.0005"
    off, simulation = flown(planned("eros-config1", OFF, ONE, small))
    assert simulation.propulsion.propellant.max() < 5e-4
    given = 65.0 * 9.80665 * np.log(8.0 / (8.0 - 0.0005))
    empty = simulation.propulsion.propellant == 0.0
    assert empty.any() and np.linalg.norm(off[empty], axis=1).max() > 5.0
    assert simulation.propulsion.delta_v.max() <= given * (1 + 1e-9)


def test_the_mothership_errs_alike_for_all():
    plan = planned("bennu-slow", "dispersions.mothership_position_m=30", "dispersions.mothership_velocity_m_s=0.02")
    start, other = (
        make_simulation(replace(plan, scenario=plan.scenario.model_copy(update={"seed": s}))) for s in (0, 1)
    )
    place = start.state.r_N - plan.deployment.release_r_N
    speed = start.state.v_N - plan.deployment.v0_N
    assert np.allclose(place, place[0]) and np.allclose(speed, speed[0])
    assert 5.0 < np.linalg.norm(place[0]) < 120.0 and 0.003 < np.linalg.norm(speed[0]) < 0.08
    assert not np.allclose(place[0], (other.state.r_N - plan.deployment.release_r_N)[0])


#: Three that leave one after the other.
LATE = (
    "duration_s=1200",
    "design.observers=[{time_of_flight_s: 600}, "
    "{time_of_flight_s: 500, release_s: 300}, "
    "{time_of_flight_s: 400, release_s: 600}]",
)
WRONG = ("dispersions.mothership_position_m=20", "dispersions.mothership_velocity_m_s=0.05")


def at_arrivals(plan, seed=0):
    """How far each is from its point at its own arrival, shape (n, 3) [m], and the simulation after the last."""
    simulation = make_simulation(replace(plan, scenario=plan.scenario.model_copy(update={"seed": seed})))
    off, arrival_s = np.zeros((plan.n, 3)), plan.deployment.arrival_s
    for t in np.unique(arrival_s):
        simulation.fly(round((t - simulation.time) / plan.scenario.control.period_s))
        r_N = simulation.state.r_N
        off[arrival_s == t] = (r_N - plan.deployment.destination_N)[arrival_s == t]
    return off, simulation


def test_errors_of_the_mothership_reach_who_leaves_late_as_its_coast_carries_them():
    plan = planned("bennu-slow", *WRONG, *LATE)
    deployment, square = plan.deployment, 0.0
    errors = analyse_corrections(plan).spread.at_arrival[-1, :, :3, :3]
    for seed in range(3):
        off, simulation = at_arrivals(plan, seed)
        r_err, v_err = mothership_error(plan.scenario.dispersions, seed)
        for j in range(plan.n):
            release, arrival = deployment.release_s[j], deployment.arrival_s[j]
            r, v = (deployment.r0_N + r_err)[None], (deployment.mothership_velocity_N + v_err)[None]
            if release > 0.0:
                (_, r), (_, v) = propagate(plan.environment.acceleration_N, r, v, np.array([0.0, release]))
            pushed = v + deployment.v0_N[j] - deployment.release_mothership_v_N[j]
            flown_N, _ = propagate(plan.environment.acceleration_N, r, pushed, np.array([release, arrival]))
            assert np.allclose(off[j], flown_N[-1, 0] - deployment.destination_N[j], atol=0.01)
            square += off[j] @ np.linalg.solve(errors[j], off[j]) / plan.n
    # All of a flight share one error of the mothership: three numbers of three flights.
    low, high = chi2.ppf((0.0005, 0.9995), 3 * 3)
    assert low < square < high


def test_corrections_count_from_each_ones_release_and_nobody_pushes_aboard():
    plan = planned("bennu-slow", *WRONG, *LATE, ONE)
    off, simulation = at_arrivals(plan)
    assert np.linalg.norm(off, axis=1).max() < 0.25
    assert np.linalg.norm(at_arrivals(planned("bennu-slow", *WRONG, *LATE))[0], axis=1).min() > 5.0

    class Pusher:
        def forces(self, view, memory):
            told.append(view.working.copy())
            return np.full((plan.n, 3), 0.01), None

    told, pushed = [], make_simulation(plan)
    pushed.force_law = Pusher()
    pushed.fly(round(400.0 / plan.scenario.control.period_s))
    late = plan.deployment.release_s > 400.0
    burnt = pushed.propulsion.delta_v
    assert (burnt[late] == 0.0).all() and (burnt[~late] > 0.0).all()
    assert np.array_equal(told[-1], ~late)


def test_a_correction_after_the_arrival_is_refused_before_the_flight():
    with pytest.raises(ScenarioError, match=r"corrections.0.after_release_s = 900: sc1 flies 600 s"):
        make_simulation(planned("eros-config1", "trajectory.corrections=[{after_release_s: 900}]"))
