"""Parallel projection of a body and of lines and points around it, with correct hiding.

Matplotlib's own 3-D axes sort whole collections by depth, so that lines behind the body show through it. Here the faces
turned to the viewer are painted from far to near, and every point of a line is tested against the mesh. Inputs are in the
body-fixed frame in metres; the plane of the picture is in kilometres.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_rgb
from numpy.typing import NDArray

from swarm_mj.figures.palette import AMBIENT, GROUND
from swarm_mj.mission.target import TargetRegion
from swarm_mj.observation.raycast import tracer_of
from swarm_mj.smallbody.shape import ShapeModel
from swarm_mj.typing import Array, Indices, Mask

KM = 1e3
#: Opacity of what lies behind the body.
HIDDEN_ALPHA = 0.22
#: Ground hidden by less than this share of the body's radius is not hidden: rays are traced in single precision.
HIDING_DEPTH = 1e-4

ZORDER_BODY, ZORDER_LINES, ZORDER_POINTS = 3.0, 4.0, 5.0


@dataclass(frozen=True)
class View:
    """A direction to look from: unit vectors to the right, upwards and towards the viewer as rows of `axes`, shape (3, 3)."""

    axes: Array

    @classmethod
    def from_direction(cls, toward: Array) -> View:
        """The view from a direction, with z upwards in the picture (or y, seen from a pole)."""
        toward = unit(toward)
        pole = np.array([0.0, 0.0, 1.0]) if abs(toward[2]) < 0.97 else np.array([0.0, 1.0, 0.0])
        up = unit(pole - (pole @ toward) * toward)
        return cls(np.array([np.cross(up, toward), up, toward]))

    @property
    def toward(self) -> Array:
        """Unit vector to the viewer."""
        return self.axes[2]

    def project(self, points: Array) -> Array:
        """Place points (..., 3) [m] in the picture, shape (..., 2) [km]."""
        return points @ self.axes[:2].T / KM

    def hidden(self, points: Array, body: ShapeModel) -> Mask:
        """Whether the body stands between points (n, 3) [m] and the viewer, shape (n,)."""
        return _meets(points, self.toward, body)

    def before(self, points: Array, body: ShapeModel) -> Mask:
        """Whether points (n, 3) [m] cover part of the body in the picture, shape (n,)."""
        return _meets(points, -self.toward, body)


def _meets(points: Array, direction: Array, body: ShapeModel) -> Mask:
    """Whether rays from points (n, 3) [m] in one unit direction meet the body, shape (n,)."""
    # A point on the surface does not hide itself; one far away starts where it nears the body, in reach of single precision.
    ahead = np.maximum(HIDING_DEPTH * body.max_radius, -points @ direction - 1.01 * body.max_radius)
    start = points + ahead[:, None] * direction
    return tracer_of(body).first_hit(start, np.broadcast_to(direction, start.shape)) >= 0


def views_of(region: TargetRegion) -> list[View]:
    """Views of a target from several sides, each well off its axis, so that heights above it can be told."""
    east, north, up = region.axes_A
    sides = (0.65, -0.65, 1.0, -1.0, 1.5, -1.5)
    return [View.from_direction(up + side * east + rise * north) for side in sides for rise in (0.3, 0.45, 0.6)]


def visible_share(view: View, region: TargetRegion) -> float:
    """Area that the target takes in the picture, hidden parts left out, as a share of its area; from a sample of cells."""
    some = slice(None, None, max(1, region.n_cells // 150))
    projected = np.clip(region.normal_A[some] @ view.toward, 0.0, None) * region.area[some]
    visible = ~view.hidden(region.centroid_A[some], region.mesh)
    return float(projected[visible].sum() / region.area[some].sum())


def unit(vector: Array) -> Array:
    """A vector scaled to unit length."""
    return vector / np.linalg.norm(vector)


def shade(colours: Array, normals: Array, lamp: Array, ambient: float = AMBIENT) -> Array:
    """Colours (n, 3) of matt faces with the given normals (n, 3) under a distant lamp (Lambert's law)."""
    light = ambient + (1.0 - ambient) * np.clip(normals @ unit(lamp), 0.0, 1.0)
    return np.clip(colours * light[:, None], 0.0, 1.0)


def face_colours(body: ShapeModel, groups: list[tuple[NDArray[Any], str]]) -> Array:
    """Colour of every face: bare ground, and a colour for each group of faces (indices, colour), shape (F, 3)."""
    colours = np.tile(to_rgb(GROUND), (len(body.faces), 1))
    for faces, colour in groups:
        colours[faces] = to_rgb(colour)
    return colours


def draw_body(ax: Axes, view: View, body: ShapeModel, colours: Array) -> None:
    """Paint the faces turned to the viewer, far ones first, lit from above the viewer's left shoulder."""
    front = np.flatnonzero(body.face_normals @ view.toward > 0.0)
    front = front[np.argsort(body.face_centroids[front] @ view.toward)]
    lamp = np.array([-0.45, 0.55, 0.7]) @ view.axes
    shaded = shade(colours[front], body.face_normals[front], lamp)
    corners = view.project(body.vertices[body.faces[front]])
    style: dict[str, Any] = {"edgecolors": 0.93 * shaded, "linewidths": 0.25, "zorder": ZORDER_BODY}
    ax.add_collection(triangles(corners, facecolors=shaded, closed=True, rasterized=True, **style), autolim=False)


def triangles(corners: Array, **style: Any) -> PolyCollection:
    """Triangles (n, 3, 2) as one collection."""
    together: Any = corners  # an array is taken at once, a list face by face
    return PolyCollection(together, **style)


def draw_line(ax: Axes, view: View, body: ShapeModel, points: Array, **style: Any) -> None:
    """Draw a line through points (n, 3) [m]; what the body hides is faded."""
    if len(points) < 2:
        return
    hidden = view.hidden(0.5 * (points[1:] + points[:-1]), body)
    flat = view.project(points)
    alpha = style.pop("alpha", 1.0)
    borders = np.flatnonzero(np.diff(hidden)) + 1
    for first, last in zip(np.append(0, borders), np.append(borders, len(hidden)), strict=True):
        piece = flat[first : last + 1]
        opacity = alpha * (HIDDEN_ALPHA if hidden[first] else 1.0)
        ax.plot(piece[:, 0], piece[:, 1], **{"zorder": ZORDER_LINES, **style}, alpha=opacity)


def draw_points(ax: Axes, view: View, body: ShapeModel, points: Array, **style: Any) -> None:
    """Draw markers at points (n, 3) [m]; those behind the body are faded."""
    hidden = view.hidden(points, body)
    flat = view.project(points)
    for behind in (True, False):
        some = flat[hidden == behind]
        alpha = HIDDEN_ALPHA if behind else 1.0
        ax.plot(some[:, 0], some[:, 1], **{"linestyle": "none", "zorder": ZORDER_POINTS, **style}, alpha=alpha)


def first_hits(start: Array, direction: Array, length: Array, body: ShapeModel) -> Array:
    """How far rays go before they meet the body, at most `length`; unit directions, all of shape (n, ...) [m]."""
    face = tracer_of(body).first_hit(start, direction)
    met = face >= 0
    reach = np.array(length, float)
    reach[met] = np.minimum(reach[met], depth_of(face[met], start[met], direction[met], body))
    return reach


def depth_of(face: Indices, start: Array, direction: Array, body: ShapeModel) -> Array:
    """How far rays go before they meet the planes of faces, in lengths of their directions, shape (...)."""
    normal, corner = body.face_normals[face], body.vertices[body.faces[face, 0]]
    with np.errstate(invalid="ignore", divide="ignore"):  # of rays without a face, which are left out later
        return np.asarray(np.einsum("...i,...i", normal, corner - start) / np.einsum("...i,...i", normal, direction))


def straight(start: Array, end: Array, count: int = 80) -> Array:
    """Points along a straight line, fine enough to test against the body, shape (count, 3)."""
    return start + np.linspace(0.0, 1.0, count)[:, None] * (end - start)
