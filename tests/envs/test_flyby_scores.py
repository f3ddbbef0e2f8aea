"""Scores of SwarmObserve-v0: frozen test seeds, files, refusals by name across the environments, the command."""

import json

import pytest
from swarm_mj.envs.missions.config import MissionConfig
from swarm_mj.envs.missions.policies import open_policy
from swarm_mj.envs.observe.single import SwarmObserveEnv
from swarm_mj.envs.policies import flyby_scores
from swarm_mj.envs.policies.baselines import POLICIES, fly
from swarm_mj.envs.policies.flyby_scores import TEST_SEEDS, FlybyTest
from swarm_mj.envs.policies.policy_behavior import PACKAGED
from swarm_mj.envs.policies.policy_network import save_network

from swarm_mj.cli.main import main
from swarm_mj.errors import ScenarioError
from swarm_mj.io.resources import asset_path

from .test_policy_network import random_policy


def test_seeds_are_frozen_and_the_first_so_many_are_taken():
    assert TEST_SEEDS == tuple(range(5_000, 5_100))
    with FlybyTest(3) as test:
        assert test.seeds == (5_000, 5_001, 5_002)


def test_a_score_is_the_mean_return_of_single_environments():
    with FlybyTest(2) as test:
        found = test.score("target_centre")
    env = SwarmObserveEnv()
    alone = [fly(env, POLICIES["target centre"], seed).total_reward for seed in found.seeds]
    env.close()
    assert found.flown.total == pytest.approx(alone, abs=1e-12)
    assert found.record()["score"] == pytest.approx(sum(alone) / 2)


def test_the_command_says_environment_and_writes_all_numbers(tmp_path, capsys):
    out = tmp_path / "out.json"
    asked = [
        "score",
        "--env",
        "SwarmObserve-v0",
        "trained",
        "body_centre",
        "--episodes",
        "2",
        "--quiet",
        "--out",
        str(out),
    ]
    assert main(asked) == 0
    assert "SwarmObserve-v0, 2 test episodes" in capsys.readouterr().out
    trained, centre = json.loads(out.read_text())
    assert trained["environment"] == "SwarmObserve-v0" and trained["score"] > centre["score"] + 0.5


def test_policies_of_the_other_environment_are_refused_by_name(tmp_path):
    file = tmp_path / "policy.npz"
    save_network(file, random_policy(environment="SwarmObserve-v1"))
    with (
        FlybyTest(2) as test,
        pytest.raises(ScenarioError, match="trained for environment = 'SwarmObserve-v1', but it is"),
    ):
        test.policy(file)
    # Files of before 0.2 do not tell; they knew one environment only.
    with pytest.raises(ScenarioError, match="trained for environment = 'SwarmObserve-v0'.*--env SwarmObserve-v0"):
        open_policy(asset_path(PACKAGED), MissionConfig())


def test_what_cannot_be_flown_is_refused_before_it_is(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(flyby_scores, "fly_seeds", lambda *_: pytest.fail("flown already"))
    (tmp_path / "policy.zip").write_bytes(b"")
    for given, words in (
        (["planner"], "policy 'planner': no such file, and no name; names are trained, body_centre"),
        ([str(tmp_path / "policy.zip")], "must be an .npz of examples/train_sb3.py to be flown in SwarmObserve-v0"),
        (["greedy", "--episodes", "101"], "episodes = 101: must be from 2 to 100"),
    ):
        assert main(["score", "--env", "SwarmObserve-v0", *given, "--quiet"]) == 2
        assert words in capsys.readouterr().err
