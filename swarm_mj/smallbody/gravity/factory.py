"""Gravity fields from scenario parameters: the built-in plug-ins of the group `swarm_mj.gravity`.

A gravity plug-in is called with the body's `ShapeModel` first and the scenario's `body.gravity.parameters` as keywords.
"""

from __future__ import annotations

from collections.abc import Sequence

from swarm_mj.errors import ScenarioError
from swarm_mj.scenarios import constants
from swarm_mj.smallbody.gravity.point_mass import PointMass
from swarm_mj.smallbody.gravity.polyhedron import Polyhedron
from swarm_mj.smallbody.gravity.spherical_harmonics import SphericalHarmonics
from swarm_mj.smallbody.shape import ShapeModel


def point_mass(shape: ShapeModel, *, gm: float = constants.EROS_GM) -> PointMass:
    """Point mass at the centre of mass.

    Args:
        shape: Shape of the body; not used.
        gm: Gravitational parameter [m^3/s^2].
    """
    return PointMass(gm)


def spherical_harmonics(
    shape: ShapeModel,
    *,
    gm: float = constants.EROS_GM,
    reference_radius_m: float = constants.EROS_REFERENCE_RADIUS,
    coefficients: Sequence[tuple[int, int, float, float]] | None = None,
) -> SphericalHarmonics:
    """Spherical harmonics of any degree.

    Args:
        shape: Shape of the body; not used.
        gm: Gravitational parameter [m^3/s^2].
        reference_radius_m: Reference radius of the coefficients [m].
        coefficients: Rows (n, m, C, S), fully normalised; None: degree 2 of NEAR15A for Eros.
    """
    table = constants.EROS_DEGREE_2 if coefficients is None else _table(coefficients)
    return SphericalHarmonics.from_coefficients(gm=gm, reference_radius=reference_radius_m, coefficients=table)


def polyhedron(shape: ShapeModel, *, gm: float | None = None, density_kg_m3: float | None = None) -> Polyhedron:
    """Polyhedron of the shape with constant density.

    Args:
        shape: Shape of the body.
        gm: Gravitational parameter [m^3/s^2]; None: that of Eros, or from the density.
        density_kg_m3: Density instead of `gm` [kg/m^3].

    Raises:
        ScenarioError: Both are given.
    """
    if density_kg_m3 is not None and gm is not None:
        raise ScenarioError(f"polyhedron: give gm = {gm!r} or density_kg_m3 = {density_kg_m3!r}, not both")
    if density_kg_m3 is not None:
        return Polyhedron(shape, density=density_kg_m3)
    return Polyhedron(shape, gm=constants.EROS_GM if gm is None else gm)


def _table(coefficients: Sequence[tuple[int, int, float, float]]) -> dict[tuple[int, int], tuple[float, float]]:
    table: dict[tuple[int, int], tuple[float, float]] = {}
    for row in coefficients:
        if len(row) != 4 or not all(type(k) is int for k in row[:2]):
            raise ScenarioError(f"gravity coefficients: {row!r} is no row [n, m, C, S] with whole n and m")
        n, m, c, s = row
        if (n, m) in table:
            raise ScenarioError(f"gravity coefficients: (n, m) = ({n}, {m}) is given twice")
        table[n, m] = (float(c), float(s))
    return table
