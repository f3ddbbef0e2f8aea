"""SwarmObserve-v1: episodes that differ, each a function of its seed alone, and where feedback pays."""

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from pettingzoo.test import parallel_api_test
from swarm_mj.envs.missions.baselines import fly, greedy, sweep
from swarm_mj.envs.missions.catalogue import CATALOGUE, mission_names
from swarm_mj.envs.missions.config import MissionConfig
from swarm_mj.envs.missions.draws import NAMES
from swarm_mj.envs.missions.episodes import Episodes
from swarm_mj.envs.missions.multi_agent import swarm_observe_v1

from swarm_mj.errors import ScenarioError

ID = "swarm_mj.envs:SwarmObserve-v1"
#: Two that are cheap to work out.
POOL = ["bennu-train-1", "ellipsoid-train-1"]


@pytest.fixture(scope="module")
def single():
    env = gymnasium.make(ID, missions=POOL).unwrapped
    yield env
    env.close()


@pytest.fixture(scope="module")
def episodes():
    flown = Episodes(MissionConfig(missions=POOL), 25)
    yield flown
    flown.close()


@pytest.mark.parametrize("observation", ["flat", "entities"])
def test_it_is_an_environment_of_gymnasium_and_pettingzoo(observation):
    env = gymnasium.make(ID, missions=POOL[:1], observation=observation)
    check_env(env.unwrapped, skip_render_check=True)
    env.close()
    agents = swarm_observe_v1.parallel_env(missions=POOL[:1], observation=observation, randomise={"spacecraft": 4})
    parallel_api_test(agents, num_cycles=40)
    agents.close()


def test_an_episode_is_a_function_of_its_seed_whatever_flies_beside_it(single):
    vector = gymnasium.make_vec(ID, num_envs=5, missions=POOL, threads=2)
    agents = swarm_observe_v1.parallel_env(missions=POOL)
    rows, _ = vector.reset(seed=3)
    alone, told = single.reset(seed=5)
    agents.reset(options={"flight_seed": told["flight_seed"]})
    rng = np.random.default_rng(0)
    for _ in range(12):
        actions = rng.integers(0, 21, (5, 4))
        rows, rewards, *_ = vector.step(actions)
        alone, reward, *_ = single.step(actions[2])
        _, rewards_by_agent, *_ = agents.step({a: actions[2][int(a[2:]) - 1] for a in agents.agents})
        assert np.array_equal(rows[2], alone)
        assert rewards[2] == reward
        assert set(rewards_by_agent.values()) == {reward}
        assert np.array_equal(agents.state(), alone)
    vector.close()
    agents.close()


def test_feedback_beats_a_list_of_choices_by_three_tenths(episodes):
    seeds = range(5000, 5050)
    assert fly(episodes, greedy, seeds).score.mean() - fly(episodes, sweep, seeds).score.mean() > 0.3


def test_places_of_test_are_never_part_of_those_of_training():
    for one in map(CATALOGUE.get, mission_names("train")):
        for other in map(CATALOGUE.get, mission_names("test")):
            a, b = (np.radians([s.latitude_deg, s.longitude_deg]) for s in (one, other))
            cosine = np.sin(a[0]) * np.sin(b[0]) + np.cos(a[0]) * np.cos(b[0]) * np.cos(a[1] - b[1])
            assert np.degrees(np.arccos(cosine)) > 2.0 * 34.0


@pytest.mark.parametrize(
    ("where", "given", "told"),
    [
        ("randomise", {"sped": 1.0}, "sped"),
        ("randomise", {"speed": {"distribution": "uniform", "low": 2.0, "high": 1.0}}, "speed"),
        ("randomise", {"speed": 9.0}, "speed = 9.0: must lie between 0.5 and 2"),
        ("missions", "eros-test-1", "is one of split = 'test'"),
        ("missions", 99, "missions = 99: must be from 1 to 40"),
        ("decision_s", 21, "decision_s = 21"),
        ("patches", 5, "patches = 5"),
    ],
)
def test_what_is_not_allowed_is_refused_by_name(where, given, told):
    with pytest.raises(ScenarioError, match=told.replace("(", r"\(")):
        env = gymnasium.make(ID, **({"missions": POOL} | {where: given}))
        env.reset(seed=0)


def test_a_given_value_changes_nothing_else_that_is_drawn(single):
    single.reset(seed=1, options={"flight_seed": 7})
    drawn = single.episodes.draws[0]
    single.reset(seed=1, options={"flight_seed": 7, "draw": {"speed": 1.25}})
    given = single.episodes.draws[0]
    assert given.speed == 1.25
    for name in set(drawn._fields) - {"speed"}:
        assert np.array_equal(getattr(drawn, name), getattr(given, name)), name
    with pytest.raises(ScenarioError, match=f"there are {', '.join(NAMES)}"):
        single.reset(options={"draw": {"weather": 1.0}})


def test_what_fails_shows_in_the_observation_and_in_the_mask(single):
    off = {"spacecraft": 3, "loss": [1, 0, 0, 0], "loss_time": 0.1, "camera_off": [0, 1, 0, 0], "camera_off_time": 0.1}
    off |= {"downlink_off": [0, 0, 1, 0], "downlink_off_time": 0.1}
    single.reset(seed=1, options={"draw": off})
    for _ in range(4):
        observation, *_, info = single.step(np.array([20, 20, 20, 20]))
    table = single.episodes.layout.split(observation)["spacecraft"][0]
    assert table[:, :3].tolist() == [[0, 0, 0], [1, 0, 1], [1, 1, 0], [0, 0, 0]]
    assert info["alive"] == [False, True, True, False]
    mask = info["action_mask"]
    assert mask[0].tolist() == [0] * 17 + [1, 0, 0, 0]
    assert not mask[1, :16].any()
    assert not mask[2, 16]
