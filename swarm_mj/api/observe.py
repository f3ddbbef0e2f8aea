"""A flight that was flown elsewhere, judged by what its cameras saw: `observe` reads its OEM and AEM, or SPK and CK."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from swarm_mj import __version__
from swarm_mj.api.scenario import Scenario, load
from swarm_mj.errors import InteropError
from swarm_mj.flight.observe import ObservationResult, observe_flight, picture_count
from swarm_mj.interop.external_flight import (
    ForeignFlight,
    Pointing,
    body_section,
    read_tracks,
    scenario_of,
)
from swarm_mj.io.atomic import atomic_file
from swarm_mj.io.progress import Shown, Stages, using_bars
from swarm_mj.io.records import writing
from swarm_mj.observation.coverage import CoverageMap, percent_text
from swarm_mj.records.cells import cells_table
from swarm_mj.records.observed import mapped_by_class, not_observed
from swarm_mj.records.run_files import coverage_arrays, write_coverage
from swarm_mj.scenarios.bodies import packaged_bodies
from swarm_mj.scenarios.loading import NO_OVERRIDES, ScenarioSource
from swarm_mj.smallbody.naif import BodyName
from swarm_mj.tracks.kernels_in import read_kernels
from swarm_mj.tracks.track import Track

Files = str | Path | Sequence[str | Path]


class Observation:
    """What the cameras of a flight saw that was flown elsewhere.

    Attributes:
        flight: The files at the instants of the pictures, with body and target.
        result: What was seen, by the scenario's criterion and over the whole passage.
    """

    def __init__(self, flight: ForeignFlight, result: ObservationResult) -> None:
        self.flight, self.result = flight, result

    @property
    def scenario(self) -> Scenario:
        """Body, target, camera and criterion."""
        return Scenario.of(self.flight.scenario)

    @property
    def coverage(self) -> CoverageMap:
        """What was observed by the scenario's criterion: `.percent`, `.seen`, `.first_seen_s`, `.seen_by`."""
        return self.result.coverage

    @property
    def passage(self) -> CoverageMap:
        """What was observed over the whole passage."""
        return self.result.passage

    @property
    def cells(self) -> pd.DataFrame:
        """One row a cell of the target; columns with units as `swarm_mj.records.cells.QUANTITIES` says."""
        return cells_table(coverage_arrays(self.flight, self.result))

    @property
    def notes(self) -> list[str]:
        """What was assumed, one sentence each."""
        return list(self.flight.notes)

    @property
    def summary(self) -> dict[str, Any]:
        """The numbers a reader asks for first."""
        scenario, by = self.flight.scenario, self.coverage.percent_by_spacecraft
        return {
            "swarm_mj": __version__,
            "body": scenario.body.name,
            "epoch_tdb": scenario.epoch,
            "duration_s": scenario.duration_s,
            "criterion": scenario.observation.criterion,
            "light": scenario.observation.light,
            "coverage_percent": self.coverage.percent,
            "not_observed": not_observed(self.flight.region.weighted_area, self.result.why),
            "classes": mapped_by_class(self.flight.region, self.result.quality),
            "coverage_percent_passage": self.passage.percent,
            "coverage_percent_by_spacecraft": dict(zip(self.flight.names, map(float, by), strict=True)),
            "images": self.result.images,
            "observer": self.result.observer,
            "notes": self.notes,
        }

    def save(self, folder: str | Path) -> Path:
        """Write observation.json and coverage.npz into a folder, which is made if need be.

        Raises:
            OutputError: They cannot be written.
        """
        place = Path(folder)
        with writing(place, "choose another folder with --out"):
            place.mkdir(parents=True, exist_ok=True)
        with atomic_file(place / "coverage.npz") as partial, partial.open("wb") as file:
            write_coverage(file, self.flight, self.result)
        with atomic_file(place / "observation.json") as partial:
            partial.write_text(json.dumps(self.summary, indent=2, allow_nan=False) + "\n", encoding="utf-8")
        return place

    def __repr__(self) -> str:
        """One line: who looked and what was seen."""
        share = f"{percent_text(self.coverage.percent)} of the target observed"
        return f"Observation({', '.join(self.flight.names)} past {self.flight.scenario.body.name}, {share})"


