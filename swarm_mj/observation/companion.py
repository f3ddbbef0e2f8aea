"""What a companion of the body hides of a target, and shades: rays against its mesh at an instant. Frame A, metres.

The Sun is a point at infinity, as in `capture.lit`: there is no half-shadow.
"""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np

from swarm_mj.mission.target import TargetRegion
from swarm_mj.observation.raycast import RayTracer, barycentric_samples
from swarm_mj.smallbody.companion import Companion
from swarm_mj.typing import Array, Indices, Mask


class TurningBody(Protocol):
    """How the body turns that the companion belongs to."""

    def C_AN(self, t: float) -> Array:
        """Rotation from N to A at a time past the epoch [s], shape (3, 3)."""


class Screen:
    """The companion as something that stands in the way, at any time of a flight.

    Args:
        companion: The body's.
        around: How the body turns.
    """

    def __init__(self, companion: Companion, around: TurningBody) -> None:
        self._companion, self._around = companion, around
        self._tracer = RayTracer(companion.shape.vertices, companion.shape.faces)

    def at(self, t: float) -> Shade:
        """Where it stands at a time past the epoch [s]."""
        C_AN, companion = self._around.C_AN(t), self._companion
        turned = companion.C_AN(t) @ C_AN.T
        return Shade(self._tracer, float(companion.shape.max_radius), C_AN @ companion.position(t), turned)


class Shade(NamedTuple):
    """A companion at one instant.

    Attributes:
        tracer: Over its mesh, in A2.
        radius: Of its vertices, the largest [m].
        centre_A: Of it, shape (3,) [m].
        C_2A: Rotation from A to A2, shape (3, 3).
    """

    tracer: RayTracer
    radius: float
    centre_A: Array
    C_2A: Array

    def may_shade(self, sun_A: Array, radius: float) -> bool:
        """Whether its shadow may fall on anything within a distance from the origin [m]; `sun_A` has length 1."""
        along = float(self.centre_A @ sun_A)
        across = float(np.linalg.norm(self.centre_A - along * sun_A))
        return along > -(self.radius + radius) and across < self.radius + radius

    def may_hide(self, r_A: Array, radius: float) -> bool:
        """Whether it may stand before anything within a distance from the origin [m], as seen from `r_A`, shape (3,) [m]."""
        return bool(_apart(self.centre_A, np.zeros((1, 3)), r_A[None], 1.0)[0] < self.radius + radius)

    def shades(self, points_A: Array, sun_A: Array) -> Mask:
        """Which points, shape (m, 3) [m], its shadow falls on, shape (m,); `sun_A` has length 1, shape (3,)."""
        found = _apart(self.centre_A, points_A, sun_A[None], np.inf) < self.radius
        found[found] = self._met(points_A[found], np.broadcast_to(sun_A, points_A[found].shape))
        return found

    def hides(self, points_A: Array, r_A: Array) -> Mask:
        """Which points, shape (m, 3) [m], it stands before as seen from `r_A`, shape (3,) [m]; shape (m,).

        Between a point and the camera is what both rays meet, from the point to the camera and from there to the point.
        """
        found = _apart(self.centre_A, points_A, r_A - points_A, 1.0) < self.radius
        ahead = r_A - points_A[found]
        found[found] = self._met(points_A[found], ahead) & self._met(r_A - 0.0 * ahead, -ahead)
        return found

    def hidden_share(self, region: TargetRegion, cells: Indices, r_A: Array, samples: int) -> Array:
        """Share of cells that it stands before as seen from `r_A`, by some samples of each; shape (len(cells),)."""
        if not len(cells) or not self.may_hide(r_A, region.mesh.max_radius):
            return np.zeros(len(cells))
        points = (barycentric_samples(samples) @ region.corners_A[cells]).reshape(-1, 3)
        return np.asarray(self.hides(points, r_A).reshape(len(cells), samples).mean(axis=1))

    def _met(self, start_A: Array, direction_A: Array) -> Mask:
        """Which rays meet it, shape (m,)."""
        if not len(start_A):
            return np.zeros(0, np.bool_)
        start, direction = (start_A - self.centre_A) @ self.C_2A.T, direction_A @ self.C_2A.T
        return np.asarray(self.tracer.first_hit(start, direction) >= 0)


def _apart(centre: Array, start: Array, way: Array, longest: float) -> Array:
    """Least distance of a centre from ways that begin at `start` and go on for up to `longest` times `way`, shape (m,) [m]."""
    to_centre = centre - start
    share = np.clip(np.einsum("ij,ij->i", to_centre, np.broadcast_to(way, start.shape)), 0.0, None)
    share = np.minimum(share / np.einsum("ij,ij->i", way, way), longest)
    return np.asarray(np.linalg.norm(to_centre - share[:, None] * way, axis=1))
