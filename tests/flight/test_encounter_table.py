"""The table of a plan's encounter: where the observers are, from when on they take pictures, and what a plan of it shows."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import swarm_mj as sm
from swarm_mj.coordination.allocation.greedy import greedy
from swarm_mj.coordination.replanning import problem_of
from swarm_mj.flight.encounter_table import encounter_of, track_of
from swarm_mj.flight.observe import camera_from
from swarm_mj.flight.plan import make_plan
from swarm_mj.mission.trajectories import propagate
from swarm_mj.observation.camera import look_at
from swarm_mj.observation.capture import observe
from swarm_mj.observation.observer import make_observer
from swarm_mj.scenarios.loading import parse_overrides


@cache
def plan(*changes):
    return make_plan(
        sm.load("eros-observe").changed(parse_overrides(["target.cell_size_m=900", *changes])), check_separation=False
    )


def test_the_track_is_that_of_the_plan():
    times = np.array([0.0, 300.0, 600.0])
    track, deployment = track_of(plan(), times), plan().deployment
    starts = np.broadcast_to(deployment.r0_N, deployment.v0_N.shape)
    r_N, _ = propagate(plan().environment.acceleration_N, starts, deployment.v0_N, times)
    C_AN = np.array([plan().environment.C_AN(t) for t in times])
    np.testing.assert_allclose(np.einsum("kji,knj->kni", C_AN, track.r_A), r_N, atol=1e-3)
    np.testing.assert_allclose(track.r_A[2], plan().points_A, atol=1.0)  # arrivals at 600 s
    ahead = track_of(plan(), times + 0.5).r_A - track_of(plan(), np.maximum(times - 0.5, 0.0)).r_A
    np.testing.assert_allclose(track.v_A[1:], ahead[1:], rtol=1e-4)


def test_who_is_released_later_rides_along_until_then_and_takes_no_pictures():
    late = plan("design.release_s=200", "design.observers=[{release_s: 0}, {release_s: 40}, {}, {}, {}]")
    times = np.array([100.0, 190.0, 200.0, 400.0])
    track = track_of(late, times)
    assert track.free[:, 2].tolist() == [False, False, True, True] and track.free[:, :2].all()
    np.testing.assert_allclose(track.r_A[1, 2], track.r_A[1, 3], atol=1e-6)  # both aboard
    assert np.linalg.norm(track.r_A[3, 2] - track.r_A[3, 3]) > 100.0
    arrived = track_of(late, np.array([800.0])).r_A[0]
    np.testing.assert_allclose(arrived[2:], late.points_A[2:], atol=1.0)
    encounter = encounter_of(late)
    aboard = encounter.slot_s < 200.0
    assert not encounter.shows[2:, :, aboard].any() and encounter.shows[2:].any()


def test_pictures_as_planned_show_what_the_table_says():
    encounter = encounter_of(plan())
    found, track = greedy(problem_of(encounter)), track_of(plan(), encounter.slot_s)
    assert 0.3 < found.value / plan().region.total_area <= 1.0 and (encounter.slew >= 1).all()
    camera = replace(camera_from(plan().scenario), shape="cone")
    observer = make_observer(plan().region, camera, kind="raycast")
    seen = np.zeros(plan().region.n_cells, bool)
    for agent, taken in enumerate(found.pictures):
        for slot, aim in taken:
            pose = look_at(track.r_A[slot, agent], encounter.aims_A[aim], roll=0.7)
            seen |= observe(observer, pose.r_A, pose.C_CA, plan().scenario.observation, track.sun_A[slot])
    assert plan().region.area[seen].sum() == pytest.approx(found.value, rel=0.02)  # another observer, another angle


def test_the_table_of_a_plan_that_is_flown_again_is_made_once_and_that_of_another_anew():
    again = replace(plan(), scenario=sm.load("eros-observe").changed({"target.cell_size_m": 900, "seed": 7}))
    assert encounter_of(again) is encounter_of(plan())
    narrow = replace(plan(), scenario=sm.load("eros-observe").changed({"observation.max_gsd_m": 2.5}))
    assert encounter_of(narrow).shows.sum() < encounter_of(plan()).shows.sum()


def test_where_the_arrival_alone_counts_each_shows_something_in_its_own_arrival_alone():
    flights = "design.observers=[{time_of_flight_s: 600}, {time_of_flight_s: 640}, {}, {}, {}]"
    encounter = encounter_of(plan("observation.criterion=arrival", flights))
    assert encounter.slot_s.tolist() == [600.0, 640.0]
    useful = encounter.shows.any(axis=(1, 3))
    assert not useful[1, 0] and useful[1, 1] and not useful[[0, 2, 3, 4], 1].any()
