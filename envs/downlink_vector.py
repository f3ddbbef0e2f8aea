"""SwarmDownlink-v0 as gymnasium's vector environment: many episodes at once, bit for bit those of single environments."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from swarm_mj.typing import Array, Mask

from .actions import check_action
from .arguments import checked_count, checked_index, checked_options, first_seeds, flight_seed, flight_seeds
from .autoreset import checked_mask, checked_mode, put_infos
from .downlink import NAME, refuse_rendering
from .downlink_batch import DOWNLINK_ENDS, DownlinkBatch, DownlinkResult
from .downlink_config import DownlinkConfig, DownlinkWeights
from .downlink_world import DownlinkTask
from .snapshots import FlightState, RebuiltOnCopy, must_have_begun, restore_state, take_state

Infos = dict[str, Any]


class SwarmDownlinkVectorEnv(RebuiltOnCopy, VectorEnv[Any, Any, Any]):
    """`num_envs` episodes of one mission; made by `gymnasium.make_vec("swarm_mj:SwarmDownlink-v0", ...)`.

    Spaces, rewards and ends are those of `SwarmDownlinkEnv`, which documents them, and so are the numbers, bit for bit. Infos
    hold arrays over the episodes, with the mask of those to whom they apply under the same name with a leading underscore.

    Args:
        num_envs: Number of episodes.
        autoreset_mode: `NextStep`, `SameStep` or `Disabled`, see `SwarmObserveVectorEnv`.
        render_mode: None.
        arguments: The others of `SwarmDownlinkEnv`.
    """

    def __init__(
        self,
        num_envs: int = 1,
        *,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        render_mode: str | None = None,
        **arguments: Any,
    ) -> None:
        refuse_rendering(render_mode)
        self.made_of = {"num_envs": num_envs, "autoreset_mode": autoreset_mode, **arguments}
        self.num_envs, self.autoreset_mode = checked_count("num_envs", num_envs), checked_mode(autoreset_mode)
        self.render_mode = None
        self.metadata = {"render_modes": [], "autoreset_mode": self.autoreset_mode}
        self.task = DownlinkTask(DownlinkConfig(**arguments))
        self.batch = DownlinkBatch(self.task, num_envs)
        self.single_observation_space = self.batch.space
        self.single_action_space = spaces.MultiDiscrete(np.full(self.task.n, self.task.n + 2))
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._random = [seeding.np_random()[0] for _ in range(num_envs)]
        self._over, self._begun = np.zeros(num_envs, np.bool_), np.zeros(num_envs, np.bool_)

    def reset(
        self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, Infos]:
        """Start all episodes, or those of `options["reset_mask"]`; arguments as of `SwarmObserveVectorEnv.reset`."""
        given = checked_options(options)
        mask = checked_mask(given.pop("reset_mask", None), self.num_envs)
        for e, own in enumerate(first_seeds(seed, self.num_envs)):
            if own is not None and mask[e]:
                self._random[e] = seeding.np_random(own)[0]
        chosen = flight_seeds(given.pop("flight_seed", None), self.num_envs)
        began = self._begin(mask, given, chosen)
        infos = self._infos(mask)
        put_infos(infos, "flight_seed", began, self.num_envs)
        return self.batch.observation, infos

    def _begin(self, which: Mask, given: dict[str, Any], chosen: list[Any]) -> dict[int, int]:
        """Start these episodes; returns their flight seeds."""
        began: dict[int, int] = {}
        for e in np.flatnonzero(which).tolist():
            wanted = {} if chosen[e] is None else {"flight_seed": chosen[e]}
            began[e] = flight_seed(given | wanted, int(self._random[e].integers(2**31)))
            self.batch.reset(e, began[e])
        self._over[which], self._begun[which] = False, True
        self.batch.observe()
        return began

    def step(self, actions: NDArray[Any]) -> tuple[Any, Array, Mask, Mask, Infos]:
        """Fly a slot, actions of shape (num_envs, n).

        Raises:
            gymnasium.error.InvalidAction: The actions do not lie in the action space.
            gymnasium.error.ResetNeeded: An episode was never begun, or with autoreset disabled one is over.
        """
        if not self._begun.all() or (self.autoreset_mode is AutoresetMode.DISABLED and self._over.any()):
            raise gymnasium.error.ResetNeeded(f"{NAME}: an episode is over or has not begun; call reset first")
        array, nobody = check_action(self.action_space, actions), [None] * self.num_envs
        restarts = self.autoreset_mode is AutoresetMode.NEXT_STEP and bool(self._over.any())
        live = ~self._over if restarts else np.ones(self.num_envs, np.bool_)
        began = self._begin(self._over.copy(), {}, nobody) if restarts else {}
        result = self.batch.step(array, live)
        terminated, truncated = (result.end > 0) & live, result.truncated & live
        infos = self._infos(np.ones(self.num_envs, np.bool_)) | self._ends(result, live)
        observations: Any = self.batch.observation
        self._over = terminated | truncated
        if self.autoreset_mode is AutoresetMode.SAME_STEP and self._over.any():
            observations, infos, began = self._restart_at_once(observations, infos)
        put_infos(infos, "flight_seed", began, self.num_envs)
        return observations, np.where(live, result.reward, 0.0), terminated, truncated, infos

    def _restart_at_once(self, last: Any, infos: Infos) -> tuple[Any, Infos, dict[int, int]]:
        over, final_obs = self._over.copy(), np.full(self.num_envs, None, dtype=object)
        for e in np.flatnonzero(over):
            final_obs[e] = (
                {name: table[e] for name, table in last.items()} if isinstance(last, dict) else last[e].copy()
            )
        began = self._begin(over, {}, [None] * self.num_envs)
        fresh = self._infos(np.ones(self.num_envs, np.bool_))
        fresh |= {"reward_terms": infos["reward_terms"], "_reward_terms": infos["_reward_terms"] & ~over}
        fresh |= {"final_obs": final_obs, "_final_obs": over, "final_info": infos, "_final_info": over}
        return self.batch.observation, fresh, began

    def get_state(self, e: int) -> FlightState:
        """Where episode e stands; single and vector environments take each other's states."""
        k = checked_index(e, self.num_envs)
        must_have_begun(bool(self._begun[k]), "get_state", NAME)
        return take_state(self.batch, k, running=not self._over[k], random=self._random[k])

    def set_state(self, e: int, state: FlightState) -> Any:
        """Let episode e go on from a state; returns its observation."""
        k = checked_index(e, self.num_envs)
        self._over[k] = not restore_state(self.batch, k, self._random[k], state).running
        self._begun[k] = True
        observation = self.batch.observation
        return (
            {name: table[k] for name, table in observation.items()} if isinstance(observation, dict) else observation[k]
        )

    def _standing(self) -> dict[str, Any]:
        kept = {name: getattr(self, name) for name in ("spec", "action_space", "single_action_space", "_random")}
        return {"kept": kept, "flights": {int(e): self.get_state(int(e)) for e in np.flatnonzero(self._begun)}}

    def _stand(self, standing: dict[str, Any]) -> None:
        self.__dict__.update(standing["kept"])
        for e, state in standing["flights"].items():
            self.set_state(e, state)

    def _infos(self, mask: Mask) -> Infos:
        values = self.batch.infos()
        return values | {f"_{name}": mask.copy() for name in values}

    def _ends(self, result: DownlinkResult, live: Mask) -> Infos:
        terms = dict(zip(DownlinkWeights._fields, result.terms.T.copy(), strict=True))
        infos: Infos = {"reward_terms": terms, "_reward_terms": live}
        ended = {int(e): DOWNLINK_ENDS[result.end[e]] for e in np.flatnonzero(live & (result.end > 0))}
        put_infos(infos, "end", ended, self.num_envs)
        return infos
