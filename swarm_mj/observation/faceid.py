"""The face-ID observer: draws the number of the face under each pixel, and counts pixels.

The whole body is drawn with depth test and back-face culling into a 32-bit integer picture, so that occlusion is the
renderer's work. A cell's visible share is the number of its pixels found over the number expected of it, which is its
projected area in pixels; at most 1, so that a threshold may be put on it, while a sum of shares would lose the surplus
of some cells and is biased low. The picture is normally confined to the window that holds the target, which spends all
pixels where they are needed.

Counts say little about slivers. A triangle of area A and perimeter P pixels that is seen whole gets between A - P/2 and
A + P/2 + 1 pixels (Nosarzewska 1948), hence at least half of the expected A when its inscribed circle, of radius
2 A / P, has 2 pixels. Cells below that, made by clipping at the target's border or seen at grazing angles, are sampled
by rays instead; they are few, and are then neither lost nor counted for the pixels of their neighbours.
"""

from functools import cached_property
from types import TracebackType
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swarm_mj.errors import ObserverError
from swarm_mj.mission.target import TargetRegion
from swarm_mj.observation.camera import CameraModel, CameraPose, camera_pose
from swarm_mj.observation.gl_context import current_context, may_release
from swarm_mj.observation.projection import WHOLE_PICTURE, Window, project
from swarm_mj.observation.raytracing import RayTracer
from swarm_mj.observation.sampling import faces_camera, sampled_fraction

#: Radius of the inscribed circle [px] from which pixel counts decide, see above.
MIN_INRADIUS_PX = 2.0
#: Rays to each cell that is too small for that.
SLIVER_SAMPLES = 16
#: Nearest depth drawn over the farthest; bounds the loss of depth precision (24 bits) close to the body.
MIN_DEPTH_RATIO = 1e-3

_VERTEX_SHADER = """
#version 330
uniform mat4 clip_from_mesh;
uniform mat4 picture_from_mesh;
in vec3 position;
out vec3 picture;
void main() {
    gl_Position = clip_from_mesh * vec4(position, 1.0);
    picture = (picture_from_mesh * vec4(position, 1.0)).xyz;
}
"""
_FRAGMENT_SHADER = """
#version 330
uniform bool cone;
in vec3 picture;
out uint face;
void main() {
    if (cone && dot(picture.xy, picture.xy) > picture.z * picture.z) discard;
    face = uint(gl_PrimitiveID) + 1u;
}
"""


