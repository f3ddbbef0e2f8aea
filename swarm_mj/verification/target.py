"""The target region: its area and number of faces against clipping of polygons, and its visiting points."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from swarm_mj.mission.target import TargetRegion, build_target
from swarm_mj.typing import Array
from swarm_mj.verification.experiment import Bench, experiment
from swarm_mj.verification.gravity import eros_shape

#: The paper's target: a pyramid about 0 N, 90 E whose corner edges stand at 20 deg.
HALF_ANGLE_DEG = 20.0
#: East, north and up there, as rows in A.
AXES_A = np.array([[-1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0]])


def eros_target(bench: Bench) -> TargetRegion:
    """The paper's target on Eros."""
    return build_target(bench.once(eros_shape), latitude_deg=0.0, longitude_deg=90.0, half_angle_deg=HALF_ANGLE_DEG)


def clipped_faces(bench: Bench) -> list[Array]:
    """Parts of the faces inside the pyramid, as polygons, after Sutherland and Hodgman (1974)."""
    shape, (east, north, up) = bench.once(eros_shape), AXES_A
    slope = np.tan(np.radians(HALF_ANGLE_DEG)) / np.sqrt(2.0)
    parts = list(shape.vertices[shape.faces])
    for inward in (slope * up + side for side in (east, -east, north, -north)):
        parts = [part for part in (clip(part, inward) for part in parts) if len(part) > 2]
    return parts


def clip(polygon: Array, inward: Array) -> Array:
    """The part of a convex polygon, shape (k, 3), on the inner side of a plane through the origin."""
    kept: list[Array] = []
    closed = np.vstack([polygon, polygon[:1]])
    for (a, da), (b, db) in pairwise(zip(closed, closed @ inward, strict=True)):
        if da >= 0.0:
            kept.append(a)
        if da * db < 0.0:
            kept.append(a + (b - a) * da / (da - db))
    return np.array(kept).reshape(-1, 3)


def polygon_area(polygon: Array) -> float:
    """Area of a flat polygon in space [m^2]."""
    fan = np.cross(polygon[1:-1] - polygon[0], polygon[2:] - polygon[0])
    return 0.5 * float(np.linalg.norm(fan.sum(axis=0)))


@experiment("target-area", "clipping of every face by Sutherland and Hodgman", 1e-12)
def area_error(bench: Bench) -> float:
    """Area of the target with all pieces that its sides cut off, relative."""
    exact = sum(polygon_area(part) for part in bench.once(clipped_faces))
    whole = build_target(
        bench.once(eros_shape), latitude_deg=0.0, longitude_deg=90.0, half_angle_deg=HALF_ANGLE_DEG, least_part=0.0
    )
    return abs(whole.total_area / exact - 1.0)


@experiment("target-visiting-points", "angles of every vertex from the axis, eastward and northward", 0.0)
def vertices_error(bench: Bench) -> float:
    """Visiting points too many or too few."""
    shape = bench.once(eros_shape)
    east, north, up = AXES_A @ shape.vertices.T
    sideways = (np.degrees(np.arctan2(np.abs(offset), up)) for offset in (east, north))
    side = np.degrees(np.arctan(np.tan(np.radians(HALF_ANGLE_DEG)) / np.sqrt(2.0)))
    inside = np.flatnonzero(np.maximum(*sideways) <= side)
    return float(len(np.setxor1d(inside, bench.once(eros_target).visiting_vertex)))
