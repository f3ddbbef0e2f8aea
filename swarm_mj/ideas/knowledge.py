"""The knowledge base: every study with its inputs, version and results, in one SQLite file.

A study stands under the digest of what it was asked and of the version that answered. Writing is one transaction: two processes
may write at once, and what is killed leaves either all of a study or nothing.
"""

from __future__ import annotations

import hashlib
import json
import sqlite3
from collections.abc import Iterator
from contextlib import closing, contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import yaml

from swarm_mj import __version__
from swarm_mj.designer.candidates.kept_flights import files_in
from swarm_mj.errors import OutputError
from swarm_mj.ideas.chain import Campaign, Known, Said, Study, run_study
from swarm_mj.ideas.requirement import Requirement
from swarm_mj.ideas.spacecraft import closeness
from swarm_mj.scenarios.loading import load_scenario

#: How unlike a study that another one begins with may be: the logarithm of the largest ratio of what is asked.
NEAR = np.log(2.0)
#: Steps in which the nearest requirement is looked for, and by what factor each is coarser than the one before.
NEAREST, COARSER = 8, 1.25
#: How long a writer waits for another one [s].
PATIENCE_S = 60.0
_TABLE = """CREATE TABLE IF NOT EXISTS studies (
    id TEXT PRIMARY KEY, name TEXT, made TEXT, version TEXT, requirement TEXT, record TEXT, took TEXT, wall_s REAL)"""
_COLUMNS = "id, name, made, version, requirement, record, took, wall_s"


class Kept(NamedTuple):
    """A study that is kept.

    Attributes:
        id: Digest of its inputs and version.
        name: The requirement's.
        made: When, UTC.
        version: Of swarm_mj.
        requirement: What was asked.
        record: What came out, see `record_of`.
        took: Study with whose swarm and bounds it began; empty: none.
        wall_s: How long it took [s].
    """

    id: str
    name: str
    made: str
    version: str
    requirement: Requirement
    record: dict[str, Any]
    took: str
    wall_s: float


def identity(asked: Requirement) -> str:
    """Digest of a requirement, the scenario that it names as it stands now with the files that it names, and the version."""
    scenario = load_scenario(asked.scenario, asked.scenario_changes).model_dump(mode="json")
    files = [hashlib.sha256(path.read_bytes()).hexdigest() for path in files_in(scenario)]
    words = json.dumps([asked.model_dump(mode="json"), scenario, files, __version__], sort_keys=True)
    return hashlib.sha256(words.encode()).hexdigest()[:12]


def record_of(study: Study) -> dict[str, Any]:
    """What a study came to, as plain data that the same inputs give again to the last bit."""
    one = study.spacecraft
    sized = None
    if one is not None:
        payload = one.payload
        sized = {
            "kind": one.name,
            "size_m": list(one.size.size_m),
            "panels": one.panels,
            "mass_kg": one.mass_kg,
            "volume_u": one.volume_u,
            "power_w": one.power_w,
            "panels_give_w": one.available_w,
            "propellant_kg": one.propellant_kg,
            "sent_within_h_as_sized": one.send_h,
            "camera": {
                "aperture_m": payload.aperture_m,
                "focal_length_m": payload.focal_m,
                "f_number": payload.focal_m / payload.aperture_m,
                "length_m": payload.length_m,
                "pixel_rad": payload.pixel_rad,
                "half_angle_deg": payload.half_angle_deg,
                "exposure_s": payload.exposure_s,
                "signal_to_noise": payload.snr,
            },
            "parts": [row._asdict() for row in one.rows],
            "modes": [mode._asdict() for mode in one.modes],
        }
    return {
        "closed": study.closed,
        "observers": study.observers,
        "spacecraft_count": study.spacecraft_count,
        "swarm_kg": study.spacecraft_count * one.mass_kg if one is not None else None,
        "taken": study.taken,
        "spacecraft": sized,
        "checks": [check._asdict() for check in study.checks],
        "forbids": study.forbids,
        "relaxed": list(study.relaxed),
        "least_kg": min((one.least_kg for one in study.tried if one.least_kg is not None), default=None),
        "drivers": [one._asdict() for one in study.drivers],
        "sobol": [one._asdict() for one in study.sobol],
        "sobol_unbuilt": study.unbuilt,
        "alternatives": [one._asdict() for one in study.alternatives],
        "tried": [{**one._asdict(), "short": one.short if np.isfinite(one.short) else None} for one in study.tried],
        "scenario": None if study.scenario is None else study.scenario.model_dump(mode="json"),
    }


