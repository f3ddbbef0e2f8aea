"""The planner of SwarmObserve-v0: what it expects of pictures, what it may do, what it knows, and that it pays."""

import numpy as np
import pytest
from swarm_mj.envs.policies.baselines import greedy as scripted_greedy
from swarm_mj.envs.policies.leaderboard import FrozenEpisodes
from swarm_mj.envs.policies.planner import NEAR, Planner, count_pixels, pictures_to_come, problem_of, turn_toward

from swarm_mj.coordination.allocation.greedy import greedy
from swarm_mj.observation.camera import look_at
from swarm_mj.observation.capture import keeps_limits, limits_of, pixels_on, sight
from tests.coordination.allocation.cases import can_be_taken

from .test_leaderboard import ONE

SEEDS = (20_000, 20_001, 20_003, 20_007)


@pytest.fixture(scope="module")
def test():
    """Four episodes of one mission."""
    with FrozenEpisodes(SEEDS, **ONE) as made:
        made.episodes.reset(dict(enumerate(SEEDS)))
        yield made


def test_a_turn_is_the_shortest_that_ends_on_the_aim():
    rng = np.random.default_rng(0)
    for _ in range(20):
        C, _ = np.linalg.qr(rng.normal(size=(3, 3)))
        aim = rng.normal(size=3)
        aim /= np.linalg.norm(aim)
        out = np.empty((3, 3))
        turn_toward(C, aim, out)
        assert out @ out.T == pytest.approx(np.eye(3), abs=1e-9) and out[2] == pytest.approx(aim, abs=1e-9)
        # The angle of the turn is that between the lines of sight: none is shorter.
        assert 0.5 * (np.trace(out @ C.T) - 1.0) == pytest.approx(C[2] @ aim, abs=1e-9)


def test_what_pictures_would_show_is_what_the_observer_sees_of_them(test):
    mission = test.episodes.mission_of(0)
    region = mission.plan.region
    place = mission.centre_A + mission.altitude_m * mission.axes_A[2]
    start, aims = look_at(place, mission.centre_A, roll=0.3).C_CA, mission.patches.centre_A
    pixels = np.zeros((2, 1, len(aims), region.n_cells), np.float32)
    places, cameras = np.tile(place, (1, 2, 1)), np.tile(start, (2, 1, 1))
    count_pixels(mission.scene, places, cameras, aims, np.array([True, False]), np.ones(region.n_cells, bool), pixels)
    limits = limits_of(mission.criterion, mission.observer.camera, mission.plan.region)
    distance, height = sight(region, place)
    for k, aim in enumerate(aims):
        C_CA = np.empty((3, 3))
        turn_toward(start, (aim - place) / np.linalg.norm(aim - place), C_CA)
        share = mission.observer.visible_fraction(place, C_CA)
        counts = (share >= mission.criterion.min_fraction) & keeps_limits(limits, distance, height)
        assert pixels[0, 0, k] == pytest.approx(counts * pixels_on(limits, region.area, distance, height), rel=1e-6)
    assert pixels[0].any() and not pixels[1].any()


def test_plans_keep_what_can_be_done_and_weigh_what_the_score_does(test):
    test.episodes.reset(dict(enumerate(SEEDS)))
    for e in range(len(SEEDS)):
        episodes, mission = test.episodes, test.episodes.mission_of(e)
        problem = problem_of(episodes, e, 0)
        plan = greedy(problem)
        assert can_be_taken(problem, plan.pictures)
        assert plan.value > 0.0
        # Seen and wholly sent from nearby, a cell brings its area over the yardstick, and its data over their volume.
        pixels = pictures_to_come(episodes, e, 0).pixels.max(axis=(0, 1, 2))
        some = np.flatnonzero(pixels)
        cells, yardstick = len(some), episodes.sheet.yardstick_area[e]
        volume = mission.nominal_bit * yardstick / mission.plan.region.total_area
        data = NEAR * pixels[some] * mission.bits_per_pixel / volume
        whole = mission.patches.cell_area[some] / yardstick + data
        assert problem.weight[:cells] + problem.weight[cells:] == pytest.approx(whole, rel=1e-5)
        assert not problem.shows[~episodes.sheet.present[e]].any()
        assert (problem.shows[..., :cells] | ~problem.shows[..., cells:]).all()  # near pictures are pictures


def test_the_planner_beats_the_greedy_rule_and_stays_below_the_bound(test):
    planner = Planner(test.episodes, prove_s=0.2)
    flown, rule = test.fly(planner), test.fly(scripted_greedy)
    assert flown.score.mean() > rule.score.mean() + 0.05
    assert (flown.seen <= test.bound.seen + 1e-9).all() and (flown.delivered <= test.bound.delivered + 1e-9).all()
    assert len(planner.first) == len(SEEDS) and all(plan.value <= plan.bound + 1e-9 for plan in planner.first)


def test_the_planner_does_not_know_what_will_fail(test):
    """Episodes that are alike until a camera fails get the same choices until then."""
    taken = []
    for fails in (0.0, 1.0):
        test.episodes.reset({0: 20_000, 1: 20_001, 2: 20_003, 3: 20_007}, {"camera_off": fails, "camera_off_time": 0.5})
        planner, chosen = Planner(test.episodes), []
        for _ in range(14):
            chosen.append(planner({}))
            test.episodes.step(chosen[-1], np.ones(4, bool))
        taken.append(np.array(chosen))
    assert np.array_equal(*taken)
