"""Face-ID buffers drawn by OpenGL, without a window."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarm_mj.observation.camera import CameraModel, CameraPose
from swarm_mj.observation.gl_context import current_context, may_release
from swarm_mj.observation.projection import PictureWindow
from swarm_mj.smallbody.shape import ShapeModel
from swarm_mj.typing import Array, Ints32

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

    def __init__(self, vertices: Array, faces: Ints32, camera: CameraModel) -> None:
        self.vertices, self.camera = vertices, camera
        self._context: Any = current_context()
        self.note = f"face-ID buffers on {self._context.info['GL_RENDERER']}"
        self._centre = vertices.mean(axis=0)
        self._reach = ShapeModel(vertices, faces).vertex_reach
        self._resources = self._allocate(faces)
        self._picture = np.empty((camera.resolution_px, camera.resolution_px), dtype=np.uint32)

    def _allocate(self, triangles: Ints32) -> dict[str, Any]:
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
        nearest = float(distance.min()) - self._reach
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
