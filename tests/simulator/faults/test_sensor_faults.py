"""Imperfect sensors in flight: what the controller believes, and how well the spacecraft points then."""

import numpy as np
import pytest
from scipy.linalg import solve_discrete_lyapunov

from swarm_mj.scenarios.schema import Scenario
from swarm_mj.scenarios.schema_faults import Dispersions
from swarm_mj.scenarios.schema_sensors import IDEAL, Sensors
from swarm_mj.simulator.faults.dispersions import ARCSEC, DEG_PER_HOUR, draw_spacecraft
from swarm_mj.simulator.faults.schedule import draw_schedule
from swarm_mj.simulator.sensors import NOISE_ROWS, Sensing, most_readings
from swarm_mj.spacecraft.attitude.estimation import first_knowledge, sense
from swarm_mj.spacecraft.control.sliding_mode import MrpSlidingMode
from swarm_mj.spacecraft.properties import SpacecraftProperties

from .flying import events_of, fault, fly

SENSORS = (
    "spacecraft.sensors.gyro_angular_random_walk_deg_sqrt_h=0.15",
    "spacecraft.sensors.gyro_bias_deg_h=20",
    "spacecraft.sensors.star_tracker_noise_arcsec=10",
)


def sensing(n=2, faults=(), period=0.5, **errors):
    checked, sensors = Scenario(name="x", faults=tuple(faults)), IDEAL.model_copy(update=errors)
    schedule = draw_schedule(checked.faults, 0, n=n, n_wheels=3, duration_s=100.0)
    drawn = draw_spacecraft(Dispersions(), sensors, 0, n=n, n_wheels=3, period_s=period)
    knowledge = first_knowledge(n, NOISE_ROWS, most_readings(sensors, checked.faults, period))
    return Sensing(sensors, drawn, schedule, 0, period, knowledge), schedule


def know(sensors, tick, q, omega):
    """Attitudes and rates that the controller is given at a tick."""
    sensors.provide_noise()
    sense(tick, q, omega, 0.5, sensors.knowledge)
    return sensors.knowledge.q_BN, sensors.knowledge.omega_BN_B


def turning(tick, n=2):
    """Attitudes and rates of a turn about z at 0.02 rad/s."""
    angle = 0.02 * 0.5 * tick
    return np.tile([np.cos(angle / 2), 0, 0, np.sin(angle / 2)], (n, 1)), np.tile([0, 0, 0.02], (n, 1))


def test_with_perfect_sensors_the_controller_knows_the_truth_itself():
    perfect, _ = sensing()
    assert not perfect.active


def test_the_filter_finds_the_bias_of_the_gyro_in_flight_and_the_spacecraft_points_as_well_as_it_knows():
    _, telemetry = fly(*SENSORS)
    error = np.abs(telemetry["gyro_bias"] - telemetry["gyro_bias_estimate"]).values.max(axis=2)
    assert error[0].min() > 3 * DEG_PER_HOUR
    assert error[110:120].max() < 0.35 * error[0].min()
    known = telemetry["attitude_knowledge_error"].values[20:170]
    assert 1 * ARCSEC < np.median(known) < 20 * ARCSEC
    pointing = telemetry["pointing_error"].values[40:120]
    assert np.median(pointing) < 30 * np.median(known)
    assert np.degrees(pointing).max() < 0.1


