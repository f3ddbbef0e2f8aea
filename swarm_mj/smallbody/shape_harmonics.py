"""Shapes of packaged bodies from spherical harmonics of an ellipsoid-scaled radius, and ellipsoids.

A unit vector u points to the surface point x = rho(u) (a u_x, b u_y, c u_z) in frame A, where rho is a sum of real
orthonormal spherical harmonics. Those of 433 Eros go to degree 40 with (16, 8, 6) km; they were fitted to the NEAR MSI plate
model with 7,790 facets (Thomas et al. 2002; PDS data set NEAR-A-5-COLLECTED-MODELS-V1.0), whose facets they pass at 12 m rms.
The tables of 101955 Bennu (degree 24) and 25143 Itokawa (degree 36) name their models in their first lines; that of the
dumb-bell, a body of our own, says how it is made.

`swarm-mj build-shape --out assets/eros.obj` builds the mesh of Eros that this project flies around.
"""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np

from swarm_mj.errors import ShapeError
from swarm_mj.io.resources import asset_path
from swarm_mj.smallbody.geodesic import geodesic_icosahedron
from swarm_mj.smallbody.shape import ShapeModel
from swarm_mj.smallbody.shape_check import check_shape
from swarm_mj.smallbody.shape_io import load_shape
from swarm_mj.typing import Array

#: Subdivision of the mesh: 4,002 vertices, 8,000 faces, edges of about 600 m.
FREQUENCY = 20
#: Vertices are rounded to this many decimals of a metre, far below the fit, so that every build gives the same file.
DECIMALS = 4
#: Directions whose harmonics are summed at once; they stay in the processor's cache.
BLOCK = 4096


class HarmonicShape(NamedTuple):
    """A body whose shape is packaged as harmonics.

    Attributes:
        name: Of the body.
        table: File in the assets.
        semi_axes_m: Of the ellipsoid that the dimensionless radius scales [m].
    """

    name: str
    table: str
    semi_axes_m: tuple[float, float, float]


#: Packaged bodies by the name that a scenario gives. The tables say which models they were fitted to, and how well.
BODIES = {
    "eros": HarmonicShape("433 Eros", "eros_shape_harmonics.csv", (16_000.0, 8_000.0, 6_000.0)),
    "bennu": HarmonicShape("101955 Bennu", "bennu_shape_harmonics.csv", (280.0, 270.0, 250.0)),
    "itokawa": HarmonicShape("25143 Itokawa", "itokawa_shape_harmonics.csv", (280.0, 150.0, 120.0)),
    "dumbbell": HarmonicShape("dumb-bell", "dumbbell_shape_harmonics.csv", (1000.0, 900.0, 800.0)),
}


def build_shape(body: str = "eros", frequency: int = FREQUENCY) -> ShapeModel:
    """Build the mesh of a packaged body on the vertices of a geodesic icosahedron.

    Args:
        body: One of `BODIES`.
        frequency: subdivision f; gives 10 f^2 + 2 vertices and 20 f^2 faces.

    Returns:
        The checked shape, frame A, metres, rounded to 0.1 mm.

    Raises:
        ShapeError: there is no such body.
    """
    if body not in BODIES:
        raise ShapeError(f"{body!r}: no packaged body; there are {', '.join(BODIES)}")
    about = BODIES[body]
    directions, faces = geodesic_icosahedron(frequency)
    rho = radius_factor(directions, read_harmonics(body))
    return check_shape(np.round(rho[:, None] * directions * about.semi_axes_m, DECIMALS) + 0.0, faces, about.name)


def build_ellipsoid(semi_axes_m: tuple[float, float, float], name: str, frequency: int = FREQUENCY) -> ShapeModel:
    """Build the mesh of an ellipsoid, its vertices on it, of semi-axes along x, y and z of A [m]; see `build_shape`."""
    directions, faces = geodesic_icosahedron(frequency)
    return check_shape(np.round(directions * np.array(semi_axes_m), DECIMALS) + 0.0, faces, name)


@cache
def load_body(body: str) -> ShapeModel:
    """The mesh of a packaged body that flights use: 4,002 vertices, 8,000 faces; that of Eros is a file, others are built.

    Raises:
        ShapeError: see `build_shape`.
    """
    return load_eros() if body == "eros" else build_shape(body)


def load_eros() -> ShapeModel:
    """Read the packaged mesh of Eros (`assets/eros.obj`), which `build_shape` made."""
    return load_shape(str(asset_path("eros.obj")), name=BODIES["eros"].name)


def read_harmonics(body: str = "eros") -> Array:
    """The packaged table of a body: rows l, m, a_lm, b_lm, shape (n, 4), dimensionless."""
    lines = asset_path(BODIES[body].table).read_text("utf-8").splitlines()
    return np.array([line.split(",") for line in lines if line and line[0] not in "#l"], dtype=np.float64)


def radius_factor(directions: Array, harmonics: Array) -> Array:
    """Evaluate rho = sum_l P_l0 a_l0 + sqrt(2) sum_{l, m > 0} P_lm (a_lm cos m lambda + b_lm sin m lambda).

    Args:
        directions: unit vectors u, shape (n, 3).
        harmonics: rows l, m, a, b, shape (k, 4).

    Returns:
        Dimensionless rho, shape (n,).
    """
    order = harmonics[:, :2].astype(int)
    cosines, sines = np.zeros((2, *(order.max(axis=0) + 1)))
    np.add.at(cosines, tuple(order.T), harmonics[:, 2])
    np.add.at(sines, tuple(order.T), harmonics[:, 3])
    rho = np.empty(len(directions))
    for start in range(0, len(directions), BLOCK):
        block = slice(start, start + BLOCK)
        rho[block] = _sum_harmonics(directions[block], cosines, sines)
    return rho


def _sum_harmonics(directions: Array, cosines: Array, sines: Array) -> Array:
    """The sum with coefficients a[l, m], b[l, m], by the recurrence in l of Legendre functions orthonormal on the sphere."""
    z, sine = directions[:, 2], np.hypot(directions[:, 0], directions[:, 1])
    longitude = np.arctan2(directions[:, 1], directions[:, 0])
    rho, sectoral = np.zeros(len(z)), np.full(len(z), 0.5 / np.sqrt(np.pi))
    for m in range(cosines.shape[1]):
        if m:
            # With the Condon-Shortley phase, as the coefficients are.
            sectoral = -np.sqrt((2 * m + 1) / (2 * m)) * sine * sectoral
        legendre, before = sectoral, np.zeros(len(z))
        even, odd = cosines[m, m] * legendre, sines[m, m] * legendre
        for degree in range(m + 1, len(cosines)):
            gain = np.sqrt((4 * degree**2 - 1) / (degree**2 - m**2))
            lag = np.sqrt(((degree - 1) ** 2 - m**2) / (4 * (degree - 1) ** 2 - 1))
            legendre, before = gain * (z * legendre - lag * before), legendre
            even += cosines[degree, m] * legendre
            odd += sines[degree, m] * legendre
        rho += (np.sqrt(2.0) if m else 1.0) * (even * np.cos(m * longitude) + odd * np.sin(m * longitude))
    return rho
