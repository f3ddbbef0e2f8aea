"""Train stock PPO of stable-baselines3 on SwarmPointing-v0, and compare it with the control laws.

    pip install 'swarm_mj[rl]'
    python examples/pointing_sb3.py --steps 400000 --out runs/pointing

Writes curve.json and policy.zip, and prints what the policy is worth on 50 flight seeds that it was not trained on.
"""

import argparse
import json
import time
from pathlib import Path

from stable_baselines3 import PPO
from swarm_mj.envs.pointing.policies import POLICIES, PointingOutcome, fly, fly_policy
from swarm_mj.envs.pointing.task import make_pointing_task
from swarm_mj.envs.training.sb3 import SwarmPointingVecEnv

#: Spacecraft side by side, and how often the policy is looked at.
ENVS, LOOKS, EPISODES = 16, 10, 50


def told(outcome: PointingOutcome) -> dict[str, float]:
    """The means over the episodes."""
    mean = {name: float(getattr(outcome, name).mean()) for name in ("total_reward", "on_target", "error_deg")}
    return {**mean, "success": float((outcome.held == 1.0).mean())}


def main() -> None:
    """Train, compare, write."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--steps", type=int, default=400_000)
    parser.add_argument("--out", type=Path, default=Path("runs/pointing"))
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    task, start = make_pointing_task(), time.perf_counter()
    laws = {name: told(fly_policy(task, policy, EPISODES)) for name, policy in POLICIES.items()}
    for name, row in laws.items():
        print(name, {key: round(value, 3) for key, value in row.items()})
    model = PPO("MlpPolicy", SwarmPointingVecEnv(ENVS), n_steps=256, batch_size=256, seed=options.seed, device="cpu")
    curve = []
    for _ in range(LOOKS):
        model.learn(max(1, options.steps // LOOKS), reset_num_timesteps=False)
        outcome = fly(task, lambda batch: model.predict(batch.numbers, deterministic=True)[0], EPISODES)
        curve.append({"steps": model.num_timesteps, "seconds": time.perf_counter() - start, **told(outcome)})
        print({key: round(value, 3) for key, value in curve[-1].items()}, flush=True)
    options.out.mkdir(parents=True, exist_ok=True)
    (options.out / "curve.json").write_text(json.dumps({"curve": curve, "laws": laws}, indent=1))
    model.save(options.out / "policy.zip")


if __name__ == "__main__":
    main()
