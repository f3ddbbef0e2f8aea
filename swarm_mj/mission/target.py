"""The target region: the part of a body's surface inside a pyramid from its centre or inside a polygon, or all of it.

After AAS 19-144, 'Target region generation': the faces inside the virtual pyramid, clipped at its sides, are the set F_T, and
the mesh vertices inside, lifted to the imaging altitude, are the n_T visiting points. Everything is in the body-fixed
frame A, in metres. The pyramid's axis points at the given latitude and longitude; its four sides are parallel to the
local east and north there (at a pole, east is the limit along the given longitude).

The pyramid selects by direction from the centre alone: where such a ray meets an overhanging surface several times,
every crossing belongs to the target, as in the paper.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import sqrt
from typing import Literal, NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike

from swarm_mj.errors import MissionError, PathError
from swarm_mj.mission.mesh_cut import Cuts, cut_mesh, plane_distance, refine_mesh
from swarm_mj.smallbody.shape import ShapeModel
from swarm_mj.smallbody.solid_angle import points_inside
from swarm_mj.typing import Array, Indices, Ints32, Mask

Edges = Literal["corner", "side"]
Projection = Literal["radial", "normal"]

#: Width of the camera's footprint over the longest edge of a cell, see `automatic_cell_size`.
CELLS_ACROSS_FOOTPRINT = 6.0
#: Least share of its face that a piece cut off by a side of the target must have to belong to it. Smaller ones are a matter of
#: rounding; for one of them 0.003 % of the paper's target stayed unseen though all other faces were seen.
LEAST_PART = 0.01
#: Of a wider target east and north angles about its axis say nothing [rad].
WIDE = np.radians(75.0)
#: Points along one side of a pyramid's border.
BORDER_POINTS = 60


@dataclass(frozen=True, eq=False, kw_only=True)
class TargetRegion:
    """The target on a mesh that was cut at the pyramid's sides, so that its area is exact.

    A *face* is an element of F_T: a triangle of the cut mesh inside the pyramid. A *cell* is what an observer judges:
    a face, or a part of one if the faces were subdivided.

    Attributes:
        mesh: The whole body in A [m], cut at the pyramid's sides; its first vertices are the original ones.
        parent: Original mesh face that each face of `mesh` lies in, shape (F,).
        target: Faces of `mesh` that are the cells, ascending, shape (n,).
        group: Face of F_T that each cell lies in, from 0, shape (n,).
        visiting_vertex: Original mesh vertices inside the pyramid, in mesh order, shape (n_T,). Visiting point k of the
            paper, counted from 1, is entry k - 1.
        visiting_normal_A: Outward unit normals of the original mesh at those vertices, shape (n_T, 3).
        axes_A: Unit vectors east, north and outward along the pyramid's axis, or at the middle of another target, as rows,
            shape (3, 3).
        side_half_angle: Angle between the axis and the sides of the pyramid, or of one about the target [rad]; pi where none
            holds it.
        weight: Of the area of each cell, the largest of the targets that it belongs to, shape (n,).
        kind: `target.region` of the scenario.
        border: Directions along the target's border, closed lines of shape (k, 3); none of the lit part and of the whole body.
        parts: Where several targets make up this one, each of them on the same mesh, in order; their cells may overlap, and
            what is said above of a pyramid and its vertices is said of the first. Empty: there is one target.
    """

    mesh: ShapeModel
    parent: Indices
    target: Indices
    group: Indices
    visiting_vertex: Indices
    visiting_normal_A: Array
    axes_A: Array
    side_half_angle: float
    weight: Array
    kind: str = "pyramid"
    border: tuple[Array, ...] = ()
    parts: tuple[TargetRegion, ...] = ()

    @property
    def targets(self) -> tuple[TargetRegion, ...]:
        """The targets of which this one is the union; itself where there is one."""
        return self.parts or (self,)

    def cells_of(self, target: int) -> Indices:
        """Numbers of the cells that belong to one of `targets`, ascending."""
        return np.searchsorted(self.target, self.targets[target].target)

    def by_face(self, values: Array) -> Array:
        """Values of the cells, shape (n,), for each face of the cut mesh; NaN beyond the target, shape (F,)."""
        found = np.full(len(self.faces), np.nan)
        found[self.target] = values
        return found

    @property
    def vertices(self) -> Array:
        """Vertices of the cut mesh in A [m], shape (V, 3)."""
        return self.mesh.vertices

    @property
    def faces(self) -> Ints32:
        """Faces of the cut mesh, outward, shape (F, 3)."""
        return self.mesh.faces

    @cached_property
    def corners_A(self) -> Array:
        """Corners of each cell in A [m], shape (n, 3, 3)."""
        return self.vertices[self.faces[self.target]]

    @cached_property
    def centroid_A(self) -> Array:
        """Centroid of each cell in A [m], shape (n, 3)."""
        return self.mesh.face_centroids[self.target]

    @cached_property
    def normal_A(self) -> Array:
        """Outward unit normal of each cell in A, shape (n, 3)."""
        return self.mesh.face_normals[self.target]

    @cached_property
    def area(self) -> Array:
        """Area of each cell [m^2], shape (n,)."""
        return self.mesh.face_areas[self.target]

    @cached_property
    def weighted_area(self) -> Array:
        """Area of each cell times its weight, of which P_TO is made [m^2], shape (n,)."""
        return self.area * self.weight

    @cached_property
    def total_weighted_area(self) -> float:
        """Of the target [m^2]."""
        return float(self.weighted_area.sum())

    @cached_property
    def typical_area(self) -> float:
        """Area of the target's median cell [m^2]; of a polygon, whose sides cut slivers, half of the area is in larger ones."""
        if self.kind != "polygon":
            return float(np.median(self.area))
        order = np.argsort(self.area)
        return float(self.area[order][np.searchsorted(np.cumsum(self.area[order]), 0.5 * self.total_area)])

    @property
    def is_weighted(self) -> bool:
        """Whether parts count more than others."""
        return bool(np.ptp(self.weight) > 0.0)

    @property
    def facing_A(self) -> Array:
        """Mean direction of its outward normals, or its axis where they point everywhere; unit vector, shape (3,)."""
        mean = self.area @ self.normal_A
        length = float(np.linalg.norm(mean))
        return np.asarray(mean / length if length > 1e-3 * self.total_area else self.axes_A[2])

    @property
    def is_wide(self) -> bool:
        """Whether it reaches too far around the body to be drawn about its axis."""
        return any(target.side_half_angle > WIDE for target in self.targets)

    @property
    def centre_longitude_deg(self) -> float:
        """East longitude of its axis, for maps [deg]."""
        return float(place_of(self.axes_A[2])[1])

    def restricted(self, chosen: Mask) -> TargetRegion:
        """The target of some of its cells alone, shape (n,), with those of its visiting vertices that are their corners.

        Raises:
            MissionError: No cell is left of one of its targets, or no vertex.
        """
        kept = np.isin(self.target, self.target[chosen])
        vertices = np.isin(self.visiting_vertex, self.mesh.faces[self.target[kept]])
        if not kept.any() or not vertices.any():
            raise MissionError(f"target.region = {self.kind}: no cell or no vertex of {self.mesh.name} is left to see")
        everything = np.zeros(len(self.mesh.faces), np.bool_)
        everything[self.target[kept]] = True
        longitude = float(place_of(self.area[kept] @ self.centroid_A[kept])[1])
        return replace(
            self,
            axes_A=local_axes(0.0, longitude) if self.kind == "lit" else self.axes_A,
            target=self.target[kept],
            group=np.unique(self.group[kept], return_inverse=True)[1],
            weight=self.weight[kept],
            visiting_vertex=self.visiting_vertex[vertices],
            visiting_normal_A=self.visiting_normal_A[vertices],
            parts=tuple(part.restricted(everything[part.target]) for part in self.parts),
        )

    @cached_property
    def total_area(self) -> float:
        """Area of the target, A(F_T) [m^2]."""
        return float(self.area.sum())

    @property
    def n_cells(self) -> int:
        """Number of cells."""
        return len(self.target)

    @cached_property
    def n_faces(self) -> int:
        """Number of faces in F_T: triangles of the cut mesh inside the pyramid, before any subdivision."""
        return int(self.group[-1]) + 1

    @property
    def n_visiting(self) -> int:
        """Number of visiting points, n_T."""
        return len(self.visiting_vertex)

    def visiting_points_A(self, altitude: float, *, projection: Projection = "radial") -> Array:
        """Lift the visiting vertices off the surface.

        Args:
            altitude: Height above each vertex [m], positive.
            projection: `radial`, away from the body's centre, or `normal`, along the area-weighted vertex normal.

        Returns:
            Visiting points in A [m], shape (n_T, 3).
        """
        points = self.vertices[self.visiting_vertex]
        if projection == "normal":
            return points + altitude * self.visiting_normal_A
        return points * (1.0 + altitude / np.linalg.norm(points, axis=1, keepdims=True))


