"""A finished run as plain data, from its folder or from memory: what reports and findings are made of."""

from __future__ import annotations

import os
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from swarm_mj.dataflow.delivery import Delivery
from swarm_mj.errors import OutputError
from swarm_mj.flight.observe import ObservationResult
from swarm_mj.flight.plan import Plan
from swarm_mj.io.atomic import MARKER
from swarm_mj.io.records import read_record, reading, record_from
from swarm_mj.observation.coverage import CoverageMap, KeptPictures
from swarm_mj.observation.quality import Figures, Quality
from swarm_mj.records.cells import MAPPED
from swarm_mj.records.modes import LOST, modes_shown
from swarm_mj.records.run_files import read_coverage, read_delivery
from swarm_mj.records.summary_schema import Event, RunSummary, contradiction
from swarm_mj.scenarios.design_record import DesignRecord
from swarm_mj.scenarios.itinerary import Stop, itinerary, target_name
from swarm_mj.scenarios.loading import MAX_BYTES, file_text, parse_yaml, scenario_from
from swarm_mj.scenarios.schema import Scenario
from swarm_mj.simulator.telemetry import REMEDY, read_telemetry
from swarm_mj.typing import Array

#: Arrays of coverage.npz that a report shows.
SHOWN = (
    "vertices", "faces", "area", "face_of_cell", "first_seen_s", "first_seen_by_s", "first_seen_s_passage",
    "first_seen_by_s_passage", "kept_s", "gsd_m", "incidence_deg", "why",
    "weight", "body_vertices", "body_faces",
)  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class RunRecord:
    """A finished run as it lies on disk, or would.

    Attributes:
        folder: Where it lies; the current folder where it does not.
        summary: summary.json.
        scenario: scenario.yaml, as it was flown.
        telemetry: telemetry.nc.
        coverage: coverage.npz, by name of the array.
        design: The record of the design that was flown, where the run has one.
        delivery: delivery.npz, where the run has it.
    """

    folder: Path
    summary: dict[str, Any]
    scenario: Scenario
    telemetry: xr.Dataset
    coverage: dict[str, NDArray[Any]]
    design: dict[str, Any] | None
    delivery: Delivery | None = None

    @property
    def n(self) -> int:
        """Number of spacecraft."""
        return int(self.telemetry.sizes["spacecraft"])

    @property
    def n_observers(self) -> int:
        """Number of spacecraft that observe; they come first."""
        return int(self.summary["observers"])

    @cached_property
    def names(self) -> list[str]:
        """Names of the spacecraft."""
        return [str(name) for name in self.telemetry["spacecraft"].values]

    @cached_property
    def times(self) -> Array:
        """Times of the samples [s]."""
        return np.asarray(self.telemetry["time"].values, dtype=np.float64)

    @cached_property
    def weighted_area(self) -> Array:
        """Area of each cell times its weight, of which P_TO is made [m^2]."""
        return np.asarray(self.coverage["area"] * self.coverage["weight"])

    @cached_property
    def mode(self) -> NDArray[np.int8]:
        """What each spacecraft tracks, or that it is lost, as `modes_shown` tells, shape (t, n)."""
        return modes_shown(self.telemetry)

    @cached_property
    def _stops(self) -> tuple[Stop, ...]:
        return itinerary(self.scenario)

    def lost_at(self, j: int) -> float | None:
        """When spacecraft j was lost [s]; None if it still works at the end."""
        lost = self.mode[:, j] == LOST
        return float(self.times[np.argmax(lost)]) if lost[-1] else None

    def role(self, j: int) -> str:
        """What spacecraft j was sent to do."""
        if j >= len(self._stops):
            return "communications"
        if self.scenario.initial_states:
            return "on its way at the epoch"
        stop, several = self._stops[j], bool(self.scenario.designer.extra_targets)
        return f"visits point {stop.point}" + (f" of target {target_name(stop.target)}" if several else "")


