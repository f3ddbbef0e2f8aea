"""Train a policy for SwarmObserve-v0 with PPO, and compare it with the untrained one.

    pip install 'swarm_mj[rl]'
    python examples/train_sb3.py --minutes 2
    python examples/train_sb3.py --minutes 30 --out runs/long
    python examples/train_sb3.py --minutes 30 --out runs/long --resume

The network first imitates the greedy rule for a few rounds (`--imitate 0` leaves that out), flying by itself while the rule
says what it should have done; PPO then goes on from there. The folder holds `checkpoint.zip` (to resume), `policy.npz` (the
best policy on the validation seeds so far, for NumPy and `swarm-mj run --policy`), `curve.csv` (the learning curve),
`state.json` (where training stands) and logs for TensorBoard. After imitation it may be interrupted at any time.

With `--minutes 2` on two cores nearly all of the difference that is printed at the end comes from imitation: PPO has time for
some thousand steps, and needs about 70,000, there five minutes or more, to pass what was imitated. The last line says how many
steps and updates PPO had, and what they brought on the validation seeds.
"""

from __future__ import annotations

import argparse
import csv
import json
import sys
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from swarm_mj.errors import ScenarioError, SwarmError

try:
    import torch
    from stable_baselines3 import PPO
    from stable_baselines3.common.callbacks import BaseCallback
    from stable_baselines3.common.logger import configure
except ImportError as error:
    raise SystemExit(f"training needs the extra rl ({error}): pip install 'swarm_mj[rl]'") from None
from swarm_mj.envs.evaluation import fly_seeds, interval
from swarm_mj.envs.policy import ArrayPolicy, greedy_actions, load_policy, save_policy
from swarm_mj.envs.sb3 import SwarmObserveVecEnv
from swarm_mj.envs.sb3_policy import SwarmActorCritic, VecPolicyFeatures, to_array_policy

#: Discount; an episode has 150 steps, and the shaped reward comes at once.
GAMMA = 0.99
#: Seeds of the flights: training draws from the first on, validation and comparison have their own.
TRAINING, VALIDATION, COMPARISON = 1_000_000, range(2_000, 2_016), range(1_000, 1_020)
#: Steps of a flight in a round of PPO: to the horizon [s], for after it no picture of `eros-observe` counts any more. In the
#: last part of training, flights go on to their end.
STEPS, HORIZON_S, WHOLE_FLIGHTS = 75, 750.0, 0.9
#: Largest seed that stable-baselines3 can give to NumPy.
MAX_SEED = 2**32 - 1
#: PPO updates between two validations.
VALIDATE_EVERY = 10
#: Passes over the data in a round of imitation.
EPOCHS = 8
#: From the first to the last update.
LEARNING_RATE, ENTROPY = (1e-3, 1e-4), (6e-3, 3e-4)


@dataclass
class Done:
    """What training has come to, kept beside the checkpoint.

    Attributes:
        steps: Of the environment, that PPO has flown.
        seconds: Of training.
        start: Return on the validation seeds before PPO's first update.
        best: That of `policy.npz`, the best so far.
    """

    steps: int = 0
    seconds: float = 0.0
    start: float = float("nan")
    best: float = -np.inf


