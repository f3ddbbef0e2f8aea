r"""Gravity of a polyhedron of constant density, valid everywhere outside, on and inside the body.

Werner and Scheeres (1997), Celestial Mechanics and Dynamical Astronomy 65, 313-344, eqs. 12 to 18:

    U       = G rho / 2 (sum_e r_e.E_e.r_e L_e - sum_f r_f.F_f.r_f w_f)
    grad U  = G rho (-sum_e E_e.r_e L_e + sum_f F_f.r_f w_f)
    grad^2 U = G rho (sum_e E_e L_e - sum_f F_f w_f),     laplacian = -G rho sum_f w_f

with r_e and r_f from the field point to a point of the edge and of the face, L_e the potential of a wire, w_f the
solid angle of the face, E_e and F_f dyads of normals. On an edge L_e is infinite, yet its products in potential and
attraction tend to zero; the gradient really is infinite there.

The sums cancel: their relative rounding grows with the cube of the distance, to pure noise at some 1e5 radii, and they take as
long everywhere. From 1.75 to 2 times the largest radius on the field therefore passes over into that of the same polyhedron in
spherical harmonics, which converge there. Both agree at first, farther out the series is truer; with 4,092 faces it takes 1/25
of the time at first and 1/65 from three radii on, where fewer terms count, and more than the sums with a few dozen faces.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from copy import copy
from dataclasses import dataclass, field
from functools import cached_property
from itertools import repeat
from typing import Any, NamedTuple

import numpy as np

from swarm_mj.compilation import allocation_free, jittable, kernel
from swarm_mj.errors import ScenarioError
from swarm_mj.io.cache import cache_folder, hash_of, load_array, store_array
from swarm_mj.io.machine import usable_threads
from swarm_mj.scenarios.constants import GRAVITATIONAL_CONSTANT
from swarm_mj.smallbody.gravity.base import positions, positive
from swarm_mj.smallbody.gravity.spherical_harmonics import SphericalHarmonics, fit_harmonics
from swarm_mj.smallbody.shape import ShapeModel, directed_edges, frozen
from swarm_mj.smallbody.shape_check import check_surface
from swarm_mj.smallbody.solid_angle import cast_rays, solid_angle, solid_angles
from swarm_mj.typing import Array, Ints, Ints32

#: Bound on the argument of the wire's logarithm: keeps 0 times infinity at 0 for points on an edge.
MIN_WIRE_GAP = 1e-300
#: Distances r over the body's largest radius R between which the sums pass over into harmonics. Of the attraction of a mass
#: at R these leave out, over that of one at the centre, at most the sum of (n + 1) (R/r)^n beyond their degree, at first
#: 2.2e-13.
FAR_RADII = (1.75, 2.0)
#: Degree of the harmonics; the sphere on which they are fitted, over the largest radius; and the degrees beyond that the fit
#: resolves: higher ones alias weakened by 1.5^-80 = 8e-15. What rounding adds there to a coefficient of degree n has fallen by
#: 0.86^n at the first distance: there attractions agree to 3e-13, gradients to 2e-12, as measured with a dumb-bell of 4,092
#: faces and Eros of 8,000.
FAR_DEGREE, FIT_RADII, FIT_MARGIN = 60, 1.5, 10
#: Terms of the sums that are worth a thread of their own, some milliseconds.
LEAST_TERMS = 100_000
#: Side of a cell over the largest radius, at most: flights that differ by rounding are nearly always in one, see `in_cells`.
CELL_RADII = 2.0**-28
#: Numbers that are kept of a cell: its middle [m], the attraction there [m/s^2], and xx, xy, xz, yy, yz, zz of the gradient
#: [1/s^2]; all zero: of none.
CELL_NUMBERS = 12


class PolyhedronElements(NamedTuple):
    """A polyhedron for kernels.

    Attributes:
        vertices: Shape (V, 3) [m].
        faces: Corners, shape (F, 3).
        normals: Of the faces, outward, shape (F, 3).
        edges: Ends, shape (E, 2).
        dyads: See `_edge_dyads`, shape (E, 7).
        scale: G times the density [1/s^2].
        radius: Of the farthest vertex [m].
    """

    vertices: Array
    faces: Ints32
    normals: Array
    edges: Ints
    dyads: Array
    scale: float
    radius: float


@dataclass(frozen=True, eq=False, init=False)
class Polyhedron:
    """Constant-density polyhedron; give its density or its gravitational parameter, the other follows.

    The attraction is that of the mesh where it stands: if its centroid is not at the origin of A, neither is the centre
    of the field. For Eros they are 53 m apart: the origin is the centre of mass of the real, inhomogeneous body.

    Attributes:
        shape: closed surface, checked.
        density: constant density [kg/m^3].
        gm: gravitational parameter [m^3/s^2].
        cell: side of the cells of its attraction, a power of two [m]; 0: there are none, see `in_cells`.
    """

    shape: ShapeModel
    density: float
    gm: float
    cell: float
    _edges: Ints = field(repr=False)
    _edge_dyads: Array = field(repr=False)

    def __init__(self, shape: ShapeModel, density: float | None = None, gm: float | None = None) -> None:
        """Check the surface, complete density and gm, and form the dyads of the edges.

        Raises:
            ShapeError: the surface does not enclose a body.
            ScenarioError: not exactly one of density and gm is given, or it is not above 0.
        """
        check_surface(shape.vertices, shape.faces, shape.name)
        unit_gm = GRAVITATIONAL_CONSTANT * shape.volume
        if density is not None and gm is None:
            gm = positive(density, "gravity.density") * unit_gm
        elif gm is None or density is not None:
            raise ScenarioError("gravity of a polyhedron: give exactly one of density [kg/m^3] and gm [m^3/s^2]")
        edges, dyads = map(frozen, _edge_dyads(shape))
        object.__setattr__(self, "shape", shape)
        object.__setattr__(self, "gm", positive(gm, "gravity.gm"))
        object.__setattr__(self, "density", self.gm / unit_gm)
        object.__setattr__(self, "cell", 0.0)
        object.__setattr__(self, "_edges", edges)
        object.__setattr__(self, "_edge_dyads", dyads)

    def acceleration(self, r_A: Array) -> Array:
        """Attraction in A [m/s^2], shape (n, 3), at positions in A [m], shape (n, 3)."""
        return self._near_and_far(r_A, self._near, lambda r: self.far_field.acceleration(r))

    def potential(self, r_A: Array) -> Array:
        """Potential [m^2/s^2], positive, shape (n,), at positions in A [m], shape (n, 3)."""
        return self._near_and_far(r_A, lambda r: self.sums(r)[:, 0], lambda r: self.far_field.potential(r))

    def gradient(self, r_A: Array) -> Array:
        """Gradient of the acceleration [1/s^2], shape (n, 3, 3), at positions in A [m], shape (n, 3)."""
        symmetric = [4, 5, 6, 5, 7, 8, 6, 8, 9]
        return self._near_and_far(
            r_A, lambda r: self.sums(r)[:, symmetric].reshape(-1, 3, 3), lambda r: self.far_field.gradient(r)
        )

    def laplacian(self, r_A: Array) -> Array:
        """Laplacian of the potential [1/s^2], shape (n,): 0 outside, -4 pi G rho inside."""
        solid_angle = solid_angles(positions(r_A), self.shape.vertices, self.shape.faces)
        return -GRAVITATIONAL_CONSTANT * self.density * solid_angle

    @cached_property
    def far_field(self) -> SphericalHarmonics:
        """The same field in spherical harmonics, which hold beyond `FAR_RADII` of the largest radius; kept on disk."""
        radius, shape = self.shape.max_radius, (2, FAR_DEGREE + 1, FAR_DEGREE + 1)
        key = hash_of(f"{self.gm!r} {FAR_DEGREE} {FIT_RADII} {FIT_MARGIN}", self.shape.vertices, self.shape.faces)
        file = cache_folder() / "harmonics" / f"{key}.npy"
        kept = load_array(file, shape, np.float64)
        if kept is None:
            field = fit_harmonics(
                lambda r_A: self.sums(r_A)[:, 0], self.gm, radius, FAR_DEGREE, FIT_RADII * radius, margin=FIT_MARGIN
            )
            kept = np.stack([field.c, field.s])
            store_array(file, kept)
        return SphericalHarmonics(self.gm, radius, kept[0], kept[1], bounded=True)

    def _near_and_far(self, r_A: Array, near: Callable[[Array], Array], far: Callable[[Array], Array]) -> Array:
        """The sums near the body, the harmonics far away, and between them a smooth passage from one to the other."""
        r_A = positions(r_A)
        first, last = FAR_RADII
        share = np.clip((np.linalg.norm(r_A, axis=1) / self.shape.max_radius - first) / (last - first), 0.0, 1.0)
        if not share.any():
            return np.ascontiguousarray(near(r_A))
        weight = _weight(share)
        beyond, within = share > 0.0, share < 1.0  # neither is asked where it does not hold
        outside = far(r_A[beyond])
        field = np.zeros((len(r_A), *outside.shape[1:]))
        field[beyond] = outside
        field[within] = _mixed(near(r_A[within]), field[within], weight[within])
        return field

    def sums(self, r_A: Array) -> Array:
        """Potential, attraction and xx, xy, xz, yy, yz, zz of its gradient by the sums alone, shape (n, 10)."""
        r_A = positions(r_A)
        if (parts := min(usable_threads(), len(r_A) * len(self.shape.faces) // LEAST_TERMS)) < 2:
            return np.asarray(_field(r_A, self.elements))
        with ThreadPoolExecutor(parts) as pool:  # kernels run without Python's lock
            return np.concatenate(list(pool.map(_field, np.array_split(r_A, parts), repeat(self.elements))))

    def _near(self, r_A: Array) -> Array:
        if self.cell > 0.0:
            return np.asarray(_attraction_in_cells(positions(r_A), self.elements, self.cell))
        return self.sums(r_A)[:, 1:4]

    @cached_property
    def in_cells(self) -> Polyhedron:
        """The same field with its sums taken in the middles of small cells and led on from there by the gradient.

        So places that differ by rounding, as those of flights of one path do, share the sums, and the attraction still depends
        on the place alone, not on who was there before. A cell is some 2^-28 of the largest radius R, 61 um at Eros.

        What is left out is of second order. The third derivative of 1/d is at most 6 / d^4; over all that is no nearer than the
        height s above the surface this makes at most 12 pi G rho d^2 / s, where d is the way from the middle, at most
        sqrt(3) / 2 cells. Beside the attraction of a ball, 4/3 pi G rho R, that is below 1e-16 R / s; of a long body, a few
        times as much: 4e-14 at 100 m above Eros, 1e-15 above Itokawa, where the rounding of the sums is 2e-14 and more.
        Potential and gradient are as they were.
        """
        if self.cell > 0.0:
            return self
        finer = copy(self)
        object.__setattr__(finer, "cell", CELL_RADII * 2.0 ** math.floor(math.log2(self.shape.max_radius)))
        return finer

    @cached_property
    def elements(self) -> PolyhedronElements:
        """The body as kernels take it; copies, for Numba compiles apart what takes an array that is read-only."""
        shape = self.shape
        return PolyhedronElements(
            vertices=shape.vertices.copy(),
            faces=shape.faces.copy(),
            normals=shape.face_normals.copy(),
            edges=self._edges.copy(),
            dyads=self._edge_dyads.copy(),
            scale=GRAVITATIONAL_CONSTANT * self.density,
            radius=float(shape.max_radius),
        )


def _mixed(near: Array, far: Array, weight: Array) -> Array:
    """Both in one, by the weight of the second, shape (n,), which may hold anything where that is zero."""
    weight = weight.reshape(-1, *(1,) * (near.ndim - 1))
    return np.where(weight > 0.0, near + weight * (far - near), near)


def _edge_dyads(shape: ShapeModel) -> tuple[Ints, Array]:
    """Edges (E, 2); and E = n_A n_A^12 + n_B n_B^21 as xx, xy, xz, yy, yz, zz with the edge's length, shape (E, 7)."""
    directed = directed_edges(shape.faces).astype(np.int64)
    along = shape.vertices[directed[:, 1]] - shape.vertices[directed[:, 0]]
    lengths = np.linalg.norm(along, axis=1, keepdims=True)
    normals = np.repeat(shape.face_normals, 3, axis=0)
    outward = np.cross(along / lengths, normals)
    halves = np.einsum("ei,ej->eij", normals, outward)
    keys = directed.min(axis=1) * len(shape.vertices) + directed.max(axis=1)
    pairs = np.argsort(keys, kind="stable").reshape(-1, 2)
    dyads = halves[pairs[:, 0]] + halves[pairs[:, 1]]
    rows, columns = np.triu_indices(3)
    components = 0.5 * (dyads + dyads.transpose(0, 2, 1))[:, rows, columns]
    return directed[pairs[:, 0]], np.column_stack([components, lengths[pairs[:, 0]]])


