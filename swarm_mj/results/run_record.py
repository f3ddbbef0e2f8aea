"""A finished run as plain data, from its folder or from memory: what reports and findings are made of."""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from swarm_mj.errors import OutputError, ScenarioError
from swarm_mj.flight.observe import ObservationResult
from swarm_mj.flight.plan import Plan
from swarm_mj.mission.behaviors import TargetKind
from swarm_mj.observation.coverage import CoverageMap
from swarm_mj.results.modes import LOST, MODE_LOOKS, modes_shown, runs
from swarm_mj.scenarios.loading import parse_yaml, scenario_from
from swarm_mj.scenarios.schema import Scenario
from swarm_mj.simulator.telemetry import read_telemetry
from swarm_mj.typing import Array

#: Arrays of coverage.npz and variables of telemetry.nc that a report shows.
COVERAGE = (
    "vertices", "faces", "area", "first_seen_s", "first_seen_by_s", "first_seen_s_passage", "first_seen_by_s_passage",
    "body_vertices", "body_faces",
)  # fmt: skip
TELEMETRY = (
    "r_BN_N", "sigma_BN", "sigma_AN", "pointing_error", "mode", "tracked_spacecraft", "wheel_speed", "link_closed",
)  # fmt: skip
ATTRIBUTES = ("wheel_max_speed_rad_s", "sun_N_m", "earth_N_m")
SUMMARY = ("scenario", "spacecraft", "observers", "coverage_percent", "versions")


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
    """

    folder: Path
    summary: dict[str, Any]
    scenario: Scenario
    telemetry: xr.Dataset
    coverage: dict[str, NDArray[Any]]
    design: dict[str, Any] | None

    @property
    def n(self) -> int:
        """Number of spacecraft."""
        return int(self.telemetry.sizes["spacecraft"])

    @property
    def n_observers(self) -> int:
        """Number of spacecraft that observe; they come first."""
        return int(self.summary["observers"])

    @property
    def names(self) -> list[str]:
        """Names of the spacecraft."""
        return [str(name) for name in self.telemetry["spacecraft"].values]

    @cached_property
    def times(self) -> Array:
        """Times of the samples [s]."""
        return np.asarray(self.telemetry["time"].values, dtype=np.float64)

    @cached_property
    def mode(self) -> NDArray[np.int8]:
        """What each spacecraft tracks, or that it is lost, as `modes_shown` tells, shape (t, n)."""
        return modes_shown(self.telemetry)

    def turns(self, j: int) -> list[tuple[float, str]]:
        """When spacecraft j chose another target [s], or was lost, and in words what came then."""
        found = []
        for run in runs(self.telemetry, j)[1:]:
            k = int(np.searchsorted(self.times, run.start))
            whom = int(self.telemetry["tracked_spacecraft"].values[k, j])
            by_name = run.mode == TargetKind.SPACECRAFT and whom >= 0
            words = MODE_LOOKS[run.mode].meaning + (f" with {self.names[whom]}" if by_name else "")
            found.append((run.start, words))
        return found

    def lost_at(self, j: int) -> float | None:
        """When spacecraft j was lost [s]; None if it still works at the end."""
        lost = self.mode[:, j] == LOST
        return float(self.times[np.argmax(lost)]) if lost[-1] else None

    def role(self, j: int) -> str:
        """What spacecraft j was sent to do."""
        points = self.scenario.design.visiting_points
        return f"visits point {points[j]}" if j < len(points) else "communications"


def read_run(folder: Path) -> RunRecord:
    """Read a result folder of `swarm-mj run`.

    Raises:
        OutputError: There is no such folder, it is no finished run, or a file in it cannot be read.
    """
    folder = Path(folder)
    _check_folder(folder)
    summary = read_json(folder / "summary.json")
    if not isinstance(summary, dict) or (missing := [key for key in SUMMARY if key not in summary]):
        what = (
            "a design" if isinstance(summary, dict) and "proof" in summary else f"no run: {', '.join(missing)} missing"
        )
        raise OutputError(f"{folder}: summary.json describes {what}; a report is made from a folder of `swarm-mj run`")
    design = folder / "design.json"
    return RunRecord(
        folder=folder,
        summary=summary,
        scenario=read_scenario(folder / "scenario.yaml"),
        telemetry=_read_telemetry(folder / "telemetry.nc"),
        coverage=_read_coverage(folder / "coverage.npz"),
        design=read_json(design) if design.is_file() else None,
    )


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
        seen = CoverageMap(plan.region.area, plan.n)
        seen.first_seen_by_s[:] = record.coverage[f"first_seen_by_s{suffix}"]
        maps.append(seen)
    summary = record.summary
    return ObservationResult(
        coverage=maps[0],
        passage=maps[1],
        observer=summary["observer"],
        note=summary["observer_note"],
        images=summary["images"],
    )


def _check_folder(folder: Path) -> None:
    try:
        if not folder.exists():
            raise OutputError(f"{folder}: no such folder; give the folder that `swarm-mj run` wrote")
        if not folder.is_dir():
            raise OutputError(f"{folder}: is a file; give the folder that `swarm-mj run` wrote")
        if not (folder / "summary.json").is_file():
            begun = any((folder / name).exists() for name in ("scenario.yaml", "telemetry.nc", "coverage.npz"))
            what = "is an unfinished run" if begun else "is not a folder of `swarm-mj run`"
            raise OutputError(f"{folder}: {what} (it has no summary.json); fly it with `swarm-mj run`")
    except OSError as error:
        raise OutputError(f"{folder}: cannot be read ({error.strerror})") from None


def unreadable(path: Path, why: object) -> OutputError:
    """The error that says that a file of a result cannot be read."""
    return OutputError(f"{path}: cannot be read ({why}); fly the scenario again with `swarm-mj run`")


def read_json(path: Path) -> Any:
    """What a JSON file of a result holds.

    Raises:
        OutputError: It cannot be read.
    """
    try:
        return json.loads(path.read_text("utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise unreadable(path, error) from None


def read_scenario(path: Path) -> Scenario:
    """The scenario of a result as it was flown or designed for.

    Raises:
        OutputError: It cannot be read.
    """
    try:
        return scenario_from(parse_yaml(path.read_text("utf-8"), str(path)), str(path))
    except (OSError, ValueError, ScenarioError) as error:
        raise unreadable(path, error) from None


def _read_telemetry(path: Path) -> xr.Dataset:
    try:
        telemetry = read_telemetry(path)
    except Exception as error:  # the HDF5 library raises what it likes on a broken file
        raise unreadable(path, error) from None
    missing = [name for name in TELEMETRY if name not in telemetry] + [
        a for a in ATTRIBUTES if a not in telemetry.attrs
    ]
    if missing:
        raise unreadable(path, f"{', '.join(missing)} missing")
    if not telemetry.sizes["time"] or not telemetry.sizes["spacecraft"]:
        raise unreadable(path, "it is empty")
    return telemetry


def _read_coverage(path: Path) -> dict[str, NDArray[Any]]:
    try:
        with np.load(path) as file:
            missing = [name for name in COVERAGE if name not in file]
            if missing:
                raise unreadable(path, f"{', '.join(missing)} missing: written by an earlier version")
            return {name: file[name] for name in COVERAGE}
    except OutputError:
        raise
    except Exception as error:  # zipfile, zlib and numpy each have their own
        raise unreadable(path, error) from None
