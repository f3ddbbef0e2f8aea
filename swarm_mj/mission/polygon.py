"""Polygons on a body by longitude and latitude: read from GeoJSON, checked, and turned into arcs that a mesh is cut along.

Edges are straight in longitude and latitude (RFC 7946, section 3.1.1). Each is replaced by arcs of great circles, the sections
of the surface with planes through the body's centre, that leave the straight line by at most `TOLERANCE_DEG`. As for pyramids
every crossing of a direction with an overhanging surface belongs to the target. Longitudes may run on past 180 deg; a pole is
inside where an edge runs along latitude 90 or -90 deg, as RFC 7946 draws such polygons.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, TypeAdapter, ValidationError

from swarm_mj.errors import MissionError
from swarm_mj.io.records import Record, bytes_of, reading, record_from
from swarm_mj.mission.mesh_cut import Cuts
from swarm_mj.mission.target import directions, local_axes, place_of
from swarm_mj.scenarios.schema import Ring, Target
from swarm_mj.typing import Array, Ints32, Mask

#: Largest distance of an arc from the edge that it stands for [deg].
TOLERANCE_DEG = 0.002
#: Longest arc [deg].
LONGEST_DEG = 45.0
#: Arcs of a target; each cuts the mesh anew.
MAX_ARCS = 5000
#: Largest GeoJSON file [bytes].
MAX_BYTES = 20_000_000
#: Of a face that an arc cuts, smaller pieces are a matter of rounding.
LEAST_PART = 1e-9

Rings = tuple[tuple[tuple[float, float], ...], ...]


class _Polygon(Record):
    type: Literal["Polygon"]
    coordinates: list[Any]


class _MultiPolygon(Record):
    type: Literal["MultiPolygon"]
    coordinates: list[list[Any]]


class _Feature(Record):
    type: Literal["Feature"]
    geometry: Annotated[_Polygon | _MultiPolygon, Field(discriminator="type")]


class _Collection(Record):
    type: Literal["FeatureCollection"]
    features: Annotated[list[_Feature], Field(min_length=1)]


_GeoJSON = Annotated[_Polygon | _MultiPolygon | _Feature | _Collection, Field(discriminator="type")]


@dataclass(frozen=True, eq=False, kw_only=True)
class Polygon:
    """Polygons that are one target.

    Attributes:
        polygons: Closed rings of corners (longitude, latitude) of each [deg], the outer one first, shapes (n, 2).
        words: What is meant, in messages.
        weight: Of its area.
        turn: Rotation by which it lies elsewhere than its corners say, (3, 3).
    """

    polygons: tuple[tuple[Array, ...], ...]
    words: str = "inside the polygon on"
    weight: float = 1.0
    turn: Array = field(default_factory=lambda: np.eye(3))
    least_part: float = LEAST_PART

    @cached_property
    def pieces(self) -> list[Array]:
        """Ends (longitude, latitude) of the arcs of each polygon [deg], shapes (p, 2, 2)."""
        found = [
            _densified(np.concatenate([np.stack((r[:-1], r[1:]), axis=1) for r in rings])) for rings in self.polygons
        ]
        if (arcs := sum(map(len, found))) > MAX_ARCS:
            raise MissionError(
                f"target.polygon: takes {arcs} arcs of great circles: at most {MAX_ARCS} cut a mesh; give fewer corners"
            )
        return found

    @cached_property
    def _ends_A(self) -> Array:
        """Ends of all arcs as unit vectors in A, shape (arcs, 2, 3)."""
        return _directions(np.concatenate(self.pieces)) @ self.turn.T

    @property
    def cuts(self) -> Cuts:
        """Along the arcs."""
        start, end = self._ends_A.swapaxes(0, 1)
        normal, middle = np.cross(start, end), start + end
        sine = np.linalg.norm(normal, axis=1)
        some = sine > 1e-12  # along a pole's latitude there is no arc
        middle /= np.linalg.norm(middle, axis=1, keepdims=True)
        reach = np.arctan2(sine, np.einsum("ij,ij->i", start, end)) / 2.0
        return Cuts(normal[some] / sine[some, None], middle[some], reach[some])

    def holds(self, points_A: Array) -> Mask:
        """Which directions from the centre (n, 3) lie inside: an odd number of arcs crosses their meridian north of them."""
        x, y, z = (points_A @ self.turn).T
        latitude, longitude = np.arctan2(z, np.hypot(x, y)), np.degrees(np.arctan2(y, x))
        inside = np.zeros(len(points_A), np.bool_)
        for pieces in self.pieces:
            west = pieces[..., 0].min()
            unwrapped, odd = west + (longitude - west) % 360.0, np.zeros(len(points_A), np.bool_)
            for (one, other), normal in zip(pieces, np.cross(*_directions(pieces).swapaxes(0, 1)), strict=True):
                meets = (min(one[0], other[0]) <= unwrapped) & (unwrapped < max(one[0], other[0]))
                if abs(one[1]) == abs(other[1]) == 90.0:
                    odd ^= meets & (one[1] > 0.0)
                    continue
                east = np.radians(unwrapped[meets])
                height = -(normal[0] * np.cos(east) + normal[1] * np.sin(east)) * np.sign(normal[2])
                odd[meets] ^= np.arctan2(height, abs(normal[2])) > latitude[meets]
            inside |= odd
        return inside

    def faces_inside(self, vertices: Array, faces: Ints32) -> Mask:
        """Which faces of a mesh that was cut along its arcs lie inside, shape (F,)."""
        return self.holds(vertices[faces].mean(axis=1))

    @cached_property
    def axes(self) -> Array:
        """East, north and outward at its middle, as rows: the mean direction of its area, or its frame's."""
        total = np.zeros(3)
        for rings in self.polygons:
            for k, ring in enumerate(rings):
                start, end = _directions(_densified(np.stack((ring[:-1], ring[1:]), axis=1))).swapaxes(0, 1)
                normal = np.cross(start, end)
                sine = np.linalg.norm(normal, axis=1, keepdims=True)
                angle = np.arctan2(sine[:, 0], np.einsum("ij,ij->i", start, end))[:, None]
                # Of a unit sphere's part the integral of the normal is half that of r x dr along its border.
                half = (0.5 * angle * normal / np.maximum(sine, 1e-300)).sum(axis=0)
                total += half * np.sign(_signed_area(ring)) * (1.0 if k == 0 else -1.0)
        corners = np.concatenate([ring for rings in self.polygons for ring in rings])
        (west, south), (east, north) = corners.min(axis=0), corners.max(axis=0)
        if (east - west == 360.0 and -90.0 < south and north < 90.0) or np.linalg.norm(total) < 1e-9:
            total = directions(0.5 * (south + north), 0.5 * (west + east))
        latitude, longitude = map(float, place_of(self.turn @ total))
        return local_axes(latitude, longitude)

    @cached_property
    def half_angle(self) -> float:
        """Between its middle and the sides of the pyramid about it [rad]; pi where no pyramid holds it."""
        east, north, up = (self._ends_A.reshape(-1, 3) @ self.axes.T).T
        if not (up > 1e-6).all() or self.holds(-self.axes[2:])[0]:
            return float(np.pi)
        return float(np.arctan(np.maximum(np.abs(east), np.abs(north)) / up).max())

    @property
    def border(self) -> tuple[Array, ...]:
        """Directions along each ring, closed lines of shape (n, 3)."""
        lines = []
        for ring in (ring for rings in self.polygons for ring in rings):
            ends = _directions(_densified(np.stack((ring[:-1], ring[1:]), axis=1))) @ self.turn.T
            lines.append(np.vstack((ends[:, 0], ends[-1:, 1])))
        return tuple(lines)


