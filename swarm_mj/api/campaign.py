"""Campaigns: many flights with drawn parameters, and their results as one table; swarm classes compared by one."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd

from swarm_mj.campaigns import runner
from swarm_mj.campaigns.loading import Resolved, load_campaign
from swarm_mj.campaigns.manifest import load_campaign_of
from swarm_mj.campaigns.runner import Replayed, run_campaign
from swarm_mj.errors import OutputError
from swarm_mj.io.machine import check_workers
from swarm_mj.io.progress import Shown, using_bars
from swarm_mj.scenarios.loading import NO_OVERRIDES, ScenarioSource, load_scenario

if TYPE_CHECKING:
    from swarm_mj.campaigns.classes import ClassResult, Recovery


@dataclass(frozen=True, eq=False)
class ComparedClasses:
    """Classes flown through the same encounters.

    Attributes:
        classes: What each came to.
        table: One row a flight.
        recovered: What class 4 brings home with one loss of what class 3 loses, by variant: as designed, and `placed`.
        places: Visiting points that were planned for the placed variants; empty: none were.
    """

    classes: list[ClassResult]
    table: pd.DataFrame
    recovered: dict[str, Recovery]
    places: tuple[int, ...]


def campaign(
    source: ScenarioSource,
    overrides: Mapping[str, Any] = NO_OVERRIDES,
    *,
    runs: int | None = None,
    out: str | Path | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
    resume: bool = False,
    figures: bool = True,
    progress: Shown = None,
) -> pd.DataFrame:
    """Fly a campaign: scenarios with drawn parameters, on all cores or a Dask cluster; needs the extra `cluster`.

    Args:
        source: YAML file of the campaign, what such a file holds as a mapping, or the name of a packaged one (see `available`);
            or a scenario, as `load` takes it, which is flown with one seed after the other.
        overrides: Values by dotted key, in all its scenarios.
        runs: Flights of each scenario, instead of the file's; of each point of a grid; of the two base samples of saltelli.
        out: Folder for results, summary and figures, which an interrupted campaign goes on from; None: nothing is kept.
        workers: Processes; None: one per core.
        scheduler: Address of a Dask cluster's scheduler that flies instead, e.g. tcp://host:8786.
        resume: Go on with the campaign in `out`.
        figures: Whether to draw figures into `out`.
        progress: Whether to show a progress bar, or the bars to use; None: on a terminal and in notebooks, after 2 s.

    Returns:
        One row a run; `attrs["summary"]` says what they say in sum, as in summary.json.

    Raises:
        SwarmError: The campaign cannot be read, flown or written; every finished run is kept in `out`.
    """
    _check_resume(resume, out)
    if resume and out is not None:
        resolved = load_campaign_of(Path(out), source, overrides, runs=runs)
    else:
        resolved = load_campaign(source, overrides, runs=runs)
    with _folder(resolved, out) as folder, using_bars(progress) as bars:
        flown = run_campaign(
            resolved,
            folder,
            workers=workers,
            scheduler=scheduler,
            resume=resume,
            bars=bars,
            figures=figures and out is not None,
        )
    table: pd.DataFrame = flown.results.to_pandas()
    table.attrs["summary"] = flown.summary
    return table


def replay(
    source: ScenarioSource,
    row: int,
    folder: str | Path,
    overrides: Mapping[str, Any] = NO_OVERRIDES,
    *,
    runs: int | None = None,
) -> Replayed:
    """Fly one row of a campaign again, here and alone, and compare it with what the folder keeps of it.

    Args:
        source: The campaign, as `campaign` takes it.
        row: Its number, from 0.
        folder: Of the campaign; the flight goes to `replays/ROW` in it.
        overrides: Values by dotted key with which it was flown.
        runs: Flights of each scenario; None: as many as the campaign in the folder has, or the file says.

    Raises:
        SwarmError: There is no such campaign or row, or the folder holds something else.
    """
    return runner.replay(load_campaign_of(Path(folder), source, overrides, runs=runs), row, Path(folder))


def compare_classes(
    scenario: ScenarioSource = "eros-observe",
    overrides: Mapping[str, Any] = NO_OVERRIDES,
    *,
    runs: int = 200,
    out: str | Path | None = None,
    workers: int | None = None,
    places: bool = True,
    resume: bool = False,
    figures: bool = True,
    progress: Shown = None,
) -> ComparedClasses:
    """Fly the swarm classes 0 to 4 through the same dispersed encounters with losses; needs the extra `cluster`.

    Args:
        scenario: What is flown, as `load` takes it.
        overrides: Values by dotted key that change it.
        runs: Encounters; each spacecraft is lost with a chance that goes from 0 to 40 % over them.
        out: Folder for results, tables and figures; None: nothing is kept.
        workers: Processes; None: one per core.
        places: Whether classes 3 and 4 fly once more with visiting points planned together with the pictures.
        resume: Go on with the comparison in `out`.
        figures: Whether to draw figures into `out`.
        progress: Whether to show a progress bar, or the bars to use; None: on a terminal and in notebooks, after 2 s.

    Raises:
        SwarmError: The scenario cannot be read, planned or flown, or nothing can be written; what was flown is kept in `out`.
    """
    from swarm_mj.campaigns.classes import class_results, classes_campaign, recovery, write_report
    from swarm_mj.designer.robust_points import robust_points

    check_workers(workers)
    _check_resume(resume, out)
    base = load_scenario(scenario, overrides)
    chosen = robust_points(base) if places else ()
    resolved = classes_campaign(base, runs=runs, places=chosen)
    with _folder(resolved, out) as folder, using_bars(progress) as bars:
        flown = run_campaign(resolved, folder, workers=workers, resume=resume, bars=bars, figures=False)
        found = class_results(flown.results)
        write_report(folder, found, flown.results, figures=figures and out is not None)
    pairs = {"as designed": ("class 3", "class 4"), "placed": ("class 3 placed", "class 4 placed")}
    recovered = {name: recovery(flown.results, *pair) for name, pair in pairs.items() if places or name != "placed"}
    return ComparedClasses(found, flown.results.to_pandas(), recovered, chosen)


def _check_resume(resume: bool, out: str | Path | None) -> None:
    if resume and out is None:
        raise OutputError("resume = True: give the folder to go on from, out=")


@contextmanager
def _folder(resolved: Resolved, out: str | Path | None) -> Iterator[Path]:
    """Where a campaign is flown: in the folder that was asked for, or in one that goes with the block."""
    if out is not None:
        yield Path(out)
        return
    with tempfile.TemporaryDirectory() as folder:
        yield Path(folder) / resolved.campaign.name
