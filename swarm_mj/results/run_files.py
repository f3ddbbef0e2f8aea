"""The files of a run: summary.json, scenario.yaml, telemetry.nc, coverage.npz, and design.json of a design that was flown."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
import yaml
from numpy.typing import NDArray

from swarm_mj.errors import ScenarioError
from swarm_mj.flight.observe import ObservationResult
from swarm_mj.flight.plan import Plan
from swarm_mj.io.atomic import write_text
from swarm_mj.scenarios.loading import design_record
from swarm_mj.scenarios.schema import Scenario


def write_results(
    folder: Path, plan: Plan, telemetry: xr.Dataset, result: ObservationResult, design: dict[str, Any] | None = None
) -> None:
    """Write telemetry, coverage, the scenario as it was flown and its design; the summary comes last, with its times."""
    write_text(folder / "scenario.yaml", yaml.safe_dump(plan.scenario.model_dump(mode="json"), sort_keys=False))
    write_telemetry(folder / "telemetry.nc", telemetry)
    write_coverage(folder / "coverage.npz", plan, result)
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
    return record if record["visiting_points"] == list(scenario.design.visiting_points) else None


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


def write_coverage(path: Path, plan: Plan, result: ObservationResult) -> None:
    """Write the clipped target mesh and what was seen of it.

    Arrays: `vertices` in A [m]; `faces`, the target's cells; `area` [m^2]; `seen`; `first_seen_s` (NaN: never); `seen_by`
    (spacecraft x face); `first_seen_by_s`, the same with the time (NaN: never); `face_of_cell`, the face of F_T each lies
    in; what was seen in the whole passage with suffix `_passage`; `body_vertices` and `body_faces`, the rest of the body.
    """
    np.savez_compressed(path, **coverage_arrays(plan, result))  # type: ignore[arg-type]


def coverage_arrays(plan: Plan, result: ObservationResult) -> dict[str, NDArray[Any]]:
    """The arrays of coverage.npz, see `write_coverage`."""
    region = plan.region
    corners = region.mesh.faces[region.target]
    used, faces = np.unique(corners, return_inverse=True)
    rest = np.delete(region.mesh.faces, region.target, axis=0)
    body_used, body_faces = np.unique(rest, return_inverse=True)
    coverage, passage = result.coverage, result.passage
    return {
        "vertices": region.mesh.vertices[used],
        "faces": faces.reshape(corners.shape),
        "area": region.area,
        "face_of_cell": region.group,
        "seen": coverage.seen,
        "first_seen_s": coverage.first_seen_s,
        "seen_by": coverage.seen_by,
        "first_seen_by_s": coverage.first_seen_by_s,
        "seen_passage": passage.seen,
        "first_seen_s_passage": passage.first_seen_s,
        "seen_by_passage": passage.seen_by,
        "first_seen_by_s_passage": passage.first_seen_by_s,
        "body_vertices": region.mesh.vertices[body_used].astype(np.float32),
        "body_faces": body_faces.reshape(rest.shape).astype(np.int32),
    }
