"""Where to look from: the whole flight, behind the swarm, or through a spacecraft's own camera."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TypeAlias

import mujoco
import numpy as np

from swarm_mj.errors import OutputError
from swarm_mj.flight.plan import Plan
from swarm_mj.rendering.frame import Instant
from swarm_mj.rendering.model import FIELD_OF_VIEW_DEG
from swarm_mj.scenarios.itinerary import last_arrival_s
from swarm_mj.typing import Array

OVERVIEW, CHASE, SPLIT = "overview", "chase", "split"
#: Begin and end of a part of a flight [s].
Span: TypeAlias = tuple[float, float]
#: Share of the picture that the flight may fill.
FILL = 0.87
#: Angle of the chase camera to the line from the body through the swarm [rad].
CHASE_ASIDE = 0.5
#: Distance of the chase camera to anything, at most, over the swarm's distance to the body: it looks from a little behind.
CHASE_REACH = 4.0
#: Directions among which the overview's is chosen.
DIRECTIONS = 400
#: Steepest look along N's z axis, which stands upright in the picture: cosine of its angle to the line of sight.
STEEPEST = 0.85
#: A spacecraft's length over the distance of the camera that looks at it.
APPARENT_LENGTH = 0.025


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

    def offsets(self, points_N: Array) -> Array:
        """How far points (k, 3) lie to the right of and above the line of sight, shape (k, 2) [m]."""
        return np.asarray((points_N - self.lookat) @ np.stack(_picture_axes(self.toward), axis=1))


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


def overview(plan: Plan, path_N: Array, aspect: float, span_s: Span | None = None) -> FreeView:
    """A fixed view that holds body and flight.

    `path_N`: positions over the time that is shown, evenly spaced in it, shape (m, n, 3) [m]. `aspect`: width of the picture
    over its height. `span_s`: begin and end of that time [s]; None: the whole flight.
    """
    begin, end = span_s or (0.0, plan.scenario.duration_s)
    times, companion = (begin, 0.5 * (begin + end), end), plan.environment.companion
    turned = [plan.shape.vertices @ plan.environment.C_AN(t) for t in times]
    if companion is not None:
        turned += [companion.position(t) + companion.shape.vertices @ companion.C_AN(t) for t in times]
    return fit(np.vstack((path_N.reshape(-1, 3), *turned)), view_direction(plan, path_N, aspect, span_s), aspect)


def reach_of(path_N: Array, view: FreeView | None = None) -> float:
    """Distance [m] from any camera of a flight within which all that is drawn lies.

    `path_N`: positions over the flight, shape (m, n, 3) [m]. `view`: the overview, if there is one; spacecraft's own cameras
    and the one behind the swarm stand on the path or near it.
    """
    farthest = float(np.linalg.norm(path_N, axis=-1).max())
    beyond = 0.0 if view is None else view.distance + float(np.linalg.norm(view.lookat))
    return max(beyond + farthest, CHASE_REACH * farthest)


def chase(plan: Plan, instant: Instant, aspect: float) -> FreeView:
    """A view from behind the swarm onto the target, a little aside, that moves with the swarm."""
    outward = _unit(instant.r_BN_N.mean(axis=0))
    sun_N = _unit(plan.environment.sun.position)
    aside = sun_N - (sun_N @ outward) * outward
    size = float(np.linalg.norm(aside))
    toward = np.cos(CHASE_ASIDE) * outward + np.sin(CHASE_ASIDE) * (aside / size if size > 1e-9 else 0.0)
    target = plan.region.corners_A.reshape(-1, 3) @ instant.C_AN
    return fit(np.vstack((instant.r_BN_N, target)), _unit(toward), aspect)


def fit(points_N: Array, toward: Array, aspect: float) -> FreeView:
    """The nearest view from a direction (3,) that holds all points (k, 3) [m]; `aspect`: width over height of the picture."""
    right, up = _picture_axes(toward)
    middle = np.zeros(3)
    for axis in (right, up):
        middle += 0.5 * (np.min(points_N @ axis) + np.max(points_N @ axis)) * axis
    tangent = np.tan(np.radians(0.5 * FIELD_OF_VIEW_DEG)) * FILL
    relative = points_N - middle
    across = np.maximum(np.abs(relative @ right) / aspect, np.abs(relative @ up)) / tangent
    return FreeView(middle, toward, float((across + relative @ toward).max()))


def view_direction(plan: Plan, path_N: Array, aspect: float, span_s: Span | None = None) -> Array:
    """Unit vector in N to a camera that sees the target's day side, and the flight from the side; arguments as of `overview`.

    A flight along the longer side of the picture is seen from nearer.
    """
    begin, end = span_s or (0.0, plan.scenario.duration_s)
    region, environment = plan.region, plan.environment
    normal_A = region.facing_A
    times = (min(max(last_arrival_s(plan.scenario), begin), end), end)
    normals = np.array([normal_A @ environment.C_AN(t) for t in times])
    path = path_N.mean(axis=1)
    directions = _sphere(DIRECTIONS)
    directions = directions[np.abs(directions[:, 2]) <= STEEPEST]
    facing = np.min(directions @ normals.T, axis=1)
    along = _unit(path[-1] - path[0])
    axes = np.array([_picture_axes(direction) for direction in directions])
    flat = np.abs(axes @ along)
    turned, reach = np.linalg.norm(flat, axis=1), np.maximum(flat[:, 0] / aspect, flat[:, 1])
    # At the arrival the swarm must not stand before the target.
    arrival = path[round((len(path) - 1) * (times[0] - begin) / (end - begin))]
    above = _unit(arrival - region.area @ region.centroid_A / region.total_area @ environment.C_AN(times[0]))
    clear = np.linalg.norm(np.cross(directions, above), axis=1)
    lit = directions @ _unit(environment.sun.position)
    # Beyond these values more of one would be bought with too much of another.
    merit = np.minimum(facing, 0.35) + np.minimum(turned, 0.8) + np.minimum(clear, 0.9) + 0.5 * np.minimum(lit, 0.6)
    merit -= 0.5 * reach
    return np.asarray(directions[np.argmax(merit)])


def magnification_for(plan: Plan, distance: float) -> float:
    """How many times to enlarge spacecraft that are seen from a distance [m]: 1, 2 or 5 times a power of ten."""
    wanted = APPARENT_LENGTH * distance / max(plan.properties.size)
    decade = 10.0 ** np.floor(np.log10(max(wanted, 1.0)))
    return float(max(step * decade for step in (1.0, 2.0, 5.0) if step * decade <= max(wanted, 1.0)))


def _unit(vector: Array) -> Array:
    """The direction of a vector; that of x if it has none."""
    size = float(np.linalg.norm(vector))
    return vector / size if size > 0.0 else np.array([1.0, 0.0, 0.0])


def _sphere(count: int) -> Array:
    """Unit vectors spread evenly over the sphere (Fibonacci lattice), shape (count, 3)."""
    z = 1.0 - (2.0 * np.arange(count) + 1.0) / count
    angle = np.pi * (3.0 - np.sqrt(5.0)) * np.arange(count)
    return np.stack((np.sqrt(1.0 - z**2) * np.cos(angle), np.sqrt(1.0 - z**2) * np.sin(angle), z), axis=1)


def _picture_axes(toward: Array) -> tuple[Array, Array]:
    """Unit vectors to the right and upwards in the picture of a camera at `toward`."""
    right = np.cross([0.0, 0.0, 1.0], toward)
    right = right / np.linalg.norm(right) if np.linalg.norm(right) > 1e-9 else np.array([0.0, 1.0, 0.0])
    return right, np.cross(toward, right)
