"""PPO in one file, with masks: swarm_mj's environment, torch, and nothing else between them.

    pip install 'swarm_mj[rl]'
    python examples/learning/ppo.py --steps 300000 --seed 1 --out runs/ppo-1
    swarm-mj score runs/ppo-1/policy.npz

Proximal policy optimisation (Schulman and others 2017) with generalised advantages (Schulman and others 2016). One network
judges every choice of every spacecraft by what is known of that choice, so that what it learns of one patch holds for all;
choices that `info["action_mask"]` rules out are never made (Huang and Ontanon 2022). Another network, which sees all choices of
the swarm, judges how the episode stands while they learn. An episode ends with the flight, whose time left is part of the
observation: nothing is bootstrapped.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import gymnasium
import numpy as np
import torch
from common import TRAINING, Curve, Options, mean_of, options
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray
from swarm_mj.envs.observe.config import EnvConfig
from swarm_mj.envs.observe.layout import choice_rows
from swarm_mj.envs.policies.policy_files import network_policy, provenance
from swarm_mj.envs.policies.policy_network import NetworkPolicy, save_network
from torch import Tensor, nn


@dataclass(frozen=True)
class Settings:
    """Of the algorithm."""

    num_envs: int = 32
    horizon: int = 48
    epochs: int = 4
    minibatches: int = 4
    rate: float = 1e-3
    gamma: float = 0.97
    gae_lambda: float = 0.95
    clip: float = 0.2
    entropy: float = 0.01
    value: float = 0.5
    max_norm: float = 0.5
    hidden: int = 48


class Agent(nn.Module):
    """Two networks of two layers: the logit of a choice, and the value of the whole.

    Args:
        episodes: Those of the environment.
        hidden: Width of the layers.
    """

    #: Whether the choices of all spacecraft are one action.
    joint = True

    def __init__(self, episodes: Any, hidden: int) -> None:
        super().__init__()
        n, choices, size = self.rows = choice_rows(episodes.entities()).shape[1:]
        self.actor = mlp(size, hidden, 1, 0.01)
        self.critic = mlp(2 * n * size, 2 * hidden, 1, 1.0)

    def shown(self, observed: Any) -> NDArray[np.float32]:
        """What the networks read, one row an episode."""
        rows = choice_rows(observed)
        return rows.reshape(len(rows), -1)

    def choose(self, seen: Tensor, mask: Tensor) -> torch.distributions.Categorical:
        """What each spacecraft would choose, of what it may."""
        logits = self.actor(seen.unflatten(-1, self.rows)).squeeze(-1)
        return torch.distributions.Categorical(logits=logits.masked_fill(~mask, -1e8))

    def value(self, seen: Tensor) -> Tensor:
        """What the rest of the episode will bring, by mean and maximum over the choices of each spacecraft."""
        rows = seen.unflatten(-1, self.rows)
        return self.critic(torch.cat([rows.mean(-2), rows.amax(-2)], dim=-1).flatten(-2)).squeeze(-1)


def mlp(inputs: int, hidden: int, outputs: int, gain: float) -> nn.Sequential:
    """Orthogonal weights, and small ones at the end."""
    layers = [nn.Linear(inputs, hidden), nn.Linear(hidden, hidden), nn.Linear(hidden, outputs)]
    for layer, scale in zip(layers, (2**0.5, 2**0.5, gain), strict=True):
        nn.init.orthogonal_(layer.weight, scale)
        nn.init.zeros_(layer.bias)
    return nn.Sequential(layers[0], nn.Tanh(), layers[1], nn.Tanh(), layers[2])


class Rollout:
    """What happened in `horizon` steps of all flights."""

    def __init__(self, horizon: int, count: int, features: int, shape: tuple[int, int]) -> None:
        self.seen = torch.zeros(horizon, count, features)
        self.mask = torch.zeros(horizon, count, *shape, dtype=torch.bool)
        self.choice = torch.zeros(horizon, count, shape[0], dtype=torch.int64)
        self.chance = torch.zeros(horizon, count, shape[0])
        self.reward, self.value, self.ended = torch.zeros(3, horizon, count)

    def advantages(self, last: Tensor, gamma: float, gae_lambda: float) -> Tensor:
        """Generalised advantage estimates, backwards from the value of what comes last."""
        out, carried, after = torch.zeros_like(self.reward), torch.zeros_like(last), last
        for t in reversed(range(len(out))):
            goes_on = 1.0 - self.ended[t]
            error = self.reward[t] + gamma * goes_on * after - self.value[t]
            carried = error + gamma * gae_lambda * goes_on * carried
            out[t], after = carried, self.value[t]
        return out


def update(agent: Agent, optimizer: torch.optim.Optimizer, rollout: Rollout, gain: Tensor, use: Settings) -> None:
    """Some passes over what happened, in small batches."""
    flat = [part.flatten(0, 1) for part in (rollout.seen, rollout.mask, rollout.choice, rollout.chance)]
    gains, targets = gain.flatten(), (gain + rollout.value).flatten()
    for _ in range(use.epochs):
        for rows in torch.randperm(len(gains)).chunk(use.minibatches):
            seen, mask, choice, before = (part[rows] for part in flat)
            chosen = agent.choose(seen, mask)
            change = chosen.log_prob(choice) - before
            ratio = (change.sum(1, keepdim=True) if agent.joint else change).exp()
            better = ((gains[rows] - gains[rows].mean()) / (gains[rows].std() + 1e-8)).unsqueeze(1)
            policy = torch.max(-better * ratio, -better * ratio.clamp(1.0 - use.clip, 1.0 + use.clip)).mean()
            value = 0.5 * (agent.value(seen) - targets[rows]).square().mean()
            loss = policy + use.value * value - use.entropy * chosen.entropy().sum(1).mean()
            optimizer.zero_grad()
            loss.backward()
            nn.utils.clip_grad_norm_(agent.parameters(), use.max_norm)
            optimizer.step()


def train(given: Options, use: Settings, kind: type[Agent] = Agent) -> None:
    """Fly and learn in turn."""
    torch.manual_seed(given.seed)
    torch.set_num_threads(1)
    envs = make_envs(use.num_envs)
    agent = kind(envs.batch, use.hidden)
    optimizer = torch.optim.Adam(agent.parameters(), lr=use.rate, eps=1e-5)
    curve, flights = Curve(given), Flights(envs, agent, given.seed)
    while flights.steps < given.steps:
        curve.update(flights.steps, network_policy(network_of(agent)), mean_of(flights.scores))
        optimizer.param_groups[0]["lr"] = use.rate * (1.0 - flights.steps / given.steps)
        rollout, last = flights.roll(use.horizon)
        update(agent, optimizer, rollout, rollout.advantages(last, use.gamma, use.gae_lambda), use)
    network = network_of(agent)
    save_network(given.out / "policy.npz", network)
    curve.end(flights.steps, network_policy(network))
    envs.close()


def make_envs(count: int) -> Any:
    """Episodes of training; one that ends is followed by the next at once."""
    mode = AutoresetMode.SAME_STEP
    return gymnasium.make_vec(
        "swarm_mj.envs:SwarmObserve-v0", count, autoreset_mode=mode, observation="entities", **TRAINING
    )


class Flights:
    """Training's episodes as they go on from rollout to rollout."""

    def __init__(self, envs: Any, agent: Agent, seed: int) -> None:
        self._envs, self._agent, self.steps = envs, agent, 0
        self.scores: list[float] = []
        self._score = np.zeros(envs.num_envs)
        self._observed, self._infos = envs.reset(seed=1_000_000 * seed)

    def roll(self, horizon: int) -> tuple[Rollout, Tensor]:
        """So many steps with drawn choices, and the value of what comes after them."""
        agent, seen = self._agent, self._seen()
        rollout = Rollout(horizon, *seen.shape, agent.rows[:2])
        for t in range(horizon):
            rollout.seen[t], rollout.mask[t] = seen, torch.as_tensor(self._infos["action_mask"]).bool()
            with torch.no_grad():
                chosen = agent.choose(seen, rollout.mask[t])
                rollout.choice[t] = chosen.sample()
                rollout.chance[t], rollout.value[t] = chosen.log_prob(rollout.choice[t]), agent.value(seen)
            self._observed, reward, terminated, truncated, self._infos = self._envs.step(rollout.choice[t].numpy())
            ended, seen = terminated | truncated, self._seen()
            rollout.reward[t], rollout.ended[t] = torch.as_tensor(reward), torch.as_tensor(ended)
            self._score += reward
            self.scores.extend(self._score[ended])
            self._score[ended] = 0.0
        self.steps += horizon * len(seen)
        with torch.no_grad():
            return rollout, agent.value(seen)

    def _seen(self) -> Tensor:
        return torch.as_tensor(self._agent.shown(self._observed))


def network_of(agent: Agent) -> NetworkPolicy:
    """The actor as arrays, for files and for flights without torch."""
    layers = [layer for layer in agent.actor if isinstance(layer, nn.Linear)]
    weights = {
        f"{name}{k + 1}": part
        for k, layer in enumerate(layers)
        for name, part in zip("Wb", layer.parameters(), strict=True)
    }
    arrays = {name: part.detach().numpy().astype(np.float64) for name, part in weights.items()}
    inputs = arrays["W1"].shape[1]
    about = provenance(EnvConfig(**TRAINING)) | {"reads": "choice"}
    about |= {"spacecraft": agent.rows[0], "choices": agent.rows[1]}
    return NetworkPolicy(arrays | {"mean": np.zeros(inputs), "scale": np.ones(inputs)}, about)


if __name__ == "__main__":
    train(options(__doc__, "ppo"), Settings())