def test_knowledge_and_pointing_err_as_the_noise_of_cubesat_sensors_makes_them_through_filter_and_control_law():
    """Farrenkopf's steady filter (1978) in closed form, and Lyapunov's equation of the loop about it, per axis [rad]."""
    T, noisy = 0.5, Sensors(star_tracker_bias_arcsec=0)
    v, u, st = np.radians([noisy.gyro_angular_random_walk_deg_sqrt_h / 60, 1 / 3600 / 60, 25 / 3600])
    Sv, Su = v * T**0.5 / st, u * T**1.5 / st
    zeta = Su / 4 + (g := np.sqrt(1 + Sv**2 / 4 + Su**2 / 48)) + np.sqrt(2 * g * Su + Sv**2 + Su**2 / 3) / 2
    gain = 1 - zeta**-2, -Su / T / zeta
    law, J = MrpSlidingMode(), SpacecraftProperties().inertia_effective_B[0, 0]
    slope = law.slope / 4
    decay = law.damping + (law.reaching_rate + 1.2 * law.disturbance_torque / J) / 0.8 / law.layer
    # Angle, rate, errors of estimated attitude and bias; white noise of the gyro over a period, and of the star tracker.
    angle, rate, error, bias, gyro, star = np.eye(6)
    wrong = bias + gyro / T
    error, bias = (
        error - T * wrong - gain[0] * (z := error - T * wrong + star),
        bias - gain[1] * z,
    )
    torque = -(slope + decay) * (rate + wrong) - slope * decay * (angle - error)
    loop = np.array([angle + T * rate + T**2 / 2 * torque, rate + T * torque, error, bias])
    noise = np.diag([v**2 * T, st**2])
    drive = loop[:, 4:] @ noise @ loop[:, 4:].T + np.diag([0, 0, 0, u**2 * T])
    P = solve_discrete_lyapunov(loop[:, :4], drive)
    assert np.sqrt(P[2, 2]) == pytest.approx(st * np.sqrt(1 - zeta**-2), rel=1e-4)
    given = "spacecraft.sensors={star_tracker_bias_arcsec: 0}", "telemetry.interval_s=0.5"
    _, flown = fly(*given, name="eros-config2")
    known = flown["attitude_knowledge_error"].values[200:]
    assert np.sqrt((known**2).mean() / 3) == pytest.approx(np.sqrt(P[2, 2]), rel=0.02)
    held = flown["pointing_error"].values[400:1700]
    assert np.sqrt((held**2).mean() / 2) == pytest.approx(np.sqrt(P[0, 0]), rel=0.04)


def test_a_dropout_of_the_star_tracker_lets_the_attitude_drift_and_its_return_ends_that():
    _, telemetry = fly(*SENSORS, fault("{kind: star_tracker_dropout, spacecraft: sc1, at_s: 300, duration_s: 200}"))
    known = telemetry["attitude_knowledge_error"].values
    before, during, after = known[40:60].max(axis=0), known[95:100].max(axis=0), known[104:140].max(axis=0)
    assert during[0] > 2 * before[0]
    assert after[0] < 0.5 * during[0]
    assert [e["kind"] for e in events_of(telemetry)] == ["star_tracker_dropout", "over"]
    assert np.array_equal(telemetry["gyro_bias"].values[:, 1], fly(*SENSORS)[1]["gyro_bias"].values[:, 1])


def test_without_a_gyro_the_spacecraft_still_points_by_its_star_tracker():
    _, telemetry = fly(*SENSORS, fault("{kind: gyro_dropout, spacecraft: sc1, at_s: 200, duration_s: 500}"))
    pointing = np.degrees(telemetry["pointing_error"].values[45:139])
    assert pointing[:, 0].max() < 0.5
    # It knows its attitude no better than a single reading, the other one better.
    known = np.median(telemetry["attitude_knowledge_error"].values[45:139], axis=0)
    assert known[0] > 1.2 * known[1]


def test_a_noisy_gyro_spoils_the_pointing_and_a_noisy_star_tracker_the_knowledge_of_it():
    noisy = "{kind: gyro_noise, spacecraft: sc1, at_s: 200}, {kind: star_tracker_noise, spacecraft: sc2, at_s: 200}"
    _, telemetry = fly(*SENSORS, fault(noisy))
    _, plain = fly(*SENSORS)
    for name, j in (("pointing_error", 0), ("attitude_knowledge_error", 1)):
        noisy_rms, plain_rms = (np.sqrt((t[name].values[45:170, j] ** 2).mean()) for t in (telemetry, plain))
        assert noisy_rms > 3 * plain_rms


def test_a_shifted_star_tracker_turns_the_spacecraft_by_its_angle():
    shift = fault("{kind: star_tracker_bias, spacecraft: sc1, at_s: 0, bias_arcsec: [1800, 0, 0]}")
    _, telemetry = fly("spacecraft.sensors.star_tracker_noise_arcsec=1", shift)
    assert np.degrees(telemetry["pointing_error"].values[60:120, 0]) == pytest.approx(0.5, abs=0.02)


