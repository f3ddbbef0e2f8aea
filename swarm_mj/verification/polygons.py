"""Exact visibility by polygon clipping on the picture plane, with shapely. Shares no code with the observers.

Perspective maps straight lines to straight lines: the visible part of a cell is its projection, cut to the field of view,
less the projections of the faces that lie nearer. Frame A and the camera's frame (z along the line of sight), metres.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

import numpy as np

from swarm_mj.typing import Array, Mask

#: Picture coordinates are rounded to this, 20 nm at 20 km; unrounded, GEOS confuses triangles with a common edge.
GRID = 1e-12
#: Overlaps of projections below this are rounding.
LEAST_OVERLAP = 1e-15


def visible_areas(corners_A: Array, mesh_A: Array, r_A: Array, C_CA: Array, half_angle_deg: float) -> Array:
    """Area of each cell that a square picture shows.

    Args:
        corners_A: The cells, shape (n, 3, 3) [m].
        mesh_A: Corners of all faces of the body, shape (F, 3, 3) [m].
        r_A: Position of the camera, shape (3,) [m].
        C_CA: Rotation from A to the camera's frame.
        half_angle_deg: Of the field of view [deg].

    Returns:
        Areas on the ground, shape (n,) [m^2].
    """
    shapely = import_module("shapely")
    cells, faces = (corners - r_A for corners in (corners_A, mesh_A))
    cells, faces = cells @ C_CA.T, faces @ C_CA.T
    faces = faces[_turned_to_camera(faces) & (faces[..., 2] > 0.0).all(axis=1)]
    t = np.tan(np.radians(half_angle_deg))
    screens, field = shapely.polygons(_flat(faces)), shapely.box(-t, -t, t, t)
    tree = shapely.STRtree(screens)
    areas = np.zeros(len(cells))
    for k in np.flatnonzero(_turned_to_camera(cells) & (cells[..., 2] > 0.0).all(axis=1)):
        part = shapely.intersection(shapely.Polygon(_flat(cells[k])), field)
        for other in tree.query(part, predicate="intersects"):
            if _hides(shapely, screens[other], faces[other], part, cells[k]):
                part = shapely.difference(part, screens[other], grid_size=GRID)
        areas[k] = _ground_area(shapely, part, cells[k])
    return areas


def _hides(shapely: Any, screen: Any, face: Array, part: Any, cell: Array) -> bool:
    overlap = shapely.intersection(screen, part, grid_size=GRID)
    if shapely.area(overlap) < LEAST_OVERLAP:
        return False
    spot = shapely.get_coordinates(shapely.point_on_surface(overlap))[0]
    return bool(_depth(face, spot) < (1.0 - 1e-9) * _depth(cell, spot))


def _ground_area(shapely: Any, part: Any, cell: Array) -> float:
    """Area on the cell's plane of a polygon on the picture."""
    normal = _normal(cell)
    length = np.linalg.norm(normal)
    axis = (cell[1] - cell[0]) / np.linalg.norm(cell[1] - cell[0])
    axes = np.array([axis, np.cross(normal / length, axis)])

    def lay(flat: Array) -> Array:
        rays = np.column_stack([flat, np.ones(len(flat))])
        points = rays * ((normal @ cell[0]) / (rays @ normal))[:, None]
        return np.asarray((points - cell[0]) @ axes.T)

    return 0.0 if part.is_empty else float(shapely.area(shapely.transform(part, lay)))


def _depth(triangle: Array, spot: Array) -> float:
    normal = _normal(triangle)
    return float(normal @ triangle[0] / (normal @ [*spot, 1.0]))


def _normal(triangles: Array) -> Array:
    return np.cross(triangles[..., 1, :] - triangles[..., 0, :], triangles[..., 2, :] - triangles[..., 0, :])


def _turned_to_camera(triangles: Array) -> Mask:
    return np.asarray(np.einsum("...i,...i", _normal(triangles), triangles[..., 0, :]) < 0.0)


def _flat(triangles: Array) -> Array:
    return triangles[..., :2] / triangles[..., 2:]
