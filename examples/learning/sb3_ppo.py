"""PPO of stable-baselines3 as it comes, on the flat observation of SwarmObserve-v1.

    pip install 'swarm_mj[rl]'
    python examples/learning/sb3_ppo.py --steps 300000 --seed 1 --out runs/sb3-1
    swarm-mj score runs/sb3-1/policy.zip

All settings are the defaults of `PPO("MlpPolicy", ...)`. It knows no masks: a choice that makes no sense does nothing.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from common import TRAINING, Curve, Options, mean_of, options
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from swarm_mj.envs.missions.config import MissionConfig
from swarm_mj.envs.missions.policies import flat_rows, tell_in_zip
from swarm_mj.envs.sb3 import SwarmObserveV1VecEnv

#: Episodes at once: as `n_steps` is 2,048 for each, an update comes after 16,384 steps.
NUM_ENVS = 8


class Points(BaseCallback):
    """Points of the learning curve, between updates."""

    def __init__(self, curve: Curve) -> None:
        super().__init__()
        self.curve = curve

    def policy(self, observed: Any) -> np.ndarray:
        """The likeliest choices."""
        return np.asarray(self.model.predict(flat_rows(observed), deterministic=True)[0])

    def _on_rollout_start(self) -> None:
        sampled = mean_of([one["r"] for one in self.model.ep_info_buffer or ()])
        self.curve.update(self.num_timesteps, self.policy, sampled)

    def _on_step(self) -> bool:
        return True


def train(given: Options) -> None:
    """Learn for that many steps, and a little more: updates are whole."""
    torch.set_num_threads(1)
    venv = SwarmObserveV1VecEnv(NUM_ENVS, **TRAINING)
    model = PPO("MlpPolicy", venv, seed=given.seed, device="cpu")
    points = Points(Curve(given))
    model.learn(given.steps, callback=points)
    model.save(given.out / "policy.zip")
    tell_in_zip(given.out / "policy.zip", MissionConfig(**TRAINING))
    points.curve.end(model.num_timesteps, points.policy)
    venv.close()


if __name__ == "__main__":
    train(options(__doc__, "sb3"))
