"""Lost spacecraft, relays, cameras and deployers: what the swarm does, and where it flies."""

import numpy as np
import pytest

from swarm_mj.errors import SimulationError
from swarm_mj.flight.fly import make_simulation, simulate
from swarm_mj.flight.observe import observe_flight, picture_count
from swarm_mj.mission.behaviors import TargetKind, Targets
from swarm_mj.mission.trajectories import propagate
from swarm_mj.simulator.faults.relay_election import Succession, relay_of

from ..flying import place
from .flying import events_of, fault, fly, plan_of

SPACECRAFT, EARTH = int(TargetKind.SPACECRAFT), int(TargetKind.EARTH)
COARSE = ("physics.timestep_s=0.5", "telemetry.interval_s=5", "observation.interval_s=60")


def line_of_sight_angle(telemetry, k, j, direction):
    los = telemetry["line_of_sight_N"].values[k, j]
    return np.degrees(np.arctan2(np.linalg.norm(np.cross(los, direction)), los @ direction))


def test_a_lost_spacecraft_gives_no_torque_no_picture_and_no_link_but_flies_on_and_disturbs_nobody():
    plan, telemetry = fly(fault("{kind: spacecraft_lost, spacecraft: sc2, at_s: 300}"))
    _, healthy = fly()
    k = 60
    assert not telemetry["wheel_torque"].values[k:, 1].any()
    assert not telemetry["link_closed"].values[k:, 1].any()
    assert not telemetry["operational"].values[k:, 1].any()
    assert telemetry["operational"].values[:k, 1].all()
    assert picture_count(plan, telemetry) < picture_count(plan, healthy)
    # Attitude reaches position only in the rounding of the integrator.
    assert np.abs(telemetry["r_BN_N"].values - healthy["r_BN_N"].values).max() < 1e-6
    for name in ("sigma_BN", "wheel_torque"):
        assert np.array_equal(telemetry[name].values[:, 0], healthy[name].values[:, 0])


def test_a_camera_that_is_off_for_a_while_takes_no_pictures_then_and_nothing_else_changes():
    off = fault("{kind: camera_off, spacecraft: sc1, at_s: 200, duration_s: 300}")
    plan, telemetry = fly(off, "observation.observer=raycast")
    plain, healthy = fly("observation.observer=raycast")
    # One picture a minute: those at 240, 300, 360, 420 and 480 s are missing.
    assert picture_count(plain, healthy) - picture_count(plan, telemetry) == 5
    for name in healthy.data_vars:
        assert np.array_equal(telemetry[name].values, healthy[name].values), name
    seen = observe_flight(plan, telemetry).coverage
    assert seen.percent <= observe_flight(plain, healthy).coverage.percent


@pytest.mark.parametrize(
    ("name", "relay"), [("eros-config1", 5), ("eros-config2", 0)], ids=["dedicated relay", "elected relay"]
)
def test_when_the_communications_spacecraft_is_lost_another_is_elected_and_the_lines_of_sight_move_to_it(name, relay):
    lost = fault("{kind: communications_lost, at_s: 1050, detection_s: 20}")
    _, telemetry = fly(lost, *COARSE, name=name)
    assert [(e["time_s"], e["spacecraft"]) for e in events_of(telemetry, "communications_lost")] == [
        (1050, f"sc{relay + 1}")
    ]
    elected = events_of(telemetry, "elected")
    assert [e["time_s"] for e in elected] == [1070.0]
    successor = int(elected[0]["spacecraft"][2:]) - 1
    mode, tracked, r = (telemetry[v].values for v in ("mode", "tracked_spacecraft", "r_BN_N"))
    before, after = 213, 215  # 1065 and 1075 s
    others = [j for j in range(telemetry.sizes["spacecraft"]) if j not in (relay, successor)]
    assert (tracked[before, others] == relay).all()
    assert (tracked[after, others] == successor).all()
    assert mode[after, successor] == EARTH
    for j in others:
        assert line_of_sight_angle(telemetry, after, j, r[after, successor] - r[after, j]) < 1e-6
    assert line_of_sight_angle(telemetry, after, successor, telemetry.attrs["earth_N_m"]) < 0.1
    assert np.degrees(telemetry["pointing_error"].values[-1, [*others, successor]]).max() < 0.5
    assert not telemetry["link_closed"].values[211:214].any()  # lost and not yet known


