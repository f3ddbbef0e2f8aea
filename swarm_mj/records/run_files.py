"""The files of a run: summary.json, scenario.yaml, telemetry.nc, coverage.npz, delivery.npz, and a flown design's record."""

from __future__ import annotations

import json
import os
from collections.abc import Collection
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import xarray as xr
import yaml
from numpy.typing import NDArray

from swarm_mj.dataflow.delivery import Delivery
from swarm_mj.errors import ScenarioError
from swarm_mj.flight.observe import ObservationResult, Observed
from swarm_mj.flight.plan import Plan
from swarm_mj.io.arrays import Declared, read_arrays
from swarm_mj.io.atomic import write_text
from swarm_mj.mission.links import Obstacle
from swarm_mj.observation.coverage import Cause
from swarm_mj.records.cells import MAPPED
from swarm_mj.scenarios.loading import design_record
from swarm_mj.scenarios.schema import Scenario
from swarm_mj.simulator.telemetry import FARTHEST, REMEDY

_CELLS, _BY = ("cells",), ("spacecraft", "cells")
#: Arrays of coverage.npz, as they are written and as they must be to be read: the clipped target mesh in A [m], its cells,
#: area [m^2] and its weight in P_TO, the face of F_T that each lies in; whether and when [s] each was seen, by the swarm and by
#: each spacecraft,
#: NaN for never, by the scenario's criterion and with suffix `_passage` in the whole passage; of the picture by which each
#: spacecraft keeps each cell the time [s], the ground sampling distance [m] and the incidence of the Sun [deg]; the `Cause`
#: why a cell was not seen; the rest of the body.
COVERAGE = {
    "vertices": Declared("f8", ("vertices", 3), -FARTHEST, FARTHEST),
    "faces": Declared("i8", ("cells", 3), 0, "vertices"),
    "area": Declared("f8", _CELLS, 1e-12, FARTHEST**2),
    "weight": Declared("f8", _CELLS, 1e-6, 1e6),
    "face_of_cell": Declared("i8", _CELLS, 0),
    "seen": Declared("?", _CELLS),
    "first_seen_s": Declared("f8", _CELLS, 0.0, FARTHEST, gaps="nan"),
    "seen_by": Declared("?", _BY),
    "first_seen_by_s": Declared("f8", _BY, 0.0, FARTHEST, gaps="nan"),
    "kept_s": Declared("f8", _BY, 0.0, FARTHEST, gaps="nan"),
    "gsd_m": Declared("f8", _BY, 0.0, FARTHEST, gaps="nan"),
    "incidence_deg": Declared("f8", _BY, 0.0, 180.0, gaps="nan"),
    "why": Declared("i1", _CELLS, 0, max(Cause)),
    "seen_passage": Declared("?", _CELLS),
    "first_seen_s_passage": Declared("f8", _CELLS, 0.0, FARTHEST, gaps="nan"),
    "seen_by_passage": Declared("?", _BY),
    "first_seen_by_s_passage": Declared("f8", _BY, 0.0, FARTHEST, gaps="nan"),
    "body_vertices": Declared("f4", ("body_vertices", 3), -FARTHEST, FARTHEST),
    "body_faces": Declared("i4", ("body_faces", 3), 0, "body_vertices"),
    # Of runs with quality classes alone, NaN where a cell has no such look, see `swarm_mj.observation.quality.Figures`.
    "looks": Declared("i4", _CELLS, 0, optional=True),
    "best_gsd_m": Declared("f4", _CELLS, 0.0, FARTHEST, gaps="nan", optional=True),
    **{
        name: Declared("f4", _CELLS, 0.0, 180.0, gaps="nan", optional=True)
        for name in ("least_emission_deg", "least_incidence_deg", "convergence_deg", "light_varied_deg")
    },
    **{
        name: Declared("f4", _CELLS, 0.0, gaps="nan", optional=True)
        for name in ("height_dop", "slope_dop", "albedo_dop")
    },
}
#: Of a target that is the whole body no rest is left.
_EMPTY_WITHOUT_REST = ("body_vertices", "body_faces")
#: Largest number of bits, or of a station, and latest time [s], that a file may hold.
_MOST_BIT, _LATEST_S = 2.0**62, 1e12
_LINKS, _WAYS, _HELD = ("slots", "spacecraft", "spacecraft"), ("slots", "spacecraft"), ("edges", "spacecraft")
_TILES, _COPIES = ("tiles",), ("spacecraft", "tiles")
#: Arrays of delivery.npz, as they are written and as they must be to be read.
DELIVERY = {
    "edges_s": Declared("f8", ("edges",), -_LATEST_S, _LATEST_S, rising=True),
    "light_time_s": Declared("f8", ("slots",), 0.0, _LATEST_S),
    "contact_bit": Declared("i8", _LINKS, 0, _MOST_BIT),
    "earth_contact_bit": Declared("i8", _WAYS, 0, _MOST_BIT),
    "station": Declared("i8", _WAYS, -1, 1000),
    "why_swarm": Declared("i1", _LINKS, 0, max(Obstacle)),
    "why_earth": Declared("i1", _WAYS, 0, max(Obstacle)),
    "relay_distance_m": Declared("f8", _WAYS, 0.0, FARTHEST, gaps="nan"),
    "sent_bit": Declared("i8", _LINKS, 0, _MOST_BIT),
    "earth_bit": Declared("i8", _WAYS, 0, _MOST_BIT),
    "aboard_bit": Declared("i8", _HELD, 0, _MOST_BIT),
    "lost_bit": Declared("i8", _HELD, 0, _MOST_BIT),
    "tile_of_cell": Declared("i8", ("cells",), -1, "tiles"),
    "tile_area": Declared("f8", _TILES, 0.0, FARTHEST**2),
    "tile_bit": Declared("i8", _COPIES, 0, _MOST_BIT),
    "tile_lost_bit": Declared("i8", _COPIES, 0, _MOST_BIT),
    "tile_overflow_bit": Declared("i8", _COPIES, 0, _MOST_BIT),
    "tile_ready_s": Declared("f8", _COPIES, 0.0, _LATEST_S, gaps="nan"),
    "tile_arrives_s": Declared("f8", _TILES, 0.0, _LATEST_S, gaps="nan"),
    "tile_origin": Declared("i8", _TILES, -1, "spacecraft"),
    "best_earth_bit": Declared("f8", _WAYS, 0.0, _MOST_BIT, gaps="nan"),
    "best_share": Declared("f8", _TILES, 0.0, 1.0 + 1e-6, gaps="nan"),
    "best_full_s": Declared("f8", (), 0.0, _LATEST_S, gaps="nan"),
    "best_bound_area": Declared("f8", (), 0.0, FARTHEST**2, gaps="nan"),
    "election_s": Declared("f8", ("elections",), -_LATEST_S, _LATEST_S, rising=True),
    "elected": Declared("?", ("elections", "spacecraft")),
}
#: Where nothing was seen.
_EMPTY_WHERE_NOTHING_WAS_SEEN = ("tiles",)