class Feature(Protocol):
    """What of a body's surface is a target."""

    @property
    def cuts(self) -> Cuts:
        """Planes along which a mesh is cut, so that each face lies inside or outside."""

    @property
    def axes(self) -> Array:
        """East, north and outward at its middle, as rows, shape (3, 3)."""

    @property
    def half_angle(self) -> float:
        """Between its middle and the sides of the pyramid about it [rad]; pi: none holds it."""

    @property
    def border(self) -> tuple[Array, ...]:
        """Directions along its border, closed lines of shape (k, 3)."""

    @property
    def weight(self) -> float:
        """Of its area."""

    @property
    def least_part(self) -> float:
        """Of a face that is cut, pieces of a smaller share of it are left out."""

    @property
    def words(self) -> str:
        """Where it is, in words before the body's name."""

    def faces_inside(self, vertices: Array, faces: Ints32) -> Mask:
        """Which faces of the cut mesh lie inside, shape (F,)."""

    def holds(self, points_A: Array) -> Mask:
        """Which vertices lie inside or on its border, shape (n,)."""


class Pyramid(NamedTuple):
    """Where a target is.

    Attributes:
        latitude_deg: Planetocentric latitude of the pyramid's axis [deg], -90 to 90.
        longitude_deg: East longitude of the axis [deg].
        half_angle_deg: Half-angle of the pyramid [deg], between 0 and 90.
        edges: What lies at the half-angle: the pyramid's four `corner` edges, or the middles of its `side` planes.
        weight: Of its area.
        least_part: Of a face that a side cuts, pieces of a smaller share of it are left out.
    """

    latitude_deg: float
    longitude_deg: float
    half_angle_deg: float
    edges: Edges = "corner"
    weight: float = 1.0
    least_part: float = LEAST_PART

    @property
    def axes(self) -> Array:
        """East, north and outward along the axis, as rows, shape (3, 3)."""
        return local_axes(self.latitude_deg, self.longitude_deg)

    @property
    def slope(self) -> float:
        """Tangent of the angle between axis and sides."""
        tangent = float(np.tan(np.radians(self.half_angle_deg)))
        return tangent / sqrt(2.0) if self.edges == "corner" else tangent

    @property
    def half_angle(self) -> float:
        """Between the axis and the sides [rad]."""
        return float(np.arctan(self.slope))

    @property
    def cuts(self) -> Cuts:
        """Along its four sides; the normals point inwards."""
        east, north, up = self.axes
        normals = self.slope * up + np.array([east, -east, north, -north])
        return Cuts(normals / np.linalg.norm(normals, axis=1, keepdims=True))

    @property
    def border(self) -> tuple[Array, ...]:
        """Directions along its sides."""
        corners = self.slope * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0]])
        share = np.linspace(0.0, 4.0, 4 * BORDER_POINTS + 1)
        east, north = (np.interp(share, np.arange(5), corners[:, k]) for k in range(2))
        return (np.column_stack((east, north, np.ones(len(share)))) @ self.axes,)

    def faces_inside(self, vertices: Array, faces: Ints32) -> Mask:
        """No face crosses a side any more."""
        return np.all(self._sides(vertices)[:, faces].sum(axis=2) > 0, axis=0)

    def holds(self, points_A: Array) -> Mask:
        """Inside or on its sides, but for the centre."""
        side = self._sides(points_A)
        return np.all(side >= 0, axis=0) & np.any(side, axis=0)

    def _sides(self, points_A: Array) -> Array:
        """On which side of each plane points lie: 1 inside, 0 on the plane, -1 outside, shape (4, n)."""
        return np.array([np.sign(plane_distance(points_A, normal)) for normal in self.cuts.normal])

    @property
    def words(self) -> str:
        """Where, in words."""
        return (
            f"within {self.half_angle_deg} deg of latitude {self.latitude_deg}, longitude {self.longitude_deg} deg on"
        )


