"""Training of `ArrayPolicy` with stable-baselines3: its network in torch, and the view of the environment it learns from.

Needs the extra `rl`.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from gymnasium import spaces
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.vec_env.base_vec_env import VecEnvObs, VecEnvStepReturn, VecEnvWrapper
from torch import Tensor, nn

from swarm_mj.typing import Array, Array32

from ..observe.observations import COLUMNS, FEATURES
from ..policies.policy import OWN, PER_PATCH, ArrayPolicy, PatchGeometry, describe, geometry_of, provenance
from .sb3 import SwarmObserveVecEnv


class VecPolicyFeatures(VecEnvWrapper):
    """What training sees: features in place of observations, and rewards that do not come late.

    Data aboard are worth nothing until Earth has them, many steps after the picture that they come from. They are therefore
    the potential of a potential-based shaping (Ng, Harada and Russell 1999), gamma Phi(s') - Phi(s) with Phi the data aboard
    over the nominal volume and 0 at the end, which changes no optimal policy. The end of the flight by its duration is an
    end like any other: the time left is part of the observation, and nothing comes after it.

    A flight can also be broken off after `horizon_s`, when all pictures are taken and only talking is left: the data aboard
    then count as delivered, so that training spends its time where decisions matter.

    Args:
        venv: The environment.
        gamma: Discount of training.

    Attributes:
        geometry: Of the patches.
        horizon_s: Flights are broken off at this time [s]; infinite for whole flights.
    """

    venv: SwarmObserveVecEnv

    def __init__(self, venv: SwarmObserveVecEnv, gamma: float) -> None:
        task = venv.vector.batch.task
        self.geometry, self._gamma, self._n = geometry_of(task), gamma, task.plan.n
        self.horizon_s = float("inf")
        shape = (self._n, OWN + PER_PATCH * self.geometry.count)
        super().__init__(venv, observation_space=spaces.Box(-np.inf, np.inf, shape, np.float32))
        self._potential = np.zeros(venv.num_envs)

    def reset(self) -> VecEnvObs:
        """Features at the start of all flights."""
        observation = np.asarray(self.venv.reset())
        self._potential = self._stored(observation)
        return self._features(observation)

    def step_wait(self) -> VecEnvStepReturn:
        """Features and shaped rewards."""
        observation, rewards, done, infos = self.venv.step_wait()
        after = self._stored(observation)
        shaped = rewards + self._gamma * np.where(done, 0.0, after) - self._potential
        for e in np.flatnonzero(done).tolist():
            infos[e]["terminal_observation"] = self._features(infos[e]["terminal_observation"][None])[0]
            infos[e]["TimeLimit.truncated"] = False
        broken = ~done & np.array([info["time_s"] >= self.horizon_s for info in infos])
        if broken.any():
            features = self._features(observation)
            for e in np.flatnonzero(broken).tolist():
                infos[e]["episode"] = self.venv.episode(e, after[e])
                infos[e]["terminal_observation"] = features[e]
            observation = self.venv.restart(broken)
            after = self._stored(observation)
        self._potential = after
        return self._features(observation), shaped.astype(np.float32), done | broken, infos

    def _features(self, observation: Any) -> Array32:
        return self.geometry.features(observation).astype(np.float32)

    def _stored(self, observation: Any) -> Array:
        first = COLUMNS["stored"].start
        return observation[:, first : self._n * FEATURES : FEATURES].sum(axis=1, dtype=np.float64)


class SwarmNetwork(nn.Module):
    """The network of `ArrayPolicy`, which documents it, and a critic that averages over the spacecraft."""

    def __init__(self, n: int, width: int, hidden: int = 64, pointer: int = 32) -> None:
        super().__init__()
        self.n, self.width, self.patches = n, width, (width - OWN) // PER_PATCH
        self.first, self.second = nn.Linear(width, hidden), nn.Linear(hidden, hidden)
        self.pointer, self.score = nn.Linear(hidden + PER_PATCH, pointer), nn.Linear(pointer, 1, bias=False)
        self.others = nn.Linear(hidden, n + 3)
        self.each = nn.Sequential(nn.Linear(width, hidden), nn.Tanh(), nn.Linear(hidden, hidden), nn.Tanh())
        self.critic = nn.Sequential(nn.Linear(hidden, hidden), nn.Tanh())
        self.latent_dim_pi, self.latent_dim_vf = n * (self.patches + n + 3), hidden
        for layer in (self.first, self.second, self.pointer):
            nn.init.orthogonal_(layer.weight, 2.0**0.5)
        for last in (self.score, self.others):
            nn.init.orthogonal_(last.weight, 0.01)

    def forward(self, features: Tensor) -> tuple[Tensor, Tensor]:
        """Logits of all spacecraft one after the other, and what the value is read from."""
        return self.forward_actor(features), self.forward_critic(features)

    def forward_actor(self, features: Tensor) -> Tensor:
        """Logits, shape (batch, n (K + n + 3))."""
        x = features.view(-1, self.n, self.width)
        patch = x[:, :, OWN:].reshape(-1, self.n, self.patches, PER_PATCH)
        hidden = torch.tanh(self.second(torch.tanh(self.first(x))))
        size = hidden.shape[2]
        context = nn.functional.linear(hidden, self.pointer.weight[:, :size], self.pointer.bias)
        turned = nn.functional.linear(patch, self.pointer.weight[:, size:])
        pointed = self.score(torch.tanh(turned + context[:, :, None])).squeeze(3)
        return torch.cat([pointed, self.others(hidden)], dim=2).flatten(1)

    def forward_critic(self, features: Tensor) -> Tensor:
        """What the value is read from, shape (batch, hidden)."""
        return self.critic(self.each(features.view(-1, self.n, self.width)).mean(dim=1))


class SwarmActorCritic(ActorCriticPolicy):
    """stable-baselines3's policy around `SwarmNetwork`: its logits are those of the actions as they are."""

    def _build_mlp_extractor(self) -> None:
        assert self.observation_space.shape is not None
        n, width = self.observation_space.shape
        self.mlp_extractor = SwarmNetwork(n, width)

    def _build(self, lr_schedule: Any) -> None:
        self.ortho_init = False
        super()._build(lr_schedule)
        self.action_net = nn.Identity()
        self.optimizer = self.optimizer_class(self.parameters(), lr=lr_schedule(1), **self.optimizer_kwargs)

    def arrays(self) -> dict[str, Array]:
        """The weights of the actor as `ArrayPolicy` names them."""
        net = self.mlp_extractor
        assert isinstance(net, SwarmNetwork)
        tensors = {"W1": net.first.weight, "b1": net.first.bias, "W2": net.second.weight, "b2": net.second.bias}
        tensors |= {"W3": net.pointer.weight, "b3": net.pointer.bias, "v": net.score.weight[0]}
        tensors |= {"W4": net.others.weight, "b4": net.others.bias}
        return {name: tensor.detach().cpu().numpy().astype(np.float64) for name, tensor in tensors.items()}


def to_array_policy(
    policy: SwarmActorCritic, venv: SwarmObserveVecEnv, geometry: PatchGeometry, **about: Any
) -> ArrayPolicy:
    """The policy as arrays, with what it was trained on."""
    task = venv.vector.batch.task
    return ArrayPolicy(policy.arrays(), geometry, describe(task) | provenance(task) | about)