@jittable
def _weight(share: Any) -> Any:
    """Of the far field, for the part of the passage behind a point: smooth at both ends."""
    return share * share * (3.0 - 2.0 * share)


@kernel
def _field(r_A: Array, body: PolyhedronElements) -> Array:
    """Potential, attraction and the six components of the gradient, shape (n, 10)."""
    out = np.zeros((r_A.shape[0], 10))
    rays = np.empty((body.vertices.shape[0], 4))
    for i in range(r_A.shape[0]):
        _sum_elements(r_A[i], body, rays, out[i])
    return out


@kernel
def _sum_elements(point: Array, body: PolyhedronElements, rays: Array, out: Array) -> None:
    cast_rays(point, body.vertices, rays)
    _add_edges(rays, body.edges, body.dyads, out)
    _add_faces(rays, body.faces, body.normals, out)
    for k in range(10):
        out[k] *= body.scale
    out[0] *= 0.5


@kernel
def _attraction_in_cells(r_A: Array, body: PolyhedronElements, cell: float) -> Array:
    out, known = np.empty((r_A.shape[0], 3)), np.zeros(CELL_NUMBERS)
    for i in range(r_A.shape[0]):
        a = _pull_near(r_A[i], body, cell, known)
        out[i, 0], out[i, 1], out[i, 2] = a
    return out


