"""Campaigns: many flights with drawn parameters, and their results as one table."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pandas as pd
from rich.progress import Progress

from swarm_mj.campaigns import runner
from swarm_mj.campaigns.loading import load_campaign
from swarm_mj.campaigns.manifest import load_campaign_of
from swarm_mj.campaigns.runner import Replayed, run_campaign
from swarm_mj.errors import OutputError
from swarm_mj.io.progress import using_bars
from swarm_mj.scenarios.loading import NO_OVERRIDES, ScenarioSource


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
    progress: bool | Progress = False,
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
        progress: Whether to show a progress bar, or the bars to use.

    Returns:
        One row a run; `attrs["summary"]` says what they say in sum, as in summary.json.

    Raises:
        SwarmError: The campaign cannot be read, flown or written; every finished run is kept in `out`.
    """
    if workers is not None and workers < 1:
        raise OutputError(f"workers = {workers}: must be at least 1")
    if resume and out is None:
        raise OutputError("resume = True: give the folder to go on from, out=")
    if resume and out is not None:
        resolved = load_campaign_of(Path(out), source, overrides, runs=runs)
    else:
        resolved = load_campaign(source, overrides, runs=runs)
    with ExitStack() as stack:
        folder = Path(out or Path(stack.enter_context(tempfile.TemporaryDirectory())) / resolved.campaign.name)
        flown = run_campaign(
            resolved,
            folder,
            workers=workers,
            scheduler=scheduler,
            resume=resume,
            bars=stack.enter_context(using_bars(progress)),
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
