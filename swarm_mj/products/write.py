"""The maps of a run written: a folder with one row a cell, every quantity on every grid, meshes, a shape kernel and panels."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd
import trimesh

from swarm_mj import __version__
from swarm_mj.errors import InteropError
from swarm_mj.figures.cell_maps import compose_panels
from swarm_mj.figures.style import write
from swarm_mj.flight.plan import Plan
from swarm_mj.interop.export import chosen_formats, files_in, written_into
from swarm_mj.interop.kernels import frames, write_dsk
from swarm_mj.interop.states import FlightStates
from swarm_mj.io.spice import spiceypy
from swarm_mj.products.grids import MapGrid, least_pixel_m, map_grids, rasterio
from swarm_mj.records.cells import quantity
from swarm_mj.typing import Array, Ints

#: What lists the files; only a folder that has it is written again.
MANIFEST: Final = "products.json"
#: Pixels along the side of a square of the median cell's area, where no size of pixels is given.
PIXELS_PER_CELL = 3.0
#: Value of pixels without the target's ground.
NO_DATA: Final = np.nan
#: Columns that are no map: where a cell is, and words.
_NO_MAP = ("face", "latitude_deg", "longitude_deg", "cause")
#: Colours of groups in the OBJ: observed, not observed, beyond the target.
_COLOURS = {"observed": (0.34, 0.71, 0.91), "not_observed": (0.90, 0.62, 0.0), "beyond_target": (0.6, 0.6, 0.6)}


@dataclass(frozen=True, eq=False)
class Mapped:
    """What is written: a run and its table of cells."""

    states: FlightStates
    cells: pd.DataFrame
    pixel_m: float

    @property
    def plan(self) -> Plan:
        """What was flown."""
        return self.states.plan

    def by_face(self, column: str) -> Array:
        """A column for each face of the cut mesh, NaN beyond the target, shape (F,)."""
        return self.plan.region.by_face(self.cells[column].to_numpy())

    @cached_property
    def maps(self) -> list[str]:
        """Columns that are drawn as maps."""
        return [name for name in self.cells if name not in _NO_MAP]

    @cached_property
    def grids(self) -> list[MapGrid]:
        """Of all projections."""
        return map_grids(self.plan.scenario.body.name, self.plan.region.mesh, self.pixel_m)

    @cached_property
    def faces(self) -> list[Ints]:
        """Faces of the cut mesh that the pixels of each grid show, see `MapGrid.faces`."""
        return [grid.faces(self.plan.region.mesh) for grid in self.grids]


def write_products(
    states: FlightStates,
    cells: pd.DataFrame,
    folder: Path,
    formats: Iterable[str] = ("all",),
    *,
    pixel_m: float | None = None,
) -> list[Path]:
    """Write the maps of a run in formats of `FORMATS`, or `all`, into a folder that is made if need be; gives the files.

    Earlier products are replaced, other files in the folder are kept.

    Args:
        states: Of the flight.
        cells: What is known of each cell, see `cells_table`.
        folder: Where.
        formats: Which.
        pixel_m: Side of a pixel of the GeoTIFFs, on the projection's sphere [m]; None: a third of the side of a square of a
            typical cell's area, or as much as keeps the largest map within `MOST_PIXELS`.

    Raises:
        InteropError: A format is unknown or needs a package that is not installed, or pixel_m is impossible.
        OutputError: The folder cannot be written or holds something else.
    """
    chosen = chosen_formats(formats, FORMATS)
    if pixel_m is not None and not (np.isfinite(pixel_m) and pixel_m > 0.0):
        raise InteropError(f"pixel_m = {pixel_m}: must be a positive number of metres")
    for name, library in (("geotiff", rasterio), ("parquet", _pyarrow), ("dsk", spiceypy)):
        if name in chosen:
            library()  # what is missing is said before anything is written
    side = _pixel_side(states) if pixel_m is None else float(pixel_m)
    mapped = Mapped(states, cells, side)
    with written_into(Path(folder), MANIFEST) as (partial, files):
        for name in chosen:
            FORMATS[name](mapped, partial)
        (partial / MANIFEST).write_text(json.dumps(_contents(mapped, partial, chosen), indent=2) + "\n")
    return files


def _pixel_side(states: FlightStates) -> float:
    """Of a third of a typical cell, or the least with which no map has too many pixels [m]."""
    side = float(np.sqrt(states.plan.region.typical_area)) / PIXELS_PER_CELL
    return max(side, least_pixel_m(states.plan.scenario.body.name, states.plan.region.mesh))


def _contents(mapped: Mapped, folder: Path, chosen: list[str]) -> dict[str, Any]:
    scenario, cells = mapped.plan.scenario, mapped.cells
    contents: dict[str, Any] = {
        "program": f"swarm_mj {__version__}",
        "scenario": scenario.name,
        "body": scenario.body.name,
        "formats": chosen,
        "frame": "A, body-fixed, z along the spin axis, origin in the centre of mass; metres",
        "cells": len(cells),
        "area_m2": float(mapped.plan.region.total_area),
        "quantities": {name: quantity(name)._asdict() for name in cells},
    }
    if "geotiff" in chosen:
        hidden = ~np.isin(mapped.plan.region.target, mapped.faces[0])
        contents["maps"] = {
            "pixel_m": mapped.pixel_m,
            "sphere_radius_m": mapped.grids[0].radius,
            "projections": {grid.name: grid.crs.to_string()[:60] for grid in mapped.grids},
            "nodata": "NaN: ground beyond the target, or of which there is no value",
            "cells_without_pixel": int(hidden.sum()),
            "cells_without_pixel_percent_of_area": 100.0
            * float(cells["area_m2"][hidden].sum() / cells["area_m2"].sum()),
        }
    contents["files"] = files_in(folder)
    return contents


def _pyarrow() -> Any:
    try:
        import pyarrow
        import pyarrow.parquet
    except ImportError:
        raise InteropError("Parquet needs pyarrow, which is not installed: pip install 'swarm_mj[products]'") from None
    return pyarrow


def _parquet(mapped: Mapped, folder: Path) -> None:
    """One row a cell, with unit and meaning of each column in the metadata of its field."""
    arrow = _pyarrow()
    table = arrow.Table.from_pandas(mapped.cells.reset_index())
    fields = [field.with_metadata(quantity(field.name)._asdict()) for field in table.schema]
    schema = arrow.schema(fields, metadata=table.schema.metadata)
    arrow.parquet.write_table(table.cast(schema), folder / "cells.parquet")


def _geotiff(mapped: Mapped, folder: Path) -> None:
    """Every quantity on every grid, in single precision."""
    library, scenario = rasterio(), mapped.plan.scenario
    for grid, faces in zip(mapped.grids, mapped.faces, strict=True):
        place = folder / grid.name
        place.mkdir()
        for name in mapped.maps:
            values = np.append(mapped.by_face(name), np.nan)[faces].astype(np.float32)  # face -1: no ground
            what = quantity(name)
            with library.open(
                place / f"{name}.tif", "w", driver="GTiff", height=grid.shape[0], width=grid.shape[1], count=1,
                dtype="float32", crs=grid.crs, transform=grid.transform, nodata=NO_DATA, compress="deflate",
            ) as tif:  # fmt: skip
                tif.write(values, 1)
                tif.set_band_description(1, name)
                tif.set_band_unit(1, what.unit)
                tif.update_tags(
                    TIFFTAG_SOFTWARE=f"swarm_mj {__version__}", TIFFTAG_IMAGEDESCRIPTION=what.meaning,
                    body=scenario.body.name, scenario=scenario.name,
                )  # fmt: skip


def _ply(mapped: Mapped, folder: Path) -> None:
    """The whole cut body with all quantities as attributes of its faces; NaN beyond the target."""
    mesh = trimesh.Trimesh(mapped.plan.region.vertices, mapped.plan.region.faces, process=False)
    for name in mapped.maps:
        mesh.face_attributes[name] = mapped.by_face(name).astype(np.float32)
    (folder / "body.ply").write_bytes(trimesh.exchange.ply.export_ply(mesh, include_attributes=True))


def _obj(mapped: Mapped, folder: Path) -> None:
    """The whole cut body in groups with colours: observed, not observed, beyond the target."""
    region, seen = mapped.plan.region, mapped.by_face("seen")
    lines = [f"# {mapped.plan.scenario.body.name}, frame A, metres", "mtllib body.mtl"]
    lines += [f"v {x:.6f} {y:.6f} {z:.6f}" for x, y, z in region.vertices.tolist()]
    groups = {"observed": seen == 1.0, "not_observed": seen == 0.0, "beyond_target": np.isnan(seen)}
    for group, held in groups.items():
        faces = region.faces[held] + 1
        if len(faces):
            lines += [f"g {group}", f"usemtl {group}", *(f"f {a} {b} {c}" for a, b, c in faces.tolist())]
    (folder / "body.obj").write_text("\n".join(lines) + "\n")
    colours = [f"newmtl {name}\nKd {r} {g} {b}\n" for name, (r, g, b) in _COLOURS.items()]
    (folder / "body.mtl").write_text("\n".join(colours))


def _dsk(mapped: Mapped, folder: Path) -> None:
    """The cut body as plates, in the order of the PLY's faces, with the kernel that names its frame."""
    (folder / "swarm.tf").write_text(frames(mapped.states))
    write_dsk(folder / "body.bds", mapped.states, mapped.plan.region.mesh)


def _panels(mapped: Mapped, folder: Path) -> None:
    """Maps of the quantities side by side."""
    write(compose_panels(mapped.plan, mapped.cells), folder / "panels.png", pdf=False)


#: Writers by format.
FORMATS: Final[dict[str, Callable[[Mapped, Path], None]]] = {
    "parquet": _parquet,
    "geotiff": _geotiff,
    "ply": _ply,
    "obj": _obj,
    "dsk": _dsk,
    "png": _panels,
}
