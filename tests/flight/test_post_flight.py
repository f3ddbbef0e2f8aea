"""The time after a flight: paths against the flight itself and Kepler, attitudes turned the shortest way, roles."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import swarm_mj as sm
from swarm_mj.flight.post_flight import (
    controlled,
    flown_instants,
    post_flight_instants,
    post_flight_paths,
    roles,
    turned,
)
from swarm_mj.mission.behaviors import TargetKind
from swarm_mj.spacecraft.attitude.mrp import dcm


@pytest.fixture(scope="module")
def config1(config_flights):
    return config_flights["eros-config1"]


def test_paths_go_on_where_mujoco_flies(config1):
    plan, telemetry = config1
    cut = telemetry.isel(time=slice(0, 601))
    _, r_N, works = post_flight_paths(plan, cut, np.array([700.0, 900.0, 1200.0]))
    flown = telemetry["r_BN_N"].sel(time=[700.0, 900.0, 1200.0]).values
    # Steps of 0.1 s and an adaptive integrator: different programs, 24 km of way.
    assert np.abs(r_N - flown).max() < 0.05
    assert works.all()


def test_energy_is_kept_for_two_days(config1):
    plan, telemetry = config1
    end = float(telemetry["time"].values[-1])
    times = end + np.array([0.5, 1.0]) + 172_800.0
    _, r_N, _ = post_flight_paths(plan, telemetry, times)
    # Far away the body is a point: half v^2 - GM / r, from positions half a second apart.
    v = (r_N[1] - r_N[0]) / 0.5
    gm = plan.environment.gravity.gm
    r = telemetry["r_BN_N"].values[-1]
    after = 0.5 * np.einsum("ni,ni->n", v, v) - gm / np.linalg.norm(r_N.mean(axis=0), axis=1)
    before = 0.5 * (telemetry["v_BN_N"].values[-1] ** 2).sum(axis=1) - gm / np.linalg.norm(r, axis=1)
    # Eros is no point at 36 km, and turns: parts in a hundred of GM / r = 12 m^2/s^2.
    assert np.abs(after - before).max() < 0.5
    assert np.abs(np.linalg.norm(r_N[1], axis=1)).min() > 1e6


def test_who_is_lost_stays_where_it_was(config1):
    plan, telemetry = config1
    lost = telemetry.copy()
    works = np.ones((lost.sizes["time"], plan.n), np.int8)
    works[-1, 2] = 0
    lost["operational"] = (("time", "spacecraft"), works)
    _, r_N, alive = post_flight_paths(plan, lost, np.array([2000.0, 3000.0]))
    assert alive.tolist() == [[True, True, False, True, True, True]] * 2
    assert (r_N[:, 2] == lost["r_BN_N"].values[-1, 2]).all()


def test_relays_point_at_earth_and_the_others_at_the_nearest_relay(config1):
    plan, telemetry = config1
    times = np.array([5000.0, 50_000.0])
    found = post_flight_instants(
        plan,
        dcm(telemetry["sigma_BN"].values[-1]),
        post_flight_paths(plan, telemetry, times),
        np.tile(np.flatnonzero(telemetry["mode"].values[-1] == TargetKind.EARTH), (2, 1)),
    )
    assert found.mode[0].tolist() == [TargetKind.SPACECRAFT] * 5 + [TargetKind.EARTH]
    for k in range(2):
        for j in range(6):
            aim = found.earth_N[k] if j == 5 else found.r_BN_N[k, 5]
            way = aim - found.r_BN_N[k, j]
            assert found.C_BN[k, j, 2] @ way == pytest.approx(np.linalg.norm(way), rel=1e-12)
    assert np.allclose(found.C_BN @ found.C_BN.swapaxes(-1, -2), np.eye(3), atol=1e-12)
    assert np.allclose(found.C_AN[0], plan.environment.C_AN(5000.0))


def test_each_tracks_the_nearest_relay_that_works():
    r_N = np.array([[[0.0, 0, 0], [10.0, 0, 0], [11.0, 0, 0], [1.0, 0, 0]]])
    relays = np.array([[0, 1]])
    mode, tracked = roles(r_N, np.ones((1, 4), bool), relays)
    assert tracked[0].tolist() == [-1, -1, 1, 0]
    mode, tracked = roles(r_N, np.array([[False, True, True, True]]), relays)
    assert tracked[0, 3] == 1 and mode[0, 3] == TargetKind.SPACECRAFT
    mode, _ = roles(r_N, np.array([[False, False, True, True]]), relays)
    assert (mode == TargetKind.ASTEROID).all()
    mode, _ = roles(r_N, np.ones((1, 4), bool), np.empty((1, 0), np.int64))
    assert (mode == TargetKind.ASTEROID).all()


def test_turns_are_the_shortest_and_half_turns_work():
    rng = np.random.default_rng(1)
    C_BN = Rotation.random(50, random_state=1).as_matrix()
    towards = rng.normal(size=(3, 50, 3)) * 1e6
    towards[1] = -C_BN[:, 2] * 7.0
    towards[2] = 0.0
    found = turned(C_BN, towards)
    assert np.allclose(np.linalg.det(found), 1.0)
    for k in range(2):
        aim = towards[k] / np.linalg.norm(towards[k], axis=1, keepdims=True)
        assert np.allclose(found[k, :, 2], aim, atol=1e-12)
    assert np.allclose(found[2], C_BN)
    by = Rotation.from_matrix(found[0] @ C_BN.swapaxes(-1, -2)).magnitude()
    between = np.arccos(np.clip(np.einsum("ni,ni->n", C_BN[:, 2], found[0, :, 2]), -1, 1))
    near = between < np.radians(115.0)
    assert near.sum() > 20
    assert np.allclose(by[near], between[near], atol=1e-7)


def test_flown_instants_are_the_samples(config1):
    plan, telemetry = config1
    found = flown_instants(plan, telemetry, np.array([0.4, 600.2]))
    assert found.t.tolist() == [0.0, 600.0]
    assert (found.r_BN_N[1] == telemetry["r_BN_N"].values[600]).all()
    assert np.allclose(found.C_BN[1], dcm(telemetry["sigma_BN"].values[600]))
    assert found.works.all()


def test_who_falls_onto_the_body_is_lost_there(config1):
    plan, telemetry = config1
    falling = telemetry.copy(deep=True)
    r = falling["r_BN_N"].values[-1, 1]
    falling["v_BN_N"].values[-1, 1] = -r / 600.0  # at the centre after ten minutes
    times = 1200.0 + np.arange(60.0, 1800.0, 60.0)
    _, _, alive = post_flight_paths(plan, falling, times)
    assert alive[:, [0, 2, 3, 4, 5]].all()
    reach = np.linalg.norm(r) * (1.0 - (times - 1200.0) / 600.0)
    assert alive[reach > plan.shape.max_radius, 1].all() and not alive[reach < 0.0, 1].any()


def test_who_is_still_turning_to_another_target_has_control_and_whose_axis_sweeps_around_has_not(config1):
    _, telemetry = config1
    turning = telemetry.isel(time=slice(0, int(np.argmax(np.diff(telemetry["mode"].values[:, 0]) != 0)) + 10))
    assert np.degrees(turning["pointing_error"].values[-1]).max() > 5.0
    assert controlled(turning).all()
    sweeping = np.abs((2.0 * telemetry["time"].values + 180.0) % 360.0 - 180.0)
    wild = telemetry.copy()
    wild["pointing_error"] = telemetry["pointing_error"].copy()
    wild["pointing_error"][:, 1] = np.radians(sweeping)
    assert controlled(wild).tolist() == [True, False, True, True, True, True]
    assert controlled(wild.isel(time=slice(0, 200))).all()  # too short to tell


SEIZED = {"kind": "wheel_stuck", "wheel": "all", "speed_rpm": 0, "at_s": 890}


@pytest.mark.parametrize(
    ("who", "antenna", "delivered"),
    [("sc1", "omnidirectional", 100.0), ("sc1", "hemispherical", 0.0), ("all", "omnidirectional", 0.0)],
)
def test_who_tumbles_when_the_flight_ends_points_no_antenna_afterwards(who, antenna, delivered):
    """Only sc1 takes pictures; its wheels give their momentum to it, or to all, once these are taken."""
    faults = [{**SEIZED, "spacecraft": who}, {"kind": "camera_off", "spacecraft": "sc2", "at_s": 0}]
    given = {"faults": faults, "link.crosslink.antenna": antenna, "data.product": "cells"}
    summary = sm.fly("eros-quick", {**given, "observation.observer": "raycast"}).summary
    assert summary["coverage_percent"] == 100.0 and summary["delivered_percent"] == delivered
    # Nobody elects who cannot point, unless nobody can.
    assert summary["relays_after"] == (["sc1"] if who == "all" else ["sc2"])
    missing = [(part["reason"], part["spacecraft"]) for part in summary["not_delivered"]]
    assert missing == ([] if delivered else [("no attitude control", ["sc1"])])
