"""Swarm classes compared: what each step of coordination buys."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd
from rich.progress import Progress

from swarm_mj.campaigns.classes import ClassResult, Recovery, class_results, classes_campaign, recovery
from swarm_mj.campaigns.classes_report import write_report
from swarm_mj.campaigns.runner import run_campaign
from swarm_mj.designer.places import plan_places
from swarm_mj.errors import OutputError
from swarm_mj.io.progress import using_bars
from swarm_mj.scenarios.loading import NO_OVERRIDES, ScenarioSource, load_scenario


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
    progress: bool | Progress = False,
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
        progress: Whether to show a progress bar, or the bars to use.

    Raises:
        SwarmError: The scenario cannot be read, planned or flown, or nothing can be written; what was flown is kept in `out`.
    """
    if workers is not None and workers < 1:
        raise OutputError(f"workers = {workers}: must be at least 1")
    if resume and out is None:
        raise OutputError("resume = True: give the folder to go on from, out=")
    base = load_scenario(scenario, overrides)
    chosen = plan_places(base) if places else ()
    resolved = classes_campaign(base, runs=runs, places=chosen)
    with ExitStack() as stack:
        folder = Path(out or Path(stack.enter_context(tempfile.TemporaryDirectory())) / resolved.campaign.name)
        bars = stack.enter_context(using_bars(progress))
        flown = run_campaign(resolved, folder, workers=workers, resume=resume, bars=bars, figures=False)
        found = class_results(flown.results)
        write_report(folder, found, flown.results, figures=figures and out is not None)
    pairs = {"as designed": ("class 3", "class 4"), "placed": ("class 3 placed", "class 4 placed")}
    recovered = {name: recovery(flown.results, *pair) for name, pair in pairs.items() if places or name != "placed"}
    return ComparedClasses(found, flown.results.to_pandas(), recovered, chosen)
