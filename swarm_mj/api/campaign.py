"""Campaigns: many flights with drawn parameters, and their results as one table."""

from __future__ import annotations

import tempfile
from contextlib import ExitStack
from pathlib import Path

import pandas as pd
from rich.progress import Progress

from swarm_mj.campaigns.loading import load_campaign
from swarm_mj.campaigns.runner import Replayed, replay, run_campaign
from swarm_mj.errors import OutputError
from swarm_mj.io.progress import using_bars


def campaign(
    source: str | Path,
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
        source: YAML file of the campaign, or the name of a packaged one (see `available`).
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
    resolved = load_campaign(source, runs=runs)
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


def replay_row(source: str | Path, row: int, folder: str | Path, *, runs: int | None = None) -> Replayed:
    """Fly one row of a campaign again, here and alone, and compare it with what the folder keeps of it.

    Args:
        source: The campaign, see `campaign`.
        row: Its number, from 0.
        folder: Of the campaign; the flight goes to `replays/ROW` in it.
        runs: See `campaign`.

    Raises:
        SwarmError: There is no such campaign or row, or the folder holds something else.
    """
    return replay(load_campaign(source, runs=runs), row, Path(folder))
