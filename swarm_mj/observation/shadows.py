"""Cast shadows: a map of the body as the Sun sees it, and whether its light reaches a place of a face.

The map has the number of the face that the light meets first at each of its places, by parallel rays. Of a place on the body
the faces at the four nearest places of the map are asked whether they cover exactly that point from above: shadows are as sharp
as the mesh then. Where none does, but all lie far above, the point is in shadow too; only of what is narrower than a place on
the map, and near above, part of a shadow may be lost.

The Sun is a point: at 1 au its disc of 0.53 deg would soften the edge of a shadow by 0.9 % of the way from what casts it.
"""

from __future__ import annotations

from math import ceil, floor
from typing import Any, NamedTuple

import numpy as np

from swarm_mj.compilation import allocation_free, jittable, kernel
from swarm_mj.observation.raster import Canvas, Mesh, draw_projected
from swarm_mj.typing import Array, Mask

#: How far above its face a place must be covered to lie in shadow, over the body's depth: rounding of double precision.
ABOVE = 1e-9
#: How far above lie faces that are not beside a place on the map, over the body's depth. What is beside it rises by as much
#: from one of 640 places to the next where the Sun stands within 2 deg of its ground, on a body as deep as it is wide.
FAR_ABOVE = 0.05


class SunMap(NamedTuple):
    """The body as the Sun sees it; `canvas.projected` has column, row and height over the body's extent of each vertex.

    Attributes:
        canvas: What the map is drawn on.
        axes: Two axes across the Sun's direction and that direction, in A, rows, shape (3, 3).
        grid: The two coordinates of its corner [m] and the size of a place [m], shape (3,).
    """

    canvas: Canvas
    axes: Array
    grid: Array


def make_sun_map(canvas: Canvas) -> SunMap:
    """A map on some canvas, of no direction yet."""
    return SunMap(canvas, np.eye(3), np.zeros(3))


@jittable
def turn_to(seen: SunMap, x: float, y: float, z: float) -> None:
    """Write the axes for a unit vector to the Sun in A."""
    axes = seen.axes
    axes[2, 0], axes[2, 1], axes[2, 2] = x, y, z
    # Across it and the axis of A that it is farthest from.
    least = min(abs(x), abs(y), abs(z))
    if abs(x) == least:
        axes[0, 0], axes[0, 1], axes[0, 2] = 0.0, -z, y
    elif abs(y) == least:
        axes[0, 0], axes[0, 1], axes[0, 2] = z, 0.0, -x
    else:
        axes[0, 0], axes[0, 1], axes[0, 2] = -y, x, 0.0
    size = np.sqrt(axes[0, 0] ** 2 + axes[0, 1] ** 2 + axes[0, 2] ** 2)
    for k in range(3):
        axes[0, k] /= size
    axes[1, 0] = y * axes[0, 2] - z * axes[0, 1]
    axes[1, 1] = z * axes[0, 0] - x * axes[0, 2]
    axes[1, 2] = x * axes[0, 1] - y * axes[0, 0]


@jittable
def frame(seen: SunMap, left: float, bottom: float, right: float, top: float) -> None:
    """Write the grid, so that it holds a box across the Sun's direction [m] with some places to spare."""
    size = seen.canvas.row_span.shape[0]
    side = max(right - left, top - bottom) * (1.0 + 4.0 / size)
    seen.grid[0], seen.grid[1] = 0.5 * (left + right - side), 0.5 * (bottom + top - side)
    seen.grid[2] = side / size


@kernel
def draw_from_sun(mesh: Mesh, seen: SunMap) -> None:
    """Draw what the light meets first: nearer is higher towards the Sun."""
    axes, grid, projected = seen.axes, seen.grid, seen.canvas.projected
    lowest, highest = np.inf, -np.inf
    for v in range(mesh.vertices.shape[0]):
        p = mesh.vertices[v]
        for k in range(2):
            at = axes[k, 0] * p[0] + axes[k, 1] * p[1] + axes[k, 2] * p[2]
            projected[v, k] = (at - grid[k]) / grid[2]
        height = axes[2, 0] * p[0] + axes[2, 1] * p[1] + axes[2, 2] * p[2]
        projected[v, 2] = height
        lowest, highest = min(lowest, height), max(highest, height)
    scale = 1.0 / (highest - lowest)
    for v in range(mesh.vertices.shape[0]):
        projected[v, 2] = 1.0 + (projected[v, 2] - lowest) * scale
    draw_projected(mesh, seen.canvas)


