"""When pictures are taken, the data that they bring, and what horizon maps see against face-ID buffers."""

from dataclasses import replace

import gymnasium
import numpy as np
import pytest
from swarm_mj.envs.policies.baselines import POLICIES

from swarm_mj.flight.fly import simulate
from swarm_mj.flight.observe import observe_flight
from swarm_mj.flight.plan import make_plan
from swarm_mj.mission.behaviors import TargetKind
from swarm_mj.scenarios.loading import load_scenario

from .flights import BOTH, CENTRE, HOLD, ID, PIXEL, LookAt, fly

SEED = 12
SEEN = ["observation.observer=horizon", f"seed={SEED}"]


@BOTH
@pytest.mark.parametrize("observer", ["horizon", "raycast"])
def test_a_picture_adds_the_imaged_area_over_the_foreshortened_ground_sampling_distance(begin, kind, observer):
    flights = begin(kind, observer=observer, bits_per_pixel=2.5)
    region, plan = flights.plan.region, flights.plan
    corners = region.vertices[region.faces[region.target]]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area, centre = 0.5 * np.linalg.norm(across, axis=1), corners.mean(axis=1)
    normal = across / np.linalg.norm(across, axis=1)[:, None]
    nominal = 2.5 * area.sum() / (14_000.0 * PIXEL) ** 2
    expected, before = np.zeros(flights.count), flights.gather(lambda batch: batch.totals.seen)
    for k in range(70):
        r_A = np.einsum("ij,ej->ei", plan.environment.C_AN(10.0 * k), flights.r_N[:, 0])  # when the picture is taken
        observations, _, infos = flights.step(np.array([5 + k // 35, HOLD, HOLD, HOLD, HOLD]))
        now = flights.gather(lambda batch: batch.totals.seen)
        for e, new in enumerate(now & ~before):
            way = r_A[e] - centre[new]
            distance = np.linalg.norm(way, axis=1)
            cosine = (way * normal[new]).sum(axis=1) / distance
            expected[e] += 2.5 * (area[new] * cosine / (PIXEL * distance) ** 2).sum()
        before = now
        stored = np.atleast_2d(infos["stored_bit"])
        assert stored[:, 0] == pytest.approx(expected, rel=1e-9)
        assert (stored[:, 1:] == 0.0).all()
        assert np.atleast_1d(infos["seen_bit"]) == pytest.approx(expected, rel=1e-9)
        assert flights.parts(observations)["stored"][:, 0, 0] == pytest.approx(expected / nominal, rel=1e-6)
    assert (expected > 0.005 * nominal).all()


def test_the_visit_criterion_counts_only_the_instant_of_the_visit():
    scenario = load_scenario("eros-observe", ["observation.criterion=visit", *SEEN])
    env = gymnasium.make(ID, scenario=scenario).unwrapped
    infos = fly(env, np.full(5, CENTRE), SEED)
    gains = {i["time_s"] for i in infos if i["reward_terms"]["seen"] > 0}
    assert gains == {610.0}  # the step that begins at the visit, 600 s
    plan = replace(make_plan(scenario), behavior=LookAt(TargetKind.ASTEROID))
    result = observe_flight(plan, simulate(plan))
    assert infos[-1]["coverage_percent"] == result.coverage.percent
    assert result.coverage.percent < result.passage.percent
    env.close()


def test_the_last_pictures_of_a_flight_count():
    # The flight ends at the visit, so that the pictures of the last instant, and only these, are taken.
    scenario = load_scenario("eros-observe", ["duration_s=600", "observation.criterion=visit", *SEEN])
    env = gymnasium.make(ID, scenario=scenario).unwrapped
    infos = fly(env, np.full(5, CENTRE), SEED)
    plan = replace(make_plan(scenario), behavior=LookAt(TargetKind.ASTEROID))
    result = observe_flight(plan, simulate(plan))
    assert infos[-1]["coverage_percent"] == result.coverage.percent > 5.0
    assert infos[-1]["reward_terms"]["seen"] == pytest.approx(result.coverage.percent / 100.0)
    env.close()


@pytest.mark.gl
@pytest.mark.usefixtures("gl")
def test_horizon_maps_and_rays_see_what_face_id_buffers_see_within_a_percent_of_the_target():
    shares = []
    for kind in ("faceid", "horizon", "raycast"):
        env = gymnasium.make(ID, observer=kind)
        env.reset(seed=0)
        for _ in range(75):
            info = env.step(np.full(5, CENTRE))[-1]
        shares.append(info["coverage_percent"])
        env.close()
    assert shares[1:] == pytest.approx([shares[0]] * 2, abs=1.0)
    assert shares[0] > 10.0


def seen_share(observer, seed, given=None):
    """Seen share of the target at the end [%], and the actions flown: greedy ones, unless given."""
    env = gymnasium.make(ID, observer=observer).unwrapped
    observation, _ = env.reset(seed=seed)
    actions, over = [], False
    while not over:
        actions.append(POLICIES["greedy"](env.task, observation) if given is None else given[len(actions)])
        observation, _, *ends, info = env.step(actions[-1])
        over = any(ends)
    env.close()
    return info["coverage_percent"], actions


def test_horizon_maps_see_what_face_id_buffers_see_within_a_percent_without_bias():
    """Greedy flights cut many cells at the border of the picture, where half a cell decides."""
    errors = []
    for seed in range(1, 7):
        by_maps, actions = seen_share("horizon", seed)
        by_pixels, _ = seen_share("raster", seed, actions)
        assert by_pixels > 70.0
        errors.append(by_maps - by_pixels)
    assert np.abs(errors).max() < 1.0
    assert np.mean(errors) == pytest.approx(0.0, abs=0.35)
