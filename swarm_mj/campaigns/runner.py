"""Flying a campaign: fly what is missing, keep every result as it comes, then sum up; and one row again."""

from __future__ import annotations

import traceback
from contextlib import closing
from pathlib import Path
from typing import Any, NamedTuple

from rich.progress import Progress

from swarm_mj.campaigns.flying import Flyer
from swarm_mj.campaigns.loading import Resolved
from swarm_mj.campaigns.manifest import REPLAYS, require_place, take_over
from swarm_mj.campaigns.pools import DaskPool, LocalPool, Pool
from swarm_mj.campaigns.sampling import Sample
from swarm_mj.errors import OutputError, ScenarioError
from swarm_mj.io import interruption
from swarm_mj.io.atomic import write_text
from swarm_mj.io.lock import only_one
from swarm_mj.io.machine import check_workers
from swarm_mj.io.progress import Stages
from swarm_mj.io.records import writing

TELEMETRY = "telemetry"


class FlownCampaign(NamedTuple):
    """A campaign that is finished: its summary as in `summary.json`, and an Arrow table with one row a run."""

    summary: dict[str, Any]
    results: Any


class Replayed(NamedTuple):
    """A row that was flown again.

    Attributes:
        row: What the run gave this time.
        values: Names of the drawn values in it.
        differs: Names of what differs from the row that the folder keeps; None: it keeps none.
    """

    row: dict[str, Any]
    values: tuple[str, ...]
    differs: list[str] | None


def run_campaign(
    resolved: Resolved,
    folder: Path,
    *,
    workers: int | None = None,
    scheduler: str | None = None,
    resume: bool = False,
    bars: Progress | None = None,
    figures: bool = True,
    going_on: str = "--resume",
) -> FlownCampaign:
    """Fly a campaign into a folder, or go on with one.

    Args:
        resolved: The campaign.
        folder: Where its results stand or will stand.
        workers: Local processes; None takes one per core.
        scheduler: Of Dask, whose workers fly instead.
        resume: Go on with the campaign in the folder.
        bars: Where to show how far it is, and to say what the user should know on the way: torn files whose runs are flown
            again, another observer, an interruption. None: nowhere, and by warnings.
        figures: Whether to draw.
        going_on: What goes on with this campaign, which is told when it is interrupted.

    Raises:
        SwarmError: The campaign cannot be flown or written; every finished run is kept.
        KeyboardInterrupt: It was interrupted; likewise.
    """
    check_workers(workers)
    _require_parquet()
    from swarm_mj.campaigns.store import Store, read_results, schema_in
    from swarm_mj.campaigns.summary import write_summary

    stages = Stages(resolved.campaign.name, bars)
    # Both before anything is written, so that what is refused leaves no trace.
    require_place(folder, resume=resume)
    with closing(_pool(resolved, folder, workers, scheduler)) as pool, only_one(folder):
        take_over(resolved, folder, resume=resume)
        store = Store(folder, schema_in(folder), Sample(resolved.campaign).rows)
        for name in store.torn:
            stages.say(f"{folder / name} was damaged; its runs are flown again")
        if resolved.without_maps:
            stages.say(
                f"{', '.join(resolved.without_maps)}: the target's cells differ from run to run, so that each horizon map "
                "would serve one run; observed by compiled face-ID buffers (observation.observer: raster) instead"
            )
        try:
            _fly_missing(resolved, store, pool, bars, stages, going_on)
        finally:
            store.close()
        results = read_results(folder, store.schema)
        summary = write_summary(folder, resolved, results)
        if figures:
            from swarm_mj.campaigns.figures import draw_all

            draw_all(folder, resolved, results, summary)
    return FlownCampaign(summary, results)


