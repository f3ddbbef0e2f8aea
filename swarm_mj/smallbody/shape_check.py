"""Whether a triangle mesh bounds one solid body in metres; if not, which face or vertex is wrong and how to repair it.

Faces and vertices are numbered from 0 in messages, as in `ShapeModel`. Gravity, coverage and target regions rest on
these properties: an open or inside-out mesh gives plausible but wrong numbers, so it is refused at the door.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from swarm_mj.errors import ShapeError
from swarm_mj.smallbody.shape import ShapeModel, as_rows, directed_edges
from swarm_mj.typing import Array, Ints

#: Largest vertex radii believed without being told [m]: most asteroids given in kilometres, read as metres, stay below the
#: first; the second is four times Ceres.
BODY_RADIUS_RANGE_M = (50.0, 2.0e6)
#: Coordinates beyond this [m] are damage, not geometry; squared areas and volumes of larger ones would overflow.
MAX_COORDINATE_M = 1e15
#: Meshes of more faces are refused: far beyond what gravity and coverage can use, and checking them takes gigabytes.
MAX_FACES = 10_000_000
#: Largest distance of the centroid from the origin, as a fraction of the radius about the centroid.
MAX_CENTROID_OFFSET = 0.5
#: A face lower than this fraction of its longest edge has no area.
MIN_RELATIVE_HEIGHT = 1e-9
#: Lengths, areas and volumes from here on are said in km, km^2 and km^3 [m, m^2, m^3].
LEAST_IN_KM = {1: 1e3, 2: 1e4, 3: 1e6}


class BodySizeError(ShapeError):
    """A body of a size that is not believed; whoever read the mesh knows how its user can say otherwise.

    Attributes:
        found: What is wrong.
        unit: Unit that the file may have been meant in, "m" or "km".
    """

    def __init__(self, found: str, unit: str) -> None:
        super().__init__(found, unit)
        self.found, self.unit = found, unit

    def __str__(self) -> str:
        """The message in terms of the arguments of `check_shape` and `load_shape`."""
        return self.advised('pass unit="{unit}"', "pass expect_radius_m=(lowest, highest)")

    def advised(self, unit_advice: str, range_advice: str) -> str:
        """The message in other terms; `unit_advice` says how to give the unit, which takes the place of `{unit}`."""
        taken, scale = (
            ("kilometres taken for metres", 1000) if self.unit == "km" else ("metres taken for kilometres", 0.001)
        )
        return (
            f"{self.found}; it looks like {taken}: {unit_advice.format(unit=self.unit)}, or scale the mesh by {scale:g}. "
            f"For a body that is really of this size {range_advice}"
        )


class UnknownUnitError(BodySizeError):
    """A body that may be meant in metres or in kilometres."""

    def advised(self, unit_advice: str, range_advice: str) -> str:
        """See `BodySizeError`; the size is not in doubt where the unit is known."""
        other = "m" if self.unit == "km" else "km"
        return f"{self.found}: {unit_advice.format(unit=self.unit)}, or {other} if that is meant"


def shown_size(value: float, power: int) -> str:
    """A length, area or volume [m, m^2, m^3] by its power of a length, to four digits, in m or km, whichever fits."""
    scale, unit = (1e3, "km") if value >= LEAST_IN_KM[power] else (1.0, "m")
    number = float(f"{value / scale**power:.4g}")
    return f"{number:,.15g} {unit}{f'^{power}' if power > 1 else ''}"


def check_shape(
    vertices: ArrayLike,
    faces: ArrayLike,
    name: str = "shape",
    *,
    expect_radius_m: tuple[float, float] = BODY_RADIUS_RANGE_M,
) -> ShapeModel:
    """Check that a mesh is one closed, outward-oriented body about the origin, of a believable size.

    Args:
        vertices: positions in A [m], shape (V, 3).
        faces: vertex indices from 0, shape (F, 3).
        name: what messages call the mesh, e.g. the file.
        expect_radius_m: lowest and highest believable distance of the farthest vertex from the origin [m].

    Returns:
        The checked shape.

    Raises:
        ShapeError: the first defect found, with the face or vertex and the repair.
    """
    shape = check_surface(vertices, faces, name)
    _check_origin(shape)
    _check_size(shape, expect_radius_m)
    return shape


def check_surface(vertices: ArrayLike, faces: ArrayLike, name: str = "shape") -> ShapeModel:
    """Check everything that does not depend on size and place: finite, closed, oriented outwards, in one piece.

    Args and errors as in `check_shape`.
    """
    corners = as_rows(vertices, np.float64, f"{name}: vertices")
    # Indices are compared as 64-bit integers: narrowing them first could wrap a huge one into range.
    triangles = as_rows(faces, np.int64, f"{name}: faces")
    if len(triangles) > MAX_FACES:
        raise ShapeError(
            f"{name}: {len(triangles)} faces exceed {MAX_FACES} (MAX_FACES); reduce it with mesh.simplify_quadric_decimation"
        )
    _check_vertices(corners, name)
    _check_indices(corners, triangles, name)
    shape = ShapeModel(corners, triangles.astype(np.int32), name)
    _check_areas(shape)
    partners = _check_edges(shape)
    _check_orientation(shape, partners)
    _check_one_piece(shape, partners)
    return shape


def _check_vertices(vertices: Array, name: str) -> None:
    bad = np.flatnonzero(~np.isfinite(vertices).all(axis=1))
    if bad.size:
        raise ShapeError(
            f"{name}: vertex {bad[0]} is {_point(vertices[bad[0]])}, not finite ({bad.size} such); "
            "export the mesh again or remove these vertices and close the hole (trimesh.repair.fill_holes)"
        )
    largest = np.abs(vertices).max(initial=0.0)
    if largest > MAX_COORDINATE_M:
        raise ShapeError(
            f"{name}: a vertex lies {largest:.3g} m from the origin; this is no body, export the mesh again"
        )


def _check_indices(vertices: Array, faces: Ints, name: str) -> None:
    if len(faces) == 0:
        raise ShapeError(f"{name}: no faces; the file may be a point cloud, export it as a triangle mesh")
    bad = np.flatnonzero(((faces < 0) | (faces >= len(vertices))).any(axis=1))
    if bad.size:
        raise ShapeError(
            f"{name}: face {bad[0]} uses vertices {faces[bad[0]].tolist()} but there are only {len(vertices)} "
            f"(0 to {len(vertices) - 1}); the file is cut short or counts its vertices from another number"
        )
    stray = np.flatnonzero(np.bincount(faces.ravel(), minlength=len(vertices)) == 0)
    if stray.size:
        raise ShapeError(
            f"{name}: vertex {stray[0]} belongs to no face ({stray.size} such); "
            "remove them with trimesh's mesh.remove_unreferenced_vertices()"
        )


def _check_areas(shape: ShapeModel) -> None:
    corners = shape.vertices[shape.faces]
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    flat = np.flatnonzero(2.0 * shape.face_areas <= MIN_RELATIVE_HEIGHT * longest**2)
    if flat.size:
        raise ShapeError(
            f"{shape.name}: face {flat[0]} (vertices {shape.faces[flat[0]].tolist()}) has no area ({flat.size} such); "
            "remove with mesh.update_faces(mesh.nondegenerate_faces()) and mesh.merge_vertices() in trimesh"
        )


def _check_edges(shape: ShapeModel) -> Ints:
    """Pair the directed edges: returns rows (i, j) of `directed_edges` that lie on the same edge, shape (E, 2)."""
    directed = directed_edges(shape.faces).astype(np.int64)
    keys = directed.min(axis=1) * len(shape.vertices) + directed.max(axis=1)
    order = np.argsort(keys, kind="stable")
    _, first, counts = np.unique(keys[order], return_index=True, return_counts=True)
    for wrong, what, repair in (
        (counts == 1, "an open edge: the surface has a hole", "weld equal vertices with mesh.merge_vertices(), then "
         "trimesh.repair.fill_holes(mesh)"),
        (counts > 2, "shared by more than two faces: the surface is not a manifold", "remove doubled faces with "
         "mesh.update_faces(mesh.unique_faces()) or inner walls in a mesh editor"),
    ):  # fmt: skip
        if wrong.any():
            row = order[first[wrong]].min()
            a, b = directed[row]
            raise ShapeError(
                f"{shape.name}: face {row // 3} has, between vertices {a} {_point(shape.vertices[a])} and "
                f"{b} {_point(shape.vertices[b])}, {what} ({wrong.sum()} such edges); {repair}"
            )
    return order.reshape(-1, 2)


def _check_orientation(shape: ShapeModel, partners: Ints) -> None:
    directed = directed_edges(shape.faces)
    same_way = directed[partners[:, 0], 0] == directed[partners[:, 1], 0]
    if same_way.any():
        # A single turned face disagrees along all three of its edges, each neighbour along one only.
        disagreements = np.bincount(partners[same_way].ravel() // 3, minlength=len(shape.faces))
        raise ShapeError(
            f"{shape.name}: face {disagreements.argmax()} winds against its neighbours ({same_way.sum()} such edges); "
            "repair with trimesh.repair.fix_normals(mesh)"
        )
    if shape.volume < 0.0:
        raise ShapeError(
            f"{shape.name}: all faces point inwards, face 0 (vertices {shape.faces[0].tolist()}) included; they must "
            "wind counter-clockwise seen from outside: repair with trimesh.repair.fix_inversion(mesh) or mesh.invert()"
        )


def _check_one_piece(shape: ShapeModel, partners: Ints) -> None:
    i, j = (partners // 3).T
    links = coo_array((np.ones(len(i), dtype=np.int8), (i, j)), shape=(len(shape.faces),) * 2)
    pieces, labels = connected_components(links, directed=False)
    if pieces > 1:
        small = int(np.bincount(labels).argmin())
        face = int(np.flatnonzero(labels == small)[0])
        raise ShapeError(
            f"{shape.name}: {pieces} separate surfaces; face {face} belongs to the smallest. Keep one body with "
            "max(mesh.split(), key=lambda part: part.volume) in trimesh"
        )


def _check_origin(shape: ShapeModel) -> None:
    offset = float(np.linalg.norm(shape.centroid))
    radius = float(np.linalg.norm(shape.vertices - shape.centroid, axis=1).max())
    if offset > MAX_CENTROID_OFFSET * radius:
        raise ShapeError(
            f"{shape.name}: the centroid {_point(shape.centroid)} lies {offset:.4g} m from the origin, too far for a "
            f"body of radius {radius:.4g} m; move it with mesh.apply_translation(-mesh.center_mass) in trimesh"
        )


def _check_size(shape: ShapeModel, expect_radius_m: tuple[float, float]) -> None:
    low, high = expect_radius_m
    if low <= shape.max_radius <= high:
        return
    vertex = int(np.linalg.norm(shape.vertices, axis=1).argmax())
    raise BodySizeError(
        f"{shape.name}: the farthest vertex, {vertex}, lies {shape.max_radius:.4g} m from the origin, expected {low:g} "
        f"to {high:g} m",
        "km" if shape.max_radius < low else "m",
    )


def _point(position: Array) -> str:
    return "(" + ", ".join(f"{x:.6g}" for x in position) + ")"
