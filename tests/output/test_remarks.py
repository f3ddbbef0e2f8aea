"""Remarks on pointing: what should have settled, and what had no time to."""

import numpy as np
import pytest

from swarm_mj.flight import simulate
from swarm_mj.output.holding import held_s
from swarm_mj.output.remarks import remarks
from swarm_mj.planning import make_plan
from swarm_mj.scenarios.loading import load_scenario

SWEEP = ["behavior={name: target_sweep, parameters: {surface_radius_m: 7000, dwell_s: 50}}", "duration_s=1000"]


@pytest.fixture(scope="module")
def swept():
    """Two spacecraft that look at one part of the target after another, 50 s each, and then talk to Earth."""
    return simulate(make_plan(load_scenario("eros-quick", SWEEP)))


def test_a_target_is_held_since_it_was_chosen_though_its_kind_stays_the_same(swept):
    held, times = held_s(swept), swept["time"].values
    assert (swept["mode"].values == 3).any() and (swept["mode"].values == 2).any()
    looking = swept["mode"].values == 3
    expected = np.broadcast_to((times % 50.0)[:, None], held.shape)
    assert np.array_equal(held[looking], expected[looking])
    for j in range(2):
        first = np.flatnonzero(~looking[:, j])[0]
        stays = swept["mode"].values[first:, j] == swept["mode"].values[first, j]
        assert np.allclose(held[first:, j][stays], times[first:][stays] - times[first])


def test_a_direction_is_held_until_another_is_given(swept):
    telemetry = swept.copy(deep=True)
    telemetry["mode"].values[:] = 4
    telemetry["line_of_sight_N"].values[:] = (0.0, 0.0, 1.0)
    telemetry["line_of_sight_N"].values[60:] = (0.0, 1e-3, 1.0)
    held = held_s(telemetry)
    assert held[59, 0] == telemetry["time"].values[59] and held[60, 0] == 0.0


def summary(error_deg, held_s, **more):
    switch = {"error_before_deg": error_deg, "target_held_s": held_s}
    return {
        "pointing_error_deg_final": {"sc1": 1e-6, "sc2": error_deg},
        "target_held_s_final": {"sc1": 500.0, "sc2": held_s},
        "mode_switches": {"sc1": [switch], "sc2": []},
        "wheel_saturation_s": {"sc1": 0.0, "sc2": 0.0},
        **more,
    }


def test_pointing_that_had_time_and_did_not_settle_is_told_from_targets_that_were_switched_soon():
    assert remarks(summary(1.5, 300.0)) == [
        "pointing had not settled at the end: sc2, up to 1.5 deg",
        "pointing had not settled before a switch: sc1, up to 1.5 deg",
    ]
    assert remarks(summary(1.5, 30.0)) == [
        "the flight ended less than 120 s after a target was chosen, while still turning: sc2, up to 1.5 deg",
        "targets were switched again less than 120 s after a target was chosen, while still turning: sc1, up to 1.5 deg",
    ]
    assert remarks(summary(0.01, 30.0)) == []
    assert len(remarks(summary(1.5, 300.0, lost=["sc1", "sc2"]))) == 0


def test_a_summary_of_an_earlier_version_tells_nothing_of_targets_and_is_read():
    old = summary(1.5, 300.0)
    del old["target_held_s_final"], old["mode_switches"]["sc1"][0]["target_held_s"]
    assert len(remarks(old)) == 2
