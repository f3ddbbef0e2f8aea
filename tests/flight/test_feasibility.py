"""Scenarios held against their encounter: closed forms of the rates, and every limit that breaks is named."""

import re
from copy import deepcopy

import numpy as np
import pytest

from swarm_mj.errors import ScenarioError, at_least, at_most
from swarm_mj.flight.feasibility import TURN_IN_A_PERIOD, arrival_geometry, sight_rates
from swarm_mj.flight.plan import make_plan
from swarm_mj.scenarios.loading import load_scenario, parse_overrides
from swarm_mj.spacecraft.attitude.slew import slew_profile, slew_time, turning_limits
from swarm_mj.spacecraft.properties import SpacecraftProperties

from .test_fast_flyby import ARRIVAL, DISTANCE, FLYBY, SPEED

WEAK, LITTLE = (f"spacecraft.wheel.max_torque_n_m={torque}" for torque in (1e-4, 1.4e-4))
#: The flyby, its arrival well before the closest approach, where the acceleration is not zero.
OBLIQUE = f"mothership.position_A_m=[0,{DISTANCE + 0.5 * SPEED * ARRIVAL},{-0.87 * SPEED * ARRIVAL}]"


def planned(*overrides):
    return make_plan(load_scenario(deepcopy(FLYBY), parse_overrides(overrides)))


def found(*overrides):
    return planned(*overrides).encounter_findings


def test_rates_are_those_of_a_straight_flyby():
    t = np.linspace(-20.0, 20.0, 4001)
    r = np.column_stack((np.full_like(t, DISTANCE), SPEED * t, 0 * t))
    rate, acceleration = sight_rates(r, np.broadcast_to([0.0, SPEED, 0.0], r.shape), 0.0)
    assert np.allclose(rate, SPEED * DISTANCE / (DISTANCE**2 + (SPEED * t) ** 2), rtol=1e-12)
    assert np.allclose(acceleration, np.abs(np.gradient(rate, t)), atol=1e-6)
    assert acceleration.max() == pytest.approx(3 * np.sqrt(3) / 8 * (SPEED / DISTANCE) ** 2, rel=1e-6)


def test_the_encounter_is_the_state_at_the_arrival():
    plan = planned()
    met = arrival_geometry(plan.deployment, plan.environment, plan.n_observers, 2e6)
    speed = np.linalg.norm(met.v_N[0])
    assert met.t.tolist() == [ARRIVAL] and np.allclose(met.r_N, plan.deployment.destination_N)
    b = np.linalg.norm(np.cross(met.r_N[0], met.v_N[0])) / speed
    assert met.peak_rate[0] == pytest.approx(speed / b, rel=1e-3)
    assert met.peak_acceleration[0] == pytest.approx(3 * np.sqrt(3) / 8 * (speed / b) ** 2, rel=1e-3)
    # Where the imaging radius leaves out the peak of the acceleration, it does not count.
    near = arrival_geometry(plan.deployment, plan.environment, plan.n_observers, 1.05 * DISTANCE)
    assert near.peak_acceleration[0] < 0.9 * met.peak_acceleration[0]


def test_a_flyby_that_works_has_no_findings():
    assert found() == ()


@pytest.mark.parametrize(
    ("overrides", "words"),
    [
        (["design.imaging_altitude_m=16000"], "max_speed_rpm = 6000: .* line of sight has an angular rate of 0.349"),
        ([WEAK, OBLIQUE], r"max_torque_n_m = 0.0001: at the arrival .* acceleration of 0.00289.*imaging_altitude_m"),
        (["behavior.imaging_radius_m=90000"], r"imaging_radius_m = 90000: no observer is inside it at any time"),
        (["behavior.imaging_radius_m=99000", "observation.criterion=arrival"], "no observer is inside it at the arrival"),
        (
            ["camera.exposure_s=2", "observation.criterion=arrival", "observation.max_motion_blur_px=1"],
            r"max_motion_blur_px = 1: every face blurs more in every picture.*exposure_s = 2: must be at most",
        ),
    ],
)  # fmt: skip
def test_what_cannot_work_is_refused_by_name(overrides, words):
    with pytest.raises(ScenarioError, match=words):
        planned(*overrides)


@pytest.mark.parametrize(
    ("overrides", "words"),
    [
        (
            ["spacecraft.wheel.max_speed_rpm=3000"],
            "rate of 0.07.*about the worst axis across the camera's the wheels give 0.089.* rad/s .about the best 0.12.*"
            ", and the initial tumbling may take 0.036.*spacecraft.wheel.max_speed_rpm",
        ),
        ([LITTLE], r"acceleration of 0.003\d* rad/s\^2 near the arrival.*give 0.0016.* .about the best 0.002.*max_torque_n_m"),
        (["control.period_s=2", "observation.interval_s=10", "telemetry.interval_s=2", "control.parameters.layer=0.2"],
         "control.period_s = 2: the line of sight turns by 8"),
        (["observation.interval_s=50", "camera.half_angle_deg=0.05"], "pictures do not join; at most"),
        (["behavior.imaging_radius_m=105000"], "crossed 8.3 s before .* half a turn about the worst axis takes the wheels 2"),
        (["behavior.imaging_radius_m=101000"], "inside behavior.imaging_radius_m = 101000 for"),
        (["observation.max_motion_blur_px=0.12"], "of the faces in pictures of the arrival blur more, up to 0.14"),
    ],
)  # fmt: skip
def test_what_may_fall_short_is_a_finding(overrides, words):
    sentences = found(*overrides)
    assert any(re.search(words, sentence) for sentence in sentences), sentences