def main(argv: list[str] | None = None) -> int:
    """Parse the command line and train; returns the exit status.

    0: done; 2: bad input, or a scenario for which no policy can be trained; 130: interrupted.
    """
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--minutes", type=_minutes, default=2.0, help="of training, comparison not included (default: 2)"
    )
    parser.add_argument("--out", type=Path, default=Path("runs/sb3"), metavar="DIR", help="default: runs/sb3")
    parser.add_argument(
        "--seed", type=_whole(0, MAX_SEED), default=0, help="of network, actions and flights (default: 0)"
    )
    parser.add_argument("--num-envs", type=_whole(1), default=32, help="flights at once (default: 32)")
    parser.add_argument("--imitate", type=_whole(0), default=3, metavar="ROUNDS", help="of imitation (default: 3)")
    parser.add_argument(
        "--scenario", default="eros-observe", help="of spacecraft with three wheels each (default: eros-observe)"
    )
    parser.add_argument("--resume", action="store_true", help="go on from the checkpoint in the folder")
    arguments = parser.parse_args(argv)
    try:
        train(arguments)
    except (SwarmError, OSError) as error:
        print(f"train_sb3: error: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        kept = (arguments.out / "checkpoint.zip").exists()
        print(
            f"interrupted; {'what was kept last stays: --resume goes on from there' if kept else 'nothing was kept yet'}"
        )
        return 130
    return 0


def train(arguments: argparse.Namespace) -> None:
    """Train until the time is up, then compare."""
    torch.set_num_threads(1)
    folder: Path = arguments.out
    if arguments.resume and not (folder / "checkpoint.zip").exists():
        raise ScenarioError(f"--resume: there is no {folder / 'checkpoint.zip'}; train without it first")
    venv = SwarmObserveVecEnv(arguments.num_envs, scenario=arguments.scenario)
    try:
        view = VecPolicyFeatures(venv, GAMMA)
        folder.mkdir(parents=True, exist_ok=True)
        untrained = to_array_policy(fresh(arguments, view).policy, venv, view.geometry)
        model, done = begin(arguments, view)
        # A learner seeds its flights like itself; these are no others' seeds, and other ones after a resume.
        view.seed(TRAINING * (1 + arguments.seed) + done.steps)
        model.set_logger(configure(str(folder / "log"), ["tensorboard"]))
        watch = Watch(folder, view, venv, done, 60.0 * arguments.minutes, anew=not arguments.resume)
        watch.init_callback(model)
        if not arguments.resume:
            # Nothing is written before it is over: a run that ends here leaves an earlier one in the folder as it is.
            imitate(model, view, arguments.imitate)
            watch.validate()
            done.start = done.best
            watch.keep()
        # Time ends training, not the number of steps.
        model.copy_truth(10**9, callback=watch, reset_num_timesteps=False)
        watch.validate()
        watch.keep()
        compare(untrained, folder, arguments.scenario)
        print(watch.share_of_ppo())
    finally:
        venv.close()


def fresh(arguments: argparse.Namespace, view: VecPolicyFeatures) -> PPO:
    """A learner that knows nothing."""
    return PPO(
        SwarmActorCritic,
        view,
        n_steps=STEPS,
        batch_size=400,
        n_epochs=6,
        gamma=GAMMA,
        gae_lambda=0.9,
        clip_range=0.2,
        learning_rate=LEARNING_RATE[0],
        ent_coef=ENTROPY[0],
        max_grad_norm=0.5,
        target_kl=0.04,
        seed=arguments.seed,
        device="cpu",
    )


def begin(arguments: argparse.Namespace, view: VecPolicyFeatures) -> tuple[PPO, Done]:
    """A fresh learner, or that of the checkpoint.

    Raises:
        ScenarioError: The checkpoint is of another swarm, or the state cannot be read.
    """
    folder: Path = arguments.out
    if not arguments.resume:
        return fresh(arguments, view), Done()
    try:
        model = PPO.load(folder / "checkpoint.zip", view, device="cpu")
    except ValueError as error:
        raise ScenarioError(
            f"--resume with --scenario {arguments.scenario}: {folder / 'checkpoint.zip'} does not fit: {error}"
        ) from None
    done, state, policy = Done(), folder / "state.json", folder / "policy.npz"
    if state.exists():
        try:
            done = Done(**json.loads(state.read_text("utf-8")))
        except (ValueError, TypeError) as error:
            raise ScenarioError(f"--resume: {state}: is no state of training: {error}") from None
    # Three files cannot be replaced at once: what each says of itself goes first.
    done.steps = model.num_timesteps
    done.best = load_policy(policy).about.get("validation_return", done.best) if policy.exists() else -np.inf
    return model, done


def imitate(model: PPO, view: VecPolicyFeatures, rounds: int) -> None:
    """Learn what the greedy rule would do where the learner itself gets to (DAgger, Ross, Gordon and Bagnell 2011)."""
    policy = model.policy
    optimizer = torch.optim.Adam(policy.parameters(), lr=1e-3)
    seen: list[torch.Tensor] = []
    wanted: list[torch.Tensor] = []
    features = view.reset()
    for turn in range(rounds):
        for _ in range(150):
            expert = greedy_actions(features, view.geometry)
            seen.append(torch.as_tensor(features))
            wanted.append(torch.as_tensor(expert))
            action = expert if turn == 0 else model.predict(features, deterministic=False)[0]
            features, *_ = view.step(action)
        x, y = torch.cat(seen), torch.cat(wanted)
        for _ in range(EPOCHS):
            for rows in torch.randperm(len(x)).split(256):
                loss = -policy.get_distribution(x[rows]).log_prob(y[rows]).mean()
                optimizer.zero_grad()
                loss.backward()
                optimizer.step()
        print(f"imitation {turn + 1} of {rounds}: loss {loss.item():.2f}", flush=True)


class Watch(BaseCallback):
    """Ends training in time; prints, validates and keeps the learner after updates."""

    def __init__(
        self, folder: Path, view: VecPolicyFeatures, venv: SwarmObserveVecEnv, done: Done, seconds: float, *, anew: bool
    ) -> None:
        super().__init__()
        self._folder, self._view, self._venv, self.done, self._anew = folder, view, venv, done, anew
        self._seconds, self._start, self._before = seconds, time.monotonic(), done.seconds
        self._rollouts, self._returns, self._from = 0, np.zeros(0), done.steps

    @property
    def share(self) -> float:
        """How much of the time is over."""
        return min(1.0, (time.monotonic() - self._start) / self._seconds)

    def _on_step(self) -> bool:
        ended = [info["episode"]["r"] for info in self.locals["infos"] if "episode" in info]
        self._returns = np.append(self._returns, ended)[-2 * self._venv.num_envs :]
        return self.share < 1.0

    def _on_rollout_start(self) -> None:
        """An update is over, or the first one has not begun."""
        left = 1.0 - self.share
        rate = LEARNING_RATE[1] + left * (LEARNING_RATE[0] - LEARNING_RATE[1])
        self.model.lr_schedule = lambda _: rate
        self._view.horizon_s = HORIZON_S if self.share < WHOLE_FLIGHTS else float("inf")
        self.model.ent_coef = ENTROPY[1] + left * (ENTROPY[0] - ENTROPY[1])
        if self._rollouts:
            self._write_down()
            mean = self._returns.mean() if len(self._returns) else float("nan")
            print(f"{100 * self.share:5.1f} %  {self.num_timesteps:9d} steps  return {mean:.3f}", flush=True)
            if self._rollouts % VALIDATE_EVERY == 0:
                self.validate()
            self.keep()
        self._rollouts += 1

    def share_of_ppo(self) -> str:
        """How much PPO there was in this run, and what it has brought since imitation."""
        # Time ends within a rollout, after which there is no update.
        updates, steps = max(0, self._rollouts - 1), self.model.num_timesteps
        return (
            f"PPO made {updates} updates and {steps - self._from:,} steps in this run, {steps:,} steps in all; return on the "
            f"validation seeds: {self.done.start:.3f} before its first update, {self.done.best:.3f} at best"
        )

    def keep(self) -> None:
        """Write checkpoint and state; each takes the place of the old one only when it is whole."""
        self.done.steps = self.model.num_timesteps
        self.done.seconds = self._before + time.monotonic() - self._start
        partial = self._folder / ".checkpoint.partial.zip"
        self.model.save(partial)
        partial.replace(self._folder / "checkpoint.zip")
        _write(self._folder / "state.json", json.dumps(asdict(self.done)))

    def validate(self) -> None:
        """Fly the validation seeds with the likeliest actions; the best policy so far is written."""
        steps = self.model.num_timesteps
        policy = to_array_policy(self.model.policy, self._venv, self._view.geometry, steps=steps)
        scenario = self._venv.vector.batch.task.plan.scenario
        flown = fly_seeds(policy.act, VALIDATION, scenario=scenario)
        mean, coverage = float(flown.total.mean()), float(flown.coverage_percent.mean())
        self._write_down(mean, coverage)
        # Not by `record`, which would write it with the numbers of the next rollout.
        numbers = {"validation/return": mean, "validation/coverage_percent": coverage}
        for output in self.logger.output_formats:
            output.write(dict(numbers), {name: () for name in numbers}, steps)
        print(f"validation: return {mean:.3f}, coverage {coverage:.1f} %", flush=True)
        if mean > self.done.best:
            self.done.best = mean
            policy = replace(policy, about={**policy.about, "validation_return": mean})
            save_policy(self._folder / "policy.npz", policy)

    def _write_down(self, *validation: float) -> None:
        """A line of the learning curve: after every update, with more after a validation."""
        curve = self._folder / "curve.csv"
        begins, self._anew = self._anew or not curve.exists(), False
        sampled = round(float(self._returns.mean()), 4) if len(self._returns) else float("nan")
        seconds = self._before + time.monotonic() - self._start
        with curve.open("w" if begins else "a", newline="") as file:
            writer = csv.writer(file)
            if begins:
                writer.writerow(["steps", "seconds", "sampled_return", "validation_return", "coverage_percent"])
            known = [round(value, 4) for value in validation] or [float("nan")] * 2
            writer.writerow([self.model.num_timesteps, round(seconds, 1), sampled, *known])


def compare(untrained: ArrayPolicy, folder: Path, scenario: str) -> None:
    """Fly the best policy and the untrained one from the same seeds."""
    best = load_policy(folder / "policy.npz")
    totals = [fly_seeds(policy.act, COMPARISON, scenario=scenario).total for policy in (untrained, best)]
    for name, values in zip(("untrained", "trained"), totals, strict=True):
        mean, half = interval(values)
        print(f"{name:10} return {mean:.3f} +- {half:.3f}")
    mean, half = interval(totals[1] - totals[0])
    print(
        f"difference on {len(COMPARISON)} paired seeds: {mean:.3f}, 95 % interval {mean - half:.3f} to {mean + half:.3f}"
    )


def _minutes(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = float("nan")
    if not 0.0 < value < float("inf"):
        raise argparse.ArgumentTypeError(f"{text!r}: must be a positive number")
    return value


def _whole(least: int, most: int | None = None) -> Callable[[str], int]:
    def whole(text: str) -> int:
        if not text.isdecimal() or int(text) < least or (most is not None and int(text) > most):
            limits = f"at least {least}" + ("" if most is None else f" and at most {most}")
            raise argparse.ArgumentTypeError(f"{text!r}: must be a whole number of {limits}")
        return int(text)

    return whole


def _write(file: Path, text: str) -> None:
    partial = file.with_suffix(".partial")
    partial.write_text(text, "utf-8")
    partial.replace(file)


if __name__ == "__main__":
    sys.exit(main())
