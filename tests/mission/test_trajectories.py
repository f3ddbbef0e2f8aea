"""Transfers against closed forms and another integrator."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from swarm_mj.errors import MissionError, PathError
from swarm_mj.flight.plan import make_plan
from swarm_mj.mission import trajectories
from swarm_mj.mission.trajectories import propagate, solve_transfers
from swarm_mj.scenarios import constants
from swarm_mj.scenarios.loading import load_scenario

GM = constants.EROS_GM


def kepler(t, r):
    return -GM * r / np.linalg.norm(r, axis=1, keepdims=True) ** 3


def test_propagation_follows_a_circular_orbit():
    radius = 30e3
    speed = np.sqrt(GM / radius)
    times = np.linspace(0.0, 5000.0, 11)
    r, v = propagate(kepler, np.array([[radius, 0, 0]]), np.array([[0, speed, 0]]), times)
    angle = speed / radius * times
    assert np.allclose(r[:, 0], radius * np.column_stack((np.cos(angle), np.sin(angle), 0 * angle)), atol=1e-6)
    assert np.allclose(np.linalg.norm(v[:, 0], axis=1), speed, rtol=1e-12)


def test_transfers_without_gravity_are_straight_lines():
    destinations = np.array([[1e3, 2e3, 3e3], [-5e3, 0, 7e3]])
    v0, miss = solve_transfers(lambda t, r: 0 * r, np.zeros(3), destinations, 600.0)
    assert np.allclose(v0, destinations / 600.0, atol=1e-9)
    assert miss.max() < 1e-3


def test_a_transfer_recovers_the_velocity_of_a_known_orbit():
    r0, v0 = np.array([[25e3, 3e3, -4e3]]), np.array([[-2.0, 4.5, 1.0]])
    r, _ = propagate(kepler, r0, v0, np.array([0.0, 4000.0]))
    solved, miss = solve_transfers(kepler, r0[0], r[-1], 4000.0)
    assert np.allclose(solved, v0, atol=1e-8)
    assert miss.max() < 1e-3


def test_a_transfer_from_two_days_before_a_fast_flyby_converges():
    """1.2 million km at 7 km/s: double precision leaves less than a millimetre, and the Sun's tide bends the path a little."""
    r0, tide = np.array([-7e3 * 2 * 86400.0, 2e7, 0.0]), 4e-14
    destinations = np.array([[0.0, 20e3, 5e3], [0.0, -25e3, 0.0]])

    def forces(t, r):
        return kepler(t, r) + tide * r * [2.0, -1.0, -1.0]

    v0, miss = solve_transfers(forces, r0, destinations, 2 * 86400.0)
    assert miss.max() < 2e-3
    assert np.linalg.norm(v0, axis=1) == pytest.approx(7e3, rel=1e-3)
    back, _ = propagate(
        lambda t, r: forces(-t, r), destinations, -velocities_at_end(forces, r0, v0), np.array([0.0, 2 * 86400.0])
    )
    assert np.linalg.norm(back[-1] - r0, axis=1).max() < 0.1


def velocities_at_end(forces, r0, v0):
    _, v = propagate(forces, np.broadcast_to(r0, v0.shape), v0, np.array([0.0, 2 * 86400.0]))
    return v[-1]


def test_a_path_that_noise_hides_is_told_from_one_that_is_not_there(monkeypatch):
    noise = np.random.default_rng(0)

    def shaken(*arguments, **keywords):
        r, v = propagate(*arguments, **keywords)
        return r + 1e-3 * noise.standard_normal(r.shape), v

    monkeypatch.setattr(trajectories, "propagate", shaken)
    with pytest.raises(MissionError, match="1e-05 m is asked for.*noise in the forces"):
        solve_transfers(lambda t, r: 0 * r, np.array([-1e7, 0.0, 0.0]), np.array([[0.0, 2e4, 0.0]]), 2e4)


