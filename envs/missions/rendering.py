"""Pictures of episodes of SwarmObserve-v1: each in its own light, with its own ways, and what it has come to so far."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import gymnasium
import numpy as np

from swarm_mj.smallbody.environment import LinearMotion
from swarm_mj.typing import Pixels

from ..observe.rendering import instant_of
from .draws import EpisodeDraw
from .episodes import Episodes
from .flights import MissionFlights
from .mission import DURATION_S, TIME_OF_FLIGHT_S
from .reach import FAR


class _Picture:
    """The drawing of one episode; holds an OpenGL context until closed."""

    def __init__(self, batch: MissionFlights, k: int, draw: EpisodeDraw, width: int, height: int) -> None:
        from swarm_mj.rendering.live import Trail
        from swarm_mj.rendering.picture import Drawing

        plan, sheet = batch.task.plan, batch.sheet
        visit_s = TIME_OF_FLIGHT_S / draw.speed
        sun_N = sheet.sun_A[k] @ plan.environment.C_AN(visit_s) * FAR * plan.shape.max_radius
        environment = replace(plan.environment, sun=LinearMotion(sun_N, np.zeros(3)))
        self.draw, self._start_N = draw, plan.deployment.r0_N
        plan = replace(plan, environment=environment)
        velocity = batch.mission.velocity_N(draw.visiting_point, draw.altitude, draw.speed)
        times = np.linspace(0.0, DURATION_S, 61)
        path_N = self._start_N + times[:, None, None] * np.where(sheet.present[k, :, None], velocity, 0.0)
        self._trail = Trail(plan)
        self._last_N = np.repeat(self._start_N[None], plan.n, axis=0)
        self._drawing = Drawing(plan, path_N, width=width, height=height)

    def at(self, batch: MissionFlights, k: int) -> Pixels:
        """The episode as it stands."""
        totals, sheet, task = batch.totals, batch.sheet, batch.task
        flies = ~totals.lost[k]
        self._last_N = np.where(flies[:, None], batch.now.r[k], self._last_N)
        possible = float(sheet.possible_area[k])
        seen = float(totals.area[k]) / possible
        sent = float(totals.delivered[k]) * task.plan.region.total_area / (task.nominal_bit * possible)
        now = instant_of(batch, k, self._trail.to(float(batch.time_s[k]), self._last_N))
        now = replace(
            now,
            r_BN_N=self._last_N,
            seen=totals.first_by[k] >= 0,  # what lies in the dark counts as seen from the start
            note=f"seen {seen:.2f} + sent {sent:.2f} of what is possible",
        )
        picture: Pixels = self._drawing.draw(now)
        return picture

    def close(self) -> None:
        """Release the OpenGL context."""
        self._drawing.close()


class MissionRenderer:
    """Draws the first episodes of some.

    Args:
        episodes: Which; they are only read.
        count: How many are drawn.
        width: Of a picture [px].
        height: Of a picture [px].
    """

    def __init__(self, episodes: Episodes, count: int, width: int = 640, height: int = 480) -> None:
        self._episodes, self.count, self._size = episodes, count, (width, height)
        self._pictures: list[_Picture | None] = [None] * count

    def draw(self, e: int = 0) -> Pixels:
        """The overview of episode e, shape (height, width, 3).

        Raises:
            ObserverError: OpenGL cannot be loaded.
        """
        batch, k = self._episodes.locate(e)
        drawn, picture = self._episodes.draws[e], self._pictures[e]
        assert drawn is not None
        if picture is None or picture.draw is not drawn:
            if picture is not None:
                picture.close()
            picture = self._pictures[e] = _Picture(batch, k, drawn, *self._size)
        return picture.at(batch, k)

    def render(self, mode: str | None, begun: Any, name: str) -> list[Pixels] | None:
        """All that are drawn, with `render_mode="rgb_array"` or `"human"`; None and a warning without.

        Raises:
            gymnasium.error.ResetNeeded: There is nothing to draw before the first `reset`.
        """
        if mode is None:
            gymnasium.logger.warn("render() draws nothing: make the environment with render_mode='rgb_array'")
            return None
        if not np.all(begun):
            raise gymnasium.error.ResetNeeded(f"{name}: call reset before render")
        return [self.draw(e) for e in range(self.count)]

    def close(self) -> None:
        """Release the OpenGL contexts; may be called again."""
        for picture in self._pictures:
            if picture is not None:
                picture.close()
        self._pictures = [None] * self.count
