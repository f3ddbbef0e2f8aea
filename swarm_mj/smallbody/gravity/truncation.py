"""A homogeneous polyhedron's field as spherical harmonics of a chosen degree, and how far off they are where.

The series converges outside the sphere about the origin that encloses the body; close to it a low degree leaves much out.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from swarm_mj.smallbody.geodesic import geodesic_icosahedron
from swarm_mj.smallbody.gravity.polyhedron import Polyhedron
from swarm_mj.smallbody.gravity.spherical_harmonics import SphericalHarmonics

#: Spheres on which both fields are compared, over the largest radius, and the frequency of the geodesic mesh of places there.
SHELLS, FREQUENCY = (1.0, 1.1, 1.25, 1.5, 2.0, 3.0, 5.0), 7


def truncated_field(body: Polyhedron, degree: int) -> SphericalHarmonics:
    """The harmonics of its `far_field` to a degree; they refer to the largest radius of the shape."""
    far, size = body.far_field, degree + 1
    return SphericalHarmonics(body.gm, far.reference_radius, far.c[:size, :size], far.s[:size, :size])


def truncation_errors(body: Polyhedron, field: SphericalHarmonics) -> Iterator[tuple[float, float]]:
    """For each of `SHELLS` the largest difference of the attractions as a share of that by the sums."""
    for share in SHELLS:
        r_A = share * body.shape.max_radius * geodesic_icosahedron(FREQUENCY)[0]
        true = body.sums(r_A)[:, 1:4]
        off = np.linalg.norm(field.acceleration(r_A) - true, axis=1) / np.linalg.norm(true, axis=1)
        yield share, float(off.max())


def gravity_text(field: SphericalHarmonics, found: Sequence[str]) -> str:
    """The section `body.gravity` of a scenario as YAML, below what was found as comments."""
    rows = [
        f"    - [{n}, {m}, {field.c[n, m]:.16e}, {field.s[n, m]:.16e}]"
        for n in range(1, field.degree + 1)
        for m in range(n + 1)
    ]
    head = [*(f"# {line}" for line in found), "model: spherical_harmonics", "parameters:"]
    numbers = [f"  gm: {field.gm:.16e}", f"  reference_radius_m: {field.reference_radius:.16e}", "  coefficients:"]
    return "\n".join([*head, *numbers, *rows, ""])