@jittable
def _pull_near(r: Array, body: PolyhedronElements, cell: float, known: Array) -> tuple[float, float, float]:
    """Attraction from the sums in the middle of the cell of a place, which are taken unless `known` is of that cell."""
    x, y, z = _middle(r[0], cell), _middle(r[1], cell), _middle(r[2], cell)
    if known[0] != x or known[1] != y or known[2] != z or known[6] == 0.0:
        _sum_in_middle(x, y, z, body, known)
    x, y, z = r[0] - x, r[1] - y, r[2] - z
    return (
        known[3] + (known[6] * x + known[7] * y + known[8] * z),
        known[4] + (known[7] * x + known[9] * y + known[10] * z),
        known[5] + (known[8] * x + known[10] * y + known[11] * z),
    )


@jittable
def _middle(x: float, cell: float) -> float:
    return cell * np.rint(x / cell) if cell > 0.0 else x


@kernel
def _sum_in_middle(x: float, y: float, z: float, body: PolyhedronElements, known: Array) -> None:
    sums = np.zeros(10)
    known[0], known[1], known[2] = x, y, z
    _sum_elements(known[:3], body, np.empty((body.vertices.shape[0], 4)), sums)
    for k in range(1, 10):  # a slice would compile NumPy's check of shapes and its words
        known[2 + k] = sums[k]