def test_the_dedicated_relay_is_replaced_while_all_still_observe_and_only_those_outside_relay():
    lost = fault("{kind: spacecraft_lost, spacecraft: sc6, at_s: 100}")
    _, telemetry = fly(lost, *COARSE, name="eros-config1")
    mode = telemetry["mode"].values
    inside = np.linalg.norm(telemetry["r_BN_N"].values, axis=2) <= 35e3
    assert (mode[21:, :5][inside[21:, :5]] == int(TargetKind.ASTEROID)).all()
    assert set(np.unique(mode[-1, :5])) == {SPACECRAFT, EARTH}
    assert (mode[-1, :5] == EARTH).sum() == 1


def test_a_loss_of_the_relay_before_there_is_one_waits_for_the_election():
    _, telemetry = fly(fault("{kind: communications_lost, at_s: 0}"), *COARSE, name="eros-config2")
    outside = (np.linalg.norm(telemetry["r_BN_N"].values, axis=2) > 35e3).any(axis=1)
    first = telemetry["time"].values[outside][0]
    assert first - 5 < events_of(telemetry, "communications_lost")[0]["time_s"] <= first


def test_successors_are_elected_among_those_that_are_left_until_nobody_is():
    r = np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0], [10, 0, 0]])
    targets = Targets(np.array([EARTH, SPACECRAFT, SPACECRAFT, SPACECRAFT]), np.zeros(4, np.int64), np.zeros((4, 3)))
    succession = Succession("medoid")
    lost = np.array([True, False, False, False])
    moved, elected = succession.redirect(targets, r, lost)
    assert elected == [(0, 2)]
    assert moved.kind.tolist() == [EARTH, SPACECRAFT, EARTH, SPACECRAFT]
    assert moved.spacecraft.tolist()[1] == moved.spacecraft.tolist()[3] == 2
    assert targets.kind.tolist()[2] == SPACECRAFT  # the behaviour's own arrays stay
    assert succession.redirect(targets, r, lost)[1] == []
    lost[2] = True
    moved, elected = succession.redirect(targets, r, lost)
    assert elected == [(0, 1)]
    assert relay_of(moved, lost) == 1
    assert succession.redirect(targets, r, np.ones(4, bool))[0] is targets
    assert relay_of(targets, np.ones(4, bool)) is None


def test_a_flight_in_which_all_spacecraft_are_lost_ends_with_its_result():
    plan, telemetry = fly(fault("{kind: spacecraft_lost, spacecraft: all}"))
    assert len(events_of(telemetry, "spacecraft_lost")) == plan.n
    assert not telemetry["operational"].values[-1].any()
    assert all(np.isfinite(telemetry[name].values).all() for name in telemetry.data_vars)


def test_a_missed_deployment_flies_with_the_mothership_and_does_nothing():
    plan, telemetry = fly(fault("{kind: missed_deployment, spacecraft: sc1}"))
    start, v = plan.deployment.r0_N[None], plan.deployment.mothership_velocity_N[None]
    r, _ = propagate(plan.environment.acceleration_N, start, v, telemetry["time"].values)
    assert np.linalg.norm(telemetry["r_BN_N"].values[:, 0] - r[:, 0], axis=1).max() < 1e-3
    assert not telemetry["operational"].values[:, 0].any()
    assert events_of(telemetry)[0]["kind"] == "missed_deployment"


def test_a_weak_deployer_leaves_the_spacecraft_behind_by_its_missing_velocity_times_time_to_gravity():
    plan, telemetry = fly(fault("{kind: deployment_velocity, spacecraft: sc2, factor: 0.9}"))
    _, healthy = fly()
    t = telemetry["time"].values
    missing = -0.1 * (plan.deployment.v0_N[1] - plan.deployment.mothership_velocity_N)
    error = telemetry["r_BN_N"].values[:, 1] - healthy["r_BN_N"].values[:, 1]
    early = (t > 0) & (t <= 60)
    assert np.allclose(error[early], t[early, None] * missing, rtol=2e-3, atol=1e-6)
    velocity = plan.deployment.v0_N[1:2] + missing
    r, _ = propagate(plan.environment.acceleration_N, plan.deployment.r0_N[None], velocity, t)
    assert np.linalg.norm(telemetry["r_BN_N"].values[:, 1] - r[:, 0], axis=1).max() < 1e-3
    assert np.array_equal(telemetry["r_BN_N"].values[:, 0], healthy["r_BN_N"].values[:, 0])


def head_for_the_body(plan):
    """The velocity error that sends sc1 to the body's centre within the time of flight [m/s]."""
    wanted = -plan.deployment.r0_N / plan.scenario.design.time_of_flight_s
    return (wanted - plan.deployment.v0_N[0]).tolist()


