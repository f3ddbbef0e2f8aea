"""The command `campaign`: fly what is missing, keep every result as it comes, then sum up."""

from __future__ import annotations

import traceback
from contextlib import closing
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import Progress, TaskID

from swarm_mj.campaigns.flying import Flyer
from swarm_mj.campaigns.loading import Resolved
from swarm_mj.campaigns.manifest import REPLAYS, require_place, take_over
from swarm_mj.campaigns.pools import LocalPool, Pool
from swarm_mj.campaigns.sampling import Sample
from swarm_mj.errors import OutputError, ScenarioError
from swarm_mj.io.atomic import write_text
from swarm_mj.io.lock import only_one
from swarm_mj.io.progress import progress_bars

TELEMETRY = "telemetry"


def run_campaign(
    resolved: Resolved,
    folder: Path,
    *,
    workers: int | None = None,
    scheduler: str | None = None,
    resume: bool = False,
    quiet: bool = False,
    figures: bool = True,
    going_on: str | None = None,
) -> dict[str, Any]:
    """Fly a campaign into a folder, or go on with one; returns its summary.

    Args:
        resolved: The campaign.
        folder: Where its results stand or will stand.
        workers: Local processes; None takes one per core.
        scheduler: Address of a Dask scheduler whose workers fly instead.
        resume: Go on with the campaign in the folder.
        quiet: No progress bar.
        figures: Whether to draw.
        going_on: The command that goes on with this campaign, which is told when it is interrupted.

    Raises:
        SwarmError: The campaign cannot be flown or written; every finished run is kept.
        KeyboardInterrupt: It was interrupted; likewise.
    """
    _require_parquet()
    from swarm_mj.campaigns.store import Store, read_results
    from swarm_mj.campaigns.summary import sobol_findings, summary_table, write_summary
    from swarm_mj.campaigns.table import schema_of

    console = Console()
    # Both before anything is written, so that what is refused leaves no trace.
    require_place(folder, resume=resume)
    with closing(_pool(resolved, folder, workers, scheduler)) as pool, only_one(folder):
        take_over(resolved, folder, resume=resume)
        store = Store(folder, schema_of(resolved.campaign))
        for name in store.torn:
            console.print(f"{folder / name}: was damaged; its runs are flown again", soft_wrap=True, highlight=False)
        _print_observers(console, resolved)
        try:
            _fly_missing(resolved, store, pool, console, quiet=quiet, going_on=going_on)
        finally:
            store.close()
        results = read_results(folder, store.schema)
        summary = write_summary(folder, resolved, results)
        if figures:
            from swarm_mj.campaigns.figures import draw_all

            draw_all(folder, resolved, results, summary)
    console.print(summary_table(summary))
    for remark in sobol_findings(summary):
        console.print(remark, soft_wrap=True, highlight=False, markup=False)
    _print_failures(console, results.to_pylist())
    console.print(f"{resolved.campaign.name}: files in {folder}", soft_wrap=True, highlight=False)
    return summary


def replay(resolved: Resolved, row: int, folder: Path, *, quiet: bool = False) -> bool:
    """Fly one row again, here and alone, and compare it with what the folder holds of it.

    The flight's scenario, and its telemetry and coverage or the traceback of its failure, go to `folder/replays/ROW`.

    Returns:
        Whether the row is the same, bit for bit; True where there is none to compare with.

    Raises:
        ScenarioError: There is no such row.
        OutputError: The folder holds something else than a campaign, or cannot be written.
    """
    _require_parquet()
    require_place(folder)
    from swarm_mj.campaigns.table import WALL, schema_of, table_of

    flyer, console = Flyer(resolved), Console(quiet=quiet)
    if not 0 <= row < flyer.sample.rows:
        raise ScenarioError(f"--replay {row}: must be a row of this campaign, 0 to {flyer.sample.rows - 1}")
    trial = flyer.sample.trial(row)
    flown = table_of([flyer.fly(row)], schema_of(resolved.campaign)).to_pylist()[0]
    _write_replay(flyer, row, folder / REPLAYS / str(row), flown)
    for name in ("scenario", "seed", *trial.values, "status", "error", "covered", "coverage_percent"):
        if flown.get(name) is not None:
            console.print(f"{name}: {flown[name]}", soft_wrap=True, highlight=False, markup=False)
    kept = _kept_row(folder, row)
    if kept is None:
        console.print(f"{folder} holds no row {row} to compare with", soft_wrap=True, highlight=False)
        return True
    differ = [name for name in flown if name != WALL and flown[name] != kept.get(name)]
    words = f"differs in {', '.join(differ)}" if differ else "is the same, bit for bit"
    console.print(f"row {row} of {folder} {words}", soft_wrap=True, highlight=False, markup=False)
    return not differ


