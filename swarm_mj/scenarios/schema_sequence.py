"""Pictures by a table: when each is taken, by whom, and how long it is exposed."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

from pydantic import BeforeValidator, Field, field_validator

from swarm_mj.errors import ScenarioError
from swarm_mj.io.records import bytes_of, reading
from swarm_mj.io.times import SECOND, epoch_of, tdb_date
from swarm_mj.scenarios.section import Section

#: No encounter has taken more pictures; a table of them is smaller.
MAX_PICTURES, MAX_BYTES = 10_000, 1_000_000
_COLUMNS = ("time", "exposure_s", "spacecraft")


class TimedPicture(Section):
    """One picture of a sequence."""

    time: float | str = Field(
        description="when it is taken: past the epoch [s], or a date as of epoch, in UTC with a trailing Z, else in TDB"
    )
    exposure_s: float | None = Field(None, gt=0, le=1e4, description="[s]; null: camera.exposure_s")
    spacecraft: int | None = Field(None, ge=1, le=1000, description="who takes it, an observer; null: all of them")

    @field_validator("time", mode="before")
    @classmethod
    def _time_is_a_number_or_a_date(cls, value: Any) -> Any:
        return value if isinstance(value, float | int) else tdb_date(value)

    def seconds_after(self, epoch: str) -> float:
        """When it is taken, past an epoch in TDB [s]."""
        return (epoch_of(self.time) - epoch_of(epoch)) / SECOND if isinstance(self.time, str) else self.time


def _listed(given: Any) -> Any:
    """Entries of a sequence, where a time alone stands for a picture."""
    if isinstance(given, str):
        raise ValueError("must be a list of pictures, or the name of a CSV file in a scenario that is read from a file")
    if not isinstance(given, list | tuple):
        return given
    return [one if isinstance(one, Mapping | TimedPicture) else {"time": one} for one in given]


Pictures = Annotated[
    tuple[TimedPicture, ...],
    BeforeValidator(_listed, json_schema_input_type=tuple[TimedPicture | float | str, ...] | str),
]


def read_sequence(path: str) -> list[dict[str, Any]]:
    """Pictures of a CSV file with the columns time, and maybe exposure_s and spacecraft, as a scenario gives them.

    Raises:
        ScenarioError: It cannot be read, or is no such table; the message names the line.
    """
    key = f"observation.sequence = {path}"
    with reading(Path(path), "give a CSV file with the column time", ScenarioError):
        text = bytes_of(Path(path), MAX_BYTES).decode("utf-8-sig")
    rows = csv.DictReader(text.splitlines(), skipinitialspace=True)
    columns = [name.strip() for name in rows.fieldnames or ()]
    if "time" not in columns or not set(columns) <= set(_COLUMNS) or len(set(columns)) < len(columns):
        raise ScenarioError(
            f"{key}: has the columns {', '.join(columns)[:200] or 'none'}; must be time, and maybe exposure_s and spacecraft"
        )
    rows.fieldnames = columns
    pictures = []
    for row in rows:
        where = f"{key}: line {rows.line_num}"
        if None in row or None in row.values():
            raise ScenarioError(f"{where}: must have {len(columns)} values, separated by commas")
        pictures.append({name: _value(value.strip(), f"{where}, {name}", name) for name, value in row.items()})
    if not pictures:
        raise ScenarioError(f"{key}: has no pictures")
    return pictures


def _value(text: str, where: str, name: str) -> Any:
    if name != "time" and not text:
        return None
    try:
        return int(text) if name == "spacecraft" else float(text)
    except ValueError:
        if name == "time":
            return text
        wanted = "a whole number" if name == "spacecraft" else "a number of seconds"
        raise ScenarioError(f"{where} = {text[:40]!r}: must be {wanted}, or empty") from None
