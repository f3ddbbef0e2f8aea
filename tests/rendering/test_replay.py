"""What is drawn between two samples of telemetry, against denser flights and closed forms."""

import warnings

import h5py
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from swarm_mj.errors import OutputError
from swarm_mj.flight.fly import simulate
from swarm_mj.flight.plan import make_plan
from swarm_mj.rendering.replay import Replay, load_replay
from swarm_mj.scenarios.loading import load_scenario
from swarm_mj.simulator.telemetry import read_telemetry
from swarm_mj.spacecraft.attitude.mrp import dcm, mrp_from_quaternion


def test_positions_and_attitudes_between_samples_are_those_of_a_ten_times_denser_recording(replay):
    dense = simulate(make_plan(load_scenario("eros-quick", {"telemetry.interval_s": 0.5})))
    for k in range(207, 2400, 331):
        now = replay.at(float(dense["time"][k]))
        assert np.abs(now.r_BN_N - dense["r_BN_N"].values[k]).max() < 1e-3
        turned = Rotation.from_matrix(now.C_BN @ dcm(dense["sigma_BN"].values[k]).transpose(0, 2, 1)).magnitude()
        assert turned.max() < np.radians(0.5)


def test_a_turn_at_constant_rate_is_interpolated_exactly_through_the_shadow_set(flown):
    plan, telemetry, result = flown
    axis, rate = np.array([0.6, -0.48, 0.64]), 0.05
    telemetry = telemetry.copy(deep=True)
    angles = rate * telemetry["time"].values
    quaternions = Rotation.from_rotvec(angles[:, None] * axis).as_quat(scalar_first=True)
    telemetry["sigma_BN"].values[:] = mrp_from_quaternion(quaternions)[:, None]
    spinning = Replay(plan, telemetry, result.coverage.first_seen_s)
    for t in (1.3, 62.6, 63.4, 127.9, 1199.2):  # a turn of 180 deg, where the MRP jumps, is at 62.8 s
        expected = Rotation.from_rotvec(rate * t * axis).as_matrix().T
        assert np.allclose(spinning.at(t).C_BN, expected, atol=1e-9)


def test_cells_fill_at_the_very_times_the_run_recorded(flown, replay):
    plan, telemetry, result = flown
    shown = [
        100.0 * plan.region.area[replay.at(t).seen].sum() / plan.region.total_area for t in telemetry["time"].values
    ]
    assert np.allclose(shown, result.coverage.percent_over_time(telemetry["time"].values))
    assert shown[0] < 1.0 and shown[-1] > 99.0
    first = np.nanmin(result.coverage.first_seen_s)
    assert not replay.at(first - 1e-3).seen.any() and replay.at(first).seen.any()


def test_modes_hold_from_one_sample_to_the_next_and_the_trail_ends_at_the_spacecraft(flown, replay):
    _, telemetry, _ = flown
    modes = telemetry["mode"].values
    switch = int(np.flatnonzero((modes[1:] != modes[:-1]).any(axis=1))[0]) + 1
    t = float(telemetry["time"][switch])
    assert (replay.at(t - 0.1).kind == modes[switch - 1]).all() and (replay.at(t).kind == modes[switch]).all()
    now = replay.at(t)
    assert np.array_equal(now.trail_N[-1], now.r_BN_N)
    assert np.allclose(now.trail_N[0], telemetry["r_BN_N"].values[0])


def test_lines_of_sight_end_at_what_is_tracked(replay):
    late = replay.at(1200.0)
    talkers = np.flatnonzero(late.tracked >= 0)
    assert talkers.size
    ends = late.r_BN_N + late.sight_length[:, None] * late.boresight_N
    reached = late.r_BN_N[late.tracked[talkers]]
    miss = np.linalg.norm(ends[talkers] - reached, axis=1)
    assert (miss < 1e-3 * np.linalg.norm(reached - late.r_BN_N[talkers], axis=1)).all()
    early = replay.at(500.0)
    assert np.allclose(early.sight_length, np.linalg.norm(early.r_BN_N, axis=1))


def test_a_foreign_file_is_refused_without_a_warning(tmp_path):
    path = tmp_path / "telemetry.nc"
    with h5py.File(path, "w") as file:
        file["nameless"] = np.arange(3.0)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(OutputError, match="telemetry.nc: cannot be read .time is missing"):
            read_telemetry(path)


def test_a_folder_that_is_no_run_and_cells_that_do_not_fit_are_clear_errors(flown, tmp_path):
    plan, telemetry, result = flown
    with pytest.raises(OutputError, match="is not a folder of `swarm-mj fly`.*summary.json"):
        load_replay(tmp_path)
    with pytest.raises(OutputError, match="143 target cells were recorded, but the scenario now gives 2 and 144"):
        Replay(plan, telemetry, result.coverage.first_seen_s[:-1])
