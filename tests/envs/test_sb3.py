"""The VecEnv of stable-baselines3: its conventions, and the same flights as everywhere else."""

import gymnasium
import numpy as np
import pytest

pytest.importorskip("stable_baselines3")
from stable_baselines3.common.env_util import make_vec_env  # noqa: E402
from stable_baselines3.common.monitor import Monitor  # noqa: E402
from stable_baselines3.common.vec_env import VecNormalize  # noqa: E402
from swarm_mj.envs.training.sb3 import (  # noqa: E402
    SwarmObserveSharedVecEnv,
    SwarmObserveVecEnv,
    SwarmPointingVecEnv,
)

from swarm_mj.errors import ScenarioError  # noqa: E402

#: Two missions that are quickly worked out, in decisions of a minute.
GIVEN = {
    "missions": ["bennu-train-1", "ellipsoid-train-1"],
    "decision_s": 60.0,
    "observation": "flat",
    "randomise": {"spacecraft": 3, "loss": 0},
}
STEPS = 10


@pytest.fixture(scope="module")
def venv():
    venv = SwarmObserveVecEnv(3, threads=1, **GIVEN)
    yield venv
    venv.close()


@pytest.fixture(scope="module")
def episode(venv):
    """Every step of three flights and one step beyond, with random actions: (actions, start, answers)."""
    venv.seed(5)
    start = venv.reset()
    actions = np.random.default_rng(0).integers(0, 20, (STEPS + 1, 3, 3))
    return actions, start, [venv.step(action) for action in actions]


def test_it_does_what_stable_baselines3s_own_wrapper_of_single_environments_does(episode):
    actions, start, answers = episode
    theirs = make_vec_env("swarm_mj.envs:SwarmObserve-v0", n_envs=3, seed=5, env_kwargs=GIVEN)
    assert np.array_equal(theirs.reset(), start)
    for action, (observations, rewards, dones, infos) in zip(actions, answers, strict=True):
        expected = theirs.step(action)
        assert np.array_equal(observations, expected[0])
        assert rewards.dtype == expected[1].dtype and np.array_equal(rewards, expected[1])
        assert np.array_equal(dones, expected[2])
        for own, other in zip(infos, expected[3], strict=True):
            assert own.keys() - {"TimeLimit.truncated"} == other.keys() - {"TimeLimit.truncated"}
            assert own.get("TimeLimit.truncated", False) == other.get("TimeLimit.truncated", False)
            assert own["reward_terms"] == other["reward_terms"]
            assert own["time_s"] == other["time_s"] and own["stored_bit"] == other["stored_bit"]
            if "episode" in own:
                assert own["episode"]["r"] == pytest.approx(other["episode"]["r"], abs=1e-5)
                assert own["episode"]["l"] == other["episode"]["l"] == STEPS
                assert np.array_equal(own["terminal_observation"], other["terminal_observation"])
    theirs.close()


def test_a_flight_that_ends_starts_anew_at_once(episode):
    _, _, answers = episode
    observations, _, dones, infos = answers[STEPS - 1]
    assert dones.all()
    for e in range(3):
        assert infos[e]["TimeLimit.truncated"]
        assert infos[e]["time_s"] == 600.0
        assert not np.array_equal(infos[e]["terminal_observation"], observations[e])
    assert answers[STEPS][3][0]["time_s"] == 60.0


def test_seeds_repeat_flights_and_count_for_one_reset_only(venv, episode):
    _, start, _ = episode
    venv.seed(5)
    assert np.array_equal(venv.reset(), start)
    assert not np.array_equal(venv.reset(), start)


def test_flights_can_be_broken_off(venv):
    venv.reset()
    venv.step(np.zeros((3, 3), np.int64))
    observations = venv.restart(np.array([False, True, False]))
    *_, infos = venv.step(np.zeros((3, 3), np.int64))
    assert [info["time_s"] for info in infos] == [120.0, 60.0, 120.0]
    assert observations.shape == (3, *venv.observation_space.shape)
    assert venv.reset_infos[1]["flight_seed"] >= 0


def test_attributes_and_methods_reach_the_vector_environment(venv):
    assert venv.get_attr("num_envs", [0, 2]) == [3, 3]
    assert venv.get_attr("render_mode") == [None] * 3
    assert len(venv.env_method("reset", indices=[1])) == 1
    venv.set_attr("mark", 7)
    assert venv.get_attr("mark") == [7] * 3
    with pytest.raises(ScenarioError, match="indices"):
        venv.set_attr("mark", 7, [1])
    assert venv.env_is_wrapped(Monitor) == [True] * 3
    assert venv.env_is_wrapped(gymnasium.wrappers.TimeLimit) == [False] * 3
    venv.set_options({"flight_seed": 1})
    with pytest.raises(ScenarioError, match="options"):
        venv.reset()
    venv.set_options()


