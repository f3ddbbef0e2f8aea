"""An allocation flown in thought: pictures pointed as allocated show by the criterion what the problem says."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import swarm_mj as sm
from swarm_mj.coordination.allocation.greedy import greedy
from swarm_mj.errors import MissionError
from swarm_mj.flight.encounter import EncounterSettings, encounter_of, track_of
from swarm_mj.flight.observe import camera_from, criterion_from
from swarm_mj.flight.plan import make_plan
from swarm_mj.mission.trajectories import propagate
from swarm_mj.observation.camera import look_at
from swarm_mj.observation.capture import observe
from swarm_mj.observation.observer import make_observer


@cache
def plan():
    return make_plan(sm.load("eros-observe"), check_separation=False)


def test_the_track_is_that_of_the_plan():
    times = np.array([0.0, 300.0, 600.0])
    track, deployment = track_of(plan(), times), plan().deployment
    starts = np.broadcast_to(deployment.r0_N, deployment.v0_N.shape)
    r_N, _ = propagate(plan().environment.acceleration_N, starts, deployment.v0_N, times)
    np.testing.assert_allclose(np.einsum("kji,knj->kni", track.C_AN, track.r_A), r_N, atol=1e-3)
    np.testing.assert_allclose(track.r_A[2], plan().points_A[: plan().n], atol=1.0)  # visits at 600 s
    ahead = track_of(plan(), times + 0.5).r_A - track_of(plan(), np.maximum(times - 0.5, 0.0)).r_A
    np.testing.assert_allclose(track.v_A[1:], ahead[1:], rtol=1e-4)


def test_pictures_as_allocated_show_what_the_problem_says():
    times = np.arange(480.0, 721.0, 30.0)
    encounter = encounter_of(plan(), times, EncounterSettings(budget=3))
    found = greedy(encounter.problem)
    assert 0.3 < found.value / plan().region.total_area < 1.0 and (encounter.problem.slew >= 1).all()
    track, camera = track_of(plan(), times), camera_from(plan().scenario)
    observer = make_observer(plan().region, replace(camera, shape="cone"), kind="raycast")
    seen = np.zeros(plan().region.n_cells, bool)
    for agent, taken in enumerate(found.pictures):
        for slot, aim in taken:
            pose = look_at(track.r_A[slot, agent], encounter.patches.aim_A[aim], roll=0.7)
            seen |= observe(observer, pose.r_A, pose.C_CA, criterion_from(plan().scenario), track.sun_A[slot])
    assert plan().region.area[seen].sum() == pytest.approx(found.value, rel=0.02)  # another observer, another angle


def test_slots_that_are_not_even_are_refused():
    for times in ([0.0], [0.0, 1.0, 3.0], [-1.0, 0.0], [1.0, 0.0]):
        with pytest.raises(MissionError, match="times"):
            encounter_of(plan(), np.array(times), EncounterSettings(budget=1))
