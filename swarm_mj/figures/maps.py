"""Maps of a body by latitude and longitude: the ground as seen from outside, with outlines and tracks on it.

Latitudes are planetocentric, longitudes count eastwards; both are in degrees in A. Where the ground overhangs, a map shows
what lies outermost.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import Colormap, Normalize, to_rgb
from matplotlib.ticker import FuncFormatter, MaxNLocator

from swarm_mj.figures.palette import AMBIENT
from swarm_mj.figures.style import label, tidy
from swarm_mj.figures.view import depth_of, shade
from swarm_mj.mission.target import TargetRegion, directions, place_of
from swarm_mj.observation.raycast import tracer_of
from swarm_mj.smallbody.shape import ShapeModel
from swarm_mj.typing import Array, Indices

#: Rays that one map may cost: Embree traces them at once, the compiled loop visits every face for each.
MAX_RAYS = {"embree": 300_000, "numba": 12_000}

#: Rays that are traced at a time.
CHUNK = 200_000
#: Where rays towards the centre begin, in largest radii of the body.
OUTSIDE = 1.5
#: How much darker than level ground a vertical slope is painted.
RELIEF = 0.7
#: On a map wider than this [deg] degrees of longitude and of latitude are equally long.
WIDE_DEG = 90.0
#: Closer to a pole than this a longitude says nothing [deg].
POLAR = 1.0


@dataclass(frozen=True, kw_only=True)
class MapExtent:
    """The part of a map that is shown [deg]; `east` may exceed 180, and `west` be less than -180."""

    west: float
    east: float
    south: float
    north: float

    @property
    def centre_longitude(self) -> float:
        """Longitude in the middle [deg]."""
        return 0.5 * (self.west + self.east)


@dataclass(frozen=True, kw_only=True)
class Ground:
    """The ground on a grid.

    Attributes:
        longitudes: Of the columns, shape (c,) [deg].
        latitudes: Of the rows, southernmost first, shape (r,) [deg].
        face: Face of the mesh at each place, -1 where the body has none, shape (r, c).
        points_A: Places in A, NaN where the body has none, shape (r, c, 3) [m].
    """

    longitudes: Array
    latitudes: Array
    face: Indices
    points_A: Array

    def every(self, step: int) -> Ground:
        """The same of every so many places along both axes."""
        face, points_A = self.face[::step, ::step], self.points_A[::step, ::step]
        return Ground(
            longitudes=self.longitudes[::step], latitudes=self.latitudes[::step], face=face, points_A=points_A
        )


def whole_body(centre_longitude: float) -> MapExtent:
    """The map of a whole body with a given longitude in the middle [deg]."""
    return MapExtent(west=centre_longitude - 180.0, east=centre_longitude + 180.0, south=-90.0, north=90.0)


def survey(body: ShapeModel, window: MapExtent, columns: int) -> Ground:
    """Find the ground below a grid of places, by rays from outside towards the body's centre.

    `columns`: places along a parallel; as many along a meridian as keep the spacing in degrees.
    """
    tracer = tracer_of(body)
    width, height = window.east - window.west, window.north - window.south
    columns = min(columns, int(np.sqrt(MAX_RAYS[tracer.engine] * width / height)))
    rows = max(2, round(columns * height / width))
    longitudes = window.west + (np.arange(columns) + 0.5) * width / columns
    latitudes = window.south + (np.arange(rows) + 0.5) * height / rows
    outward = directions(*np.meshgrid(latitudes, longitudes, indexing="ij"))
    start, face = OUTSIDE * body.max_radius * outward, outermost_faces(body, outward)
    depth = depth_of(face, start, -outward, body)
    points = np.where(face[..., None] >= 0, start - depth[..., None] * outward, np.nan)
    return Ground(longitudes=longitudes, latitudes=latitudes, face=face, points_A=points)


def outermost_faces(body: ShapeModel, outward: Array) -> Indices:
    """Face of the outermost ground along directions from the body's centre (..., 3), -1 where it has none, shape (...)."""
    tracer, rays = tracer_of(body), outward.reshape(-1, 3)
    parts = [
        tracer.first_hit(OUTSIDE * body.max_radius * rays[k : k + CHUNK], -rays[k : k + CHUNK])
        for k in range(0, len(rays), CHUNK)
    ]
    return np.concatenate(parts).astype(np.int64).reshape(outward.shape[:-1])