class FaceIdObserver:
    """Share of each cell in view, by counting pixels of a face-ID buffer.

    Args:
        region: The target; its whole mesh is drawn.
        camera: The camera; its resolution is that of the buffer.
        crop: Spend the buffer on the part of the picture that holds the target, instead of on the whole picture.

    Raises:
        ObserverError: OpenGL cannot be loaded, or this is a forked child or another thread.
    """

    name = "faceid"

    def __init__(self, region: TargetRegion, camera: CameraModel, *, crop: bool = True) -> None:
        self.region, self.camera, self.crop = region, camera, crop
        self._context: Any = current_context()
        self.note = f"face-ID buffers on {self._context.info['GL_RENDERER']}"
        self._centre = region.mesh.vertices.mean(axis=0)
        self._longest_edge = _longest_edge(region)
        self._resources = self._allocate()
        self._picture = np.empty((camera.resolution_px, camera.resolution_px), dtype=np.uint32)

    def _allocate(self) -> dict[str, Any]:
        gl, size = self._context, (self.camera.resolution_px,) * 2
        program = gl.program(_VERTEX_SHADER, _FRAGMENT_SHADER)
        program["cone"].value = self.camera.shape == "cone"
        vertices = gl.buffer((self.region.vertices - self._centre).astype("f4").tobytes())
        faces = gl.buffer(self.region.faces.astype("i4").tobytes())
        mesh = gl.vertex_array(program, [(vertices, "3f", "position")], index_buffer=faces)
        colour, depth = gl.texture(size, 1, dtype="u4"), gl.depth_renderbuffer(size)
        buffer = gl.framebuffer([colour], depth)
        return dict(
            buffer=buffer, mesh=mesh, program=program, vertices=vertices, faces=faces, colour=colour, depth=depth
        )

    @cached_property
    def tracer(self) -> RayTracer:
        """Ray tracer over the region's mesh, built at first use."""
        return RayTracer(self.region.vertices, self.region.faces)

    def visible_fraction(self, r_A: ArrayLike, C_CA: ArrayLike) -> NDArray[np.float64]:
        """Share of each cell in view, see `Observer.visible_fraction`."""
        self._open_resources()
        pose = camera_pose(r_A, C_CA)
        cells = project(pose.to_camera(self.region.corners_A), self.camera)
        candidate = cells.in_picture & faces_camera(self.region, pose)
        fraction = np.zeros(self.region.n_cells)
        if not candidate.any():
            return fraction
        window = cells.window(candidate) if self.crop else WHOLE_PICTURE
        area, inradius = cells.pixels(window, self.camera.resolution_px)
        countable = candidate & cells.ahead & (inradius >= MIN_INRADIUS_PX)
        if countable.any():
            found = np.bincount(self.face_ids(pose, window).ravel(), minlength=len(self.region.faces) + 1)[1:]
            fraction[countable] = np.minimum(found[self.region.target[countable]] / area[countable], 1.0)
        slivers = np.flatnonzero(candidate & ~countable)
        if len(slivers):
            fraction[slivers] = sampled_fraction(self.tracer, self.region, slivers, self.camera, pose, SLIVER_SAMPLES)
        return fraction

    def face_ids(self, pose: CameraPose, window: Window = WHOLE_PICTURE) -> NDArray[np.uint32]:
        """Draw the face under each pixel of a window of the picture.

        Returns:
            Face of the region's mesh plus one, 0 for the sky; bottom row first, shape (resolution, resolution). The
            array is reused by the next call.

        Raises:
            ObserverError: This is a forked child or another thread, or the observer was closed.
        """
        gl, parts = current_context(), self._open_resources()
        to_picture = self._picture_from_mesh(pose)
        parts["program"]["picture_from_mesh"].write(to_picture.T.astype("f4").tobytes())
        parts["program"]["clip_from_mesh"].write(
            (_clip_from_picture(window, *self._depths(pose)) @ to_picture).T.astype("f4").tobytes()
        )
        parts["buffer"].use()
        parts["buffer"].clear()
        gl.enable_only(gl.DEPTH_TEST | gl.CULL_FACE)
        parts["mesh"].render()
        parts["buffer"].read_into(self._picture, components=1, dtype="u4")
        return self._picture

    def _open_resources(self) -> dict[str, Any]:
        if not self._resources:
            raise ObserverError("this face-ID observer was closed: make a new one")
        return self._resources

    def _picture_from_mesh(self, pose: CameraPose) -> NDArray[np.float64]:
        """Homogeneous picture coordinates, (x, y) = (X, Y) / Z, of mesh positions relative to the centre."""
        scale = np.diag([1.0 / self.camera.tan_half_angle, 1.0 / self.camera.tan_half_angle, 1.0])
        matrix = np.eye(4)
        matrix[:3, :3] = scale @ pose.C_CA
        matrix[:3, 3] = scale @ pose.to_camera(self._centre)
        return matrix

    def _depths(self, pose: CameraPose) -> tuple[float, float]:
        """Depths [m] between which everything in the picture lies."""
        distance = np.linalg.norm(self.region.vertices - pose.r_A, axis=1)
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

    def __enter__(self) -> Self:
        """Use as a context manager."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close."""
        self.close()

    def __del__(self) -> None:
        """Close, if nobody did."""
        self.close()


def _clip_from_picture(window: Window, near: float, far: float) -> NDArray[np.float64]:
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


def _longest_edge(region: TargetRegion) -> float:
    corners = region.vertices[region.faces]
    return float(np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2).max())