@allocation_free
def find_clear(mesh: Mesh, canvas: Canvas, wanted: Mask, clear: Mask) -> None:
    """Tell of which wanted faces the Sun sees every place, so that none of their samples needs to be asked.

    A face is clear if it has places on the map from the Sun, and all whose centres lie in it are its own.
    """
    size, at, picture = canvas.row_span.shape[0], canvas.projected, canvas.picture
    for f in range(len(wanted)):
        clear[f] = False
        if not wanted[f]:
            continue
        a, b, c = mesh.faces[f, 0], mesh.faces[f, 1], mesh.faces[f, 2]
        area = (at[b, 0] - at[a, 0]) * (at[c, 1] - at[a, 1]) - (at[b, 1] - at[a, 1]) * (at[c, 0] - at[a, 0])
        if not area > 0.0:
            continue
        bottom = int(ceil(min(at[a, 1], at[b, 1], at[c, 1]) - 0.5))
        top = int(floor(max(at[a, 1], at[b, 1], at[c, 1]) - 0.5))
        own, some, all_own = np.uint32(f + 1), False, True
        for row in range(max(bottom, 0), min(top, size - 1) + 1):
            left, right, y = -1e300, 1e300, row + 0.5
            for k in range(3):
                i, j = mesh.faces[f, k], mesh.faces[f, (k + 1) % 3]
                rise = at[j, 1] - at[i, 1]
                if rise == 0.0:
                    continue
                x = at[i, 0] + (at[j, 0] - at[i, 0]) * ((y - at[i, 1]) / rise)
                if rise > 0.0:  # counter-clockwise: what goes up bounds on the right
                    right = min(right, x)
                else:
                    left = max(left, x)
            first, last = int(ceil(max(left, 0.0) - 0.5)), int(floor(min(right, size * 1.0) - 0.5))
            for column in range(first, last + 1):
                some = True
                if picture[np.uintp(row * size + column)] != own:
                    all_own = False
                    break
            if not all_own:
                break
        clear[f] = some and all_own


@jittable
def is_lit(mesh: Mesh, seen: SunMap, f: Any, column: float, row: float) -> bool:
    """Whether the Sun reaches a place of a face that is turned to it; the place is given on the map from the Sun."""
    picture, size = seen.canvas.picture, seen.canvas.row_span.shape[0]
    i, j = int(floor(column - 0.5)), int(floor(row - 0.5))
    if i < 0 or j < 0 or i >= size - 1 or j >= size - 1:
        return True
    own, at, below = np.uint32(f + 1), np.uintp(j * size + i), np.uintp((j + 1) * size + i)
    a, b = picture[at], picture[at + np.uintp(1)]
    c, d = picture[below], picture[below + np.uintp(1)]
    if (a == own) & (b == own) & (c == own) & (d == own):
        return True
    if (
        (a != own and _covers(mesh, seen, a, f, column, row))
        or (b != own and b != a and _covers(mesh, seen, b, f, column, row))
        or (c != own and c != a and c != b and _covers(mesh, seen, c, f, column, row))
        or (d != own and d != a and d != b and d != c and _covers(mesh, seen, d, f, column, row))
    ):
        return False
    # Between faces far above, that which lies exactly there may be so narrow as to be on none of the four places.
    if a == own or b == own or c == own or d == own or min(a, b, c, d) == 0:
        return True
    x, y, far = i + 0.5, j + 0.5, _height(mesh, seen, f, column, row) + FAR_ABOVE
    return not (
        _height(mesh, seen, int(a) - 1, x, y) > far
        and _height(mesh, seen, int(b) - 1, x + 1.0, y) > far
        and _height(mesh, seen, int(c) - 1, x, y + 1.0) > far
        and _height(mesh, seen, int(d) - 1, x + 1.0, y + 1.0) > far
    )


@jittable
def _height(mesh: Mesh, seen: SunMap, f: Any, column: float, row: float) -> float:
    """How high the plane of a face lies at a place of the map, as `projected` has it."""
    at, faces = seen.canvas.projected, mesh.faces
    a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
    ub, vb, hb = at[b, 0] - at[a, 0], at[b, 1] - at[a, 1], at[b, 2] - at[a, 2]
    uc, vc, hc = at[c, 0] - at[a, 0], at[c, 1] - at[a, 1], at[c, 2] - at[a, 2]
    u, v = column - at[a, 0], row - at[a, 1]
    return float(at[a, 2] + (u * (hb * vc - hc * vb) + v * (hc * ub - hb * uc)) / (ub * vc - uc * vb))


@jittable
def _covers(mesh: Mesh, seen: SunMap, number: Any, f: int, column: float, row: float) -> bool:
    """Whether a face, given as its number plus one, lies exactly above a place of face f, as the Sun sees it."""
    if number == 0:
        return False
    g, at, faces = int(number) - 1, seen.canvas.projected, mesh.faces
    a, b, c = faces[g, 0], faces[g, 1], faces[g, 2]
    ua, va = at[a, 0] - column, at[a, 1] - row
    ub, vb = at[b, 0] - column, at[b, 1] - row
    uc, vc = at[c, 0] - column, at[c, 1] - row
    wa, wb, wc = ub * vc - uc * vb, uc * va - ua * vc, ua * vb - ub * va
    whole = wa + wb + wc
    if wa < 0.0 or wb < 0.0 or wc < 0.0 or whole <= 0.0:
        return False
    above = (wa * at[a, 2] + wb * at[b, 2] + wc * at[c, 2]) / whole
    return above > _height(mesh, seen, f, column, row) + ABOVE