def read_run(folder: Path) -> RunRecord:
    """Read a result folder of `swarm-mj fly`.

    Raises:
        OutputError: There is no such folder, it is no finished run, or a file in it cannot be read.
    """
    folder = Path(folder)
    _check_folder(folder)
    path, design = folder / MARKER, folder / "design.json"
    summary = read_record(path, RunSummary, REMEDY)
    telemetry = read_telemetry(folder / "telemetry.nc", {"spacecraft": summary["spacecraft"]})
    with reading(folder / "telemetry.nc", REMEDY):
        record_from(telemetry.attrs.get("events", "[]"), list[Event])
    if why := contradiction(summary, [str(name) for name in telemetry["spacecraft"].values]):
        raise OutputError(f"{path}: cannot be read ({why}); {REMEDY}")
    sizes = {"spacecraft": summary["spacecraft"], "cells": summary["target_cells"]}
    delivery = read_delivery(folder, **sizes)
    if delivery is not None and summary.get("delivered_percent") is None:
        raise OutputError(f"{path}: cannot be read (delivered_percent is missing, but delivery.npz is there); {REMEDY}")
    return RunRecord(
        folder=folder,
        summary=summary,
        scenario=read_scenario(folder / "scenario.yaml"),
        telemetry=telemetry,
        coverage=read_coverage(folder / "coverage.npz", (*SHOWN, *Figures._fields, *_classes(summary)), **sizes),
        design=read_record(design, DesignRecord, REMEDY) if os.path.lexists(design) else None,
        delivery=delivery,
    )


def _classes(summary: dict[str, Any]) -> list[str]:
    """Arrays of what quality classes map."""
    return [f"{MAPPED}{name}" for name in summary.get("classes", {})]


def _quality(record: RunRecord) -> Quality | None:
    """What quality classes map, where the run has some."""
    if "looks" not in record.coverage:
        return None
    mapped = {name.removeprefix(MAPPED): record.coverage[name] for name in _classes(record.summary)}
    return Quality(mapped, Figures(**{name: record.coverage[name] for name in Figures._fields}))


def observation_of(record: RunRecord, plan: Plan) -> ObservationResult:
    """What the cameras saw, from a record and the plan made again.

    Raises:
        OutputError: The plan's target has other cells than were recorded.
    """
    cells = len(record.coverage["area"])
    if plan.n != record.n or plan.region.n_cells != cells:
        raise OutputError(
            f"{record.folder}: {record.n} spacecraft and {cells} target cells were recorded, but the scenario now gives "
            f"{plan.n} and {plan.region.n_cells}: fly it again with this version"
        )
    maps = []
    for suffix in ("", "_passage"):
        seen = CoverageMap(plan.region.weighted_area, plan.n)
        seen.first_seen_by_s[:] = record.coverage[f"first_seen_by_s{suffix}"]
        maps.append(seen)
    kept = KeptPictures(cells, plan.n, plan.scenario.data.pictures)
    for own, name in ((kept.taken_s, "kept_s"), (kept.gsd_m, "gsd_m"), (kept.incidence_deg, "incidence_deg")):
        own[:] = record.coverage[name]
    summary = record.summary
    return ObservationResult(
        coverage=maps[0],
        passage=maps[1],
        observer=summary["observer"],
        note=summary["observer_note"],
        images=summary["images"],
        why=record.coverage["why"],
        kept=kept,
        delivery=record.delivery,
        quality=_quality(record),
    )


def _check_folder(folder: Path) -> None:
    try:
        if not folder.exists():
            raise OutputError(f"{folder}: no such folder; give the folder that `swarm-mj fly` wrote")
        if not folder.is_dir():
            raise OutputError(f"{folder}: is a file; give the folder that `swarm-mj fly` wrote")
        if not os.path.lexists(folder / MARKER):
            begun = any((folder / name).exists() for name in ("scenario.yaml", "telemetry.nc", "coverage.npz"))
            what = "is an unfinished run" if begun else "is not a folder of `swarm-mj fly`"
            raise OutputError(f"{folder}: {what} (it has no {MARKER}); fly it with `swarm-mj fly`")
    except OSError as error:
        raise OutputError(f"{folder}: cannot be read ({error.strerror})") from None


def read_scenario(path: Path) -> Scenario:
    """The scenario of a result as it was flown or designed for.

    Raises:
        OutputError: It cannot be read.
    """
    with reading(path, REMEDY):
        return scenario_from(parse_yaml(file_text(path, "scenario", 4 * MAX_BYTES), path.name), path.name)
