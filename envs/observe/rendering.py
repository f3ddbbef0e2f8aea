"""Pictures of episodes, each in its own light and with its own ways, and the window that shows them.

OpenGL and pygame are imported only when something is drawn.
"""

from __future__ import annotations

import os
import sys
from dataclasses import replace
from typing import Any

import numpy as np

from swarm_mj.errors import ObserverError
from swarm_mj.flight.plan import Plan
from swarm_mj.typing import Pixels

from ..arguments import nothing_to_draw
from ..batch_env import must_have_begun
from .draws import EpisodeDraw
from .episodes import Episodes
from .rewards import measures


def lit_plan(episodes: Episodes, e: int) -> Plan:
    """The plan of episode e, with the Sun that was drawn for it where it is at the arrival."""
    plan, sun = episodes.mission_of(e).plan, episodes.sun_of(e)
    return plan if sun is plan.environment.sun else replace(plan, environment=replace(plan.environment, sun=sun))


class _Picture:
    """The drawing of one episode; holds an OpenGL context until closed."""

    def __init__(self, episodes: Episodes, e: int, draw: EpisodeDraw, width: int, height: int) -> None:
        from swarm_mj.rendering.live import Trail, planned_path
        from swarm_mj.rendering.picture import Drawing

        mission, sheet = episodes.mission_of(e), episodes.sheet
        plan = lit_plan(episodes, e)
        self.draw, self._start_N = draw, plan.deployment.r0_N
        if mission.drawn_light:
            velocity = mission.velocity_N(draw.visiting_point, draw.altitude, draw.speed)
            times = np.linspace(0.0, mission.duration_s, 61)
            path_N = self._start_N + times[:, None, None] * np.where(sheet.present[e, :, None], velocity, 0.0)
        else:
            path_N = planned_path(plan)
        self._trail = Trail(plan)
        self._last_N = np.repeat(self._start_N[None], plan.n, axis=0)
        self._drawing = Drawing(plan, path_N, width=width, height=height)

    def at(self, episodes: Episodes, e: int) -> Pixels:
        """The episode as it stands."""
        from swarm_mj.rendering.frame import Instant

        totals, mission, now = episodes.totals, episodes.mission_of(e), episodes.now
        # Who is lost is shown where it was seen last.
        self._last_N = np.where(~totals.lost[e, :, None], now.r[e], self._last_N)
        t, (seen, sent) = float(now.t[e]), measures(totals, episodes.sheet)[e]
        instant = Instant(
            t=t,
            r_BN_N=self._last_N,
            C_BN=now.C_BN[e].copy(),
            C_AN=now.C_AN[e].copy(),
            kind=episodes.tracking.kind[e].copy(),
            tracked=episodes.tracking.spacecraft[e].copy(),
            link=None,
            seen=totals.seen[e, : mission.plan.region.n_cells],
            trail_N=self._trail.to(t, self._last_N),
            lost=totals.lost[e].copy(),
            note=f"seen {seen:.2f} + sent {sent:.2f} of the yardsticks",
        )
        picture: Pixels = self._drawing.draw(instant)
        return picture

    def close(self) -> None:
        """Release the OpenGL context."""
        self._drawing.close()


class EpisodeRenderer:
    """Draws the first `count` of some episodes, which it only reads, each in a picture of that size [px]."""

    def __init__(self, episodes: Episodes, count: int, width: int = 640, height: int = 480) -> None:
        self._episodes, self.count, self._size = episodes, count, (width, height)
        self._pictures: list[_Picture | None] = [None] * count

    def draw(self, e: int = 0) -> Pixels:
        """The overview of episode e, shape (height, width, 3).

        Raises:
            ObserverError: OpenGL cannot be loaded.
        """
        drawn, picture = self._episodes.draws[e], self._pictures[e]
        assert drawn is not None
        if picture is None or picture.draw is not drawn:
            if picture is not None:
                picture.close()
            picture = self._pictures[e] = _Picture(self._episodes, e, drawn, *self._size)
        return picture.at(self._episodes, e)

    def render(self, mode: str | None, begun: Any, name: str) -> list[Pixels] | None:
        """All that are drawn, with `render_mode="rgb_array"` or `"human"`; None and a warning without.

        Raises:
            gymnasium.error.ResetNeeded: There is nothing to draw before the first `reset`.
        """
        if nothing_to_draw(mode):
            return None
        must_have_begun(bool(np.all(begun)), "render", name)
        return [self.draw(e) for e in range(self.count)]

    def close(self) -> None:
        """Release the OpenGL contexts; may be called again."""
        for picture in self._pictures:
            if picture is not None:
                picture.close()
        self._pictures = [None] * self.count


class PygameWindow:
    """Shows pictures of one size [px], at most `fps` of them a second, by pygame.

    Raises:
        ObserverError: pygame is not installed, or there is no display.
    """

    def __init__(self, width: int, height: int, fps: float, title: str) -> None:
        try:
            import pygame
        except ImportError as error:
            raise ObserverError("render_mode 'human' needs pygame: pip install 'swarm_mj[rl]'") from error
        if not _display_exists():
            # Left to itself, SDL would take an offscreen driver that ends the OpenGL display which the pictures come from.
            raise ObserverError(
                "render_mode 'human' needs a display, and there is none; use render_mode='rgb_array', or set SDL_VIDEODRIVER"
            )
        self._pygame: Any = pygame
        pygame.display.init()
        try:
            self._surface = pygame.display.set_mode((width, height))
        except pygame.error as error:
            pygame.display.quit()
            raise ObserverError(
                f"render_mode 'human' cannot open a window ({error}); use render_mode='rgb_array'"
            ) from error
        pygame.display.set_caption(title)
        self._clock, self._fps = pygame.time.Clock(), fps

    def show(self, picture: Pixels) -> None:
        """Show a picture, shape (height, width, 3)."""
        self._pygame.event.pump()
        self._pygame.surfarray.blit_array(self._surface, picture.swapaxes(0, 1))
        self._pygame.display.flip()
        self._clock.tick(self._fps)

    def close(self) -> None:
        """Close the window."""
        self._pygame.display.quit()


def _display_exists() -> bool:
    named = any(os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY", "SDL_VIDEODRIVER"))
    return named or not sys.platform.startswith("linux")
