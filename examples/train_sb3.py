"""Train a policy for SwarmObserve-v0 with PPO of stable-baselines3, and compare it with scripted ones.

    pip install 'swarm_mj[rl]'
    python examples/train_sb3.py --minutes 2
    python examples/train_sb3.py --minutes 30 --out runs/long
    swarm-mj score runs/long/policy.zip

Each spacecraft chooses among its best patches and sending, and is an environment of its own to PPO, so that what one finds out
serves all. `examples/learning` trains better policies, with masks and a network that judges choices one by one.
"""

import argparse
import time
from pathlib import Path

from stable_baselines3 import PPO
from swarm_mj.envs import SwarmObserveSharedVecEnv
from swarm_mj.envs.observe.config import EnvConfig
from swarm_mj.envs.observe.episodes import Episodes
from swarm_mj.envs.policies.baselines import fly, greedy, random_choices
from swarm_mj.envs.policies.policy_files import open_policy, tell_in_zip

#: Flight seeds of the comparison, which training does not see.
COMPARISON = range(1_000_000, 1_000_020)


def train(out: Path, minutes: float, seed: int, num_episodes: int, scenario: str | None) -> dict[str, float]:
    """Learn until the time is up; the mean scores of the policy and of two that learnt nothing."""
    arguments = {"candidates": 4, "horizon_terminates": True, "scenario": scenario}
    venv, end = SwarmObserveSharedVecEnv(num_episodes, **arguments), time.monotonic() + 60.0 * minutes
    model = PPO("MlpPolicy", venv, n_steps=256, seed=seed, device="cpu", verbose=1)
    # Time ends training, not the number of steps.
    model.learn(10**9, callback=lambda *_: time.monotonic() < end)
    venv.close()
    file = out / "policy.zip"
    model.save(file)
    config = EnvConfig(**arguments)
    tell_in_zip(file, config, reads="spacecraft")
    episodes = Episodes(config, 10)
    policies = {"random": random_choices(), "trained": open_policy(file, config), "greedy": greedy}
    scores = {name: float(fly(episodes, policy, COMPARISON).score.mean()) for name, policy in policies.items()}
    episodes.close()
    return scores


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("runs/sb3"), help="folder of policy.zip")
    parser.add_argument("--minutes", type=float, default=2.0, help="of training")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--num-episodes", type=int, default=8, help="at once")
    parser.add_argument("--scenario", help="one flyby instead of the catalogue")
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    for name, score in train(given.out, given.minutes, given.seed, given.num_episodes, given.scenario).items():
        print(f"{name:8} {score:.3f}")
