"""PPO of stable-baselines3 as it comes, on the flat observation of SwarmObserve-v1 with candidates.

    pip install 'swarm_mj[rl]'
    python examples/learning/sb3_ppo.py --steps 300000 --seed 1 --out runs/sb3-1
    swarm-mj score runs/sb3-1/policy.zip

All settings are the defaults of `PPO("MlpPolicy", ...)`. Each spacecraft chooses among its best patches and sending. PPO knows
no masks: a choice that makes no sense does nothing.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from common import TRAINING, Curve, Options, mean_of, options
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from swarm_mj.envs.missions.config import MissionConfig
from swarm_mj.envs.missions.layout import make_interface
from swarm_mj.envs.missions.policies import tell_in_zip
from swarm_mj.envs.sb3 import SwarmObserveV1VecEnv

#: What each spacecraft chooses among, beside sending.
CANDIDATES = 4
#: Episodes at once: as `n_steps` is 2,048 for each, an update comes after 16,384 steps.
NUM_ENVS = 8


class Points(BaseCallback):
    """Points of the learning curve, between updates."""

    def __init__(self, curve: Curve, config: MissionConfig) -> None:
        super().__init__()
        self.curve = curve
        self.interface = make_interface(config.max_spacecraft, config.patches, config.candidates)

    def policy(self, observed: Any) -> np.ndarray:
        """The likeliest choices."""
        chosen = self.model.predict(self.interface.flat(observed), deterministic=True)[0]
        return self.interface.decoded(observed, chosen)

    def _on_rollout_start(self) -> None:
        sampled = mean_of([one["r"] for one in self.model.ep_info_buffer or ()])
        self.curve.update(self.num_timesteps, self.policy, sampled)

    def _on_step(self) -> bool:
        return True


def train(given: Options) -> None:
    """Learn for that many steps, and a little more: updates are whole."""
    torch.set_num_threads(1)
    config = MissionConfig(**TRAINING, candidates=CANDIDATES)
    venv = SwarmObserveV1VecEnv(NUM_ENVS, **TRAINING, candidates=CANDIDATES)
    model = PPO("MlpPolicy", venv, seed=given.seed, device="cpu")
    points = Points(Curve(given), config)
    model.learn(given.steps, callback=points)
    model.save(given.out / "policy.zip")
    tell_in_zip(given.out / "policy.zip", config)
    points.curve.end(model.num_timesteps, points.policy)
    venv.close()


if __name__ == "__main__":
    train(options(__doc__, "sb3"))