@jittable
def _share_of_far(r: Array, radius: float) -> float:
    """How far through the passage from sums to harmonics a place lies: below 0 before it, above 1 beyond."""
    x, y, z = r[0], r[1], r[2]
    first, last = FAR_RADII
    return (np.sqrt(x * x + y * y + z * z) / radius - first) / (last - first)


@allocation_free
def any_far(r_A: Array, radius: float) -> bool:
    """Whether the harmonics have a share in the attraction at any of the places, shape (n, 3) [m]."""
    for i in range(r_A.shape[0]):
        if _share_of_far(r_A[i], radius) > 0.0:
            return True
    return False


@allocation_free
def write_near_and_far(r_A: Array, body: PolyhedronElements, cell: float, known: Array, a_A: Array) -> None:
    """Put the attraction of the polyhedron in the place of its harmonics, wherever these do not hold alone.

    Args:
        r_A: In A, shape (n, 3) [m].
        body: The polyhedron.
        cell: Side of the cells [m]; 0: each place is its own, see `Polyhedron.in_cells`.
        known: A cell for each place, see `CELL_NUMBERS`, replaced by the one it is in, shape (n, 12).
        a_A: Accelerations by its harmonics, needed if `any_far`, replaced, shape (n, 3) [m/s^2].
    """
    for i in range(r_A.shape[0]):
        share = _share_of_far(r_A[i], body.radius)
        if share >= 1.0:
            continue
        near, weight = _pull_near(r_A[i], body, cell, known[i]), _weight(max(share, 0.0))
        for k in range(3):
            a_A[i, k] = near[k] + weight * (a_A[i, k] - near[k]) if weight > 0.0 else near[k]