def test_planned_transfers_hit_their_points_within_a_millimetre_by_another_integrator(quick_plan):
    environment, t = quick_plan.environment, 600.0
    for j in range(quick_plan.n):
        start = np.concatenate((quick_plan.deployment.r0_N, quick_plan.deployment.v0_N[j]))

        def rhs(time, y):
            return np.concatenate((y[3:], environment.acceleration_N(time, y[None, :3])[0]))

        end = solve_ivp(rhs, (0, t), start, method="LSODA", rtol=1e-12, atol=1e-10).y[:3, -1]
        in_A = environment.C_AN(t) @ end
        assert np.linalg.norm(in_A - quick_plan.points_A[j]) < 1e-3


def test_the_mothership_starts_where_the_paper_says_and_deploys_at_ten_metres_a_second_at_most():
    plan = make_plan(load_scenario("eros-config1"))
    assert np.allclose(plan.environment.C_AN(0.0) @ plan.deployment.r0_N, [0, 0, -30e3], atol=1e-6)
    assert plan.deployment.delta_v.max() < 10.5
    resting = make_plan(load_scenario("eros-config1", {"mothership.velocity": "rest"}))
    assert 50.0 < resting.deployment.delta_v[:5].min() < resting.deployment.delta_v[:5].max() < 70.0
    given = make_plan(load_scenario("eros-config1", {"mothership.velocity": [1, 2, 3]}))
    assert np.allclose(given.deployment.delta_v, np.linalg.norm(given.deployment.v0_N - [1, 2, 3], axis=1))


def test_the_communications_spacecraft_visits_the_mean_of_the_observers_points():
    plan = make_plan(load_scenario("eros-config1"))
    expected = plan.points_A.mean(axis=0) @ plan.environment.C_AN(600.0)
    assert np.allclose(plan.deployment.destination_N[-1], expected)


def test_an_impossible_transfer_is_an_error_that_says_what_to_change():
    def blow_up(t, r):
        return r**3

    with pytest.raises(MissionError, match="design.time_of_flight_s"):
        solve_transfers(blow_up, np.ones(3), np.array([[1000.0, 0, 0]]), 100.0)


def test_a_transfer_that_does_not_converge_names_the_spacecraft():
    def unreachable(t, r):
        # Whatever the start velocity, nothing stays beyond x = 500 m: the miss cannot vanish.
        return np.column_stack((-(np.maximum(r[:, 0] - 400.0, 0.0) ** 2), 0 * r[:, 1], 0 * r[:, 2]))

    with pytest.raises(MissionError, match="sc1|visiting points"):
        solve_transfers(unreachable, np.zeros(3), np.array([[5e5, 0, 0]]), 3.0)


def test_one_that_never_arrives_does_not_fly_on_with_those_that_have():
    flown = []

    def acceleration(t, r):
        flown.append(len(r))
        pushed_back = np.maximum(r[:, 0] - 400.0, 0.0) ** 2
        return np.column_stack((-pushed_back, 0 * r[:, 1], 0 * r[:, 2]))

    destinations = np.column_stack(([*np.linspace(10.0, 390.0, 30), 5e5], np.zeros((31, 2))))
    with pytest.raises(PathError) as refused:
        solve_transfers(acceleration, np.zeros(3), destinations, 3.0)
    assert refused.value.spacecraft == (30,)
    # Four paths each for the Jacobian: all of them at first, in the end the one that is left.
    assert flown[0] == 4 * 31 and flown[-1] == 4


def test_those_that_arrive_late_arrive_where_each_alone_would(monkeypatch):
    monkeypatch.setattr(trajectories, "ALL_TOGETHER", 1)
    r0 = np.array([0.0, 0.0, -30e3])
    destinations = np.array([[14e3, 0.0, 0.0], [0.0, 25e3, 9e3], [-40e3, 1e3, 1e3]])
    together, miss = solve_transfers(kepler, r0, destinations, 6000.0)
    for k in range(3):
        alone, _ = solve_transfers(kepler, r0, destinations[k : k + 1], 6000.0)
        assert np.allclose(together[k], alone[0], rtol=0, atol=1e-8) and miss[k] < 1e-5
        r, _ = propagate(kepler, r0[None], together[k : k + 1], np.array([0.0, 6000.0]))
        assert np.linalg.norm(r[-1, 0] - destinations[k]) < 1e-4