def test_a_wrapper_of_stable_baselines3_takes_it():
    venv = VecNormalize(SwarmObserveVecEnv(2, threads=1, **GIVEN))
    venv.reset()
    observations, rewards, dones, _ = venv.step(np.zeros((2, 3), np.int64))
    assert np.isfinite(observations).all() and rewards.shape == dones.shape == (2,)
    venv.close()


def test_pointing_ends_and_starts_as_stable_baselines3_expects():
    env = SwarmPointingVecEnv(3, observation="camera", holds=1, hold_s=5.0)
    env.seed(4)
    first = env.reset()
    assert first["image"].shape == (3, 3, 64, 64) and env.observation_space.contains(
        {k: v[0] for k, v in first.items()}
    )
    total = np.zeros(3)
    for k in range(10):
        observations, rewards, done, infos = env.step(np.zeros((3, 3), np.float32))
        total += rewards
        assert done.all() == (k == 9)
    assert infos[1]["TimeLimit.truncated"] and infos[1]["terminal_observation"]["state"][-1] == 0.0
    assert infos[1]["episode"]["l"] == 10 and infos[1]["episode"]["r"] == pytest.approx(total[1], rel=1e-5)
    assert (observations["state"][:, -1] == 1.0).all()
    env.close()


@pytest.mark.parametrize("shared", [False, True])
def test_masks_of_every_episode_are_those_that_maskable_ppo_asks_for(shared):
    made = SwarmObserveSharedVecEnv if shared else SwarmObserveVecEnv
    venv = made(2, missions=["ellipsoid-train-1"])
    venv.seed(4)
    venv.reset()
    _, _, _, infos = venv.step(np.full((6,) if shared else (2, 3), 16))
    wanted = [info["action_mask"] for info in infos]
    if shared:
        wanted = [mask[k % 3] for k, mask in enumerate(wanted)]
    assert venv.has_attr("action_masks") and np.array_equal(np.stack(venv.env_method("action_masks")), np.stack(wanted))
    assert np.array_equal(venv.env_method("action_masks", indices=1), [wanted[1]]) and not np.array_equal(*wanted[:2])
    venv.close()


def test_a_shared_policy_cannot_be_shown_something_else():
    with pytest.raises(ScenarioError, match="observation = 'entities': each spacecraft is shown .*; leave it out"):
        SwarmObserveSharedVecEnv(1, missions=["ellipsoid-train-1"], observation="entities")


def test_each_spacecraft_is_an_environment_and_all_of_an_episode_share_rewards_and_ends():
    """Against the agents of PettingZoo's environment, which are shown the same in flights of the same seeds."""
    from swarm_mj.envs.observe.parallel import SwarmObserveParallelEnv

    loss = {"distribution": "bernoulli", "probability": 0.3}
    given = {"missions": ["ellipsoid-train-1"], "candidates": 3, "randomise": {"camera_off": 0.0, "loss": loss}}
    venv = SwarmObserveSharedVecEnv(2, threads=1, **given)
    venv.seed(4)
    rows, seeds = venv.reset(), [info["flight_seed"] for info in venv.reset_infos[:: venv.num_envs // 2]]
    teams = [SwarmObserveParallelEnv(observation="flat", **given) for _ in seeds]
    told = [team.reset(options={"flight_seed": seed})[0] for team, seed in zip(teams, seeds, strict=True)]
    n, rng = venv.num_envs // 2, np.random.default_rng(0)
    assert n == 3 and rows.shape == (6, *venv.observation_space.shape)
    for step in range(30):
        actions = rng.integers(0, 4, 6)
        rows, rewards, dones, infos = venv.step(actions)
        assert dones.tolist() == [step == 29] * 6
        if step == 29:
            rows = np.array([info["terminal_observation"] for info in infos])
        for e, team in enumerate(teams):
            if not team.agents:
                continue
            flew = [team.possible_agents.index(agent) for agent in team.agents]
            answers = team.step({team.possible_agents[j]: actions[n * e + j] for j in flew})
            for j in flew:
                agent = team.possible_agents[j]
                assert rewards[n * e + j] == np.float32(answers[1][agent])
                if agent in team.agents or step == 29:
                    assert np.array_equal(rows[n * e + j], answers[0][agent])
    assert len(set(rewards.tolist())) <= 2 and all(info["episode"]["l"] == 30 for info in infos)
    assert told[0].keys() and venv.get_attr("render_mode") == [None] * 6 and venv.env_is_wrapped(Monitor) == [True] * 6
    venv.close()
    for team in teams:
        team.close()