class KnowledgeBase:
    """Studies in a file.

    Args:
        path: Of the file.
        make: Whether it is made where there is none.

    Raises:
        OutputError: It cannot be opened, or is no knowledge base.
    """

    def __init__(self, path: str | Path, *, make: bool = True) -> None:
        self.path = Path(path)
        if not make and not self.path.is_file():
            raise OutputError(
                f"{self.path}: there is no such knowledge base; studies make one, --base FILE names another"
            )
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise OutputError(f"{self.path}: the knowledge base cannot be made: {error}") from None
        with self._connected() as connection:
            connection.execute(_TABLE)

    @contextmanager
    def _connected(self) -> Iterator[sqlite3.Connection]:
        """A connection whose changes are one transaction."""
        try:
            with closing(sqlite3.connect(self.path, timeout=PATIENCE_S)) as connection, connection:
                yield connection
        except sqlite3.Error as error:
            raise OutputError(f"{self.path}: the knowledge base cannot be used: {error}") from None

    def kept(self) -> list[Kept]:
        """All studies, the oldest first."""
        with self._connected() as connection:
            rows = connection.execute(f"SELECT {_COLUMNS} FROM studies ORDER BY made, id").fetchall()
        found = []
        for key, name, made, version, requirement, record, took, wall_s in rows:
            asked = Requirement.model_validate_json(requirement)
            found.append(Kept(key, name, made, version, asked, json.loads(record), took, wall_s))
        return found

    def find(self, name: str) -> Kept:
        """The study of an id, or its beginning, or a name, of which the latest counts.

        Raises:
            OutputError: There is none, or ids of several begin so.
        """
        kept = self.kept()
        found = [one for one in kept if one.id.startswith(name)] or [one for one in kept if one.name == name][-1:]
        if len(found) == 1:
            return found[0]
        known = ", ".join(f"{one.id} ({one.name})" for one in kept) or "none"
        what = "there is no such study" if not found else "several begin so"
        raise OutputError(f"{name}: {what} in {self.path}; it holds {known}")

    def nearest(self, asked: Requirement) -> Kept | None:
        """The closed study that is most like a requirement, and not that of itself; None: none is alike.

        Of a scenario that stands otherwise by now, or by another version, none is.
        """
        own = identity(asked)
        found = [
            (closeness(asked, one.requirement), one) for one in self.kept() if one.record["closed"] and one.id != own
        ]
        near = sorted((pair for pair in found if pair[0] <= NEAR), key=lambda pair: pair[0])
        return next((one for _, one in near if identity(one.requirement) == one.id), None)

    def keep(self, asked: Requirement, record: dict[str, Any], took: str, wall_s: float) -> Kept:
        """Keep a study, in the place of one of the same inputs."""
        made = datetime.now(UTC).isoformat(timespec="seconds")
        one = Kept(identity(asked), asked.name, made, __version__, asked, record, took, wall_s)
        values = (*one[:4], asked.model_dump_json(), json.dumps(record), took, wall_s)
        with self._connected() as connection:
            connection.execute(f"INSERT OR REPLACE INTO studies ({_COLUMNS}) VALUES (?, ?, ?, ?, ?, ?, ?, ?)", values)
        return one


def known_from(kept: Kept | None) -> Known | None:
    """What a kept study tells one that is like it."""
    if kept is None:
        return None
    record, design = kept.record, kept.record["scenario"]["design"]
    counts = {one["kind"]: int(one["proven"]) for one in record["tried"] if one["proven"]}
    swarm = {key: design[key] for key in ("visiting_points", "observers")}
    return Known(kept.requirement, record["spacecraft"]["kind"], counts, swarm)


def study(
    asked: Requirement,
    base: KnowledgeBase,
    *,
    campaign: Campaign | None = None,
    workers: int | None = None,
    say: Said | None = None,
) -> tuple[Study, Kept]:
    """Carry a requirement through the chain, beginning with what a study like it found, and keep what comes out.

    Raises:
        ScenarioError: The scenario cannot be flown.
        OutputError: The result cannot be kept.
    """
    like = base.nearest(asked)
    if like is not None and say is not None:
        say(f"begins with what the study {like.id} ({like.name}) found")
    found = run_study(asked, known=known_from(like), campaign=campaign, workers=workers, say=say)
    return found, base.keep(asked, record_of(found), "" if like is None else like.id, found.wall_s)