def latitude_longitude(points_A: Array, centre_longitude: float = 0.0) -> tuple[Array, Array]:
    """Latitudes and longitudes of points (..., 3) [deg], longitudes within 180 deg of the centre's."""
    latitude, longitude = place_of(points_A)
    return latitude, centre_longitude + (longitude - centre_longitude + 180.0) % 360.0 - 180.0


def target_outlines(region: TargetRegion) -> list[Array]:
    """Directions along the borders of the targets of a region, closed lines of shape (n, 3)."""
    return [line for target in region.targets for line in target.border]


def paint(
    ax: Axes, ground: Ground, body: ShapeModel, colours: Array, lamp_A: Array | None, *, relief: float = RELIEF
) -> None:
    """Paint a map in the colours of the mesh's faces (F, 3), lit from a direction in A; None: from straight above everywhere.

    With `relief` slopes are darker, so that the night side shows its ground too. Where the body has none the map stays white.
    """
    outward = ground.points_A / np.linalg.norm(ground.points_A, axis=-1, keepdims=True)
    level = np.einsum("...i,...i", outward, body.face_normals[ground.face])
    brightness = 1.0 - relief * (1.0 - np.clip(level, 0.0, 1.0))
    shaded = colours if lamp_A is None else shade(colours, body.face_normals, lamp_A, AMBIENT)
    _show(ax, ground, np.nan_to_num(shaded[ground.face] * brightness[..., None], nan=1.0))


def paint_values(ax: Axes, ground: Ground, values: Array, colours: Colormap, scale: Normalize, beyond: str) -> None:
    """Paint values at the places of a map (r, c) by a scale of colours; ground without a value in a colour of its own."""
    picture = colours(scale(values))[..., :3]
    picture[np.isnan(values)] = to_rgb(beyond)
    picture[ground.face < 0] = 1.0
    _show(ax, ground, picture)


def _show(ax: Axes, ground: Ground, picture: Array) -> None:
    sides = [(a[0] - 0.5 * (a[1] - a[0]), a[-1] + 0.5 * (a[1] - a[0])) for a in (ground.longitudes, ground.latitudes)]
    extent = (*sides[0], *sides[1])
    ax.imshow(picture, origin="lower", extent=extent, interpolation="nearest", zorder=0)


def draw_track(ax: Axes, points_A: Array, centre_longitude: float, **style: Any) -> None:
    """Draw a line through points (n, 3) on a map, broken at its sides and at the poles."""
    latitude, longitude = latitude_longitude(points_A, centre_longitude)
    latitude = np.where(np.abs(latitude) > 90.0 - POLAR, np.nan, latitude)
    breaks = 1 + np.flatnonzero(np.abs(np.diff(longitude)) > 180.0)
    ax.plot(np.insert(longitude, breaks, np.nan), np.insert(latitude, breaks, np.nan), **style)


def draw_places(ax: Axes, points_A: Array, centre_longitude: float, **style: Any) -> None:
    """Draw markers at points (n, 3) on a map, but for those on a pole."""
    latitude, longitude = latitude_longitude(points_A, centre_longitude)
    latitude = np.where(np.abs(latitude) > 90.0 - POLAR, np.nan, latitude)
    ax.plot(longitude, latitude, **{"linestyle": "none", **style})


def map_aspect(window: MapExtent) -> float:
    """Length of a degree of longitude on a map over that of a degree of latitude."""
    middle = np.radians(0.5 * (window.south + window.north))
    return 1.0 if window.east - window.west > WIDE_DEG else max(0.2, float(np.cos(middle)))


def name_map(ax: Axes, window: MapExtent) -> None:
    """Scales and names of a map's axes; longitudes from 0 to 360 deg."""
    ax.set_xlim(window.west, window.east)
    ax.set_ylim(window.south, window.north)
    width, height = window.east - window.west, window.north - window.south
    ax.set_aspect("auto" if width > 4.0 * height else 1.0 / map_aspect(window))  # a cap around a pole would be a thread
    wide = width > WIDE_DEG
    for axis in (ax.xaxis, ax.yaxis):
        axis.set_major_locator(MaxNLocator(7, steps=[3, 4.5, 6, 9] if wide else [1, 2, 5, 10]))
    ax.xaxis.set_major_formatter(FuncFormatter(lambda longitude, _: f"{longitude % 360.0:g}"))
    tidy(ax)
    ax.grid(True, color="white", linewidth=0.5, alpha=0.6)
    label(ax, "east longitude [deg]", "latitude [deg]")