def test_an_impact_is_found_within_a_control_period_and_the_others_fly_on():
    error = head_for_the_body(plan_of("eros-quick", ()))
    plan, telemetry = fly(fault(f"{{kind: deployment_velocity, spacecraft: sc1, error_m_s: {error}}}"))
    (impact,) = events_of(telemetry, "impact")
    times = np.arange(0.0, 600.0, 0.05)
    start, velocity = plan.deployment.r0_N[None], plan.deployment.v0_N[:1] + np.array(error)
    end = int(np.searchsorted(times, impact["time_s"])) + 1
    r, _ = propagate(plan.environment.acceleration_N, start, velocity, times[:end])
    from swarm_mj.mission.safety import find_impacts

    C_AN = np.array([plan.environment.C_AN(t) for t in times[:end]])
    (found,) = find_impacts(plan.shape, times[:end], np.einsum("kij,kj->ki", C_AN, r[:, 0])[:, None])
    assert 0.0 <= impact["time_s"] - found.time <= plan.scenario.control.period_s + 0.05
    # It lies where it hit, on the turning body.
    late = telemetry["time"].values > impact["time_s"] + 1
    C = np.array([plan.environment.C_AN(t) for t in telemetry["time"].values[late]])
    r_A = np.einsum("kij,kj->ki", C, telemetry["r_BN_N"].values[late, 0])
    assert np.ptp(r_A, axis=0).max() < 1e-6
    assert not telemetry["operational"].values[late, 0].any()
    assert np.abs(telemetry["r_BN_N"].values[:, 1] - fly()[1]["r_BN_N"].values[:, 1]).max() < 1e-6


def test_without_faults_an_impact_stops_the_flight_with_time_and_spacecraft():
    plan = plan_of("eros-quick", ())
    simulation = make_simulation(plan)
    velocity = simulation.state.v_N.copy()
    velocity[0] += head_for_the_body(plan)
    place(simulation, v_N=velocity)
    with pytest.raises(SimulationError, match=r"sc1 hits the body at t = \d+(\.5)? s, latitude"):
        simulation.run(600.0, 5.0)


def test_a_spacecraft_whose_state_is_no_number_is_given_up_at_the_next_control_period_and_the_others_fly_on():
    plan = plan_of("eros-quick", (fault("{kind: camera_off, spacecraft: sc1, at_s: 0}"),))
    simulation = make_simulation(plan)
    simulation.run(100.0, 5.0)
    before, rates = simulation.state.r_N[0].copy(), simulation.state.omega_B.copy()
    rates[0, 1] = np.nan
    place(simulation, omega_B=rates)
    record = simulation.run(500.0, 5.0)
    (event,) = [e for e in simulation.events if e.kind == "diverged"]
    assert (event.time_s, event.spacecraft) == (100.0, 0)
    assert simulation.lost.tolist() == [True, False]
    assert np.linalg.norm(simulation.state.r_N[0] - before) < 1e-6
    healthy = fly()[1]
    assert np.abs(record.samples["r_BN_N"][:, 1] - healthy["r_BN_N"].values[20:121, 1]).max() < 1e-6
    assert np.abs(record.samples["wheel_speed"][:, 1] - healthy["wheel_speed"].values[20:121, 1]).max() < 1e-6


def test_a_flight_with_faults_replays_bit_by_bit_and_another_seed_is_another_flight():
    faults = fault(
        "{kind: wheel_lost, spacecraft: any, wheel: any}, {kind: spacecraft_lost, spacecraft: all, probability: 0.5}"
    )
    noise = ("spacecraft.sensors=cubesat", "dispersions.mass_percent=2")
    plan, first = fly(faults, *noise)
    again = simulate(plan)
    for name in first.data_vars:
        assert np.array_equal(first[name].values, again[name].values), name
    assert first.attrs["events"] == again.attrs["events"]
    _, other = fly(faults, *noise, "seed=1")
    assert first.attrs["events"] != other.attrs["events"]


def test_a_simulation_that_is_reset_flies_the_same_faults_again():
    plan, _ = fly(fault("{kind: wheel_stuck, spacecraft: sc1, wheel: 1, at_s: 20}"), "dispersions.inertia_percent=3")
    from swarm_mj.flight.fly import initial_state

    simulation = make_simulation(plan)
    first, events = simulation.run(60.0, 5.0), list(simulation.events)
    simulation.reset(initial_state(plan))
    second = simulation.run(60.0, 5.0)
    assert all(np.array_equal(values, second.samples[name]) for name, values in first.samples.items())
    assert simulation.events == events