def easier_than(found: Kept) -> Iterator[Requirement]:
    """Requirements among which the nearest one that a swarm meets is looked for, where none meets a study's, in their order."""
    asked, ways = found.requirement, found.record["relaxed"]
    way = next((way for way in ways if "resolution_m" in way), ways[0] if ways else {})
    easier = asked.eased(way or {"resolution_m": COARSER * asked.resolution_m})
    easier = easier.model_copy(update={"sobol": 0, "nearest": False})
    for _ in range(NEAREST):
        yield easier.model_copy(update={"name": f"{asked.name}, {easier.resolution_m:.4g} m"})
        easier = easier.with_value("resolution_m", COARSER * easier.resolution_m)


def nearest(
    found: Kept,
    base: KnowledgeBase,
    *,
    workers: int | None = None,
    say: Said | None = None,
    **also: Any,
) -> tuple[Study, Kept] | None:
    """The study of the nearest requirement that a swarm meets, where none meets one; None: none was found in `NEAREST` steps.

    Each step is a study of its own, which is kept.
    """
    for easier in easier_than(found):
        step, kept = study(easier, base, workers=workers, say=say, **also)
        if kept.record["closed"]:
            return step, kept
    return None


def nearest_kept(found: Kept, base: KnowledgeBase) -> Kept | None:
    """The same where it is kept already; None: none is, or the study did not look for one."""
    if found.record["closed"] or not found.requirement.nearest:
        return None
    steps = {identity(easier) for easier in easier_than(found)}
    return next((one for one in base.kept() if one.id in steps and one.record["closed"]), None)


#: By which of their keys rows of a record are told apart.
NAMED_BY = ("name", "requirement", "kind", "key")


def _by_name(rows: Any) -> Any:
    """Rows that are told apart by a name, by that; anything else as it is."""
    if not isinstance(rows, list) or not rows or not all(isinstance(row, dict) for row in rows):
        return rows
    key = next((key for key in NAMED_BY if all(key in row for row in rows)), None)
    named = {str(row[key]): row for row in rows} if key else {}
    return named if len(named) == len(rows) else rows


def differences(one: Any, other: Any, key: str = "") -> list[tuple[str, Any, Any]]:
    """Where two records differ: key, value of the one, value of the other."""
    if isinstance(one, list) and isinstance(other, list):
        named = _by_name(one), _by_name(other)
        if all(isinstance(each, dict) for each in named):
            one, other = named
    if isinstance(one, dict) and isinstance(other, dict):
        keys = [*one, *(name for name in other if name not in one)]
        return [
            row
            for name in keys
            for row in differences(one.get(name), other.get(name), f"{key}.{name}" if key else name)
        ]
    if isinstance(one, list) and isinstance(other, list) and len(one) == len(other):
        pairs = enumerate(zip(one, other, strict=True))
        return [row for k, (a, b) in pairs for row in differences(a, b, f"{key}.{k}")]
    if isinstance(one, dict) != isinstance(other, dict):
        # Where one of them has a whole section more, its values say so.
        both = (one, {}) if isinstance(one, dict) else ({}, other)
        return differences(*both, key) or [(key, one, other)]
    return [] if one == other else [(key, one, other)]


def rerun(
    base: KnowledgeBase,
    name: str,
    *,
    campaign: Campaign | None = None,
    workers: int | None = None,
    say: Said | None = None,
) -> tuple[Kept, list[tuple[str, Any, Any]]]:
    """Run a study anew, with what it took from another one; where it differs from what was kept, which stays as it is.

    Raises:
        OutputError: There is no such study, or the one that it began with is not there any more.
    """
    kept = base.find(name)
    like = known_from(base.find(kept.took)) if kept.took else None
    found = run_study(kept.requirement, known=like, campaign=campaign, workers=workers, say=say)
    again = json.loads(json.dumps(record_of(found)))
    return kept, differences(kept.record, again)


def scenario_text(kept: Kept) -> str:
    """The scenario that flies a study's swarm, as YAML."""
    return yaml.safe_dump(kept.record["scenario"], sort_keys=False)
