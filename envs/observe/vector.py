"""SwarmObserve-v0 as gymnasium's vector environment: many episodes at once, bit for bit those of single environments."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from swarm_mj.typing import Mask, Pixels

from ..arguments import checked_count, checked_index, checked_render_mode, record_of
from ..autoreset import FlightsVectorEnv, Infos, checked_mode
from ..capacity import default_threads
from ..snapshots import FlightState, RebuiltOnCopy, must_have_begun, restore_state, take_state
from .config import EnvConfig
from .episodes import Episodes
from .rendering import EpisodeRenderer
from .single import NAME, refuse_graph


class SwarmObserveVectorEnv(RebuiltOnCopy, FlightsVectorEnv):
    """`num_envs` episodes; made by `gymnasium.make_vec("swarm_mj.envs:SwarmObserve-v0", ...)`.

    Spaces, rewards and ends are those of `SwarmObserveEnv`, which documents them, and so are the numbers: an episode is a
    function of its flight seed alone, whatever `num_envs` and `threads` are. Infos hold arrays over the flights, with the mask
    of those to whom they apply under the same name with a leading underscore.

    Args:
        num_envs: Number of episodes.
        autoreset_mode: `NextStep` (default, as gymnasium's own vector environments: an episode that ended is started anew by
            the next call of `step`, which ignores its action and gives reward 0), `SameStep` (it is started at once;
            `final_obs` and `final_info` hold the end) or `Disabled` (call `reset(options={"reset_mask": mask})`).
        threads: Most that are used; None for the cores that this process may use.
        render_mode: None or `"rgb_array"`.
        render_flights: How many episodes `render` shows, the first ones.
        arguments: The others of `SwarmObserveEnv`, except `width` and `height`.
    """

    name = NAME
    _own_options = ("draw",)

    def __init__(
        self,
        num_envs: int = 1,
        *,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        threads: int | None = None,
        render_mode: str | None = None,
        render_flights: int = 4,
        **arguments: Any,
    ) -> None:
        self.made_of = {"num_envs": num_envs, "autoreset_mode": autoreset_mode, "threads": threads}
        self.made_of |= {"render_mode": render_mode, "render_flights": render_flights, **arguments}
        count = checked_count("num_envs", num_envs)
        used = default_threads() if threads is None else checked_count("threads", threads, ", or None")
        self.render_mode = checked_render_mode(render_mode, ["rgb_array"])
        shown = min(count, checked_count("render_flights", render_flights))
        mode = checked_mode(autoreset_mode)
        self.metadata = {"render_modes": ["rgb_array"], "render_fps": 10, "autoreset_mode": mode}
        self.config = record_of(EnvConfig, NAME, arguments)
        refuse_graph(self.config)
        batch = Episodes(self.config, count, used)
        self._renderer = EpisodeRenderer(batch, shown)
        self._set_up(batch, mode, count, (batch.observation_space, batch.action_space))

    def _begin(self, flights: dict[int, int], given: Any) -> None:
        self.batch.reset(flights, given.get("draw"))

    def _infos(self, mask: Mask) -> Infos:
        values = self.batch.infos()
        return values | {f"_{name}": mask.copy() for name in values}

    def action_masks(self) -> NDArray[np.int8]:
        """`infos["action_mask"]` of now, shape (num_envs, n, C)."""
        return self.batch.action_mask.copy()

    def get_state(self, e: int) -> FlightState:
        """Where flight e stands; single and vector environments take each other's states."""
        k = checked_index(e, self.num_envs)
        must_have_begun(bool(self._begun[k]), "get_state", NAME)
        return take_state(self.batch, k, running=not self._over[k], random=self._random[k])

    def set_state(self, e: int, state: FlightState) -> Any:
        """Let flight e go on from a state; the others are left alone. Returns its observation."""
        k = checked_index(e, self.num_envs)
        self._over[k] = not restore_state(self.batch, k, self._random[k], state).running
        self._begun[k] = True
        return self.batch.observation_of(k)

    def _standing(self) -> dict[str, Any]:
        kept = {name: getattr(self, name) for name in ("spec", "action_space", "single_action_space", "_random")}
        _ = self.batch
        return {"kept": kept, "flights": {int(e): self.get_state(int(e)) for e in np.flatnonzero(self._begun)}}

    def _stand(self, standing: dict[str, Any]) -> None:
        self.__dict__.update(standing["kept"])
        for e, state in standing["flights"].items():
            self.set_state(e, state)

    def render(self) -> tuple[Pixels, ...] | None:
        """The overviews of the first `render_flights` episodes, see `SwarmObserveEnv.render`."""
        _ = self.batch
        pictures = self._renderer.render(self.render_mode, self._begun[: self._renderer.count], NAME)
        return None if pictures is None else tuple(pictures)

    def close_extras(self, **kwargs: Any) -> None:
        """End the threads and release observers and OpenGL contexts."""
        if self._batch is not None:
            self._renderer.close()
        super().close_extras(**kwargs)
