"""Training of an `ArrayPolicy` with PPO of stable-baselines3: imitation first, then PPO, with validation on the way.

The network first imitates the greedy rule for a few rounds, flying by itself while the rule says what it should have done
(DAgger, Ross, Gordon and Bagnell 2011); PPO (Schulman and others 2017) then goes on from there. Needs the extra `rl`.
"""

from __future__ import annotations

import csv
import time
from dataclasses import replace
from typing import Any

import numpy as np

from swarm_mj.errors import ScenarioError
from swarm_mj.io.atomic import atomic_file

from ..policies.evaluation import fly_seeds, interval
from ..policies.policy import greedy_actions, load_policy, save_policy
from .sb3 import SwarmObserveVecEnv
from .sb3_options import TrainingOptions
from .sb3_policy import SwarmActorCritic, VecPolicyFeatures, to_array_policy
from .sb3_state import TrainingState, read_state

try:
    import torch
    from stable_baselines3 import PPO
    from stable_baselines3.common.callbacks import BaseCallback
    from stable_baselines3.common.logger import configure
except ImportError as error:
    raise ImportError(f"training needs the extra rl ({error}): pip install 'swarm_mj[rl]'") from None

#: Discount; an episode has 150 steps, and the shaped reward comes at once.
GAMMA = 0.99
#: Seeds of the flights: training draws from the first on, validation and comparison have their own.
TRAINING, VALIDATION, COMPARISON = 1_000_000, range(2_000, 2_016), range(1_000, 1_020)
#: Steps of a flight in a round of PPO: to the horizon [s], for after it no picture of `eros-observe` counts any more. In the
#: last part of training, flights go on to their end.
STEPS, HORIZON_S, WHOLE_FLIGHTS = 75, 750.0, 0.9
#: PPO updates between two validations.
VALIDATE_EVERY = 10
#: Steps of a round of imitation, and passes over the data after it.
IMITATION_STEPS, EPOCHS = 150, 8
#: From the first to the last update.
LEARNING_RATE, ENTROPY = (1e-3, 1e-4), (6e-3, 3e-4)


class Training:
    """A policy in training; a context manager that closes its environment.

    Args:
        options: What to train and for how long; the time begins now.

    Attributes:
        options: What to train and for how long.
        untrained: The policy as it is before anything is learned.
        state: What training has come to.

    Raises:
        ScenarioError: No policy can be trained for the scenario, or there is no fitting checkpoint to resume from.
    """

    def __init__(self, options: TrainingOptions) -> None:
        torch.set_num_threads(1)
        self.options = options
        if options.resume and not options.checkpoint.exists():
            raise ScenarioError(f"--resume: there is no {options.checkpoint}; train without it first")
        self._venv = SwarmObserveVecEnv(options.num_envs, scenario=options.scenario)
        try:
            self._features = VecPolicyFeatures(self._venv, GAMMA)
            options.out.mkdir(parents=True, exist_ok=True)
            model = new_model(self._features, options.seed)
            self.untrained = to_array_policy(model.policy, self._venv, self._features.geometry)
            if options.resume:
                self._model, self.state = resumed(options, self._features)
            else:
                self._model, self.state = new_model(self._features, options.seed), TrainingState()
            # A model seeds its flights like itself; these are no others' seeds, and other ones after a resume.
            self._features.seed(TRAINING * (1 + options.seed) + self.state.steps)
            self._model.set_logger(configure(str(options.out / "log"), ["tensorboard"]))
            self._callback = TrainingCallback(options, self._features, self.state)
            self._callback.init_callback(self._model)
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> Training:
        """Itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close the environment."""
        self.close()

    def close(self) -> None:
        """End the threads of the environment and release its observer."""
        self._venv.close()

    def imitate(self) -> None:
        """Imitate the greedy rule, unless training goes on from a checkpoint.

        Nothing is written before it is over: a run that ends here leaves an earlier one in the folder as it is.
        """
        if not self.options.resume:
            imitate(self._model, self._features, self.options.imitate)
            self._callback.validate()
            self.state.start = self.state.best
            self._callback.keep()

    def learn(self) -> None:
        """Improve by PPO until the time is up; may be interrupted at any time."""
        # Time ends training, not the number of steps.
        self._model.learn(10**9, callback=self._callback, reset_num_timesteps=False)
        self._callback.validate()
        self._callback.keep()

    def compare(self) -> str:
        """Fly the best policy and the untrained one from the same seeds; the difference and what PPO has done for it."""
        best = load_policy(self.options.out / "policy.npz")
        policies = {"untrained": self.untrained, "trained": best}
        totals = {
            name: fly_seeds(policy, COMPARISON, scenario=self.options.scenario).total
            for name, policy in policies.items()
        }
        lines = []
        for name, values in totals.items():
            mean, half = interval(values)
            lines.append(f"{name:10} return {mean:.3f} +- {half:.3f}")
        mean, half = interval(totals["trained"] - totals["untrained"])
        low, high = mean - half, mean + half
        lines.append(f"difference on {len(COMPARISON)} paired seeds: {mean:.3f}, 95 % interval {low:.3f} to {high:.3f}")
        return "\n".join([*lines, self._callback.share_of_ppo()])


def new_model(features: VecPolicyFeatures, seed: int) -> PPO:
    """PPO around a network that knows nothing."""
    return PPO(
        SwarmActorCritic,
        features,
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
        seed=seed,
        device="cpu",
    )


