"""SwarmDownlink-v0 as gymnasium's vector environment: many episodes at once, bit for bit those of single environments."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode

from swarm_mj.typing import Mask

from ..arguments import checked_count, checked_index, record_of
from ..autoreset import FlightsVectorEnv, Infos, checked_mode, one_of, put_infos
from ..snapshots import FlightState, RebuiltOnCopy, must_have_begun, restore_state, take_state
from .batch import DOWNLINK_ENDS, DownlinkBatch
from .config import DownlinkConfig, DownlinkWeights
from .single import NAME, choices_of, refuse_rendering
from .world import DownlinkTask


class SwarmDownlinkVectorEnv(RebuiltOnCopy, FlightsVectorEnv):
    """`num_envs` episodes of one mission; made by `gymnasium.make_vec("swarm_mj.envs:SwarmDownlink-v0", ...)`.

    Spaces, rewards and ends are those of `SwarmDownlinkEnv`, which documents them, and so are the numbers, bit for bit. Infos
    hold arrays over the episodes, with the mask of those to whom they apply under the same name with a leading underscore.

    Args:
        num_envs: Number of episodes.
        autoreset_mode: `NextStep`, `SameStep` or `Disabled`, see `SwarmObserveVectorEnv`.
        render_mode: None.
        arguments: The others of `SwarmDownlinkEnv`.
    """

    name = NAME

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
        count, mode = checked_count("num_envs", num_envs), checked_mode(autoreset_mode)
        self.render_mode, self.metadata = None, {"render_modes": [], "autoreset_mode": mode}
        self.task = DownlinkTask(record_of(DownlinkConfig, NAME, arguments))
        batch = DownlinkBatch(self.task, count)
        self._set_up(batch, mode, count, (batch.space, choices_of(self.task)))

    def _begin(self, flights: dict[int, int], given: Any) -> None:
        for e, seed in flights.items():
            self.batch.reset(e, seed)
        self.batch.observe()

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
        return one_of(self.batch.observation, k)

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

    def _ends(self, result: Any, live: Mask) -> Infos:
        terms = dict(zip(DownlinkWeights._fields, result.terms.T.copy(), strict=True))
        infos: Infos = {"reward_terms": terms, "_reward_terms": live}
        ended = {int(e): DOWNLINK_ENDS[result.end[e]] for e in np.flatnonzero(live & (result.end > 0))}
        put_infos(infos, "end", ended, self.num_envs)
        return infos

    def close_extras(self, **kwargs: Any) -> None:
        """Forget the episodes."""
        self._batch = None
