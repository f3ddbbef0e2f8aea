"""Learn SwarmPointing-v0 from pixels: a small convolutional network and PPO, in one file, with torch alone.

    pip install torch
    python examples/pointing_pixels.py --steps 400000 --out runs/pixels

What the spacecraft sees is the body, 64 x 64 pixels of grey, mask and nearness; what it is to do is to point at the body's
centre. Writes curve.json, curve.png and policy.pt, and prints what the policy is worth on 50 flight seeds that it was not
trained on, beside the control laws, which are told the attitude error.
"""

import argparse
import json
import time
from pathlib import Path

import gymnasium as gym
import numpy as np
import torch
from gymnasium.vector import AutoresetMode
from swarm_mj.envs.pointing.policies import POLICIES, fly, fly_policy
from swarm_mj.envs.pointing.task import make_pointing_task
from torch import nn

ENVS, ROLLOUT, EPOCHS, MINIBATCHES = 32, 128, 4, 8
GAMMA, LAMBDA, CLIP, RATE, MOST_GRADIENT = 0.98, 0.95, 0.2, 7e-4, 0.5
#: One reference an episode, the body's centre.
TASK = {"observation": "camera", "holds": 1}
#: Flight seeds of training lie above; those of the comparison begin at 0.
TRAINING_SEED, TEST_EPISODES = 1_000_000, 50


class Network(nn.Module):
    """Convolutions, where in the picture each of their channels answers (soft argmax), and two dense layers."""

    def __init__(self, numbers: int) -> None:
        super().__init__()
        self.eyes = nn.Sequential(nn.Conv2d(3, 12, 4, 4), nn.ReLU(), nn.Conv2d(12, 16, 3, 2, 1))
        self.body = nn.Sequential(nn.Linear(3 * 16 + numbers, 64), nn.Tanh(), nn.Linear(64, 64), nn.Tanh())
        self.mean, self.value = nn.Linear(64, 3), nn.Linear(64, 1)
        self.log_std = nn.Parameter(torch.full((3,), -0.5))
        self.mean.weight.data *= 0.01
        self.register_buffer("place", torch.linspace(-1.0, 1.0, 8))

    def forward(self, image: torch.Tensor, state: torch.Tensor) -> tuple[torch.distributions.Normal, torch.Tensor]:
        """Distribution of the actions, and the value."""
        answer = self.eyes(image.float() / 255.0)
        share = torch.softmax(answer.flatten(2), 2).view_as(answer)
        x, y = (share.sum(2) * self.place).sum(2), (share.sum(3) * self.place).sum(2)
        features = self.body(torch.cat([4.0 * x, 4.0 * y, answer.amax((2, 3)), state], 1))
        return torch.distributions.Normal(self.mean(features), self.log_std.exp()), self.value(features)[:, 0]


def tensors(observation: dict[str, np.ndarray]) -> tuple[torch.Tensor, torch.Tensor]:
    """An observation for the network."""
    return torch.from_numpy(observation["image"]), torch.from_numpy(observation["state"])


def gather(envs: gym.vector.VectorEnv, network: Network, observation: dict[str, np.ndarray]) -> tuple[dict, dict]:
    """Fly a rollout; returns what PPO needs of it, and the observation that comes next."""
    kept: dict[str, list] = {name: [] for name in ("image", "state", "action", "log", "value", "reward", "end")}
    for _ in range(ROLLOUT):
        image, state = tensors(observation)
        with torch.no_grad():
            policy, value = network(image, state)
            action = policy.sample()
            log = policy.log_prob(action).sum(1)
        observation, reward, _, truncated, infos = envs.step(action.clamp(-1.0, 1.0).numpy())
        reward = torch.from_numpy(reward).float()
        if truncated.any():  # time is up, and that is no end: what would have come is worth what the value says
            last = [infos["final_obs"][e] for e in np.flatnonzero(truncated)]
            with torch.no_grad():
                reward[truncated] += GAMMA * network(*tensors({k: np.array([o[k] for o in last]) for k in last[0]}))[1]
        row = (image, state, action, log, value, reward, torch.from_numpy(truncated).float())
        for name, part in zip(kept, row, strict=True):
            kept[name].append(part)
    stacked = {name: torch.stack(rows) for name, rows in kept.items()}
    with torch.no_grad():
        stacked["last"] = network(*tensors(observation))[1]
    return stacked, observation


def advantages(rollout: dict[str, torch.Tensor]) -> torch.Tensor:
    """Generalised advantage estimates, shape (ROLLOUT, ENVS)."""
    out, running, following = torch.zeros_like(rollout["reward"]), torch.zeros(ENVS), rollout["last"]
    for t in reversed(range(ROLLOUT)):
        goes_on = 1.0 - rollout["end"][t]
        delta = rollout["reward"][t] + GAMMA * goes_on * following - rollout["value"][t]
        running = delta + GAMMA * LAMBDA * goes_on * running
        out[t], following = running, rollout["value"][t]
    return out


