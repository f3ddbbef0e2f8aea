"""What the cameras of spacecraft see of the body, as small pictures for agents."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from gymnasium import spaces

from swarm_mj.compilation import kernel
from swarm_mj.flight.plan import Plan
from swarm_mj.observation.camera import CameraModel
from swarm_mj.observation.photometry import body_surface
from swarm_mj.observation.thumbnails import PLAIN, SIDE_PX, ThumbnailDrawer, Thumbnails
from swarm_mj.smallbody.environment import LinearMotion
from swarm_mj.smallbody.shape import ShapeModel
from swarm_mj.smallbody.simplify import simplify
from swarm_mj.spacecraft.attitude.algebra import put_vector, quaternion, rotate
from swarm_mj.typing import Array, Ints, Mask, Pixels

#: Faces of the mesh that is drawn; a body with more is simplified to as many.
MOST_FACES = 2_000
#: Where the light is.
LIGHTS = ("sun", "headlight")
#: Channels of a picture.
CHANNELS = ("grey", "mask", "nearness")
IMAGE_SPACE = spaces.Box(0, 255, (len(CHANNELS), SIDE_PX, SIDE_PX), np.uint8)


class Poses(NamedTuple):
    """Where P cameras are.

    Attributes:
        r_N: Positions relative to the body, shape (P, 3) [m].
        q_BN: Attitudes, shape (P, 4).
        C_AN: Rotations from N to A, shape (P, 3, 3).
        t: Seconds past the epoch, shape (P,).
    """

    r_N: Array
    q_BN: Array
    C_AN: Array
    t: Array


class BodyPictures:
    """Draws the body of a plan.

    Args:
        plan: The mission.
        half_angle_deg: Of the square camera along +z.
        light: `sun`, where the Sun is, or `headlight`, at the camera.
        mesh: Drawn as it is, reflecting as the scenario's body does and with its shadows; None: the body's, simplified, as the
            cosine of incidence.

    Attributes:
        kept: Which face of the body's mesh each one is that is drawn, shape (f,).
        drawer: Draws them.
        sun: Where the Sun is; that of the plan at first.
    """

    def __init__(
        self, plan: Plan, half_angle_deg: float, light: str = "sun", *, mesh: ShapeModel | None = None
    ) -> None:
        shape, most = (plan.shape, MOST_FACES) if mesh is None else (mesh, len(mesh.faces))
        drawn = simplify(shape.vertices, shape.faces.astype(np.int64), most)
        self.kept: Ints = drawn.kept
        camera = CameraModel(half_angle_deg=half_angle_deg, resolution_px=SIDE_PX)
        surface = None if mesh is None else body_surface(plan.scenario.body) or PLAIN
        self.drawer = ThumbnailDrawer(drawn.vertices, drawn.faces, camera, surface)
        self.sun: LinearMotion = plan.environment.sun
        self._radius, self._sunlit, self._exposed = plan.shape.max_radius, light == "sun", mesh is not None

    def draw(self, poses: Poses, marked: Mask | None = None) -> Thumbnails:
        """Draw pictures.

        Args:
            poses: Of P cameras.
            marked: Faces of the mesh that is drawn, for the mask, shape (P, f) or (1, f); None: all.
        """
        count = len(poses.r_N)
        r_A, C_BA, light_A = np.empty((count, 3)), np.empty((count, 3, 3)), np.empty((count, 3))
        sun_N = np.zeros((count, 3))
        for p in range(count if self._sunlit else 0):
            sun_N[p] = self.sun.at(float(poses.t[p]))
        _to_body_frame(poses, sun_N, r_A, C_BA, light_A)
        out = self.drawer.blank(count)
        faces = np.ones((1, len(self.kept)), np.bool_) if marked is None else marked
        self.drawer.draw(r_A, C_BA, light_A if self._sunlit else None, faces, out)
        return out

    def images(self, pictures: Thumbnails) -> Pixels:
        """Pictures as bytes, shape (P, 3, S, S), see `CHANNELS`.

        Nearness is the body's radius over depth, at most 1. Radiance factors are exposed so that the brightest pixel of each
        picture is 1, as `camera.exposure_s` by itself does; the cosine of incidence is taken as it is.
        """
        out = np.empty((len(pictures.grey), *IMAGE_SPACE.shape), np.uint8)
        _to_bytes(pictures.grey, pictures.mask, pictures.depth, self._radius, self._exposed, out)
        return out


@kernel
def _to_body_frame(poses: Poses, sun_N: Array, r_A: Array, C_BA: Array, light_A: Array) -> None:
    """Write positions in A, rotations from A to B, and unit vectors to the Sun in A."""
    for p in range(r_A.shape[0]):
        C, q = poses.C_AN[p], quaternion(poses.q_BN, p)
        # Axes of B in N, as rows of C_BN.
        axes = (rotate(q, (1.0, 0.0, 0.0)), rotate(q, (0.0, 1.0, 0.0)), rotate(q, (0.0, 0.0, 1.0)))
        sun = np.sqrt(sun_N[p, 0] ** 2 + sun_N[p, 1] ** 2 + sun_N[p, 2] ** 2)
        scale = 1.0 / sun if sun > 0.0 else 0.0
        for k in range(3):
            r_A[p, k] = C[k, 0] * poses.r_N[p, 0] + C[k, 1] * poses.r_N[p, 1] + C[k, 2] * poses.r_N[p, 2]
            light_A[p, k] = scale * (C[k, 0] * sun_N[p, 0] + C[k, 1] * sun_N[p, 1] + C[k, 2] * sun_N[p, 2])
        for i in range(3):
            axis = axes[i]
            put_vector(
                C_BA[p],
                i,
                (
                    C[0, 0] * axis[0] + C[0, 1] * axis[1] + C[0, 2] * axis[2],
                    C[1, 0] * axis[0] + C[1, 1] * axis[1] + C[1, 2] * axis[2],
                    C[2, 0] * axis[0] + C[2, 1] * axis[1] + C[2, 2] * axis[2],
                ),
            )


@kernel
def _to_bytes(grey: Array, mask: Mask, depth: Array, radius: float, exposed: bool, out: Pixels) -> None:
    for p in range(grey.shape[0]):
        brightest = 1.0
        if exposed:
            brightest = grey[p].max()
            brightest = brightest if brightest > 0.0 else 1.0
        for i in range(grey.shape[1]):
            for j in range(grey.shape[2]):
                z = depth[p, i, j]
                out[p, 0, i, j] = np.uint8(255.0 * grey[p, i, j] / brightest + 0.5)
                out[p, 1, i, j] = np.uint8(255) if mask[p, i, j] else np.uint8(0)
                out[p, 2, i, j] = np.uint8(255.0 * min(1.0, radius / z) + 0.5) if z > 0.0 else np.uint8(0)