def write_results(
    folder: Path, plan: Plan, telemetry: xr.Dataset, result: ObservationResult, design: dict[str, Any] | None = None
) -> None:
    """Write telemetry, coverage, the scenario as it was flown and its design; the summary comes last, with its times."""
    write_text(folder / "scenario.yaml", yaml.safe_dump(plan.scenario.model_dump(mode="json"), sort_keys=False))
    write_telemetry(folder / "telemetry.nc", telemetry)
    write_coverage(folder / "coverage.npz", plan, result)
    if result.delivery is not None:
        write_delivery(folder, result.delivery)
    if design is not None:
        write_text(folder / "design.json", json.dumps(design, indent=2) + "\n")


def flown_design(scenario: Scenario) -> dict[str, Any] | None:
    """The record of the design that a scenario flies; None: it names none, or flies other points than that design's."""
    reference = scenario.design.reference
    if reference is None:
        return None
    try:
        record = design_record(reference)
    except ScenarioError:
        return None  # points that are given outright fly without their design's record
    design = scenario.design
    given = [arrival.model_dump(exclude_none=True) for arrival in design.observers]
    same = record["visiting_points"] == list(design.visiting_points) and record.get("observers", []) == given
    return record if same else None


def write_summary(folder: Path, summary: dict[str, Any]) -> None:
    """Write summary.json."""
    write_text(folder / "summary.json", json.dumps(summary, indent=2, allow_nan=False) + "\n")


