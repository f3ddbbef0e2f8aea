"""The OpenGL context of this process, one, made at first use, without a window; and face-ID buffers drawn in it.

An OpenGL context belongs to the thread that made it and does not survive a fork: forked children hang in the driver.
Both are turned into an `ObserverError` here. Other libraries (MuJoCo's renderer) make their own contexts current on the
same thread, so that ours must be made current again before every use: always go through `current_context`.
"""

from __future__ import annotations

import os
import sys
import threading
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from swarm_mj.errors import ObserverError
from swarm_mj.observation.camera import CameraModel, CameraPose
from swarm_mj.observation.projection import PictureWindow
from swarm_mj.typing import Array

#: Without a display server Linux needs EGL; the sonames, because the unversioned links belong to development packages.
_PLATFORM_SETTINGS: Final[dict[str, Any]] = (
    dict(backend="egl", libgl="libGL.so.1", libegl="libEGL.so.1") if sys.platform == "linux" else {}
)
_INSTALL_HINT: Final = "on Debian or Ubuntu install it with `apt-get install libegl1 libgl1`"


@dataclass(frozen=True)
class ContextOwner:
    """The process and thread that an OpenGL context belongs to."""

    pid: int = field(default_factory=os.getpid)
    thread: int = field(default_factory=threading.get_ident)

    def check(self) -> None:
        """Raise an `ObserverError` in any other process or thread."""
        self.check_process()
        if self.thread != threading.get_ident():
            raise ObserverError(
                "the OpenGL context belongs to another thread of this process: observe and draw from the thread that did "
                "so first, use one process per worker (spawn), or use the raycast observer"
            )

    def check_process(self) -> None:
        """Raise an `ObserverError` in a forked child."""
        if self.pid != os.getpid():
            raise ObserverError(
                f"process {os.getpid()} was forked from {self.pid} after that made its OpenGL context, which a fork "
                "cannot share: start workers with multiprocessing.get_context('spawn'), or use the raycast observer"
            )

    def is_here(self) -> bool:
        """Whether the caller may use the context."""
        return self.pid == os.getpid() and self.thread == threading.get_ident()


class _Slot:
    """The one place where the process keeps its context; OpenGL itself leaves no choice but a global."""

    context: Any = None
    owner: ContextOwner | None = None
    failure: str | None = None
    #: Who made the first context of any kind in this process or in one that it was forked from.
    first: ContextOwner | None = None


def check_fork() -> None:
    """Refuse to make an OpenGL context in a forked child of a process that has made one: the driver would hang.

    Raises:
        ObserverError: This is such a child.
    """
    if _Slot.first is not None:
        _Slot.first.check_process()


def own_context() -> ContextOwner:
    """To be called when an OpenGL context has been made: its owner."""
    owner = ContextOwner()
    _Slot.first = _Slot.first or owner
    return owner


def current_context() -> Any:
    """The process's moderngl context, made at the first call, and current on the calling thread.

    Raises:
        ObserverError: OpenGL cannot be loaded, or the caller is a forked child or another thread.
    """
    check_fork()
    if _Slot.owner is not None:
        _Slot.owner.check()
    if _Slot.context is None:
        if _Slot.failure is None:
            _create()
        if _Slot.failure is not None:
            raise ObserverError(_Slot.failure)
    _Slot.context.__enter__()
    return _Slot.context


def gl_available() -> tuple[bool, str]:
    """Whether face-ID buffers can be drawn here, and the renderer's name or the reason why not.

    Makes the context of this process; do not fork afterwards.
    """
    try:
        return True, str(current_context().info["GL_RENDERER"])
    except ObserverError as error:
        return False, str(error)


def may_release(context: Any) -> bool:
    """Whether GL objects of `context` can be deleted by the caller; elsewhere their process's end frees them."""
    if sys.is_finalizing() or _Slot.owner is None or context is not _Slot.context:
        return False
    return _Slot.owner.is_here()


def _create() -> None:
    try:
        import moderngl

        context = moderngl.create_context(require=330, standalone=True, **_PLATFORM_SETTINGS)
    except Exception as error:  # moderngl raises plain Exception, and each driver its own
        reason = str(error).strip() or type(error).__name__
        _Slot.failure = f"OpenGL 3.3 cannot be loaded ({reason}); {_INSTALL_HINT}, or use the raycast observer"
        return
    _Slot.context, _Slot.owner = context, own_context()


#: Nearest depth drawn over the farthest; bounds the loss of depth precision (24 bits) close to the body.
MIN_DEPTH_RATIO = 1e-3

# A discard keeps a driver from testing depths early: only the picture of a cone needs it, and where it is.
_SQUARE_SHADERS = (
    """
#version 330
uniform mat4 clip_from_mesh;
in vec3 position;
void main() {
    gl_Position = clip_from_mesh * vec4(position, 1.0);
}
""",
    """
#version 330
out uint face;
void main() {
    face = uint(gl_PrimitiveID) + 1u;
}
""",
)
_CONE_SHADERS = (
    """
#version 330
uniform mat4 clip_from_mesh;
uniform mat4 picture_from_mesh;
in vec3 position;
out vec3 picture;
void main() {
    gl_Position = clip_from_mesh * vec4(position, 1.0);
    picture = (picture_from_mesh * vec4(position, 1.0)).xyz;
}
""",
    """
#version 330
in vec3 picture;
out uint face;
void main() {
    if (dot(picture.xy, picture.xy) > picture.z * picture.z) discard;
    face = uint(gl_PrimitiveID) + 1u;
}
""",
)