def replay(resolved: Resolved, row: int, folder: Path) -> Replayed:
    """Fly one row again, here and alone, and compare it with what the folder holds of it.

    The flight's scenario, and its telemetry and coverage or the traceback of its failure, go to `folder/replays/ROW`.

    Raises:
        ScenarioError: There is no such row.
        OutputError: The folder holds something else than a campaign, or cannot be written.
    """
    _require_parquet()
    require_place(folder)
    from swarm_mj.campaigns.store import WALL, schema_of, table_of

    flyer = Flyer(resolved)
    if not 0 <= row < flyer.sample.rows:
        raise ScenarioError(f"--replay {row}: must be a row of this campaign, 0 to {flyer.sample.rows - 1}")
    trial = flyer.sample.trial(row)
    flown = table_of([flyer.fly(row)], schema_of(resolved.campaign)).to_pylist()[0]
    _write_replay(flyer, row, folder / REPLAYS / str(row), flown)
    kept = _kept_row(folder, row)
    differs = None if kept is None else [name for name in flown if name != WALL and flown[name] != kept.get(name)]
    return Replayed(flown, tuple(trial.values), differs)


def _require_parquet() -> None:
    try:
        import pyarrow.parquet  # noqa: F401
    except ImportError:
        raise OutputError("campaigns write Parquet: pip install 'swarm_mj[cluster]'") from None


def _fly_missing(
    resolved: Resolved, store: Any, pool: Pool, bars: Progress | None, stages: Stages, going_on: str
) -> None:
    total = store.rows
    missing = [row for row in range(total) if row not in store.done]
    if missing:
        if resolved.campaign.telemetry:
            (store.folder / TELEMETRY).mkdir(exist_ok=True)
        try:
            _collect(pool, missing, store, total, bars, resolved.campaign.name)
        except KeyboardInterrupt:
            stages.say(f"{len(store.done)} of {total} runs are kept in {store.folder}; go on with {going_on}")
            raise
        finally:
            pool.close()  # workers are gone before the rest is written
    store.compact()


def _collect(pool: Pool, missing: list[int], store: Any, total: int, bars: Progress | None, name: str) -> None:
    """Keep rows as they come, and count them on a bar."""
    failed = 0

    def count() -> dict[str, Any]:
        words = f"{name}: {len(store.done)} of {total} runs" + (f", {failed} failed" if failed else "")
        return {"description": words, "completed": len(store.done)}

    bars = bars or Progress(disable=True)
    task = bars.add_task(total=total, **count())
    for row in pool.results(missing):
        store.add(row)
        failed += row["status"] == "failed"
        interruption.check()
        bars.update(task, **count())


def _pool(resolved: Resolved, folder: Path, workers: int | None, scheduler: str | None) -> Pool:
    # Resolved: workers may have another current folder.
    telemetry = str((folder / TELEMETRY).resolve()) if resolved.campaign.telemetry else None
    return LocalPool(resolved, telemetry, workers) if scheduler is None else DaskPool(resolved, telemetry, scheduler)


def _kept_row(folder: Path, row: int) -> dict[str, Any] | None:
    from swarm_mj.campaigns.store import read_results

    try:
        return next((kept for kept in read_results(folder).to_pylist() if kept["row"] == row), None)
    except OutputError:
        return None


def _write_replay(flyer: Flyer, row: int, folder: Path, flown: dict[str, Any]) -> None:
    import yaml

    from swarm_mj.flight.observe import add_coverage
    from swarm_mj.records.run_files import flown_design, write_results

    trial = flyer.sample.trial(row)
    with writing(folder, "choose another folder with --out"):
        folder.mkdir(parents=True, exist_ok=True)
        try:
            scenario = flyer.scenario(trial)
            write_text(folder / "scenario.yaml", yaml.safe_dump(scenario.model_dump(mode="json"), sort_keys=False))
            plan, telemetry, result = flyer.flight(trial)
        except Exception:
            write_text(folder / "error.txt", traceback.format_exc())
            return
        add_coverage(telemetry, result)
        write_results(folder, plan, telemetry, result, flown_design(plan.scenario))