def polygon_from(target: Target) -> Polygon:
    """The polygon of a scenario's target, read and checked.

    Raises:
        MissionError: The file cannot be read or is no GeoJSON of polygons; a ring is open, crosses itself, or leaves its place
            unclear; the message names it.
    """
    key, every = "target.polygon", [target.polygon]
    if target.polygon_file is not None:
        key = f"target.polygon_file = {target.polygon_file}"
        with reading(key, "give a GeoJSON file with Polygons or MultiPolygons", MissionError):
            every = list(_polygons(record_from(bytes_of(Path(target.polygon_file), MAX_BYTES), _GeoJSON)))
    found = tuple(
        tuple(_checked(ring, f"{key}, polygon {p + 1}, ring {k + 1}") for k, ring in enumerate(_rings(rings, key)))
        for p, rings in enumerate(every)
    )
    for p, rings in enumerate(found):
        _check_together(rings, f"{key}, polygon {p + 1}")
    return Polygon(polygons=found, weight=target.weight)


def _polygons(data: dict[str, Any]) -> Iterator[Any]:
    """Coordinates of all polygons of a GeoJSON object."""
    for feature in data.get("features", (data,)):
        geometry = feature.get("geometry", feature)
        yield from geometry["coordinates"] if geometry["type"] == "MultiPolygon" else (geometry["coordinates"],)


def _rings(given: Any, key: str) -> Rings:
    """Rings of one polygon, in bounds; heights beside longitude and latitude are left out."""
    try:
        flat = [[corner[:2] for corner in ring] for ring in given]
        return TypeAdapter(Annotated[tuple[Ring, ...], Field(min_length=1)]).validate_python(flat)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        where = ", ".join(
            f"{name} {int(k) + 1}" for name, k in zip(("ring", "corner", "coordinate"), first["loc"], strict=False)
        )
        raise MissionError(f"{key}: {where}: {first['msg'][0].lower()}{first['msg'][1:]}") from None
    except TypeError:
        raise MissionError(f"{key}: must be rings of corners [east longitude, latitude]") from None