def write_telemetry(path: Path, telemetry: xr.Dataset) -> None:
    """Write telemetry as compressed NetCDF-4."""
    encoding: dict[Any, dict[str, Any]] = {
        name: {"zlib": True, "complevel": 4} for name, variable in telemetry.data_vars.items() if variable.ndim
    }
    # In memory first: on a full disk HDF5 keeps a broken file open that crashes the interpreter when it ends.
    path.write_bytes(telemetry.to_netcdf(engine="h5netcdf", encoding=encoding))


def write_coverage(path: Path | BinaryIO, plan: Observed, result: ObservationResult) -> None:
    """Write the clipped target mesh and what was seen of it, the arrays of `COVERAGE`."""
    np.savez_compressed(path, **coverage_arrays(plan, result))  # type: ignore[arg-type]


def read_coverage(path: Path, names: Collection[str] = tuple(COVERAGE), **sizes: int) -> dict[str, NDArray[Any]]:
    """Arrays of a coverage.npz by name, optional ones where they are there; `sizes`: `spacecraft` and `cells`, where known.

    Which cells a quality class maps is `mapped_CLASS`; the classes' names are the keys of `classes` in summary.json.

    Raises:
        OutputError: It cannot be read, or an array is missing or not as `COVERAGE` says.
    """
    mapped = Declared("?", _CELLS, optional=True)
    declared = {name: mapped if name.startswith(MAPPED) else COVERAGE[name] for name in names}
    return read_arrays(path, declared, REMEDY, sizes=sizes, may_be_empty=_EMPTY_WITHOUT_REST)


def coverage_arrays(plan: Observed, result: ObservationResult) -> dict[str, NDArray[Any]]:
    """The arrays of coverage.npz, see `COVERAGE`."""
    region = plan.region
    corners = region.mesh.faces[region.target]
    used, faces = np.unique(corners, return_inverse=True)
    rest = np.delete(region.mesh.faces, region.target, axis=0)
    body_used, body_faces = np.unique(rest, return_inverse=True)
    seen = {
        f"{name}{suffix}": getattr(of, name)
        for suffix, of in (("", result.coverage), ("_passage", result.passage))
        for name in ("seen", "first_seen_s", "seen_by", "first_seen_by_s")
    }
    arrays = {
        "vertices": region.mesh.vertices[used],
        "faces": faces.reshape(corners.shape),
        "area": region.area,
        "weight": region.weight,
        "face_of_cell": region.group,
        "kept_s": result.kept.taken_s,
        "gsd_m": result.kept.gsd_m,
        "incidence_deg": result.kept.incidence_deg,
        "why": result.why,
        "body_vertices": region.mesh.vertices[body_used].astype(np.float32),
        "body_faces": body_faces.reshape(rest.shape).astype(np.int32),
        **seen,
    }
    arrays = {name: arrays[name] for name in COVERAGE if name in arrays}
    if (quality := result.quality) is not None:
        arrays |= quality.figures._asdict() | {f"{MAPPED}{name}": cells for name, cells in quality.mapped.items()}
    return arrays


def write_delivery(folder: Path, delivery: Delivery) -> None:
    """Write delivery.npz into a folder."""
    np.savez_compressed(folder / "delivery.npz", **vars(delivery))


def read_delivery(folder: Path, **sizes: int) -> Delivery | None:
    """The delivery of a run; None where its folder has none. `sizes`: `spacecraft` and `cells`, where they are known.

    Raises:
        OutputError: The file cannot be read, or an array is missing or not as `DELIVERY` says.
    """
    path = folder / "delivery.npz"
    if not os.path.lexists(path):
        return None
    return Delivery(**read_arrays(path, DELIVERY, REMEDY, sizes=sizes, may_be_empty=_EMPTY_WHERE_NOTHING_WAS_SEEN))