class WholeBody(NamedTuple):
    """All of the surface; no pyramid bounds it, and its axes are those of A from the x axis."""

    weight: float = 1.0
    least_part: float = 0.0
    half_angle: float = np.pi
    words: str = "on all of"
    cuts: Cuts = Cuts(np.empty((0, 3)))
    border: tuple[Array, ...] = ()

    @property
    def axes(self) -> Array:
        """East, north and outward along the x axis."""
        return local_axes(0.0, 0.0)

    def faces_inside(self, vertices: Array, faces: Ints32) -> Mask:
        """All of them."""
        return np.ones(len(faces), np.bool_)

    def holds(self, points_A: Array) -> Mask:
        """All of them."""
        return np.ones(len(points_A), np.bool_)


def build_target(
    shape: ShapeModel,
    *,
    latitude_deg: float,
    longitude_deg: float,
    half_angle_deg: float,
    edges: Edges = "corner",
    cell_size_m: float | None = None,
    least_part: float = LEAST_PART,
) -> TargetRegion:
    """Cut the mesh at the sides of the virtual pyramid and collect what lies inside; see `Pyramid` and `build_targets`."""
    pyramid = Pyramid(latitude_deg, longitude_deg, half_angle_deg, edges, least_part=least_part)
    return build_targets(shape, [pyramid], cell_size_m=cell_size_m)