@pytest.mark.parametrize(
    ("speed", "distance", "axes"),
    [(5.0, 1_500.0, 250.0), (10_000.0, 2_000_000.0, 40_000.0), (7_000.0, 100_000.0, 10_000.0), (46.0, 14_000.0, 5_000.0)],
)  # fmt: skip
def test_unlike_missions_raise_no_alarm(speed, distance, axes):
    """From 5 m/s past a pebble to 10 km/s; released from afar, straight, inside the imaging radius for long."""
    flight = max(600.0, 30.0 * round(distance / speed))
    body = FLYBY["body"] | {"semi_axes_m": [axes] * 3}
    gravity = body["gravity"]["parameters"] | {"gm": 5e-7 * axes**3, "reference_radius_m": axes}
    mission = FLYBY | {
        "duration_s": flight + 200,
        "body": body | {"gravity": {"model": "spherical_harmonics", "parameters": gravity}},
        "design": {"visiting_points": [1], "imaging_altitude_m": distance - axes, "time_of_flight_s": flight},
        "mothership": {"position_A_m": [0, distance, -speed * flight]},
        "behavior": {"name": "adaptable_roles", "imaging_radius_m": 20 * distance},
        "telemetry": {"interval_s": 10},
    }
    assert make_plan(load_scenario(mission)).encounter_findings == ()


@pytest.mark.parametrize("period", [0.5, 1.0, 2.0])
def test_a_period_that_is_told_keeps_the_limit_and_differs_from_the_one_that_broke_it(period):
    """Just above the limit: speeds past the body at which the line of sight turns by 0.1 rad in a period, and a little more."""
    for more in (1.0001, 1.003, 1.04):
        speed = more * TURN_IN_A_PERIOD / period * DISTANCE
        arrival = period * round(ARRIVAL / period)
        start = f"mothership.position_A_m=[0,{DISTANCE},{-speed * arrival}]"
        times = [f"control.period_s={period}", f"telemetry.interval_s={period}", f"design.time_of_flight_s={arrival}"]
        easy = ["spacecraft.wheel.max_speed_rpm=60000", "control.parameters.layer=0.2", "observation.interval_s=10"]
        (said,) = [one for one in found(start, *times, *easy) if one.startswith("control.period_s")]
        turned, most, kept = map(
            float, re.search(r"turns by (\S+) deg .* at most (\S+) s keeps .* within (\S+) deg", said).groups()
        )
        assert most < period and most * speed / DISTANCE <= TURN_IN_A_PERIOD and turned > kept


def test_limits_in_messages_are_cut_to_the_side_that_keeps_them():
    assert [at_most(x) for x in (0.4996, 0.5, 123.0, -1.23, 0.0)] == ["0.49", "0.5", "120", "-1.3", "0"]
    assert [at_least(x) for x in (0.4996, 0.3, 1.1, 12341.0, 99.95)] == ["0.5", "0.3", "1.1", "12400", "100"]


def test_the_minimum_time_turn_is_bang_bang_or_bang_coast_bang():
    worst, best = turning_limits(SpacecraftProperties())
    J = 0.0837333 - 2.387e-5
    assert worst.acceleration == pytest.approx(0.004 / J, rel=1e-5)
    assert best.acceleration == pytest.approx(np.sqrt(2) * 0.004 / J, rel=1e-3)
    short = 0.5 * worst.rate**2 / worst.acceleration
    assert slew_time(short, worst) == pytest.approx(2 * np.sqrt(short * J / 0.004), rel=1e-5)
    for angle in (short, 3.0):
        end = slew_time(angle, worst)
        t = np.linspace(0.0, end, 20001)
        left, rate, acceleration = np.array([slew_profile(angle, worst, float(s)) for s in t]).T
        assert left[0] == angle and abs(left[-1]) < 1e-12 and abs(rate[-1]) < 1e-12
        assert np.abs(rate).max() <= worst.rate * (1 + 1e-12) and np.abs(acceleration).max() <= worst.acceleration
        assert np.allclose(np.gradient(left, t)[1:-1], rate[1:-1], atol=1e-4)
        assert np.allclose(
            left, angle + np.concatenate(([0], np.cumsum(0.5 * (rate[1:] + rate[:-1]) * np.diff(t)))), atol=1e-4
        )
