"""The built-in gravity fields as numbers, for kernels that fly without Python."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from swarm_mj.compilation import kernel
from swarm_mj.smallbody.gravity.base import Gravity
from swarm_mj.smallbody.gravity.point_mass import PointMass, write_point_mass
from swarm_mj.smallbody.gravity.polyhedron import Polyhedron, PolyhedronElements, any_far, write_near_and_far
from swarm_mj.smallbody.gravity.spherical_harmonics import SphericalHarmonics, write_series
from swarm_mj.typing import Array

#: Kinds of fields that kernels know.
POINT_MASS, HARMONICS, POLYHEDRON = 0, 1, 2


class CompiledField(NamedTuple):
    """A gravity field for kernels; what its kind does not need is empty.

    Attributes:
        kind: POINT_MASS, HARMONICS or POLYHEDRON.
        gm: Gravitational parameter of a point mass [m^3/s^2].
        radius: Reference radius of the harmonics; of a polyhedron, those that hold far away [m].
        recursion: See `recursion_table`.
        series: Coefficients of their acceleration, see `SphericalHarmonics`.
        elements: The polyhedron; None for other fields, whose kernels then do without it.
        cell: Side of the cells of its attraction [m]; 0: there are none, see `Polyhedron.in_cells`.
        bounded: Of harmonics, see `SphericalHarmonics`.
    """

    kind: int
    gm: float
    radius: float
    recursion: Array
    series: Array
    elements: PolyhedronElements | None
    cell: float
    bounded: bool = False


def compiled_field(gravity: Gravity) -> CompiledField | None:
    """A field as kernels take it; None where they do not know its kind."""
    if type(gravity) is PointMass:
        return CompiledField(POINT_MASS, gravity.gm, 1.0, np.empty((0, 0, 2)), np.empty((0, 0, 3, 2)), None, 0.0)
    if type(gravity) is SphericalHarmonics:
        return CompiledField(HARMONICS, 0.0, *_series_of(gravity), None, 0.0, gravity.bounded)
    if type(gravity) is Polyhedron:
        return CompiledField(POLYHEDRON, 0.0, *_series_of(gravity.far_field), gravity.elements, gravity.cell, True)
    return None


def _series_of(field: SphericalHarmonics) -> tuple[float, Array, Array]:
    # Copies, for Numba compiles apart what takes an array that is read-only.
    return field.reference_radius, field.recursion.copy(), field.acceleration_series.copy()


@kernel
def write_attraction(
    r_A: Array, field: CompiledField, elements: PolyhedronElements | None, series: Array, known: Array, out: Array
) -> None:
    """Accelerations at places of the turning body, as the field's `acceleration` gives them.

    Args:
        r_A: In A, shape (n, 3) [m].
        field: The field.
        elements: Its `elements`; an argument of its own, for Numba leaves out what is for none of them by arguments alone.
        series: Its own `series`, or another one of the same size in its place.
        known: Cells of a polyhedron whose sums are known, brought up to date, see `write_near_and_far`, shape (n, 12).
        out: Receives the accelerations in A, shape (n, 3) [m/s^2].
    """
    if field.kind == HARMONICS:
        write_series(r_A, field.radius, field.recursion, series, field.bounded, out)
    elif field.kind == POINT_MASS:
        write_point_mass(r_A, field.gm, out)
    elif elements is not None:
        if any_far(r_A, elements.radius):
            write_series(r_A, field.radius, field.recursion, series, field.bounded, out)
        write_near_and_far(r_A, elements, field.cell, known, out)