def observe(
    oem: Files = (),
    aem: Files = (),
    *,
    kernels: Files = (),
    spacecraft: str | Sequence[str] = (),
    scenario: ScenarioSource | None = None,
    overrides: Mapping[str, Any] = NO_OVERRIDES,
    body: str | None = None,
    pointing: Pointing = "nadir",
    progress: Shown = None,
) -> Observation:
    """Judge what the cameras of a flight saw that was flown elsewhere, as `fly` judges its own.

    Args:
        oem: Orbit Ephemeris Messages (CCSDS, KVN), one a spacecraft, relative to the body.
        aem: Attitude Ephemeris Messages, as many and in the same order; none: `pointing`.
        kernels: SPICE kernels instead: SPK, CK, and the text kernels that these need; a meta-kernel serves too (extra `spice`).
        spacecraft: SPICE's names or numbers of the observers, or `NAME/FRAME` with the frame whose z axis the camera looks
            along; none: all spacecraft of the SPKs.
        scenario: Body, target, camera, criterion, epoch and duration, as `load` takes it; None: `body`, as long as the files
            last.
        overrides: Values by dotted key that change the scenario, e.g. `{"camera.half_angle_deg": 6}`.
        body: A packaged body, a YAML file with the keys of `body`, or a shape file, instead of a scenario.
        pointing: Where the cameras look without an AEM: at the body's centre (`nadir`) or the target's (`target`).
        progress: Whether to show progress bars, or the bars to use; None: on a terminal and in notebooks, after 2 s.

    Raises:
        InteropError: A file is refused; one line says which line, key and value, and the remedy.
        SwarmError: The scenario is refused.
    """
    if (scenario is None) == (body is None):
        raise InteropError("give either a scenario (--scenario) or a body (--body)")
    if bool(_paths(oem)) == bool(_paths(kernels)):
        raise InteropError("give either OEM (--oem) or SPICE kernels (--kernels)")
    wanted = [spacecraft] if isinstance(spacecraft, str) else list(spacecraft)

    def tracks(body: str, code: str | None) -> tuple[Sequence[Track], Sequence[Track]]:
        if _paths(kernels):
            return read_kernels(_paths(kernels), wanted, code or str(BodyName.of(body).code))
        return read_tracks(_paths(oem), _paths(aem), body)

    if scenario is None:
        section = body_section(str(body))
        _check_complete(str(body), section, overrides)
        paths, attitudes = tracks(str(section["name"]), overrides.get("ephemerides.body"))
        asked = load(scenario_of(paths, section), overrides)
    else:
        asked = load(scenario, overrides)
        paths, attitudes = tracks(asked.body.name, asked.ephemerides.body)
    flight = ForeignFlight(asked, paths, attitudes, pointing)
    with using_bars(progress) as bars:
        stages = Stages(asked.name, bars)
        with stages.stage("coverage", "images", picture_count(flight, flight.telemetry)) as done:
            return Observation(flight, observe_flight(flight, flight.telemetry, done))


def _check_complete(body: str, section: Mapping[str, Any], overrides: Mapping[str, Any]) -> None:
    """Refuse a body that would turn, or stand in the light, as Eros does because nobody said how."""
    missing = [
        key
        for key in ("rotation", "orbit")
        if key not in section and not any(f"{given}.".startswith(f"body.{key}.") for given in overrides)
    ]
    if missing and body not in packaged_bodies() and "ephemerides.kernels" not in overrides:
        raise InteropError(
            f"body = {body}: says nothing of its {' and '.join(missing)}; give body.{missing[0]} in a YAML file or by --set, "
            "or SPICE kernels that know it (ephemerides.kernels)"
        )


def _paths(files: Files) -> list[Path]:
    return [Path(files)] if isinstance(files, str | Path) else [Path(file) for file in files]
