"""The command `campaign`: fly what is missing, keep every result as it comes, then sum up."""

from __future__ import annotations

import json
import traceback
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import Progress, TaskID

from swarm_mj.cache import hash_of
from swarm_mj.campaign.flying import Flyer
from swarm_mj.campaign.loading import MANIFEST, Resolved
from swarm_mj.campaign.lock import LOCK, only_one
from swarm_mj.campaign.pools import LocalPool, Pool
from swarm_mj.campaign.sampling import Sample
from swarm_mj.errors import OutputError, ScenarioError
from swarm_mj.output.folder import write_text
from swarm_mj.output.summary import library_versions
from swarm_mj.progress import progress_bars

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

    Raises:
        SwarmError: The campaign cannot be flown or written; every finished run is kept.
        KeyboardInterrupt: It was interrupted; likewise.
    """
    _require_parquet()
    from swarm_mj.campaign.store import Store, read_results
    from swarm_mj.campaign.summary import sobol_remarks, summary_table, write_summary
    from swarm_mj.campaign.table import schema_of

    console = Console()
    with only_one(folder):
        _take_over(resolved, folder, resume)
        store = Store(folder, schema_of(resolved.campaign))
        for name in store.torn:
            console.print(f"{folder / name}: was damaged; its runs are flown again", soft_wrap=True, highlight=False)
        _print_observers(console, resolved)
        telemetry = _telemetry_folder(resolved, folder)
        try:
            _fly_missing(resolved, store, console, telemetry, workers=workers, scheduler=scheduler, quiet=quiet)
        finally:
            store.close()
        results = read_results(folder, store.schema)
        summary = write_summary(folder, resolved, results)
        if figures:
            from swarm_mj.campaign.figures import draw_all

            draw_all(folder, resolved, results, summary)
    console.print(summary_table(summary))
    for remark in sobol_remarks(summary):
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
    """
    _require_parquet()
    from swarm_mj.campaign.table import WALL, schema_of, table_of

    flyer, console = Flyer(resolved), Console(quiet=quiet)
    if not 0 <= row < flyer.sample.rows:
        raise ScenarioError(f"--replay {row}: must be a row of this campaign, 0 to {flyer.sample.rows - 1}")
    trial = flyer.sample.trial(row)
    flown = table_of([flyer.fly(row)], schema_of(resolved.campaign)).to_pylist()[0]
    _write_replay(flyer, row, folder / "replays" / str(row), flown)
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


def _take_over(resolved: Resolved, folder: Path, resume: bool) -> None:
    """Start a campaign in an empty folder, or check that the one there is this one."""
    manifest = folder / MANIFEST
    ours = {"campaign": resolved.campaign.name, **_fingerprint(resolved), **resolved.dump()}
    if not manifest.exists():
        # The shape of a campaign's name is checked, so what else stands here was put here by somebody else.
        foreign = [p.name for p in folder.iterdir() if p.name not in (LOCK, f".{MANIFEST}.partial", "replays")]
        if foreign:
            raise OutputError(f"{folder}: holds {foreign[0]} and no campaign; choose another folder with --out")
        try:
            write_text(manifest, json.dumps(ours, indent=2) + "\n")
        except OSError as error:
            raise OutputError(f"{folder}: cannot be written ({error.strerror})") from None
        return
    if not resume:
        raise OutputError(
            f"{folder}: holds a campaign already; go on with --resume, or choose another folder with --out"
        )
    _require_same(_read_manifest(manifest), ours, folder)


def _fingerprint(resolved: Resolved) -> dict[str, Any]:
    return {"fingerprint": hash_of(resolved.dumps()), "versions": library_versions()}