class OpenGlFaces:
    """Draws the number of the face under each pixel into a 32-bit integer buffer, with depth test and back-face culling.

    Args:
        vertices: Of the body in A [m], shape (v, 3).
        faces: Vertex indices, shape (f, 3).
        camera: The camera; its resolution is that of the buffer.

    Raises:
        ObserverError: OpenGL cannot be loaded, or this is a forked child or another thread.
    """

    def __init__(self, vertices: Array, faces: NDArray[np.integer], camera: CameraModel) -> None:
        self.vertices, self.camera = vertices, camera
        self._context: Any = current_context()
        self.note = f"face-ID buffers on {self._context.info['GL_RENDERER']}"
        self._centre = vertices.mean(axis=0)
        self._longest_edge = _longest_edge(vertices[faces])
        self._resources = self._allocate(faces)
        self._picture = np.empty((camera.resolution_px, camera.resolution_px), dtype=np.uint32)

    def _allocate(self, triangles: NDArray[np.integer]) -> dict[str, Any]:
        gl, size = self._context, (self.camera.resolution_px,) * 2
        program = gl.program(*(_CONE_SHADERS if self.camera.shape == "cone" else _SQUARE_SHADERS))
        vertices = gl.buffer((self.vertices - self._centre).astype("f4").tobytes())
        faces = gl.buffer(triangles.astype("i4").tobytes())
        mesh = gl.vertex_array(program, [(vertices, "3f", "position")], index_buffer=faces)
        colour, depth = gl.texture(size, 1, dtype="u4"), gl.depth_renderbuffer(size)
        buffer = gl.framebuffer([colour], depth)
        return dict(
            buffer=buffer, mesh=mesh, program=program, vertices=vertices, faces=faces, colour=colour, depth=depth
        )

    def draw(self, pose: CameraPose, window: PictureWindow) -> NDArray[np.uint32]:
        """Draw a window of the picture: face plus one, 0 for the sky; bottom row first. The next call reuses the array.

        Raises:
            ObserverError: This is a forked child or another thread.
        """
        gl, parts = current_context(), self._resources
        to_picture = self._picture_from_mesh(pose)
        matrices = {
            "clip_from_mesh": _clip_from_picture(window, *self._depths(pose)) @ to_picture,
            "picture_from_mesh": to_picture,
        }
        for name, matrix in matrices.items():
            if name in parts["program"]:
                parts["program"][name].write(matrix.T.astype("f4").tobytes())
        parts["buffer"].use()
        parts["buffer"].clear()
        gl.enable_only(gl.DEPTH_TEST | gl.CULL_FACE)
        parts["mesh"].render()
        parts["buffer"].read_into(self._picture, components=1, dtype="u4")
        return self._picture

    def _picture_from_mesh(self, pose: CameraPose) -> Array:
        """Homogeneous picture coordinates, (x, y) = (X, Y) / Z, of mesh positions relative to the centre."""
        scale = np.diag([1.0 / self.camera.tan_half_angle, 1.0 / self.camera.tan_half_angle, 1.0])
        matrix = np.eye(4)
        matrix[:3, :3] = scale @ pose.C_CA
        matrix[:3, 3] = scale @ pose.to_camera(self._centre)
        return matrix

    def _depths(self, pose: CameraPose) -> tuple[float, float]:
        """Depths [m] between which everything in the picture lies."""
        distance = np.linalg.norm(self.vertices - pose.r_A, axis=1)
        far = 1.001 * float(distance.max())
        # No point of a triangle is farther than (longest edge)/sqrt(3) from its nearest vertex.
        nearest = float(distance.min()) - self._longest_edge / np.sqrt(3.0)
        cosine = 1.0 / np.sqrt(1.0 + 2.0 * self.camera.tan_half_angle**2)
        return max(0.999 * cosine * nearest, MIN_DEPTH_RATIO * far), far

    def close(self) -> None:
        """Release the GL objects; safe to call twice, in a forked child and at interpreter exit."""
        resources, self._resources = self.__dict__.get("_resources", {}), {}
        if resources and may_release(self._context):
            self._context.__enter__()
            for resource in resources.values():
                resource.release()


def _clip_from_picture(window: PictureWindow, near: float, far: float) -> Array:
    """OpenGL clip coordinates (y up) from homogeneous picture coordinates (y down)."""
    centre, half = 0.5 * (window.high + window.low), 0.5 * (window.high - window.low)
    return np.array(
        [
            [1.0 / half[0], 0.0, -centre[0] / half[0], 0.0],
            [0.0, -1.0 / half[1], centre[1] / half[1], 0.0],
            [0.0, 0.0, (far + near) / (far - near), -2.0 * far * near / (far - near)],
            [0.0, 0.0, 1.0, 0.0],
        ]
    )


def _longest_edge(corners: Array) -> float:
    return float(np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2).max())