def improve(network: Network, optimiser: torch.optim.Optimizer, rollout: dict[str, torch.Tensor]) -> None:
    """PPO's clipped update."""
    gain = advantages(rollout)
    target = (gain + rollout["value"]).flatten()
    flat = {name: rollout[name].flatten(0, 1) for name in ("image", "state", "action", "log")}
    gain = gain.flatten()
    for _ in range(EPOCHS):
        for rows in torch.randperm(len(gain)).chunk(MINIBATCHES):
            policy, value = network(flat["image"][rows], flat["state"][rows])
            ratio = (policy.log_prob(flat["action"][rows]).sum(1) - flat["log"][rows]).exp()
            g = (gain[rows] - gain[rows].mean()) / (gain[rows].std() + 1e-8)
            loss = -torch.min(ratio * g, ratio.clamp(1.0 - CLIP, 1.0 + CLIP) * g).mean()
            loss = loss + 0.5 * ((value - target[rows]) / 10.0).square().mean()
            optimiser.zero_grad()
            loss.backward()
            nn.utils.clip_grad_norm_(network.parameters(), MOST_GRADIENT)
            optimiser.step()


def worth(network: Network, task) -> dict[str, float]:
    """What the policy's means come to on the test seeds."""

    def act(batch) -> np.ndarray:
        with torch.no_grad():
            return network(*tensors(batch.observation))[0].mean.clamp(-1.0, 1.0).numpy()

    return told(fly(task, act, TEST_EPISODES))


def told(outcome) -> dict[str, float]:
    """The means over the episodes."""
    success = float((outcome.held == 1.0).mean())
    mean = {name: float(getattr(outcome, name).mean()) for name in ("total_reward", "on_target", "error_deg")}
    return {**mean, "success": success}


def draw(curve: list[dict[str, float]], laws: dict[str, dict[str, float]], file: Path) -> None:
    """The curve as a picture."""
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, 2, figsize=(9, 3.4), constrained_layout=True)
    steps = [row["steps"] / 1e3 for row in curve]
    for axis, name, title in zip(
        axes, ("total_reward", "on_target"), ("reward of an episode", "share of time on target"), strict=True
    ):
        axis.plot(steps, [row[name] for row in curve], marker=".", label="CNN from pixels")
        for law, style in zip(laws, ("--", ":", "-."), strict=False):
            axis.axhline(laws[law][name], ls=style, c="0.4", label=law)
        axis.set(xlabel="thousands of steps", title=title)
    axes[0].legend(frameon=False)
    figure.savefig(file, dpi=110)


def main() -> None:
    """Train, compare, write."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--steps", type=int, default=400_000)
    parser.add_argument("--out", type=Path, default=Path("runs/pixels"))
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    torch.manual_seed(options.seed)
    envs = gym.make_vec(
        "swarm_mj.envs:SwarmPointing-v0",
        num_envs=ENVS,
        autoreset_mode=AutoresetMode.SAME_STEP,
        **TASK,
    )
    task, start = make_pointing_task(**TASK), time.perf_counter()
    observation, _ = envs.reset(seed=options.seed, options={"flight_seed": [TRAINING_SEED + e for e in range(ENVS)]})
    network = Network(task.layout.space.shape[0])
    optimiser = torch.optim.Adam(network.parameters(), RATE, eps=1e-5)
    updates, curve = max(1, options.steps // (ENVS * ROLLOUT)), []
    for k in range(updates + 1):
        if k % 8 == 0 or k == updates:
            steps, seconds = k * ENVS * ROLLOUT, time.perf_counter() - start
            curve.append({"steps": steps, "seconds": seconds, **worth(network, task)})
            print({name: round(value, 3) for name, value in curve[-1].items()}, flush=True)
        if k < updates:
            optimiser.param_groups[0]["lr"] = RATE * (1.0 - k / updates)
            rollout, observation = gather(envs, network, observation)
            improve(network, optimiser, rollout)
    config = task.config
    seeing = make_pointing_task(
        references=("body",),
        holds=config.holds,
        tolerance_deg=config.largest_error_deg,
        start_deg=config.largest_start_deg,
    )
    laws = {
        name: told(fly_policy(seeing, POLICIES[name], TEST_EPISODES)) for name in ("quick PD", "sliding mode", "zero")
    }
    options.out.mkdir(parents=True, exist_ok=True)
    (options.out / "curve.json").write_text(json.dumps({"curve": curve, "laws": laws}, indent=1))
    torch.save(network.state_dict(), options.out / "policy.pt")
    draw(curve, laws, options.out / "curve.png")
    for name, row in laws.items():
        print(name, {key: round(value, 3) for key, value in row.items()})


if __name__ == "__main__":
    main()