def test_a_jump_of_the_gyro_bias_shows_in_the_pointing_until_the_filter_has_found_it():
    _, telemetry = fly(*SENSORS, fault("{kind: gyro_bias, spacecraft: sc1, at_s: 300, bias_deg_h: [600, 600, 0]}"))
    error = np.degrees(telemetry["attitude_knowledge_error"].values[:, 0])
    assert error[61:80].max() > 5 * error[40:60].max()
    assert error[140:170].max() < 0.5 * error[61:80].max()


def test_a_delayed_controller_is_given_what_was_true_so_many_periods_ago():
    delay = {"kind": "sensor_delay", "spacecraft": "sc2", "at_s": 0, "delay_s": 1.5}
    late, (entry,) = sensing(faults=[delay])
    assert late.active and not late.estimating
    late.set_fault(1, entry.fault, active=True)
    for tick in range(10):
        q, omega = know(late, tick, *turning(tick))
    assert np.array_equal(q[0], turning(9)[0][0])
    assert np.array_equal(q[1], turning(6)[0][1])
    assert late.knowledge_error(turning(9)[0])[1] == pytest.approx(0.02 * 1.5, rel=1e-6)
    late.set_fault(1, entry.fault, active=False)
    assert np.array_equal(know(late, 10, *turning(10))[0][1], turning(10)[0][1])


def test_what_is_asked_twice_at_a_tick_is_measured_once():
    noisy, _ = sensing(star_tracker_noise_arcsec=10)
    first = [a.copy() for a in know(noisy, 0, *turning(0))]
    again = know(noisy, 0, *turning(0))
    assert all(np.array_equal(a, b) for a, b in zip(first, again, strict=True))


def test_dispersed_delays_are_whole_periods_up_to_the_given_one_and_a_late_loop_still_settles():
    drawn = draw_spacecraft(Dispersions(), Sensors(delay_s=2.0), 1, n=400, n_wheels=3, period_s=0.5)
    assert set(drawn.delay_ticks) == {0, 1, 2, 3, 4}
    _, telemetry = fly("spacecraft.sensors.delay_s=0.5")
    assert telemetry["attitude_knowledge_error"].values[1:10].max() > 1e-3
    assert np.degrees(telemetry["pointing_error"].values[60:120]).max() < 0.5


def two_biases(kind, key):
    given = [{"kind": kind, "spacecraft": "sc2", "at_s": 0, key: bias} for bias in ([300, -100, 50], [20, 40, -60])]
    sensors, schedule = sensing(faults=given)
    for entry in schedule:
        sensors.set_fault(1, entry.fault, active=True)
    return sensors, schedule


def test_the_bias_that_a_fault_adds_to_a_gyro_is_taken_back_when_it_is_over():
    sensors, (first, second) = two_biases("gyro_bias", "bias_deg_h")
    assert sensors.gyro_bias[1] / DEG_PER_HOUR == pytest.approx([320, -60, -10])
    sensors.set_fault(1, first.fault, active=False)
    assert sensors.gyro_bias[1] / DEG_PER_HOUR == pytest.approx([20, 40, -60])
    sensors.set_fault(1, second.fault, active=False)
    assert sensors.gyro_bias / DEG_PER_HOUR == pytest.approx(np.zeros((2, 3)), abs=1e-9)


def test_the_turn_that_a_fault_gives_a_star_tracker_is_taken_back_when_it_is_over():
    for recovered, left in (((), [320, -60, -10]), ((0,), [20, 40, -60]), ((0, 1), [0, 0, 0])):
        sensors, schedule = two_biases("star_tracker_bias", "bias_arcsec")
        for k in recovered:
            sensors.set_fault(1, schedule[k].fault, active=False)
        # The filter begins with what the star tracker says; of a turn so small twice the vector part is the angle.
        q, _ = know(sensors, 0, np.tile([1.0, 0, 0, 0], (2, 1)), np.zeros((2, 3)))
        assert 2 * q[1, 1:] / ARCSEC == pytest.approx(left, rel=1e-5, abs=1e-9)
