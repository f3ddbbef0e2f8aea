"""Maps of a whole body on the grids of map projections: equirectangular, and polar stereographic about either pole.

Latitudes are planetocentric, longitudes count eastwards from A's x axis. A pixel shows the outermost ground along the direction
of its centre from the body's centre of mass. The reference sphere is that of the IAU's coordinate system where the body has
one, else the sphere of the body's volume; heights above it play no part.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from swarm_mj.errors import InteropError
from swarm_mj.figures.maps import outermost_faces
from swarm_mj.mission.target import directions
from swarm_mj.smallbody.naif import NUMBERED, BodyName
from swarm_mj.smallbody.shape import ShapeModel
from swarm_mj.typing import Array, Ints

#: Lowest latitude of the polar maps, at the middles of their sides [deg].
POLAR_FROM_DEG = 60.0
#: Codes of projections in the IAU's coordinate systems of 2015, behind the number of the body; and their names.
PROJECTIONS = {"equirectangular": 10, "north_polar": 30, "south_polar": 35}
#: Largest number of pixels of a map.
MOST_PIXELS = 20_000_000


def rasterio() -> Any:
    """The library.

    Raises:
        InteropError: It is not installed.
    """
    try:
        import rasterio
        import rasterio.crs
        import rasterio.transform
        import rasterio.warp
    except ImportError:
        raise InteropError("GeoTIFF needs rasterio, which is not installed: pip install 'swarm_mj[products]'") from None
    return rasterio


@dataclass(frozen=True)
class MapGrid:
    """The pixels of one map.

    Attributes:
        name: Of `PROJECTIONS`.
        crs: Coordinate reference system of rasterio.
        radius: Of its sphere [m].
        step: Side of a pixel [m of the projection].
    """

    name: str
    crs: Any
    radius: float
    step: float

    @property
    def half_sides(self) -> tuple[float, float]:
        """From the middle of the map to its sides, east and north [m]."""
        if self.name == "equirectangular":
            return np.pi * self.radius, 0.5 * np.pi * self.radius
        reach = 2.0 * self.radius * np.tan(0.5 * np.radians(90.0 - POLAR_FROM_DEG))
        return float(reach), float(reach)

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        east, north = self.half_sides
        return max(round(2.0 * north / self.step), 1), max(round(2.0 * east / self.step), 1)

    @property
    def transform(self) -> Any:
        """From columns and rows to metres of the projection; row 0 is the northernmost, or uppermost."""
        (east, north), (rows, columns) = self.half_sides, self.shape
        return rasterio().transform.from_bounds(-east, -north, east, north, columns, rows)

    @property
    def directions_A(self) -> Array:
        """Of the pixels' centres from the body's centre, shape (rows, columns, 3)."""
        (east, north), (rows, columns) = self.half_sides, self.shape
        x = (np.arange(columns) + 0.5) / columns * 2.0 * east - east
        y = north - (np.arange(rows) + 0.5) / rows * 2.0 * north
        if self.name == "equirectangular":
            return directions(*np.degrees(np.meshgrid(y, x, indexing="ij")) / self.radius)
        up, right = np.meshgrid(y, x, indexing="ij")
        distance = np.hypot(right, up)
        latitude = 90.0 - 2.0 * np.degrees(np.arctan(0.5 * distance / self.radius))
        side = 1.0 if self.name == "north_polar" else -1.0
        return directions(side * latitude, np.degrees(np.arctan2(right, -side * up)))

    def faces(self, mesh: ShapeModel) -> Ints:
        """Face of a mesh that each pixel shows, -1 where the body has no ground there, shape (rows, columns)."""
        return outermost_faces(mesh, self.directions_A)


def map_grids(body: str, mesh: ShapeModel, step_m: float) -> list[MapGrid]:
    """The grids of all projections of a body by its name in scenarios.

    Raises:
        InteropError: rasterio is not installed, or the maps would have too many pixels.
    """
    crs, radius = _systems(body, mesh)
    grids = [MapGrid(name, crs[name], radius, step_m) for name in PROJECTIONS]
    largest = max(int(np.prod(grid.shape)) for grid in grids)
    if largest > MOST_PIXELS:
        raise InteropError(
            f"pixel_m = {step_m:g}: a map of {body} would have {largest} pixels; must give at most {MOST_PIXELS}, as "
            f"{step_m * np.sqrt(largest / MOST_PIXELS):.2g} m does"
        )
    return grids


def least_pixel_m(body: str, mesh: ShapeModel) -> float:
    """Side of the pixels with which the largest map of a body has nearly `MOST_PIXELS` [m]; 0 without rasterio."""
    try:
        _, radius = _systems(body, mesh)
    except InteropError:
        return 0.0
    return float(np.sqrt(2.0 * (np.pi * radius) ** 2 / (0.99 * MOST_PIXELS)))


def _systems(body: str, mesh: ShapeModel) -> tuple[dict[str, Any], float]:
    """Coordinate reference systems by the names of `PROJECTIONS`, and the radius of their sphere [m]."""
    library, code = rasterio(), BodyName.of(body).code
    if code < NUMBERED * 2:
        # The IAU's registry writes 2000433 for Eros, and so do NAIF's older numbers.
        known = {name: _known(library, code * 100 + kind) for name, kind in PROJECTIONS.items()}
        if all(known.values()):
            sphere = known["equirectangular"].to_dict(projjson=True)["base_crs"]["datum"]["ellipsoid"]
            return known, float(sphere.get("radius", sphere.get("semi_major_axis")))
    radius = float((3.0 * abs(mesh.volume) / (4.0 * np.pi)) ** (1.0 / 3.0))
    return {name: library.crs.CRS.from_wkt(_wkt(body, name, radius)) for name in PROJECTIONS}, radius


def _known(library: Any, code: int) -> Any:
    """The system of that code of the IAU; None where it has none."""
    try:
        with library.Env(CPL_LOG="/dev/null"):
            return library.crs.CRS.from_string(f"IAU_2015:{code}")
    except library.errors.CRSError:
        return None


def _wkt(body: str, name: str, radius: float) -> str:
    """A coordinate reference system on a sphere, for a body for which the IAU has none."""
    title = "".join(letter for letter in body if letter.isalnum() or letter in " -") or "body"
    sphere = (
        f'GEOGCS["{title} - Sphere / Ocentric",DATUM["{title}",SPHEROID["{title}, sphere of its volume",{radius:.6f},0]],'
        'PRIMEM["Reference Meridian",0],UNIT["degree",0.0174532925199433]]'
    )
    pole = 90 if name == "north_polar" else -90
    projection = (
        'PROJECTION["Equirectangular"],PARAMETER["standard_parallel_1",0],PARAMETER["central_meridian",0]'
        if name == "equirectangular"
        else f'PROJECTION["Polar_Stereographic"],PARAMETER["latitude_of_origin",{pole}],PARAMETER["central_meridian",0],'
        'PARAMETER["scale_factor",1]'
    )
    zero = 'PARAMETER["false_easting",0],PARAMETER["false_northing",0]'
    return f'PROJCS["{title} - {name}",{sphere},{projection},{zero},UNIT["metre",1]]'