def _require_parquet() -> None:
    try:
        import pyarrow.parquet  # noqa: F401
    except ImportError:
        raise OutputError("campaigns write Parquet: pip install 'swarm_mj[cluster]'") from None


def _fly_missing(
    resolved: Resolved, store: Any, pool: Pool, console: Console, *, quiet: bool, going_on: str | None
) -> None:
    total = Sample(resolved.campaign).rows
    missing = [row for row in range(total) if row not in store.done]
    if not missing:
        store.compact()
        return
    if resolved.campaign.telemetry:
        (store.folder / TELEMETRY).mkdir(exist_ok=True)
    with progress_bars(console, quiet) as bars:
        task = bars.add_task(
            _label(resolved, total - len(missing), total, 0), total=total, completed=total - len(missing)
        )
        try:
            _collect(pool, missing, store, bars, task, resolved, total)
        except KeyboardInterrupt:
            console.print(
                f"{resolved.campaign.name}: {len(store.done)} of {total} runs are kept in {store.folder}; "
                f"go on with {going_on or '--resume'}",
                soft_wrap=True,
                highlight=False,
                markup=False,
            )
            raise
        finally:
            pool.close()  # workers are gone before the rest is written
    store.compact()


def _collect(
    pool: Pool, missing: list[int], store: Any, bars: Progress, task: TaskID, resolved: Resolved, total: int
) -> None:
    failed = 0
    try:
        for row in pool.results(missing):
            store.add(row)
            failed += row["status"] == "failed"
            bars.update(task, completed=len(store.done), description=_label(resolved, len(store.done), total, failed))
    finally:
        store.seal()


def _pool(resolved: Resolved, folder: Path, workers: int | None, scheduler: str | None) -> Pool:
    # Resolved: workers may have another current folder.
    telemetry = str((folder / TELEMETRY).resolve()) if resolved.campaign.telemetry else None
    if scheduler is None:
        return LocalPool(resolved, telemetry, workers)
    from swarm_mj.campaigns.dask_pool import DaskPool

    return DaskPool(resolved, telemetry, scheduler)


def _label(resolved: Resolved, done: int, total: int, failed: int) -> str:
    return f"{resolved.campaign.name}: {done} of {total} runs" + (f", {failed} failed" if failed else "")


def _print_failures(console: Console, rows: list[dict[str, Any]]) -> None:
    failed = [row for row in rows if row["status"] == "failed"]
    for row in failed[:5]:
        console.print(
            f"row {row['row']} ({row['scenario']}, seed {row['seed']}) failed: {row['error']}",
            soft_wrap=True,
            highlight=False,
            markup=False,
        )
    if failed:
        console.print(
            f"{len(failed)} failed; replay one with --replay {failed[0]['row']}", soft_wrap=True, highlight=False
        )


def _print_observers(console: Console, resolved: Resolved) -> None:
    """Say where the campaign's observer differs from the one that its file asks for."""
    if resolved.without_maps:
        console.print(
            f"{', '.join(resolved.without_maps)}: the target's cells differ from run to run, so that each horizon map would "
            "serve one run; observed by compiled face-ID buffers (observation.observer: raster) instead",
            soft_wrap=True,
            highlight=False,
            markup=False,
        )


def _kept_row(folder: Path, row: int) -> dict[str, Any] | None:
    from swarm_mj.campaigns.store import read_results

    try:
        found = [kept for kept in read_results(folder).to_pylist() if kept["row"] == row]
    except OutputError:
        return None
    return found[0] if found else None


def _write_replay(flyer: Flyer, row: int, folder: Path, flown: dict[str, Any]) -> None:
    import yaml

    from swarm_mj.flight.observe import add_coverage
    from swarm_mj.results.run_files import flown_design, write_results

    trial = flyer.sample.trial(row)
    try:
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
    except OSError as error:
        raise OutputError(f"{folder}: cannot be written ({error.strerror})") from None