def build_targets(
    shape: ShapeModel, features: Sequence[Feature], *, cell_size_m: float | None = None, kind: str = "pyramid"
) -> TargetRegion:
    """Cut the mesh at the borders of features and collect what lies inside any of them.

    Args:
        shape: The body in A [m].
        features: One for each target; where they overlap, a cell belongs to several and counts once in the whole.
        cell_size_m: Subdivide the targets until no cell has a longer edge [m]; None keeps the faces of F_T as cells.
        kind: Of the first one, see `TargetRegion`.

    Raises:
        MissionError: One holds no face or no vertex.
    """
    vertices, faces, parent = shape.vertices, shape.faces, np.arange(len(shape.faces))
    for feature in features:
        vertices, faces, origin = cut_mesh(vertices, faces, feature.cuts)
        parent = parent[origin]
    part = _part_of_face(shape, vertices, faces, parent)
    held = [feature.faces_inside(vertices, faces) & (part >= feature.least_part) for feature in features]
    for feature, faces_held in zip(features, held, strict=True):
        if not faces_held.any():
            where = f"{feature.words} {shape.name}"
            raise MissionError(f"target off the body: no face {where}; check the target or the shape's origin")
    visiting = [np.flatnonzero(feature.holds(shape.vertices)) for feature in features]
    for feature, points in zip(features, visiting, strict=True):
        if not len(points):
            where = f"{feature.words} {shape.name}"
            raise MissionError(f"no mesh vertex {where}, so nothing to visit: enlarge the target or refine the mesh")
    chosen: Mask = np.any(held, axis=0)
    weights = np.max([np.where(inside, f.weight, 0.0) for inside, f in zip(held, features, strict=True)], axis=0)
    origin = np.arange(len(faces))
    if cell_size_m is not None:
        vertices, faces, origin = refine_mesh(vertices, faces, chosen, cell_size_m)
    mesh = ShapeModel(vertices, faces, shape.name)

    def region(cells: Mask, k: int, parts: tuple[TargetRegion, ...] = ()) -> TargetRegion:
        return TargetRegion(
            mesh=mesh,
            parent=parent[origin],
            target=np.flatnonzero(cells[origin]),
            group=(np.cumsum(cells) - 1)[origin][cells[origin]],
            visiting_vertex=visiting[k],
            visiting_normal_A=shape.vertex_normals[visiting[k]],
            axes_A=features[k].axes,
            side_half_angle=features[k].half_angle,
            weight=weights[origin][cells[origin]],
            kind="pyramid" if k else kind,
            border=features[k].border,
            parts=parts,
        )

    several = tuple(region(held[k], k) for k in range(len(features))) if len(features) > 1 else ()
    return region(chosen, 0, several)


