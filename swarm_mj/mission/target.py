"""The target region: the part of a body's surface inside a virtual pyramid with its apex at the body's centre.

After AAS 19-144, 'Target region generation': the faces inside the pyramid, clipped at its sides, are the set F_T, and
the mesh vertices inside, lifted to the imaging altitude, are the n_T visiting points. Everything is in the body-fixed
frame A, in metres. The pyramid's axis points at the given latitude and longitude; its four sides are parallel to the
local east and north there (at a pole, east is the limit along the given longitude).

The pyramid selects by direction from the centre alone: where such a ray meets an overhanging surface several times,
every crossing belongs to the target, as in the paper.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from math import sqrt
from typing import Literal, NamedTuple

import numpy as np

from swarm_mj.errors import MissionError, PathError
from swarm_mj.mission.mesh_cut import cut_mesh, plane_distance, refine_mesh
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
        axes_A: Unit vectors east, north and outward along the pyramid's axis, as rows, shape (3, 3).
        side_half_angle: Angle between the axis and the pyramid's sides [rad].
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
    parts: tuple[TargetRegion, ...] = ()

    @property
    def targets(self) -> tuple[TargetRegion, ...]:
        """The targets of which this one is the union; itself where there is one."""
        return self.parts or (self,)

    def cells_of(self, target: int) -> Indices:
        """Numbers of the cells that belong to one of `targets`, ascending."""
        return np.searchsorted(self.target, self.targets[target].target)

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


class Pyramid(NamedTuple):
    """Where a target is.

    Attributes:
        latitude_deg: Planetocentric latitude of the pyramid's axis [deg], -90 to 90.
        longitude_deg: East longitude of the axis [deg].
        half_angle_deg: Half-angle of the pyramid [deg], between 0 and 90.
        edges: What lies at the half-angle: the pyramid's four `corner` edges, or the middles of its `side` planes.
    """

    latitude_deg: float
    longitude_deg: float
    half_angle_deg: float
    edges: Edges = "corner"

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
    def words(self) -> str:
        """Where, in words."""
        return (
            f"within {self.half_angle_deg} deg of latitude {self.latitude_deg}, longitude {self.longitude_deg} deg on"
        )


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
    pyramid = Pyramid(latitude_deg, longitude_deg, half_angle_deg, edges)
    return build_targets(shape, [pyramid], cell_size_m=cell_size_m, least_part=least_part)


def build_targets(
    shape: ShapeModel,
    pyramids: Sequence[Pyramid],
    *,
    cell_size_m: float | None = None,
    least_part: float = LEAST_PART,
) -> TargetRegion:
    """Cut the mesh at the sides of virtual pyramids and collect what lies inside any of them.

    Args:
        shape: The body in A [m].
        pyramids: One for each target; where they overlap, a cell belongs to several and counts once in the whole.
        cell_size_m: Subdivide the targets until no cell has a longer edge [m]; None keeps the faces of F_T as cells.
        least_part: Of a face that a side cuts, pieces of a smaller share of it are left out.

    Raises:
        MissionError: A pyramid holds no face or no vertex.
    """
    sides = [_side_normals(pyramid.axes, pyramid.slope) for pyramid in pyramids]
    vertices, faces, parent = cut_mesh(shape.vertices, shape.faces, np.vstack(sides))
    # On which side of each plane of each pyramid the vertices lie: 1 inside, 0 on the plane, -1 outside.
    side = np.array([[np.sign(plane_distance(vertices, normal)) for normal in normals] for normals in sides])
    # No face crosses a plane any more.
    held = np.all(side[:, :, faces].sum(axis=3) > 0, axis=1) & (
        _part_of_face(shape, vertices, faces, parent) >= least_part
    )
    for pyramid, faces_held in zip(pyramids, held, strict=True):
        if not faces_held.any():
            where = f"{pyramid.words} {shape.name}"
            raise MissionError(f"target off the body: no face {where}; check the target or the shape's origin")
    points_inside_or_on = np.all(side >= 0, axis=1) & np.any(side, axis=1)
    visiting = [np.flatnonzero(each[: len(shape.vertices)]) for each in points_inside_or_on]
    for pyramid, points in zip(pyramids, visiting, strict=True):
        if not len(points):
            where = f"{pyramid.words} {shape.name}"
            raise MissionError(
                f"no mesh vertex {where}, so nothing to visit: enlarge the half-angle or refine the mesh"
            )
    chosen: Mask = np.asarray(held.any(axis=0))
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
            axes_A=pyramids[k].axes,
            side_half_angle=float(np.arctan(pyramids[k].slope)),
            parts=parts,
        )

    several = tuple(region(held[k], k) for k in range(len(pyramids))) if len(pyramids) > 1 else ()
    return region(chosen, 0, several)


def _part_of_face(shape: ShapeModel, vertices: Array, faces: Ints32, parent: Indices) -> Array:
    """Share of each piece in the area of the face that it was cut from."""
    whole, part = (
        0.5 * np.linalg.norm(np.cross(v[f[:, 1]] - v[f[:, 0]], v[f[:, 2]] - v[f[:, 0]]), axis=1)
        for v, f in ((shape.vertices, shape.faces), (vertices, faces))
    )
    return np.asarray(part / whole[parent])


def whole_body(shape: ShapeModel, *, cell_size_m: float | None = None) -> TargetRegion:
    """The whole surface as the target, for maps; no pyramid bounds it, and its axes are those of A from the x axis.

    Args:
        shape: The body in A [m].
        cell_size_m: Subdivide the faces until no cell has a longer edge [m]; None keeps them as cells.
    """
    vertices, faces, parent = shape.vertices, shape.faces, np.arange(len(shape.faces))
    if cell_size_m is not None:
        every = np.ones(len(faces), np.bool_)
        vertices, faces, parent = refine_mesh(vertices, faces, every, cell_size_m)
    return TargetRegion(
        mesh=ShapeModel(vertices, faces, shape.name),
        parent=parent,
        target=np.arange(len(faces)),
        group=parent,
        visiting_vertex=np.arange(len(shape.vertices)),
        visiting_normal_A=shape.vertex_normals,
        axes_A=local_axes(0.0, 0.0),
        side_half_angle=np.pi,
    )


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


def local_axes(latitude_deg: float, longitude_deg: float) -> Array:
    """Unit vectors east, north and up at a planetocentric latitude and longitude, as rows in A, shape (3, 3)."""
    lat, lon = np.radians(latitude_deg), np.radians(longitude_deg)
    up = np.array([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)])
    east = np.array([-np.sin(lon), np.cos(lon), 0.0])
    return np.array([east, np.cross(up, east), up])


def angles(points_A: Array, axes_A: Array) -> Array:
    """Directions of points (..., 3) as angles east and north of the target's axis, shape (..., 2) [deg].

    The pyramid's side planes become the sides of a square.
    """
    east, north, up = np.moveaxis(points_A @ axes_A.T, -1, 0)
    return np.degrees(np.stack((np.arctan2(east, up), np.arctan2(north, up)), axis=-1))


def _side_normals(axes_A: Array, slope: float) -> Array:
    """Inward unit normals of the pyramid's four sides, shape (4, 3)."""
    east, north, up = axes_A
    normals = slope * up + np.array([east, -east, north, -north])
    return normals / np.linalg.norm(normals, axis=1, keepdims=True)
