"""Minimum-time slews in flight: the time of the closed form, within the wheels' limits, sooner than by the law's gains."""

from functools import cache

import numpy as np
import pytest

from swarm_mj.flight.fly import simulate
from swarm_mj.flight.plan import make_plan
from swarm_mj.scenarios.loading import load_scenario, parse_overrides
from swarm_mj.simulator.slews import SHARE
from swarm_mj.spacecraft.attitude.slew import Turning, slew_time, turning_about

from .test_fast_flyby import FLYBY

STILL = ["spacecraft.initial_rate_range_rpm=0", "duration_s=150", "telemetry.interval_s=0.5"]
QUICK = "control.slew=time_optimal"


@cache
def flown(seed, *overrides):
    plan = make_plan(load_scenario(FLYBY, parse_overrides([*STILL, f"seed={seed}", *overrides])))
    return plan, simulate(plan)


def settled_s(telemetry, within_deg=0.5):
    outside = np.degrees(telemetry["pointing_error"].values[:, 0]) > within_deg
    return telemetry["time"].values[np.flatnonzero(outside)[-1] + 1]


@pytest.mark.parametrize("seed", range(4))
def test_a_slew_from_rest_takes_the_time_of_the_closed_form(seed):
    plan, telemetry = flown(seed, QUICK)
    angle = float(telemetry["pointing_error"].values[0, 0])
    # The turn goes about the axis across +z and the line of sight, here in body components at its start.
    C_BN = dcm_of(telemetry["sigma_BN"].values[0, 0])
    axis = np.cross([0.0, 0.0, 1.0], C_BN @ telemetry["line_of_sight_N"].values[0, 0])
    whole = turning_about(axis / np.linalg.norm(axis), plan.properties)
    expected = slew_time(angle, Turning(SHARE * whole.acceleration, SHARE * whole.rate))
    assert slew_time(angle, whole) < expected < settled_s(telemetry) + 1.0 < expected + 3.0
    assert telemetry["wheel_saturation_time"].values.max() == 0.0
    assert telemetry["wheel_speed_peak"].values.max() < 0.85 * plan.properties.max_wheel_speed
    assert 0.7 < telemetry["wheel_torque_peak"].values.max() / plan.properties.max_wheel_torque < 1.0
    _, by_gains = flown(seed)
    assert settled_s(telemetry) < 0.6 * settled_s(by_gains)


def dcm_of(sigma):
    """From N to B, written from the definition of MRPs."""
    s, square = np.array([[0, -sigma[2], sigma[1]], [sigma[2], 0, -sigma[0]], [-sigma[1], sigma[0], 0]]), sigma @ sigma
    return np.eye(3) + (8 * s @ s - 4 * (1 - square) * s) / (1 + square) ** 2


def test_tumbling_spacecraft_slew_within_the_limits_of_the_wheels():
    plan = make_plan(load_scenario("eros-quick", parse_overrides([QUICK, "duration_s=1200"])))
    telemetry = simulate(plan)
    # Only the rates of the release, which no profile knows, take the wheels to their limit for some seconds.
    assert telemetry["wheel_saturation_time"].values.max() < 5.0
    usual = simulate(make_plan(load_scenario("eros-quick", {"duration_s": 1200})))
    k = int(np.searchsorted(telemetry["time"].values, 60.0))
    assert (
        np.degrees(telemetry["pointing_error"].values[k]).max()
        < 0.1
        < np.degrees(usual["pointing_error"].values[k]).max()
    )