def _read_manifest(path: Path) -> dict[str, Any]:
    try:
        manifest = json.loads(path.read_text("utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise OutputError(f"{path}: cannot be read ({error}); choose another folder with --out") from None
    if not isinstance(manifest, dict) or "fingerprint" not in manifest:
        raise OutputError(f"{path}: describes no campaign; choose another folder with --out")
    return manifest


def _require_same(theirs: dict[str, Any], ours: dict[str, Any], folder: Path) -> None:
    then, now = _without_descriptions(theirs), _without_descriptions(ours)
    changed = [
        f"{path} = {after!r}, was {before!r}"
        for section in ("campaign", "bases", "shapes", "versions")
        for path, before, after in _differences(then.get(section), now[section], section)
    ]
    if changed:
        more = f" and {len(changed) - 5} more" if len(changed) > 5 else ""
        raise OutputError(
            f"{folder}: --resume: the campaign or the program has changed since it began: {'; '.join(changed[:5])}{more}. "
            "Rows of both would not belong together: change it back, or choose another folder with --out"
        )


def _without_descriptions(manifest: dict[str, Any]) -> dict[str, Any]:
    """A manifest without the words for its reader, on which no row depends: of the campaign, of its scenarios and in `set`."""

    def plain(value: Any) -> Any:
        return {k: v for k, v in value.items() if k != "description"} if isinstance(value, dict) else value

    def settled(value: Any) -> Any:
        return {**plain(value), "set": plain(value.get("set"))} if isinstance(value, dict) else value

    campaign, bases = settled(manifest.get("campaign")), manifest.get("bases")
    if isinstance(campaign, dict) and isinstance(campaign.get("scenarios"), list):
        campaign["scenarios"] = [settled(base) for base in campaign["scenarios"]]
    if isinstance(bases, dict):
        bases = {name: plain(base) for name, base in bases.items()}
    return {**manifest, "campaign": campaign, "bases": bases}


def _differences(then: Any, now: Any, path: str) -> list[tuple[str, Any, Any]]:
    if isinstance(then, dict) and isinstance(now, dict):
        return [
            found
            for key in dict.fromkeys((*then, *now))
            for found in _differences(then.get(key), now.get(key), f"{path}.{key}")
        ]
    return [] if then == now else [(path, then, now)]


def _telemetry_folder(resolved: Resolved, folder: Path) -> str | None:
    if not resolved.campaign.telemetry:
        return None
    (folder / TELEMETRY).mkdir(exist_ok=True)
    return str((folder / TELEMETRY).resolve())  # workers may have another current folder


def _fly_missing(
    resolved: Resolved,
    store: Any,
    console: Console,
    telemetry: str | None,
    *,
    workers: int | None,
    scheduler: str | None,
    quiet: bool,
) -> None:
    total = Sample(resolved.campaign).rows
    missing = [row for row in range(total) if row not in store.done]
    if not missing:
        store.compact()
        return
    with progress_bars(console, quiet) as bars:
        task = bars.add_task(
            _label(resolved, total - len(missing), total, 0), total=total, completed=total - len(missing)
        )
        pool = _pool(resolved, telemetry, workers, scheduler)
        try:
            _collect(pool, missing, store, bars, task, resolved, total)
        except KeyboardInterrupt:
            console.print(
                f"{resolved.campaign.name}: {len(store.done)} of {total} runs are kept in {store.folder}; go on with --resume",
                soft_wrap=True,
                highlight=False,
            )
            raise
        finally:
            pool.close()
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


def _pool(resolved: Resolved, telemetry: str | None, workers: int | None, scheduler: str | None) -> Pool:
    if scheduler is None:
        return LocalPool(resolved, telemetry, workers)
    from swarm_mj.campaign.dask_pool import DaskPool

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
    from swarm_mj.campaign.store import read_results

    try:
        found = [kept for kept in read_results(folder).to_pylist() if kept["row"] == row]
    except OutputError:
        return None
    return found[0] if found else None


def _write_replay(flyer: Flyer, row: int, folder: Path, flown: dict[str, Any]) -> None:
    import yaml

    from swarm_mj.flight import add_coverage
    from swarm_mj.output.results import write_results

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
        write_results(folder, plan, telemetry, result)
    except OSError as error:
        raise OutputError(f"{folder}: cannot be written ({error.strerror})") from None
