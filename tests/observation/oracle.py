"""Exact visibility by polygon clipping on the image plane, sharing no code with the observers.

Visible part of a patch = its projection, cut to the field of view, minus the projections of the front faces that lie
nearer. Perspective maps straight lines to straight lines, so all of it is exact up to double precision.
"""

from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

Array = NDArray[np.float64]
EMPTY = shapely.Polygon()
#: Picture coordinates are rounded to this, 20 nm at 20 km: unrounded, GEOS confuses triangles with a common edge.
GRID = 1e-12


@dataclass(frozen=True)
class Patch:
    """A convex polygon on one face of the mesh: corners in A [m], shape (k, 3)."""

    face: int
    corners: Array


@dataclass(frozen=True)
class View:
    """Camera position [m], rotation A to camera (z along the line of sight), field of view on the plane z = 1."""

    r: Array
    C: Array
    field: BaseGeometry


def rectangle(half_angle_deg: float, sides: tuple[float, float] = (1.0, 1.0)) -> BaseGeometry:
    x, y = np.tan(np.radians(half_angle_deg)) * np.array(sides)
    return shapely.box(-x, -y, x, y)


def cone(half_angle_deg: float, sides: int = 720) -> BaseGeometry:
    angle = np.linspace(0.0, 2.0 * np.pi, sides, endpoint=False)
    t = np.tan(np.radians(half_angle_deg)) * np.sqrt(2.0 * np.pi / sides / np.sin(2.0 * np.pi / sides))
    return shapely.Polygon(t * np.column_stack([np.cos(angle), np.sin(angle)]))


def clip_to_pyramid(vertices: Array, faces: NDArray[np.int32], axes: Array, slope: float) -> list[Patch]:
    """Parts of the faces in |east|, |north| <= slope * up, by clipping polygons one half-space after another."""
    east, north, up = axes
    normals = [slope * up + side for side in (east, -east, north, -north)]
    patches = []
    for k, face in enumerate(faces):
        polygon = vertices[face]
        for normal in normals:
            polygon = _keep_half(polygon, polygon @ normal)
            if len(polygon) < 3:
                break
        else:
            patches.append(Patch(k, polygon))
    return patches


def _keep_half(polygon: Array, distance: Array) -> Array:
    kept = []
    for a, b, da, db in zip(polygon, np.roll(polygon, -1, 0), distance, np.roll(distance, -1), strict=True):
        if da >= 0:
            kept.append(a)
        if da * db < 0:
            kept.append(a + (b - a) * (da / (da - db)))
    return np.array(kept).reshape(-1, 3)


def area(polygon: Array) -> float:
    fan = np.cross(polygon[1:-1] - polygon[0], polygon[2:] - polygon[0])
    return float(np.linalg.norm(fan.sum(axis=0)) / 2)


class Oracle:
    """Exact visible parts of patches on a closed mesh."""

    def __init__(self, vertices: Array, faces: NDArray[np.int32], patches: list[Patch]) -> None:
        self.vertices, self.faces, self.patches = vertices, faces, patches
        self.area = np.array([area(p.corners) for p in patches])
        self._owner = np.array([p.face for p in patches])

    def visible_parts(self, view: View) -> list[BaseGeometry]:
        """Visible part of each patch on the plane z = 1 of the camera."""
        points = (self.vertices - view.r) @ view.C.T
        corners = points[self.faces]
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        offset = np.einsum("ij,ij->i", normals, corners[:, 0])
        front = np.flatnonzero((offset < 0) & (corners[..., 2] > 0).all(axis=1))
        flat = corners[front][..., :2] / corners[front][..., 2:]
        touches = np.array(view.field.bounds).reshape(2, 2)
        near = ((flat.min(axis=1) <= touches[1]) & (flat.max(axis=1) >= touches[0])).all(axis=1)
        front, triangles = front[near], shapely.polygons(flat[near])
        parts = np.array([self._on_picture(p, view, offset[p.face] < 0) for p in self.patches], dtype=object)
        patch, other = shapely.STRtree(triangles).query(parts, predicate="intersects")
        apart = front[other] != self._owner[patch]
        patch, other = patch[apart], other[apart]
        overlap = shapely.intersection(parts[patch], triangles[other], grid_size=GRID)
        real = shapely.area(overlap) > 1e-15
        patch, other, overlap = patch[real], other[real], overlap[real]
        spot = shapely.get_coordinates(shapely.point_on_surface(overlap)).reshape(-1, 2)
        ray = np.column_stack([spot, np.ones(len(spot))])

        def depth(face: NDArray[np.intp]) -> Array:
            return offset[face] / np.einsum("ij,ij->i", normals[face], ray)

        nearer = depth(front[other]) < depth(self._owner[patch])
        for k in np.unique(patch[nearer]):
            before = shapely.union_all(triangles[other[nearer & (patch == k)]], grid_size=GRID)
            parts[k] = shapely.difference(parts[k], before, grid_size=GRID)
        return list(parts)

    def visible_area(self, view: View) -> Array:
        """Visible area of each patch on the ground [m^2]."""
        parts = self.visible_parts(view)
        return np.array([_polygon_area(self._on_face(k, part, view)) for k, part in enumerate(parts)])

    def united_area(self, views: list[View]) -> Array:
        """Area of each patch that at least one view sees [m^2]."""
        pieces: list[list[BaseGeometry]] = [[] for _ in self.patches]
        for view in views:
            for k, part in enumerate(self.visible_parts(view)):
                if not part.is_empty:
                    pieces[k].append(self._on_face(k, part, view))
        return np.array([_polygon_area(shapely.union_all(p, grid_size=1e-4)) if p else 0.0 for p in pieces])

    def _on_picture(self, patch: Patch, view: View, facing: bool) -> BaseGeometry:
        points = (patch.corners - view.r) @ view.C.T
        if not facing or (points[:, 2] <= 0).any():
            return EMPTY
        return shapely.Polygon(points[:, :2] / points[:, 2:]).intersection(view.field)

    def _on_face(self, k: int, part: BaseGeometry, view: View) -> BaseGeometry:
        """Picture polygon to orthonormal coordinates [m] on the plane of the patch's face."""
        a, b, c = self.vertices[self.faces[self.patches[k].face]]
        normal = np.cross(b - a, c - a)
        e1 = (b - a) / np.linalg.norm(b - a)
        e2 = np.cross(normal, e1) / np.linalg.norm(normal)

        def lay(flat: Array) -> Array:
            ray = np.column_stack([flat, np.ones(len(flat))]) @ view.C
            point = view.r + ray * ((normal @ (a - view.r)) / (ray @ normal))[:, None] - a
            return np.column_stack([point @ e1, point @ e2])

        return shapely.make_valid(shapely.transform(part, lay)) if not part.is_empty else EMPTY


def _polygon_area(shape: BaseGeometry) -> float:
    return float(shape.area)