def _part_of_face(shape: ShapeModel, vertices: Array, faces: Ints32, parent: Indices) -> Array:
    """Share of each piece in the area of the face that it was cut from."""
    whole, part = (
        0.5 * np.linalg.norm(np.cross(v[f[:, 1]] - v[f[:, 0]], v[f[:, 2]] - v[f[:, 0]]), axis=1)
        for v, f in ((shape.vertices, shape.faces), (vertices, faces))
    )
    return np.asarray(part / whole[parent])


def whole_body(shape: ShapeModel, *, cell_size_m: float | None = None) -> TargetRegion:
    """The whole surface as the target, for maps; arguments as of `build_targets`."""
    return build_targets(shape, [WholeBody()], cell_size_m=cell_size_m, kind="body")


def automatic_cell_size(altitude_m: float, half_angle_deg: float) -> float:
    """Longest cell edge [m] at which judging cells whole no longer distorts the covered area.

    A cell is counted whole or not at all, so that the border of each image is rounded to the cells under it; the error
    shrinks as more cells lie across the footprint, whose width is 2 h tan(half-angle). Six across keep the accumulated
    coverage of a passage within 1 % of the exact one (measured against polygon clipping, 3 deg at 14 km).
    """
    return 2.0 * altitude_m * float(np.tan(np.radians(half_angle_deg))) / CELLS_ACROSS_FOOTPRINT


def check_visiting_points(shape: ShapeModel, points_A: Array) -> None:
    """Make sure that every visiting point in A, in order, shape (n_T, 3) [m], lies outside the body.

    Raises:
        PathError: A point is inside the body or on its surface; the message names the first one.
    """
    below = points_inside(np.ascontiguousarray(points_A, dtype=np.float64), shape.vertices, shape.faces)
    buried = np.flatnonzero(below | ~np.isfinite(points_A).all(axis=1))
    if len(buried):
        first = buried[0]
        raise PathError(
            f"visiting point {first + 1} at {np.round(points_A[first], 1).tolist()} m is below the surface of {shape.name}: "
            "raise the imaging altitude or project it along the other direction (radial or normal)",
            f"below the surface of {shape.name}",
            buried.tolist(),
        )


def directions(latitude_deg: ArrayLike, longitude_deg: ArrayLike) -> Array:
    """Unit vectors in A of places given in degrees, shape (..., 3)."""
    latitude, longitude = np.radians(latitude_deg), np.radians(longitude_deg)
    return np.stack(
        (np.cos(latitude) * np.cos(longitude), np.cos(latitude) * np.sin(longitude), np.sin(latitude)), axis=-1
    )


def place_of(points_A: ArrayLike) -> tuple[Array, Array]:
    """Planetocentric latitude and east longitude of points (..., 3) [deg], longitudes from -180 to 180."""
    x, y, z = np.moveaxis(np.asarray(points_A, np.float64), -1, 0)
    return np.degrees(np.arctan2(z, np.hypot(x, y))), np.degrees(np.arctan2(y, x))


def local_axes(latitude_deg: float, longitude_deg: float) -> Array:
    """Unit vectors east, north and up at a planetocentric latitude and longitude, as rows in A, shape (3, 3)."""
    lon, up = np.radians(longitude_deg), directions(latitude_deg, longitude_deg)
    east = np.array([-np.sin(lon), np.cos(lon), 0.0])
    return np.array([east, np.cross(up, east), up])


def angles(points_A: Array, axes_A: Array) -> Array:
    """Directions of points (..., 3) as angles east and north of the target's axis, shape (..., 2) [deg].

    The pyramid's side planes become the sides of a square.
    """
    east, north, up = np.moveaxis(points_A @ axes_A.T, -1, 0)
    return np.degrees(np.stack((np.arctan2(east, up), np.arctan2(north, up)), axis=-1))
