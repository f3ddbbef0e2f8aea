"""SwarmObserve-v0 as gymnasium's vector environment: many episodes at once, bit for bit those of single environments."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from swarm_mj.io.machine import usable_cores
from swarm_mj.typing import Pixels

from ..arguments import checked_count, checked_render_mode
from ..batch_env import BatchVectorEnv, vector_arguments
from .episodes import Episodes
from .rendering import EpisodeRenderer
from .rewards import ENDS, TERMS
from .single import NAME, config_of_one_agent


class SwarmObserveVectorEnv(BatchVectorEnv):
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

    name, terms, ends, own_options = NAME, TERMS, ENDS, ("draw",)

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
        count, mode = vector_arguments(num_envs, autoreset_mode)
        used = usable_cores() if threads is None else checked_count("threads", threads, ", or None")
        self.render_mode = checked_render_mode(render_mode, ["rgb_array"])
        shown = min(count, checked_count("render_flights", render_flights))
        self.config = config_of_one_agent(arguments)
        batch = Episodes(self.config, count, used)
        self._renderer = EpisodeRenderer(batch, shown)
        self._set_up(batch, mode, batch.action_space, render_fps=10)

    def action_masks(self) -> NDArray[np.int8]:
        """`infos["action_mask"]` of now, shape (num_envs, n, C)."""
        return self.batch.action_mask.copy()

    def render(self) -> tuple[Pixels, ...] | None:
        """The overviews of the first `render_flights` episodes, see `SwarmObserveEnv.render`."""
        _ = self.batch
        pictures = self._renderer.render(self.render_mode, self._begun[: self._renderer.count], NAME)
        return None if pictures is None else tuple(pictures)
