"""Offscreen OpenGL: several views of the drawing's model side by side in one picture."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from typing import Any, NamedTuple

import mujoco
import numpy as np

from swarm_mj.errors import ObserverError
from swarm_mj.observation.gl_context import check_fork, own_context
from swarm_mj.rendering.decorations import NextGeom
from swarm_mj.rendering.model import BODY_GROUP, SPACECRAFT_GROUP, DrawingModel
from swarm_mj.typing import Array, Mask, Pixels

#: Sizes that can be drawn and encoded [pixel].
LEAST_SIDE, MOST_SIDE = 64, 8192
#: Most geoms in a scene; what is beyond is left out.
MAX_GEOMS = 20_000


class Box(NamedTuple):
    """A part of the picture [pixel], from its left upper corner."""

    left: int
    top: int
    width: int
    height: int


class Projection(NamedTuple):
    """From N into a part of the picture.

    Attributes:
        position: Of the camera in N, shape (3,) [m].
        axes: Unit vectors right, up and forward, as rows, shape (3, 3).
        scale: Pixels to the right and upwards for a tangent of 1, shape (2,).
        box: Where the view stands in the picture.
    """

    position: Array
    axes: Array
    scale: Array
    box: Box

    def place(self, points_N: Array) -> tuple[Array, Mask]:
        """Pixels (right, down) of points (n, 3) [m], shape (n, 2), and which lie inside the view, shape (n,)."""
        right, up, forward = np.moveaxis((points_N - self.position) @ self.axes.T, -1, 0)
        ahead = np.where(forward > 0.0, forward, np.nan)
        box = self.box
        x = box.left + 0.5 * box.width + self.scale[0] * right / ahead
        y = box.top + 0.5 * box.height - self.scale[1] * up / ahead
        with np.errstate(invalid="ignore"):
            inside = (x >= box.left) & (x < box.left + box.width) & (y >= box.top) & (y < box.top + box.height)
        return np.stack((x, y), axis=-1), inside


def _gl_context(width: int, height: int) -> Any:
    """An OpenGL context without a window: by EGL on Linux, unless MUJOCO_GL asks for another."""
    if sys.platform == "linux" and not os.environ.get("MUJOCO_GL"):
        # MuJoCo's own choice, made when it was imported, would be a hidden window, which needs a display.
        from mujoco.egl import GLContext
    else:
        from mujoco import GLContext
    return GLContext(width, height)


class Canvas:
    """Draws a model into pictures of some width and height [pixel]; holds one OpenGL context until closed.

    Raises:
        ObserverError: OpenGL cannot be loaded here, or this process was forked from one that has used it.
    """

    def __init__(self, model: DrawingModel, width: int, height: int) -> None:
        self.model, self.width, self.height = model, width, height
        self._gl: Any = None
        self._context: Any = None
        check_fork()
        try:
            self._gl = _gl_context(width, height)
            self._owner = own_context()
            self._gl.make_current()
            self._context = mujoco.MjrContext(model.mjmodel, mujoco.mjtFontScale.mjFONTSCALE_100)
        except Exception as error:  # whatever the platform's OpenGL loader raises
            self.close()
            raise ObserverError(
                f"pictures need OpenGL, which cannot be loaded here ({type(error).__name__}: {error}); "
                "on Debian or Ubuntu install it with `apt-get install libegl1 libgl1`"
            ) from error
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, self._context)
        self._scene = mujoco.MjvScene(model.mjmodel, MAX_GEOMS)
        self._geoms = self._scene.geoms
        self._options = mujoco.MjvOption()
        self._pixels = np.zeros((height, width, 3), np.uint8)

    def upload(self) -> None:
        """Show what the model's texture holds now."""
        self._make_current()
        mujoco.mjr_uploadTexture(self.model.mjmodel, self._context, self.model.texture)

    def clear(self) -> None:
        """Begin a picture."""
        self._make_current()
        mujoco.mjr_rectangle(mujoco.MjrRect(0, 0, self.width, self.height), 0.0, 0.0, 0.0, 1.0)

    def view(
        self,
        camera: mujoco.MjvCamera,
        box: Box,
        *,
        spacecraft: bool = True,
        decorate: Callable[[NextGeom], None] | None = None,
    ) -> Projection:
        """Draw one view into a part of the picture, with or without spacecraft; `decorate` adds further geoms to the scene."""
        self._options.geomgroup[:] = 0
        self._options.geomgroup[BODY_GROUP], self._options.geomgroup[SPACECRAFT_GROUP] = 1, spacecraft
        drawn, everything = self.model, mujoco.mjtCatBit.mjCAT_ALL
        mujoco.mjv_updateScene(drawn.mjmodel, drawn.data, self._options, None, camera, everything, self._scene)
        if decorate is not None:
            decorate(self._next_geom)
        rect = mujoco.MjrRect(box.left, self.height - box.top - box.height, box.width, box.height)
        mujoco.mjr_render(rect, self._scene, self._context)
        return self._projection(box)

    def read(self) -> Pixels:
        """The picture, shape (height, width, 3)."""
        mujoco.mjr_readPixels(self._pixels, None, mujoco.MjrRect(0, 0, self.width, self.height), self._context)
        return np.ascontiguousarray(self._pixels[::-1])

    def close(self) -> None:
        """Release the OpenGL context; may be called again. In another thread or process the end of the owner does so."""
        if self._gl is not None and self._owner.is_here():
            if self._context is not None:
                self._make_current()
                self._context.free()
            self._gl.free()
        self._context = self._gl = None

    def _make_current(self) -> None:
        # Other contexts of this thread (face-ID buffers) may have been used since.
        if self._gl is None:
            raise ObserverError("this drawing was closed; make a new one")
        self._owner.check()
        self._gl.make_current()

    def _next_geom(self) -> mujoco.MjvGeom | None:
        if self._scene.ngeom >= self._scene.maxgeom:
            return None
        self._scene.ngeom += 1
        return self._geoms[self._scene.ngeom - 1]

    def _projection(self, box: Box) -> Projection:
        left, right = self._scene.camera
        up, forward = np.array(left.up, float), np.array(left.forward, float)
        tangent = 0.5 * (left.frustum_top - left.frustum_bottom) / left.frustum_near
        axes, position = np.array([np.cross(forward, up), up, forward]), np.array(left.pos, float)
        return Projection(
            0.5 * (position + np.array(right.pos, float)), axes, np.full(2, 0.5 * box.height / tangent), box
        )
