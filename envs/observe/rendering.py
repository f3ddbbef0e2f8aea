"""The picture of an episode, the overview of `swarm-mj video`, and the window that shows it.

OpenGL and pygame are imported only when something is drawn.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from swarm_mj.errors import ObserverError
from swarm_mj.typing import Array, Pixels

from .batch import EpisodeFlights

if TYPE_CHECKING:
    from swarm_mj.rendering.frame import Instant


class EpisodeRenderer:
    """Draws flights; holds one OpenGL context from the first picture until closed.

    Args:
        flights: Batches, which are only read, and numbers of flights in them; at least one.
        width: Of the picture [px].
        height: Of the picture [px].
    """

    def __init__(self, flights: Sequence[tuple[EpisodeFlights, int]], width: int, height: int) -> None:
        self._flights, self._size = list(flights), (width, height)
        self._drawing: Any = None
        self._trails: list[Any] = []

    @property
    def count(self) -> int:
        """Number of flights that are drawn."""
        return len(self._flights)

    def draw(self, k: int = 0) -> Pixels:
        """The overview of the k-th flight, shape (height, width, 3).

        Raises:
            ObserverError: OpenGL cannot be loaded.
        """
        if self._drawing is None:
            self._open()
        batch, e = self._flights[k]
        state = batch.swarm_state(e)
        picture: Pixels = self._drawing.draw(instant_of(batch, e, self._trails[k].to(state.t, state.r_BN_N)))
        return picture

    def _open(self) -> None:
        from swarm_mj.rendering.live import Trail, planned_path
        from swarm_mj.rendering.picture import Drawing

        plan, (width, height) = self._flights[0][0].task.plan, self._size
        self._trails = [Trail(plan) for _ in self._flights]
        self._drawing = Drawing(plan, planned_path(plan), width=width, height=height)

    def close(self) -> None:
        """Release the OpenGL context; may be called again."""
        if self._drawing is not None:
            self._drawing.close()
        self._drawing = None


def instant_of(batch: EpisodeFlights, e: int, trail_N: Array) -> Instant:
    """What there is to draw of flight e now, with the ways so far, shape (m, n, 3) [m]."""
    from swarm_mj.rendering.frame import Instant

    state = batch.swarm_state(e)
    return Instant(
        t=state.t,
        r_BN_N=state.r_BN_N,
        C_BN=state.C_BN,
        C_AN=state.C_AN,
        kind=batch.flights.kind[e].copy(),
        tracked=batch.flights.index[e].copy(),
        link=None,
        seen=batch.totals.seen[e],
        trail_N=trail_N,
        lost=batch.totals.lost[e].copy(),
    )


class Window:
    """Shows pictures of one size, at most so many a second, by pygame.

    Args:
        width: [px].
        height: [px].
        fps: Pictures a second at most.
        title: What the window is called.

    Raises:
        ObserverError: pygame is not installed, or there is no display.
    """

    def __init__(self, width: int, height: int, fps: float, title: str = "SwarmObserve-v0") -> None:
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
