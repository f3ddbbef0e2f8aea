"""SwarmObserve-v0 as gymnasium's vector environment: many flights at once, bit for bit those of single environments."""

from __future__ import annotations

from typing import Any, ClassVar

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode

from swarm_mj.typing import Array32, Mask, Pixels

from ..arguments import checked_count, checked_index, checked_render_mode, refuse_graph
from ..autoreset import FlightsVectorEnv, Infos, checked_mode
from ..snapshots import FlightState, RebuiltOnCopy, must_have_begun, restore_state, take_state
from ..threads import ThreadedBatch, default_threads
from .rendering import EpisodeRenderer
from .task import make_task


class SwarmObserveVectorEnv(RebuiltOnCopy, FlightsVectorEnv):
    """`num_envs` flights of one scenario; made by `gymnasium.make_vec("swarm_mj.envs:SwarmObserve-v0", ...)`.

    Spaces, rewards and episode ends are those of `SwarmObserveEnv`, which documents them, and so are the numbers: with the
    same seeds every flight is bit for bit that of the single environment, whatever `num_envs` and `threads` are.

    Infos hold arrays over the flights, with the mask of those to whom they apply under the same name with a leading
    underscore: `time_s`, `coverage_percent`, `delivered_bit`, `stored_bit` (num_envs, n), `seen_bit`, `lost_bit`,
    `reward_terms` (a dict of arrays), `flight_seed` where a flight began, `end` (text) where one ended by itself, and `cause`
    where one diverged.

    Args:
        num_envs: Number of flights.
        autoreset_mode: `NextStep` (default, as gymnasium's own vector environments: a flight that ended is started anew by the
            next call of `step`, which ignores its action and gives reward 0), `SameStep` (it is started at once; `final_obs`
            and `final_info` hold the end) or `Disabled` (call `reset(options={"reset_mask": mask})`).
        threads: Most that are used; None for the cores that this process may use.
        render_mode: None or `"rgb_array"`.
        render_flights: How many flights `render` shows, the first ones.
        arguments: The others of `SwarmObserveEnv`, except `width` and `height`.
    """

    name = "SwarmObserve-v0"
    #: Whether a flight goes on without the spacecraft that hit the body.
    continues_after_impact: ClassVar[bool] = False

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
        self.made_of = {"num_envs": num_envs, "autoreset_mode": autoreset_mode, "threads": threads, **arguments}
        num_envs = checked_count("num_envs", num_envs)
        if threads is not None:
            threads = checked_count("threads", threads, ", or None")
        self.made_of |= {"render_mode": render_mode, "render_flights": render_flights}
        self.render_mode = checked_render_mode(render_mode, ["rgb_array"])
        shown = min(num_envs, checked_count("render_flights", render_flights))
        mode = checked_mode(autoreset_mode)
        self.metadata = {"render_modes": ["rgb_array"], "render_fps": 10, "autoreset_mode": mode}
        task = make_task(**arguments)
        refuse_graph(task.config.observability)
        used = default_threads() if threads is None else threads
        batch = ThreadedBatch(task, num_envs, used, continues_after_impact=self.continues_after_impact)
        self._renderer = EpisodeRenderer([batch.locate(e) for e in range(shown)], 640, 480)
        action_space = batch.batches[0].level.action_space
        self._set_up(batch, mode, num_envs, (task.observation_layout.space, action_space))

    def get_state(self, e: int) -> FlightState:
        """Where flight e stands, see `SwarmObserveEnv.get_state`; single and vector environments take each other's states."""
        batch, k = self.batch.locate(checked_index(e, self.num_envs))
        must_have_begun(bool(self._begun[e]), "get_state", self.name)
        return take_state(batch, k, running=not self._over[e], random=self._random[e])

    def set_state(self, e: int, state: FlightState) -> Array32:
        """Let flight e go on from a state, see `SwarmObserveEnv.set_state`; the others are left alone.

        Returns:
            Its observation, shape (F,).
        """
        batch, k = self.batch.locate(checked_index(e, self.num_envs))
        self._over[e] = not restore_state(batch, k, self._random[e], state).running
        self._begun[e] = True
        return batch.observation[k].copy()

    def _standing(self) -> dict[str, Any]:
        kept = {name: getattr(self, name) for name in ("spec", "action_space", "single_action_space", "_random")}
        _ = self.batch
        return {"kept": kept, "flights": {int(e): self.get_state(int(e)) for e in np.flatnonzero(self._begun)}}

    def _stand(self, standing: dict[str, Any]) -> None:
        self.__dict__.update(standing["kept"])
        for e, state in standing["flights"].items():
            self.set_state(e, state)

    def _infos(self, mask: Mask) -> Infos:
        batch = self.batch
        values = {
            "time_s": batch.gather(lambda part: part.time_s),
            "coverage_percent": batch.gather(lambda part: part.totals.percent),
            "delivered_bit": batch.gather(lambda part: part.totals.delivered),
            "stored_bit": batch.gather(lambda part: part.totals.stored),
            "seen_bit": batch.gather(lambda part: part.totals.seen_bit),
            "lost_bit": batch.gather(lambda part: part.totals.lost_bit),
        }
        return values | {f"_{name}": mask.copy() for name in values}

    def render(self) -> tuple[Pixels, ...] | None:
        """The overviews of the first `render_flights` flights, see `SwarmObserveEnv.render`, with `render_mode="rgb_array"`."""
        if self.render_mode is None:
            gymnasium.logger.warn("render() draws nothing: make the environment with render_mode='rgb_array'")
            return None
        _ = self.batch
        must_have_begun(bool(self._begun[: self._renderer.count].all()), "render", self.name)
        return tuple(self._renderer.draw(k) for k in range(self._renderer.count))

    def close_extras(self, **kwargs: Any) -> None:
        """End the threads and release the observer."""
        if self._batch is not None:
            self._renderer.close()
        super().close_extras(**kwargs)
