"""A window for `render_mode="human"`, by pygame, which is imported only here."""

from __future__ import annotations

import os
import sys
from typing import Any

from swarm_mj.errors import ObserverError
from swarm_mj.typing import Pixels


def _display_exists() -> bool:
    named = any(os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY", "SDL_VIDEODRIVER"))
    return named or not sys.platform.startswith("linux")


class Window:
    """Shows pictures of one size, at most so many a second.

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