def resumed(options: TrainingOptions, features: VecPolicyFeatures) -> tuple[PPO, TrainingState]:
    """Model and state of the checkpoint.

    Raises:
        ScenarioError: The checkpoint is of another swarm, or the state cannot be read.
    """
    try:
        model = PPO.load(options.checkpoint, features, device="cpu")
    except ValueError as error:
        raise ScenarioError(
            f"--resume with --scenario {options.scenario}: {options.checkpoint} does not fit: {error}"
        ) from None
    state, file, policy = TrainingState(), options.out / "state.json", options.out / "policy.npz"
    if file.exists():
        state = read_state(file)
    # Three files cannot be replaced at once: what each says of itself goes first.
    state.steps = model.num_timesteps
    state.best = load_policy(policy).about.get("validation_return", state.best) if policy.exists() else -np.inf
    return model, state


def imitate(model: PPO, features: VecPolicyFeatures, rounds: int) -> None:
    """Learn what the greedy rule would do where the network itself gets to; in the first round the rule flies."""
    policy = model.policy
    optimizer = torch.optim.Adam(policy.parameters(), lr=1e-3)
    seen: list[torch.Tensor] = []
    wanted: list[torch.Tensor] = []
    observed = np.asarray(features.reset())
    for turn in range(rounds):
        for _ in range(IMITATION_STEPS):
            expert = greedy_actions(observed, features.geometry)
            seen.append(torch.as_tensor(observed))
            wanted.append(torch.as_tensor(expert))
            action = expert if turn == 0 else model.predict(observed, deterministic=False)[0]
            observed, *_ = features.step(action)
        loss = _fit(policy, optimizer, torch.cat(seen), torch.cat(wanted))
        print(f"imitation {turn + 1} of {rounds}: loss {loss:.2f}", flush=True)


def _fit(policy: Any, optimizer: Any, seen: torch.Tensor, wanted: torch.Tensor) -> float:
    """Make wanted actions likely; returns the last loss."""
    for _ in range(EPOCHS):
        for rows in torch.randperm(len(seen)).split(256):
            loss = -policy.get_distribution(seen[rows]).log_prob(wanted[rows]).mean()
            optimizer.zero_grad()
            loss.backward()
            optimizer.step()
    return float(loss.item())


class TrainingCallback(BaseCallback):
    """Ends training in time; prints, validates and keeps the model after updates.

    Args:
        options: What to train and for how long; the time begins now.
        features: What the model learns from.
        state: What training has come to; written to.
    """

    def __init__(self, options: TrainingOptions, features: VecPolicyFeatures, state: TrainingState) -> None:
        super().__init__()
        self._folder, self._features, self._state = options.out, features, state
        self._new_curve, self._seconds = not options.resume, 60.0 * options.minutes
        self._start, self._before = time.monotonic(), state.seconds
        self._rollouts, self._returns, self._from = 0, np.zeros(0), state.steps

    @property
    def share(self) -> float:
        """How much of the time is over."""
        return min(1.0, (time.monotonic() - self._start) / self._seconds)

    @property
    def seconds(self) -> float:
        """Of training, in all."""
        return self._before + time.monotonic() - self._start

    def _on_step(self) -> bool:
        ended = [info["episode"]["r"] for info in self.locals["infos"] if "episode" in info]
        self._returns = np.append(self._returns, ended)[-2 * self._features.num_envs :]
        return self.share < 1.0

    def _on_rollout_start(self) -> None:
        """An update is over, or the first one has not begun."""
        left = 1.0 - self.share
        rate = LEARNING_RATE[1] + left * (LEARNING_RATE[0] - LEARNING_RATE[1])
        self.model.lr_schedule = lambda _: rate
        self._features.horizon_s = HORIZON_S if self.share < WHOLE_FLIGHTS else float("inf")
        self.model.ent_coef = ENTROPY[1] + left * (ENTROPY[0] - ENTROPY[1])
        if self._rollouts:
            self._write_curve()
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
            f"validation seeds: {self._state.start:.3f} before its first update, {self._state.best:.3f} at best"
        )

    def keep(self) -> None:
        """Write checkpoint and state; each takes the place of the old one only when it is whole."""
        self._state.steps, self._state.seconds = self.model.num_timesteps, self.seconds
        with atomic_file(self._folder / "checkpoint.zip") as partial, partial.open("wb") as file:
            self.model.save(file)
        self._state.write(self._folder / "state.json")

    def validate(self) -> None:
        """Fly the validation seeds with the likeliest actions; the best policy so far is written."""
        steps, venv = self.model.num_timesteps, self._features.venv
        policy = to_array_policy(self.model.policy, venv, self._features.geometry, steps=steps)
        flown = fly_seeds(policy, VALIDATION, scenario=venv.vector.batch.task.plan.scenario)
        mean, coverage = float(flown.total.mean()), float(flown.coverage_percent.mean())
        self._write_curve(mean, coverage)
        # Not by `record`, which would write it with the numbers of the next rollout.
        numbers = {"validation/return": mean, "validation/coverage_percent": coverage}
        for output in self.logger.output_formats:
            output.write(dict(numbers), {name: () for name in numbers}, steps)
        print(f"validation: return {mean:.3f}, coverage {coverage:.1f} %", flush=True)
        if mean > self._state.best:
            self._state.best = mean
            policy = replace(policy, about={**policy.about, "validation_return": mean})
            save_policy(self._folder / "policy.npz", policy)

    def _write_curve(self, *validation: float) -> None:
        """A line of the learning curve: after every update, with more after a validation."""
        curve = self._folder / "curve.csv"
        begins, self._new_curve = self._new_curve or not curve.exists(), False
        sampled = round(float(self._returns.mean()), 4) if len(self._returns) else float("nan")
        with curve.open("w" if begins else "a", newline="") as file:
            writer = csv.writer(file)
            if begins:
                writer.writerow(["steps", "seconds", "sampled_return", "validation_return", "coverage_percent"])
            known = [round(value, 4) for value in validation] or [float("nan")] * 2
            writer.writerow([self.model.num_timesteps, round(self.seconds, 1), sampled, *known])
