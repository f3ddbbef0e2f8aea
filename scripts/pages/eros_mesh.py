"""Eros's harmonics sampled finer or coarser, as a body of a scenario: what `convergence` and `benchmarks.scale` compare."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from swarm_mj.scenarios import constants
from swarm_mj.smallbody.shape import ShapeModel
from swarm_mj.smallbody.shape_harmonics import build_shape
from swarm_mj.smallbody.shape_io import save_shape

#: A mesh of one's own takes no gravity from Eros by itself; here it is Eros's on purpose.
EROS_FIELD = {
    "gm": constants.EROS_GM,
    "reference_radius_m": constants.EROS_REFERENCE_RADIUS,
    "coefficients": [[n, m, *cs] for (n, m), cs in constants.EROS_DEGREE_2.items()],
}


def eros_at(frequency: int, folder: Path) -> tuple[ShapeModel, dict[str, Any]]:
    """Write Eros as a mesh of 20 `frequency`^2 faces into a folder.

    Returns:
        The mesh, and the overrides with which a scenario flies past it in Eros's measured field.
    """
    shape, path = build_shape("eros", frequency), folder / f"eros-{frequency}.obj"
    save_shape(shape, path)
    return shape, {"body.shape": str(path), "body.gravity.parameters": EROS_FIELD}