def _checked(ring: Sequence[tuple[float, float]], where: str) -> Array:
    """A closed ring, shape (n, 2)."""
    corners = np.array(ring, np.float64)
    if (corners[0] != corners[-1]).any():
        raise MissionError(f"{where}: is open: its last corner must be its first, {_told(corners[0])}")
    steps = np.abs(np.diff(corners[:, 0]))
    if (unclear := (steps > 180.0) & (steps != 360.0) & (np.abs(corners[1:, 1]) < 90.0)).any():
        k = int(np.argmax(unclear))
        raise MissionError(
            f"{where}: the edge from {_told(corners[k])} to {_told(corners[k + 1])} would run over {steps[k]:g} deg of "
            "longitude: let longitudes run on past 180 where it crosses the antimeridian, or put a corner between"
        )
    if np.ptp(corners[:, 0]) > 360.0:
        raise MissionError(f"{where}: spans {np.ptp(corners[:, 0]):g} deg of longitude: at most 360")
    return corners


def _check_together(rings: tuple[Array, ...], where: str) -> None:
    """Refuse rings of one polygon that cross themselves or each other, and holes outside."""
    edges = np.concatenate([np.stack((ring[:-1], ring[1:]), axis=1) for ring in rings])
    a, b = edges.swapaxes(0, 1)
    for c, d in edges[:MAX_ARCS]:
        apart = _side(a, b, c) * _side(a, b, d) < 0.0
        if (cross := apart & (_side(c, d, a) * _side(c, d, b) < 0.0)).any():
            other = edges[int(np.argmax(cross))]
            raise MissionError(
                f"{where}: the edges {_told(c)} to {_told(d)} and {_told(other[0])} to {_told(other[1])} cross: give its "
                "corners in order, and polygons that overlap one by one"
            )
    for k, ring in enumerate(rings, start=1):
        if abs(_signed_area(ring)) < 1e-9:
            raise MissionError(f"{where}: ring {k} encloses nothing")
    west = rings[0][:, 0].min()
    outer = Polygon(polygons=(rings[:1],))
    for k, hole in enumerate(rings[1:], start=2):
        inside = (hole[:, 0] >= west) & (hole[:, 0] <= rings[0][:, 0].max())
        middle = _directions(0.5 * (hole[:-1] + hole[1:]))
        if not (inside.all() and outer.holds(middle).any()):
            raise MissionError(f"{where}: ring {k} is no hole in ring 1: give it as a polygon of its own")


def _side(a: Array, b: Array, c: Array) -> Array:
    """On which side of the line from a to b the point c lies, positive on the left."""
    return np.asarray(
        (b[..., 0] - a[..., 0]) * (c[..., 1] - a[..., 1]) - (b[..., 1] - a[..., 1]) * (c[..., 0] - a[..., 0])
    )


def _signed_area(ring: Array) -> float:
    """In the plane of longitude and latitude, positive where the ring runs counter-clockwise [deg^2]."""
    (x, y), (u, v) = (ring[:-1] - ring[0]).T, (ring[1:] - ring[0]).T
    return float(0.5 * (x * v - u * y).sum())


def _told(corner: Array) -> str:
    return f"[{corner[0]:g}, {corner[1]:g}]"


def _directions(corners: Array) -> Array:
    """Unit vectors of (longitude, latitude) [deg], shape (..., 3)."""
    return directions(corners[..., 1], corners[..., 0])


def _densified(edges: Array) -> Array:
    """Edges (n, 2, 2) [deg] halved until each is within `TOLERANCE_DEG` of the arc between its ends, in order."""
    while True:
        start, end = edges.swapaxes(0, 1)
        normal = np.cross(*_directions(edges).swapaxes(0, 1))
        normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)
        between = _directions(start + np.array([0.25, 0.5, 0.75])[:, None, None] * (end - start))
        off = np.abs(np.einsum("kni,ni->kn", between, normal)).max(axis=0)
        span = np.abs(end - start)
        span[(np.abs(start[:, 1]) == 90.0) & (np.abs(end[:, 1]) == 90.0), 0] = 0.0
        halved = (off > np.radians(TOLERANCE_DEG)) | (span.max(axis=1) > LONGEST_DEG)
        if not halved.any() or len(edges) > MAX_ARCS:
            return edges
        middle = 0.5 * (start + end)
        parts = np.stack((np.stack((start, middle), axis=1), np.stack((middle, end), axis=1)), axis=1)
        keep = np.ones((len(edges), 2), np.bool_)
        keep[~halved, 1] = False
        parts[~halved, 0] = edges[~halved]
        edges = parts[keep]
