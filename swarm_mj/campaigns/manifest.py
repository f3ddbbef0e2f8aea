"""What stands in the folder of a campaign: whether it may be flown there, and whether it is the one that began there."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from swarm_mj.campaigns.config import Campaign
from swarm_mj.campaigns.loading import Resolved, load_campaign
from swarm_mj.errors import OutputError
from swarm_mj.io.atomic import write_text
from swarm_mj.io.cache import hash_of
from swarm_mj.io.lock import LOCK
from swarm_mj.io.records import Record, one_line, read_record, writing
from swarm_mj.io.values import shown
from swarm_mj.records.summary import library_versions
from swarm_mj.scenarios.loading import NO_OVERRIDES, ScenarioSource

#: Where a campaign's folder says what it flies: `Resolved.dump` and what it was flown with.
MANIFEST = "campaign.json"
#: Of it, what rows depend on.
_SECTIONS = ("campaign", "bases", "shapes", "versions")
#: Where replayed rows go.
REPLAYS = "replays"
#: What a folder without a campaign may hold: what a campaign that ended before it began leaves, and replays.
_OURS = re.compile(rf"{re.escape(LOCK)}|{REPLAYS}|\.{re.escape(MANIFEST)}\.[0-9a-f]{{8}}\.partial")


def require_place(folder: Path, *, resume: bool = False) -> None:
    """Refuse a folder that is not absent, empty or a campaign's, or with `resume` has no campaign; nothing is written."""
    try:
        names = os.listdir(folder) if folder.exists() else []
        # Asked last: a campaign that begins meanwhile writes its manifest before all else.
        if (folder / MANIFEST).exists():
            return
    except NotADirectoryError:
        raise OutputError(f"{folder}: is a file; --out must name a folder") from None
    except OSError as error:
        raise OutputError(f"{folder}: cannot be read ({error.strerror}); choose another folder with --out") from None
    if resume:
        raise OutputError(f"{folder}: holds no campaign to go on with; start one without --resume")
    foreign = sorted(name for name in names if not _OURS.fullmatch(name))
    if foreign:
        raise OutputError(f"{folder}: holds {foreign[0]} and no campaign; choose another folder with --out")


def take_over(resolved: Resolved, folder: Path, *, resume: bool) -> None:
    """Start a campaign in an empty folder, or check that the one there is this one; under the folder's lock.

    Raises:
        OutputError: The folder holds something else, or cannot be written.
    """
    require_place(folder, resume=resume)
    manifest = folder / MANIFEST
    ours = {**resolved.dump(), "versions": library_versions()}
    if not manifest.exists():
        with writing(folder, "choose another folder with --out"):
            write_text(manifest, json.dumps(ours, indent=2) + "\n")
        return
    if not resume:
        raise OutputError(
            f"{folder}: holds a campaign already; go on with --resume, or choose another folder with --out"
        )
    require_same(_read_manifest(manifest), ours, folder)


def load_campaign_of(
    folder: Path, source: ScenarioSource, overrides: Mapping[str, Any] = NO_OVERRIDES, *, runs: int | None = None
) -> Resolved:
    """A campaign as `load_campaign` reads it, with as many runs as it began with in a folder where `runs` gives no number."""
    resolved = load_campaign(source, overrides, runs=runs)
    kept = resolved.campaign.runs if runs is not None else kept_runs(folder, resolved.campaign)
    return resolved if kept == resolved.campaign.runs else load_campaign(source, overrides, runs=kept)


def kept_runs(folder: Path, campaign: Campaign) -> int:
    """The `runs` with which the campaign of this name and method began in a folder; the campaign's own where there is none."""
    try:
        kept = _read_manifest(folder / MANIFEST)["campaign"]
    except OutputError:
        return campaign.runs
    runs = kept.get("runs")
    same = (kept.get("name"), kept.get("method")) == (campaign.name, campaign.method)
    return runs if same and type(runs) is int else campaign.runs


def campaign_in(folder: Path) -> Campaign:
    """The campaign of a folder, which must describe one."""
    path = folder / MANIFEST
    try:
        return Campaign.model_validate(_read_manifest(path).get("campaign"))
    except ValueError as error:
        raise OutputError(f"{path}: describes no campaign ({one_line(error)})") from None


def mark_in(folder: Path) -> str:
    """By which rows of the campaign in a folder are known: a hash of all that they depend on."""
    manifest = _without_descriptions(_read_manifest(folder / MANIFEST))
    return hash_of(json.dumps([manifest.get(section) for section in _SECTIONS], sort_keys=True))


class Manifest(Record):
    """What a campaign's folder says it flies, campaign.json."""

    campaign: dict[str, Any]
    bases: dict[str, dict[str, Any]] = {}
    shapes: dict[str, str] = {}
    versions: dict[str, str] = {}


def _read_manifest(path: Path) -> dict[str, Any]:
    return dict(read_record(path, Manifest, "choose another folder with --out"))


def require_same(theirs: dict[str, Any], ours: dict[str, Any], folder: Path) -> None:
    """Refuse two manifests that do not describe one campaign, flown by one program; the message names what differs."""
    then, now = _without_descriptions(theirs), _without_descriptions(ours)
    changed = [
        f"{path} = {shown(after)}, was {shown(before)}"
        for section in _SECTIONS
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