@kernel
def _add_edges(rays: Array, edges: Ints, dyads: Array, out: Array) -> None:
    for e in range(edges.shape[0]):
        p, q = rays[edges[e, 0]], rays[edges[e, 1]]
        wire = _wire(p, q, dyads[e, 6])
        xx, xy, xz = dyads[e, 0] * wire, dyads[e, 1] * wire, dyads[e, 2] * wire
        yy, yz, zz = dyads[e, 3] * wire, dyads[e, 4] * wire, dyads[e, 5] * wire
        ax = xx * p[0] + xy * p[1] + xz * p[2]
        ay = xy * p[0] + yy * p[1] + yz * p[2]
        az = xz * p[0] + yz * p[1] + zz * p[2]
        out[0] += ax * p[0] + ay * p[1] + az * p[2]
        out[1] -= ax
        out[2] -= ay
        out[3] -= az
        out[4] += xx
        out[5] += xy
        out[6] += xz
        out[7] += yy
        out[8] += yz
        out[9] += zz


@kernel
def _add_faces(rays: Array, faces: Ints32, normals: Array, out: Array) -> None:
    for f in range(faces.shape[0]):
        p = rays[faces[f, 0]]
        angle = solid_angle(p, rays[faces[f, 1]], rays[faces[f, 2]])
        nx, ny, nz = normals[f, 0], normals[f, 1], normals[f, 2]
        height = nx * p[0] + ny * p[1] + nz * p[2]
        out[0] -= height * height * angle
        out[1] += nx * height * angle
        out[2] += ny * height * angle
        out[3] += nz * height * angle
        out[4] -= nx * nx * angle
        out[5] -= nx * ny * angle
        out[6] -= nx * nz * angle
        out[7] -= ny * ny * angle
        out[8] -= ny * nz * angle
        out[9] -= nz * nz * angle


@kernel
def _wire(p: Array, q: Array, length: float) -> float:
    """L_e = ln((|p| + |q| + e) / (|p| + |q| - e)) for an edge of length e between the ends of the rays p and q."""
    # |p| + |q| - e = 2 (|p| |q| + p.q) / (|p| + |q| + e); near the edge this sum cancels, its conjugate does not.
    dot = p[0] * q[0] + p[1] * q[1] + p[2] * q[2]
    gap = p[3] * q[3] + dot
    if dot < 0.0:
        cx, cy, cz = p[1] * q[2] - p[2] * q[1], p[2] * q[0] - p[0] * q[2], p[0] * q[1] - p[1] * q[0]
        gap = (cx * cx + cy * cy + cz * cz) / (p[3] * q[3] - dot)
    # Not max(): that costs more than the logarithm.
    if gap < MIN_WIRE_GAP:
        gap = MIN_WIRE_GAP
    reach = p[3] + q[3] + length
    return np.log(reach * reach / (2.0 * gap))
