"""Where to look from: the whole flight, behind the swarm, or through a spacecraft's own camera."""

from __future__ import annotations

import re
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from swarm_mj.drawing.instant import Instant
from swarm_mj.drawing.model import FIELD_OF_VIEW_DEG
from swarm_mj.errors import OutputError
from swarm_mj.planning import Plan

Array = NDArray[np.float64]

OVERVIEW, CHASE, SPLIT = "overview", "chase", "split"
#: Share of the picture that the flight may fill.
FILL = 0.86
#: The chase camera stands outside the swarm, this far over its radius, and at least this far over its distance to the body.
CHASE_SPREAD, CHASE_LEAST = 2.6, 0.45
#: How far the chase camera stands behind and above the line from the body through the swarm [rad].
CHASE_ASIDE = 0.5
#: A spacecraft's length over the distance of the camera that looks at it.
APPARENT_LENGTH = 0.035


@dataclass(frozen=True)
class FreeView:
    """A camera in N with +z of N upwards.

    Attributes:
        lookat: Point in the middle of the picture, shape (3,) [m].
        toward: Unit vector from there to the camera, shape (3,).
        distance: [m].
    """

    lookat: Array
    toward: Array
    distance: float

    def camera(self) -> mujoco.MjvCamera:
        """The same for MuJoCo."""
        camera = mujoco.MjvCamera()
        x, y, z = -self.toward
        camera.lookat[:], camera.distance = self.lookat, self.distance
        camera.azimuth, camera.elevation = np.degrees([np.arctan2(y, x), np.arctan2(z, np.hypot(x, y))])
        return camera


def spacecraft_number(name: str, n: int) -> int | None:
    """Which spacecraft, from 0, a camera's name means; None for the cameras of the whole swarm.

    Raises:
        OutputError: There is no camera of that name; the message lists them.
    """
    if name in (OVERVIEW, CHASE, SPLIT):
        return None
    match = re.fullmatch(r"sc([1-9]\d*)", name)
    if match is None or int(match[1]) > n:
        raise OutputError(f"camera {name!r} does not exist: use {OVERVIEW}, {CHASE}, {SPLIT} or sc1 to sc{n}")
    return int(match[1]) - 1


def overview(plan: Plan, path_N: Array, aspect: float) -> FreeView:
    """A fixed view across the plane of the flyby, from its sunlit side, that holds body and flight.

    Args:
        plan: What is flown.
        path_N: Positions over the flight, shape (m, n, 3) [m].
        aspect: Width of the picture over its height.
    """
    toward = view_direction(plan)
    right, up = _picture_axes(toward)
    radius = plan.shape.max_radius
    ball = radius * np.vstack((right, -right, up, -up, toward, -toward))
    points = np.vstack((path_N.reshape(-1, 3), ball))
    middle = sum(0.5 * (np.min(points @ axis) + np.max(points @ axis)) * axis for axis in (right, up))
    tangent = np.tan(np.radians(0.5 * FIELD_OF_VIEW_DEG)) * FILL
    relative = points - middle
    across = np.maximum(np.abs(relative @ right) / aspect, np.abs(relative @ up)) / tangent
    return FreeView(middle, toward, float((across + relative @ toward).max()))


def chase(plan: Plan, instant: Instant) -> FreeView:
    """A view from behind the swarm onto the body, a little aside, that moves with the swarm."""
    centre = instant.r_BN_N.mean(axis=0)
    range_m = float(np.linalg.norm(centre))
    outward = centre / range_m
    aside = view_direction(plan)
    aside = aside - (aside @ outward) * outward
    size = float(np.linalg.norm(aside))
    toward = np.cos(CHASE_ASIDE) * outward + np.sin(CHASE_ASIDE) * (aside / size if size > 1e-9 else 0.0)
    spread = float(np.linalg.norm(instant.r_BN_N - centre, axis=1).max())
    lookat = 0.75 * centre
    distance = 0.25 * range_m + max(CHASE_LEAST * range_m, CHASE_SPREAD * spread)
    return FreeView(lookat, toward / np.linalg.norm(toward), distance)


def view_direction(plan: Plan) -> Array:
    """Unit vector across the plane of the flyby, to the side of the Sun; to the Sun if the flyby has no plane, in N."""
    sun_N = plan.environment.sun.position / np.linalg.norm(plan.environment.sun.position)
    start, velocity = plan.deployment.r0_N, plan.deployment.v0_N.mean(axis=0)
    across = np.cross(start, velocity)
    size = float(np.linalg.norm(across))
    if size < 1e-6 * float(np.linalg.norm(start) * np.linalg.norm(velocity)):
        return sun_N
    return across / size * (1.0 if across @ sun_N >= 0.0 else -1.0)


def magnification_for(plan: Plan, distance: float) -> float:
    """How many times to enlarge spacecraft that are seen from a distance [m]: 1, 2 or 5 times a power of ten."""
    wanted = APPARENT_LENGTH * distance / max(plan.properties.size)
    decade = 10.0 ** np.floor(np.log10(max(wanted, 1.0)))
    return float(max(step * decade for step in (1.0, 2.0, 5.0) if step * decade <= max(wanted, 1.0)))


def _picture_axes(toward: Array) -> tuple[Array, Array]:
    """Unit vectors to the right and upwards in the picture of a camera at `toward`."""
    right = np.cross([0.0, 0.0, 1.0], toward)
    right = right / np.linalg.norm(right) if np.linalg.norm(right) > 1e-9 else np.array([0.0, 1.0, 0.0])
    return right, np.cross(toward, right)
