"""The sweep over a target: where it looks, in which order, and that a flight follows it."""

from dataclasses import replace

import numpy as np
import pytest

from swarm_mj.errors import MissionError
from swarm_mj.flight.fly import simulate
from swarm_mj.flight.plan import behavior_from, make_plan
from swarm_mj.mission.behaviors import AdaptableRoles, SwarmView, TargetKind
from swarm_mj.mission.sweep import TargetSweep
from swarm_mj.scenarios.loading import load_scenario, parse_overrides
from swarm_mj.spacecraft.attitude.mrp import dcm


def latitude_longitude(points):
    return (
        np.degrees(np.arcsin(points[:, 2] / np.linalg.norm(points, axis=1))),
        np.degrees(np.arctan2(points[:, 1], points[:, 0])),
    )


#: The target of the packaged scenarios.
EROS = {"latitude_deg": 0.0, "longitude_deg": 90.0, "half_angle_deg": 20.0}


def test_points_go_to_and_fro_over_the_target_at_one_distance():
    points = TargetSweep(5, 35e3, 7000.0, rows=3, **EROS).points_A
    assert np.allclose(np.linalg.norm(points, axis=1), 7000.0)
    latitude, longitude = (a.reshape(3, 3) for a in latitude_longitude(points))
    assert (np.diff(latitude.mean(axis=1)) > 5.0).all()
    assert (np.diff(longitude[0]) > 5.0).all() and (np.diff(longitude[1]) < -5.0).all()
    # Corner edges 20 deg off the axis: sides at atan(tan 20 / sqrt 2) = 14.43 deg, middles of the outer thirds at 2/3 of that.
    assert longitude[1, 0] == pytest.approx(90.0 + np.degrees(np.arctan(2 / 3 * np.tan(np.radians(14.4328)))), abs=1e-3)


def test_one_row_is_the_targets_middle():
    point = TargetSweep(2, 35e3, 7000.0, latitude_deg=30.0, longitude_deg=-60.0, half_angle_deg=20.0, rows=1).points_A
    assert np.allclose(latitude_longitude(point), [[30.0], [-60.0]])


def test_all_parts_are_looked_at_and_observers_start_apart():
    sweep = TargetSweep(5, 35e3, 7000.0, dwell_s=10.0, **EROS)
    near = np.tile([20e3, 0.0, 0.0], (5, 1))
    looks = []
    for t in np.arange(0.0, 160.0, 10.0):
        targets, _ = sweep.targets(SwarmView(t, near, near, np.eye(3)), None)
        assert (targets.kind == TargetKind.SURFACE).all()
        looks.append(targets.vector)
    first = np.array(looks)[:, 0]
    assert len(np.unique(first.round(3), axis=0)) == 16
    assert len(np.unique(looks[0].round(3), axis=0)) == 5


def test_outside_the_imaging_radius_it_talks_as_adaptable_roles_do():
    far = np.array([[40e3, 0.0, 0.0], [41e3, 0.0, 0.0], [20e3, 0.0, 0.0]])
    view = SwarmView(0.0, far, far, np.eye(3))
    sweep, memory = TargetSweep(3, 35e3, 7000.0, election="medoid", **EROS).targets(view, None)
    roles, same = AdaptableRoles(3, 35e3, "medoid").targets(view, None)
    assert memory == same
    assert np.array_equal(sweep.kind[:2], roles.kind[:2]) and sweep.kind[2] == TargetKind.SURFACE
    assert np.array_equal(sweep.spacecraft, roles.spacecraft)


def test_a_flight_follows_the_sweep():
    plan = make_plan(load_scenario("eros-observe"))
    sweep = TargetSweep(5, 35e3, 7000.0, dwell_s=100.0, **EROS)
    telemetry = simulate(replace(plan, behavior=sweep))
    k = int(np.flatnonzero(telemetry["time"].values == 595.0)[0])  # at the end of the sixth dwell
    C_AN = dcm(telemetry["sigma_AN"].values[k])
    r_A = telemetry["r_BN_N"].values[k] @ C_AN.T
    boresight_A = dcm(telemetry["sigma_BN"].values[k])[:, 2] @ C_AN.T
    wanted = sweep.points_A[(np.arange(5) * 16 // 5 + 5) % 16] - r_A
    cosine = (boresight_A * wanted).sum(axis=1) / np.linalg.norm(wanted, axis=1)
    assert np.degrees(np.arccos(np.clip(cosine, -1, 1))).max() < 0.1


@pytest.mark.parametrize(
    ("parameters", "word"),
    [
        ({"surface_radius_m": -1.0}, "surface_radius_m = -1.0"),
        ({"dwell_s": 0.0}, "dwell_s = 0.0"),
        ({"rows": 0}, "rows = 0"),
        ({"half_angle_deg": 90.0}, "half_angle_deg = 90.0"),
        ({"election": "best"}, "election = 'best'"),
    ],
)
def test_impossible_sweeps_are_clear_errors(parameters, word):
    with pytest.raises(MissionError, match=word):
        TargetSweep(**{"n_observers": 5, "imaging_radius_m": 35e3, "surface_radius_m": 7000.0, **parameters})


def swept_in(*overrides):
    return behavior_from(
        load_scenario("eros-quick", parse_overrides(["behavior.name=target_sweep", *overrides]))
    ).points_A


def test_the_sweep_is_over_the_scenarios_target_unless_it_is_told_another():
    there = ["target.latitude_deg=10", "target.longitude_deg=-40", "target.half_angle_deg=12"]
    middle = swept_in(*there, "behavior.parameters={surface_radius_m: 7000, rows: 1}")
    assert np.allclose(latitude_longitude(middle), [[10.0], [-40.0]])
    points = swept_in(*there, "behavior.parameters={surface_radius_m: 7000, rows: 2}")
    axis = middle[0] / 7000.0
    # The middles of four parts of a square whose corners are 12 deg off the axis lie half as far out.
    assert np.degrees(np.arccos(points @ axis / 7000.0)) == pytest.approx(
        np.degrees(np.arctan(np.tan(np.radians(12)) / 2))
    )
    side = swept_in(*there, "target.edges=side", "behavior.parameters={surface_radius_m: 7000, rows: 2}")
    wider = np.arctan(np.sqrt(2) * np.tan(np.radians(12)) / 2)
    assert np.degrees(np.arccos(side @ axis / 7000.0)) == pytest.approx(np.degrees(wider))
    other = swept_in(*there, "behavior.parameters={surface_radius_m: 7000, rows: 1, latitude_deg: -30}")
    assert np.allclose(latitude_longitude(other), [[-30.0], [-40.0]])


def test_a_sweep_that_nobody_aims_says_what_it_lacks():
    with pytest.raises(MissionError, match="half_angle_deg: give it"):
        _ = TargetSweep(2, 35e3, 7000.0).points_A
