"""PPO of stable-baselines3 as it comes, on SwarmObserve-v0 with candidates: one policy for all spacecraft.

    pip install 'swarm_mj[rl]'
    python examples/learning/sb3_ppo.py --steps 300000 --seed 1 --out runs/sb3-1
    swarm-mj score runs/sb3-1/policy.zip

All settings are the defaults of `PPO("MlpPolicy", ...)`. Each spacecraft chooses among its best patches and sending, and is an
environment of its own to PPO (parameter sharing: Terry and others 2020), so that what one finds out serves all: a decision of
the swarm is as many steps of PPO as there may be spacecraft. PPO knows no masks: a choice that makes no sense does nothing.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from common import TRAINING, Curve, Options, mean_of, options
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from swarm_mj.envs.observe.config import EnvConfig
from swarm_mj.envs.observe.layout import local_rows, make_interface
from swarm_mj.envs.policies.policy_files import tell_in_zip
from swarm_mj.envs.training.sb3 import SwarmObserveSharedVecEnv

#: What each spacecraft chooses among, beside sending.
CANDIDATES = 4
#: Episodes at once; PPO takes 2,048 steps of each spacecraft of each between updates.
NUM_EPISODES = 4


class Points(BaseCallback):
    """Points of the learning curve, between updates."""

    def __init__(self, curve: Curve, config: EnvConfig) -> None:
        super().__init__()
        self.curve, self.n = curve, config.spacecraft
        self.interface = make_interface(self.n, config.patches, config.candidates)

    @property
    def decisions(self) -> int:
        """Of the swarm, in each of which all spacecraft choose."""
        return self.num_timesteps // self.n

    def policy(self, observed: Any) -> np.ndarray:
        """The likeliest choices."""
        rows = local_rows(self.interface.layout.split(self.interface.flat(observed)))
        chosen = self.model.predict(rows.reshape(-1, rows.shape[2]), deterministic=True)[0]
        return self.interface.decoded(observed, chosen.reshape(-1, self.n))

    def _on_rollout_start(self) -> None:
        sampled = mean_of([one["r"] for one in self.model.ep_info_buffer or ()])
        self.curve.update(self.decisions, self.policy, sampled)

    def _on_step(self) -> bool:
        return True


def train(given: Options) -> None:
    """Learn for that many decisions, and a little more: updates are whole."""
    torch.set_num_threads(1)
    # An episode ends with the flight, whose time left is part of the observation: nothing is bootstrapped.
    arguments = {**TRAINING, "candidates": CANDIDATES, "horizon_terminates": True}
    config, venv = EnvConfig(**arguments), SwarmObserveSharedVecEnv(NUM_EPISODES, **arguments)
    model = PPO("MlpPolicy", venv, seed=given.seed, device="cpu")
    points = Points(Curve(given), config)
    model.learn(given.steps * config.spacecraft, callback=points)
    model.save(given.out / "policy.zip")
    tell_in_zip(given.out / "policy.zip", config, reads="spacecraft")
    points.curve.end(points.decisions, points.policy)
    venv.close()


if __name__ == "__main__":
    train(options(__doc__, "sb3"))
