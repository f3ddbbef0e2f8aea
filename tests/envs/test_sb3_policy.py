"""The network in torch against the policy in NumPy, and what a learner sees of the environment."""

import numpy as np
import pytest

torch = pytest.importorskip("torch")
pytest.importorskip("stable_baselines3")
from stable_baselines3 import PPO  # noqa: E402
from swarm_mj.envs.policies.policy import load_policy, save_policy  # noqa: E402
from swarm_mj.envs.training.sb3 import SwarmObserveVecEnv  # noqa: E402
from swarm_mj.envs.training.sb3_policy import SwarmActorCritic, VecPolicyFeatures, to_array_policy  # noqa: E402


def test_the_network_in_torch_and_the_policy_in_numpy_give_the_same_logits(tmp_path):
    venv = SwarmObserveVecEnv(2, threads=1)
    view = VecPolicyFeatures(venv, 0.99)
    model = PPO(SwarmActorCritic, view, n_steps=8, batch_size=8, seed=1, device="cpu")
    with torch.no_grad():
        for weights in model.policy.parameters():
            weights.add_(0.1 * torch.randn_like(weights))
    save_policy(tmp_path / "p.npz", to_array_policy(model.policy, venv, view.geometry, note="a test"))
    policy = load_policy(tmp_path / "p.npz")
    features = view.reset()
    with torch.no_grad():
        expected = model.policy.mlp_extractor.forward_actor(torch.as_tensor(features)).numpy()
    logits = policy.logits(features.astype(np.float64))
    assert np.ptp(expected) > 0.1
    assert np.allclose(logits.reshape(2, -1), expected, atol=1e-4)
    action, _ = model.predict(features, deterministic=True)
    assert np.array_equal(action, logits.argmax(axis=2))
    venv.close()


def test_shaping_changes_the_return_of_an_episode_by_nothing_but_the_discount():
    venv = SwarmObserveVecEnv(2, threads=1)
    view = VecPolicyFeatures(venv, 1.0)
    view.seed(3)
    view.reset()
    total, done = np.zeros(2), np.zeros(2, bool)
    while not done.all():
        centre = np.full((2, 5), 16)
        _, rewards, done, infos = view.step(centre)
        total += rewards
    # Pictures were taken, nothing was sent: with no discount the shaping adds up to zero.
    assert sum(infos[0]["stored_bit"]) > 0.0 and infos[0]["delivered_bit"] == 0.0
    assert np.allclose(total, [info["episode"]["r"] for info in infos], atol=1e-5)
    assert infos[0]["terminal_observation"].shape == view.observation_space.shape
    venv.close()


def test_a_flight_broken_off_counts_its_data_as_delivered():
    venv = SwarmObserveVecEnv(2, threads=1)
    view = VecPolicyFeatures(venv, 1.0)
    view.horizon_s = 600.0
    view.seed(3)
    view.reset()
    total, done, steps = np.zeros(2), np.zeros(2, bool), 0
    while not done.all():
        _, rewards, done, infos = view.step(np.full((2, 5), 16))
        total, steps = total + rewards, steps + 1
    nominal = venv.vector.batch.task.nominal_bit
    assert steps == 60
    for e in range(2):
        aboard = sum(infos[e]["stored_bit"]) / nominal
        assert aboard > 0.0
        seen = infos[e]["coverage_percent"] / 100.0
        assert total[e] == pytest.approx(seen + aboard, abs=1e-3)
        assert infos[e]["episode"]["r"] == pytest.approx(total[e], abs=1e-5)
    venv.close()
