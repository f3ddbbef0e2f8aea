"""The picture of an episode, the overview of `swarm-mj video`, and the window that shows it.

OpenGL and pygame are imported only when something is drawn.
"""

from __future__ import annotations

import os
import sys
from typing import Any

from swarm_mj.errors import ObserverError
from swarm_mj.typing import Pixels

from .batch import EpisodeBatch


class EpisodeRenderer:
    """Draws flight 0 of a batch; holds one OpenGL context from the first picture until closed.

    Args:
        batch: The flights, which are only read.
        width: Of the picture [px].
        height: Of the picture [px].
    """

    def __init__(self, batch: EpisodeBatch, width: int, height: int) -> None:
        self._batch, self._size = batch, (width, height)
        self._drawing: Any = None
        self._trail: Any = None

    def draw(self) -> Pixels:
        """The overview, shape (height, width, 3).

        Raises:
            ObserverError: OpenGL cannot be loaded.
        """
        from swarm_mj.rendering.frame import Instant

        if self._drawing is None:
            self._open()
        batch, state = self._batch, self._batch.swarm_state(0)
        picture: Pixels = self._drawing.draw(
            Instant(
                t=state.t,
                r_BN_N=state.r_BN_N,
                C_BN=state.C_BN,
                C_AN=state.C_AN,
                kind=batch.flights.kind[0].copy(),
                tracked=batch.flights.index[0].copy(),
                link=None,
                seen=batch.totals.seen[0],
                trail_N=self._trail.to(state.t, state.r_BN_N),
                lost=batch.totals.lost[0].copy(),
            )
        )
        return picture

    def _open(self) -> None:
        from swarm_mj.rendering.live import Trail, planned_path
        from swarm_mj.rendering.picture import Drawing

        plan, (width, height) = self._batch.task.plan, self._size
        self._trail = Trail(plan)
        self._drawing = Drawing(plan, planned_path(plan), width=width, height=height)

    def close(self) -> None:
        """Release the OpenGL context; may be called again."""
        if self._drawing is not None:
            self._drawing.close()
        self._drawing = None


class Window:
    """Shows pictures of one size, at most so many a second, by pygame.

    Args:
        width: [px].
        height: [px].
        fps: Pictures a second at most.

    Raises:
        ObserverError: pygame is not installed, or there is no display.
    """

    def __init__(self, width: int, height: int, fps: float) -> None:
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
        pygame.display.set_caption("SwarmObserve-v0")
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
