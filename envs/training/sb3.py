"""SwarmObserve-v0 and SwarmPointing-v0 as stable-baselines3's own VecEnv; needs the extra `rl`."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
from gymnasium import spaces
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from swarm_mj.errors import ScenarioError
from swarm_mj.typing import Array32, Mask

from ..observe.episodes import box
from ..observe.layout import local_rows
from ..observe.vector import SwarmObserveVectorEnv
from ..pointing.env import SwarmPointingVectorEnv

try:
    from stable_baselines3.common.vec_env.base_vec_env import (
        VecEnv,
        VecEnvIndices,
        VecEnvObs,
        VecEnvStepReturn,
        VecEnvWrapper,
    )
except ImportError as error:
    raise ImportError("environments of stable-baselines3 need it: pip install 'swarm_mj[rl]'") from error


class SwarmObserveVecEnv(VecEnv):
    """`SwarmObserveVectorEnv` with the conventions of stable-baselines3.

    A flight that ends is started anew at once. Its info then holds `terminal_observation`, `TimeLimit.truncated`, what the
    end of the flight told, and `episode` with return `r`, length `l` and time `t` as stable-baselines3's `Monitor` gives
    them. Rewards are float32.

    Args:
        num_envs: Number of flights.
        threads: Most that are used; None for the cores that this process may use.
        arguments: Those of `SwarmObserveEnv`, except `render_mode`.
    """

    def __init__(self, num_envs: int = 1, *, threads: int | None = None, **arguments: Any) -> None:
        self.vector = self._make(num_envs, threads, autoreset_mode=AutoresetMode.SAME_STEP, **arguments)
        self.render_mode = None
        super().__init__(num_envs, self.vector.single_observation_space, self.vector.single_action_space)
        self._actions: NDArray[Any] | None = None
        self._start = time.monotonic()
        self._return, self._length = np.zeros(num_envs), np.zeros(num_envs, np.int64)

    def _make(self, num_envs: int, threads: int | None, **arguments: Any) -> Any:
        return SwarmObserveVectorEnv(num_envs, threads=threads, **arguments)

    def reset(self) -> VecEnvObs:
        """Start all flights, from the seeds of `seed` if that was called since the last time."""
        if any(self._options):
            raise ScenarioError(
                f"options {self._options}: SwarmObserveVecEnv takes none; use the gymnasium environment"
            )
        observations, infos = self.vector.reset(seed=list(self._seeds))
        self.reset_infos = [_of_flight(infos, e) for e in range(self.num_envs)]
        self._return[:], self._length[:] = 0.0, 0
        self._reset_seeds()
        return observations

    def step_async(self, actions: NDArray[Any]) -> None:
        """Keep the actions for `step_wait`."""
        self._actions = actions

    def step_wait(self) -> VecEnvStepReturn:
        """Fly on for one step."""
        assert self._actions is not None, "call step_async first"
        observations, rewards, terminated, truncated, infos = self.vector.step(self._actions)
        done = terminated | truncated
        self._return += rewards
        self._length += 1
        listed = [
            self._info(infos, e, bool(done[e]), bool(truncated[e] and not terminated[e])) for e in range(len(done))
        ]
        self._return[done], self._length[done] = 0.0, 0
        return observations, rewards.astype(np.float32), done, listed

    def _info(self, infos: dict[str, Any], e: int, done: bool, truncated: bool) -> dict[str, Any]:
        if not done:
            return _of_flight(infos, e)
        info = _of_flight(infos["final_info"], e)
        self.reset_infos[e] = _of_flight({k: v for k, v in infos.items() if "final" not in k}, e)
        return info | {
            "terminal_observation": infos["final_obs"][e],
            "TimeLimit.truncated": truncated,
            "episode": self.episode(e),
        }

    def episode(self, e: int, more: float = 0.0) -> dict[str, float]:
        """What `Monitor` would tell of flight e if it ended now: return `r`, length `l`, seconds since the start `t`.

        A wrapper may add `more` to the return.
        """
        since = round(time.monotonic() - self._start, 6)
        return {"r": float(self._return[e]) + more, "l": int(self._length[e]), "t": since}

    def restart(self, mask: Mask) -> Array32:
        """Break off the flights of a mask, shape (num_envs,), and start them anew; the observations of all."""
        observations, infos = self.vector.reset(options={"reset_mask": mask})
        for e in np.flatnonzero(mask):
            self.reset_infos[e] = _of_flight(infos, int(e))
        self._return[mask], self._length[mask] = 0.0, 0
        return observations

    def close(self) -> None:
        """End the threads and release the observer; may be called again."""
        self.vector.close()

    def get_attr(self, attr_name: str, indices: VecEnvIndices = None) -> list[Any]:
        """An attribute of the vector environment, which all flights share; one entry for each flight asked for."""
        value = getattr(self, attr_name) if attr_name == "render_mode" else getattr(self.vector, attr_name)
        return [value for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: VecEnvIndices = None) -> None:
        """Set an attribute of the vector environment.

        Raises:
            ScenarioError: Only some of the flights are meant; they share everything that can be set.
        """
        if len(list(self._get_indices(indices))) != self.num_envs:
            raise ScenarioError(f"set_attr({attr_name!r}): flights share their attributes; leave indices out")
        setattr(self.vector, attr_name, value)

    def env_method(self, method_name: str, *args: Any, indices: VecEnvIndices = None, **kwargs: Any) -> list[Any]:
        """Call a method of the vector environment once; its answer, for each flight asked for.

        Of `action_masks`, which MaskablePPO calls, each flight has its own, shape (n, C).
        """
        answer = getattr(self.vector, method_name)(*args, **kwargs)
        own = method_name == "action_masks"
        return [answer[e] if own else answer for e in self._get_indices(indices)]

    def env_is_wrapped(self, wrapper_class: type[Any], indices: VecEnvIndices = None) -> list[bool]:
        """No flight is wrapped by itself; episodes are counted here, which is what `Monitor` is for."""
        from stable_baselines3.common.monitor import Monitor

        return [wrapper_class is Monitor for _ in self._get_indices(indices)]


class SwarmObserveSharedVecEnv(VecEnvWrapper):
    """Every spacecraft of every episode as one of stable-baselines3's environments, for one policy that flies them all.

    They stand episode by episode. An action is the choice of one spacecraft; its observation is that of an agent of
    `SwarmObserveParallelEnv`, worked out from the flat observation (`layout.local_rows`), which without candidates holds
    two columns of the patches only; rewards and ends are those of the episode. Who does not fly, or no more, has zeros in
    its own row, and its choices do nothing.

    Args:
        num_episodes: Number of episodes.
        threads: Most that are used; None for the cores that this process may use.
        arguments: Those of `SwarmObserveEnv`, except `render_mode` and `observation`.
    """

    def __init__(self, num_episodes: int = 1, *, threads: int | None = None, **arguments: Any) -> None:
        if "observation" in arguments:
            raise ScenarioError(
                f"observation = {arguments['observation']!r}: each spacecraft is shown its own rows here; leave it out"
            )
        team = SwarmObserveVecEnv(num_episodes, threads=threads, observation="flat", **arguments)
        self._layout, choices = team.vector.batch.layout, team.action_space.nvec
        self._n = len(choices)
        size = self._each(np.zeros((1, self._layout.size), np.float32)).shape[1]
        super().__init__(team, box(size), spaces.Discrete(choices[0]))
        self.num_envs = num_episodes * self._n

    def reset(self) -> VecEnvObs:
        """Start all episodes."""
        observations = self._each(np.asarray(self.venv.reset()))
        self.reset_infos = [info for info in self.venv.reset_infos for _ in range(self._n)]
        return observations

    def step_async(self, actions: NDArray[Any]) -> None:
        """Keep the choices, shape (num_envs,), for `step_wait`."""
        self.venv.step_async(actions.reshape(-1, self._n))

    def step_wait(self) -> VecEnvStepReturn:
        """Fly on for one step."""
        observations, rewards, dones, infos = self.venv.step_wait()
        told: list[dict[str, Any]] = []
        for info in infos:
            last = info.get("terminal_observation")
            own = [{}] * self._n if last is None else [{"terminal_observation": row} for row in self._each(last)]
            told += [info | one for one in own]
        n = self._n
        return self._each(np.asarray(observations)), rewards.repeat(n), dones.repeat(n), told

    def get_attr(self, attr_name: str, indices: VecEnvIndices = None) -> list[Any]:
        """An attribute of the vector environment, which all share; one entry for each spacecraft asked for."""
        return self.venv.get_attr(attr_name, 0) * len(list(self._get_indices(indices)))

    def env_method(self, method_name: str, *args: Any, indices: VecEnvIndices = None, **kwargs: Any) -> list[Any]:
        """Call a method of the vector environment; of `action_masks` each spacecraft has its own, shape (C,)."""
        asked = list(self._get_indices(indices))
        if method_name == "action_masks":
            masks = self.venv.env_method(method_name)
            return [masks[k // self._n][k % self._n] for k in asked]
        return self.venv.env_method(method_name, *args, indices=0, **kwargs) * len(asked)

    def env_is_wrapped(self, wrapper_class: type[Any], indices: VecEnvIndices = None) -> list[bool]:
        """Episodes are counted by the team's environment, which is what `Monitor` is for."""
        return self.venv.env_is_wrapped(wrapper_class, 0) * len(list(self._get_indices(indices)))

    def _each(self, flat: NDArray[Any]) -> Array32:
        """One row a spacecraft, from one row an episode."""
        rows = local_rows(self._layout.split(flat))
        return rows.reshape(-1, rows.shape[2])


class SwarmPointingVecEnv(SwarmObserveVecEnv):
    """`SwarmPointingVectorEnv` with the conventions of stable-baselines3, see `SwarmObserveVecEnv`.

    Args:
        num_envs: Number of spacecraft.
        arguments: Those of `SwarmPointingEnv`, except `render_mode`.
    """

    def _make(self, num_envs: int, threads: int | None, **arguments: Any) -> Any:
        return SwarmPointingVectorEnv(num_envs, **arguments)


def _of_flight(infos: dict[str, Any], e: int) -> dict[str, Any]:
    """What the vector environment's infos say about one flight, as the single environment would say it."""
    own: dict[str, Any] = {}
    for name, values in infos.items():
        if name.startswith("_") or not infos[f"_{name}"][e]:
            continue
        own[name] = (
            {key: float(row[e]) for key, row in values.items()} if isinstance(values, dict) else _plain(values[e])
        )
    return own


def _plain(value: Any) -> Any:
    return value.tolist() if isinstance(value, (np.ndarray, np.generic)) else value
