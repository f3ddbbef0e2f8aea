"""The programs of examples/learning: their equations, and that each trains, keeps a curve and writes a policy that flies."""

import csv
import json
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

torch = pytest.importorskip("torch")
from swarm_mj.envs.observe.tables import GENERAL, PAIRS, PATCHES, SPACECRAFT  # noqa: E402
from swarm_mj.envs.policies import leaderboard  # noqa: E402

sys.path.insert(0, str(Path(__file__).parents[2] / "examples" / "learning"))
import common  # noqa: E402
import mappo  # noqa: E402
import ppo  # noqa: E402

try:
    import sb3_ppo
except ImportError:
    sb3_ppo = None

sys.path.pop(0)


@pytest.fixture
def small(monkeypatch):
    """One mission of each split, and two episodes to validate on."""
    monkeypatch.setattr(leaderboard, "TEST", {"split": "test", "missions": ["ellipsoid-test-1"]})
    for module in (common, ppo, *([sb3_ppo] if sb3_ppo else [])):
        monkeypatch.setattr(module, "TRAINING", {"split": "train", "missions": ["ellipsoid-train-1"]})
    monkeypatch.setattr(common, "VALIDATION_SEEDS", (30_000, 30_001))


def test_advantages_are_the_weighted_sums_of_their_definition():
    gamma, gae_lambda, rng = 0.9, 0.8, np.random.default_rng(0)
    rollout = ppo.Rollout(6, 1, 1, (1, 2))
    reward, value = rng.normal(size=6), rng.normal(size=7)
    ended = np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
    for name, part in (("reward", reward), ("value", value[:6]), ("ended", ended)):
        getattr(rollout, name)[:, 0] = torch.as_tensor(part)
    found = rollout.advantages(torch.tensor([value[6]], dtype=torch.float32), gamma, gae_lambda)[:, 0]
    for t in range(6):
        total, weight = 0.0, 1.0
        for s in range(t, 6):
            total += weight * (reward[s] + gamma * (1.0 - ended[s]) * value[s + 1] - value[s])
            weight *= gamma * gae_lambda * (1.0 - ended[s])
        assert float(found[t]) == pytest.approx(total, abs=1e-5)


@pytest.mark.parametrize("kind", [ppo.Agent, mappo.Team])
def test_choices_that_are_ruled_out_are_never_drawn_and_what_pays_is_learnt(kind):
    """Two spacecraft and two patches: they are paid for talking to Earth, choice 1 of the second is ruled out."""
    torch.manual_seed(0)
    torch.set_num_threads(1)
    widths = {"spacecraft": (2, len(SPACECRAFT)), "pairs": (2, 2, len(PAIRS)), "patches": (2, len(PATCHES))}
    shapes = widths | {"general": (len(GENERAL),)}
    observed = {name: np.ones((1, *shape), np.float32) for name, shape in shapes.items()}
    agent = kind(SimpleNamespace(entities=lambda: observed), 16)
    row = torch.as_tensor(agent.shown(observed))
    mask = torch.ones(1, 2, 5, dtype=torch.bool)
    mask[0, 1, 1] = False
    optimizer = torch.optim.Adam(agent.parameters(), lr=3e-2)
    for _ in range(12):
        rollout = ppo.Rollout(64, 1, row.shape[1], (2, 5))
        rollout.seen[:], rollout.mask[:] = row, mask
        chosen = agent.choose(rollout.seen, rollout.mask)
        rollout.choice = chosen.sample()
        rollout.chance = chosen.log_prob(rollout.choice).detach()
        rollout.reward = (rollout.choice == 2).float().mean(dim=-1)
        rollout.ended[:] = 1.0
        assert (rollout.choice[..., 1] != 1).all()
        ppo.update(agent, optimizer, rollout, rollout.advantages(torch.zeros(1), 0.9, 0.9), ppo.Settings(minibatches=2))
    assert float(agent.choose(row, mask).probs[0, 0, 2].detach()) > 0.8


@pytest.mark.parametrize(("name", "kind"), [("ppo", ppo.Agent), ("mappo", mappo.Team)])
def test_a_program_keeps_its_curve_and_a_policy_that_flies_as_the_network_did(name, kind, small, tmp_path):
    use = ppo.Settings(num_envs=2, horizon=4, epochs=1, minibatches=1, hidden=8)
    given = common.Options(out=tmp_path, steps=16, seed=1, every=8)
    ppo.train(given, use, kind)
    with (tmp_path / "curve.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [int(row["steps"]) for row in rows] == [0, 8, 16]
    assert json.loads((tmp_path / "done.json").read_text())["steps"] == 16
    with leaderboard.FrozenEpisodes((30_000, 30_001)) as test:
        assert test.score(tmp_path / "policy.npz").flown.score.mean() == pytest.approx(
            float(rows[-1]["score"]), abs=0.02
        )


@pytest.mark.skipif(sb3_ppo is None, reason="needs stable-baselines3")
def test_the_program_of_stable_baselines3_writes_a_policy_that_flies_as_it_did(small, tmp_path, monkeypatch):
    real = sb3_ppo.PPO
    monkeypatch.setattr(sb3_ppo, "PPO", lambda *given, **names: real(*given, n_steps=4, batch_size=8, **names))
    sb3_ppo.train(common.Options(out=tmp_path, steps=16, seed=1, every=16))
    with (tmp_path / "curve.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [int(row["steps"]) for row in rows] == [0, 16]
    with leaderboard.FrozenEpisodes((30_000, 30_001)) as test:
        assert test.score(tmp_path / "policy.zip").flown.score.mean() == pytest.approx(
            float(rows[-1]["score"]), abs=1e-3
        )
