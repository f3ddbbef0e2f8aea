"""Results on disk that survive a crash: a journal while the campaign flies, one Parquet file at the end.

    campaign.json      what is flown, written by who starts the campaign
    journal.jsonl      finished rows as they come; each line carries the campaign's mark and its own checksum
    results.parquet    all rows, sorted, with the mark, at the end; the journal is then removed

A row is in the operating system's hands before the next one is asked for, so that no death of a process loses it, and on the
disk every few seconds. A crash between two steps leaves a row in both places at most, and reading takes each row once. A file
that is torn is set aside, a line that is torn is left out, and their rows are flown again. Whole rows of another campaign are
refused; the mark tells them.

The columns are `row`, `run`, `scenario`, `seed`; the drawn parameters by dotted key; `status`, `error`, `covered`,
`spacecraft`; what is recorded; `events`; and last `wall_s`, the only one that differs when a run is flown again.
"""

from __future__ import annotations

import json
import os
import time
import zlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, Any, Literal

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
from pydantic import NonNegativeInt

from swarm_mj.campaigns.config import Campaign
from swarm_mj.campaigns.distributions import Bernoulli, Choice, Integer
from swarm_mj.campaigns.flying import recorded
from swarm_mj.campaigns.manifest import campaign_in, mark_in
from swarm_mj.errors import OutputError
from swarm_mj.io.arrays import MAX_BYTES
from swarm_mj.io.atomic import replacing
from swarm_mj.io.interruption import held
from swarm_mj.io.records import MAX_RECORD_BYTES, Record, one_line, reading, record_from, require_file, writing

#: The column that is not the same when a run is flown again.
WALL = "wall_s"
RESULTS, JOURNAL = "results.parquet", "journal.jsonl"

#: A journal of more bytes is none.
MAX_JOURNAL_BYTES = 4 * MAX_BYTES
#: Where the metadata of a schema keep the mark.
MARK = b"campaign"

#: The journal is on the disk after this time [s], whatever happens to the machine.
SYNC_S = 2.0

#: Types that columns have, see `schema_of`.
_TYPES = (pa.int64(), pa.float64(), pa.bool_(), pa.string())

Row = dict[str, Any]

_KEPT = "every finished run is kept: make room, then go on with --resume"
_FOREIGN = "move it elsewhere, or choose another folder with --out"


class JournalRow(Record):
    """What every row of the journal says; its other columns are the campaign's."""

    row: NonNegativeInt
    run: NonNegativeInt
    scenario: str
    seed: int
    status: Literal["ok", "failed"]


class Store:
    """The results of a campaign in its folder, for the one process that writes them; open it under the folder's lock.

    Args:
        folder: The campaign's folder.
        schema: Columns, with the mark.
        rows: How many the campaign has.

    Raises:
        OutputError: The folder cannot be read or written, or holds rows of another campaign, or beyond its own.
    """

    def __init__(self, folder: Path, schema: pa.Schema, rows: int) -> None:
        self.folder, self.schema, self.rows = folder, schema, rows
        self.torn: list[str] = []
        with writing(self.folder, _KEPT):
            for left in folder.glob(".*.partial"):
                if not left.is_dir():
                    left.unlink()
            self.done = self._rows_of_results()
            self._recover()
            if odd := [row for row in self.done if row is None or not 0 <= row < rows]:
                raise OutputError(
                    f"{folder}: holds row {odd[0]}; this campaign has rows 0 to {rows - 1} alone; {_FOREIGN}"
                )
            # A link is not followed: what it names belongs to somebody else.
            flags = os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW
            self._journal = os.open(folder / JOURNAL, flags, 0o644)
        self._synced = time.monotonic()

    def add(self, row: Row) -> None:
        """Keep a row; a row that is there already is not counted again.

        Raises:
            OutputError: It cannot be written, as on a full disk; all earlier rows are kept.
        """
        if row["row"] in self.done:
            return
        with writing(self.folder, _KEPT), held():
            end = os.fstat(self._journal).st_size
            try:
                _write_all(self._journal, _line(row, self.schema))
            except OSError:
                os.ftruncate(self._journal, end)
                raise
            self.done.add(row["row"])
            if time.monotonic() - self._synced > SYNC_S:
                os.fsync(self._journal)
                self._synced = time.monotonic()

    def compact(self) -> None:
        """Put all rows into one file, sorted."""
        with writing(self.folder, _KEPT):
            if os.fstat(self._journal).st_size:
                _write_parquet(self.folder / RESULTS, read_results(self.folder, self.schema))
                os.ftruncate(self._journal, 0)

    def close(self) -> None:
        """Let go of the journal, which is removed where it is empty."""
        if os.fstat(self._journal).st_size == 0:
            with suppress(OSError):
                (self.folder / JOURNAL).unlink()
        os.close(self._journal)

    def _rows_of_results(self) -> set[int]:
        path = self.folder / RESULTS
        try:
            table = _read_parquet(path)
        except FileNotFoundError:
            return set()
        except (pa.ArrowException, ValueError, OSError):
            path.rename(path.with_name(f"{path.name}.torn"))
            self.torn.append(path.name)
            return set()
        _require_ours(table, self.schema, path)
        return set(table["row"].to_pylist())

    def _recover(self) -> None:
        """Take over what an interrupted campaign left in the journal, without lines that are damaged."""
        journal = self.folder / JOURNAL
        rows, damaged = read_journal(journal, self.schema)
        self.done |= {row["row"] for row in rows}
        if damaged:
            self.torn.append(f"{JOURNAL} ({damaged} line{'s' if damaged > 1 else ''})")
            with _replaced(journal) as file:
                file.write(b"".join(_line(row, self.schema) for row in rows))


def read_results(folder: str | os.PathLike[str], schema: pa.Schema | None = None) -> pa.Table:
    """All finished rows of a campaign, sorted by row, each once; also while it runs, from any process.

    Args:
        folder: The campaign's folder.
        schema: Columns, with the mark; default: those of the campaign in the folder.

    Raises:
        OutputError: There are none, a file is torn, or holds rows of another campaign.
    """
    folder = Path(folder)
    schema = schema_in(folder) if schema is None else schema
    tables: list[pa.Table] = []
    # Whoever writes moves rows from the journal to the results: read in that order, nothing is missed.
    journal, _ = read_journal(folder / JOURNAL, schema)
    try:
        tables.append(_read_parquet(folder / RESULTS))
    except FileNotFoundError:
        pass
    except (pa.ArrowException, ValueError, OSError) as error:
        raise OutputError(
            f"{folder / RESULTS}: is torn or no Parquet file ({one_line(error)}); --resume flies its runs again"
        ) from None
    if not (tables or journal):
        raise OutputError(f"{folder}: holds no finished run")
    tables.append(table_of(journal, schema))
    for table in tables:
        _require_ours(table, schema, folder / RESULTS)
    whole = pa.concat_tables(tables).sort_by("row")
    numbers = whole["row"].to_pylist()
    first = [k for k, number in enumerate(numbers) if k == 0 or number != numbers[k - 1]]
    return whole.take(first).combine_chunks()


def _require_ours(table: pa.Table, schema: pa.Schema, path: Path) -> None:
    if not table.schema.equals(schema) or _mark(table.schema) != _mark(schema):
        raise OutputError(f"{path}: its {table.num_rows} rows are of another campaign; {_FOREIGN}")


def read_journal(path: Path, schema: pa.Schema) -> tuple[list[Row], int]:
    """Rows of a journal, and how many of its lines are damaged.

    Raises:
        OutputError: It cannot be read, or a line is whole and of another campaign.
    """
    if not os.path.lexists(path):
        return [], 0
    with reading(path, "remove it"):
        require_file(path, MAX_JOURNAL_BYTES)
        with path.open("rb") as file:
            lines = list(iter(lambda: file.readline(MAX_RECORD_BYTES), b""))
    rows = [row for number, line in enumerate(lines, 1) if (row := _parse(line, schema, path, number)) is not None]
    return rows, len(lines) - len(rows)


def _line(row: Row, schema: pa.Schema) -> bytes:
    text = b"%s %s" % (_mark(schema), json.dumps(row, allow_nan=False).encode())
    return b"%08x %s\n" % (zlib.crc32(text), text)


def _parse(line: bytes, schema: pa.Schema, path: Path, number: int) -> Row | None:
    text = line[9:-1]
    if not line.endswith(b"\n") or line[:9] != b"%08x " % zlib.crc32(text):
        return None
    mark, _, values = text.partition(b" ")
    if mark != _mark(schema):
        raise OutputError(f"{path}: line {number} is of another campaign; {_FOREIGN}")
    try:
        row: Row = record_from(values, JournalRow)
        table_of([row], schema)
    except (ValueError, TypeError):  # the second: Arrow's where a value is of another kind than its column
        return None
    return row


def _mark(schema: pa.Schema) -> bytes:
    return dict(schema.metadata or {}).get(MARK, b"")


def _write_all(handle: int, data: bytes) -> None:
    while data:
        data = data[os.write(handle, data) :]


def _write_parquet(path: Path, table: pa.Table) -> None:
    with _replaced(path) as file:
        pq.write_table(table, file, write_page_checksum=True)


@contextmanager
def _replaced(path: Path) -> Iterator[IO[bytes]]:
    """A file that takes the place of another one when it is written and on the disk."""
    with replacing(path) as partial, partial.open("wb") as file:
        yield file
        file.flush()
        os.fsync(file.fileno())
    folder = os.open(path.parent, os.O_RDONLY)
    try:
        os.fsync(folder)
    finally:
        os.close(folder)


def _read_parquet(path: Path) -> pa.Table:
    """The rows of a file that may be damaged or hostile; an ArrowException, ValueError or OSError where it is.

    Text stays packed, each different one kept once, until it is known how much all of it takes.
    """
    if not os.path.lexists(path):
        raise FileNotFoundError(path)
    require_file(path, MAX_BYTES)
    with pq.ParquetFile(path) as file:
        schema, rows = file.schema_arrow, file.metadata.num_rows
    odd = next((field for field in schema if field.type not in _TYPES), None)
    if odd is not None:
        raise pa.ArrowInvalid(f"{odd.name} is of type {odd.type}, must be one of {', '.join(map(str, _TYPES))}")
    _check_bytes(8 * rows * len(schema.names))
    text = [field.name for field in schema if field.type == pa.string()]
    packed = pq.read_table(path, page_checksum_verification=True, memory_map=False, read_dictionary=text)
    _check_bytes(packed.nbytes + sum(_text_bytes(packed[name]) for name in text))
    return packed.cast(schema)


def _check_bytes(size: int) -> None:
    if size > MAX_BYTES:
        raise pa.ArrowInvalid(f"its rows would take more than {MAX_BYTES} bytes (MAX_BYTES)")


def _text_bytes(column: pa.ChunkedArray) -> int:
    """What the texts of a packed column take when each is written out [bytes]."""
    return sum(pc.sum(pc.binary_length(part.dictionary).take(part.indices)).as_py() or 0 for part in column.chunks)


def schema_in(folder: Path) -> pa.Schema:
    """Columns of the campaign in a folder, with its mark."""
    return schema_of(campaign_in(folder)).with_metadata({MARK: mark_in(folder)})


def schema_of(campaign: Campaign) -> pa.Schema:
    """Names and types of the columns."""
    fields = [("row", pa.int64()), ("run", pa.int64()), ("scenario", pa.string()), ("seed", pa.int64())]
    fields += [(key, _type_of(law)) for key, law in campaign.parameters.items()]
    fields += [("status", pa.string()), ("error", pa.string()), ("covered", pa.bool_()), ("spacecraft", pa.int64())]
    fields += [(column, pa.float64()) for column in recorded(campaign)]
    fields += [("events", pa.string()), (WALL, pa.float64())]
    return pa.schema(fields)


def table_of(rows: Sequence[dict[str, Any]], schema: pa.Schema) -> pa.Table:
    """Rows as a table; what a row lacks is null."""
    columns = [pa.array([_cell(row.get(f.name), f.type) for row in rows], f.type) for f in schema]
    return pa.Table.from_arrays(columns, schema=schema)


def _type_of(law: Any) -> pa.DataType:
    if isinstance(law, Bernoulli):
        return pa.bool_()
    if isinstance(law, Integer):
        return pa.int64()
    if isinstance(law, Choice):
        kinds = {type(value) for value in law.values}
        if kinds == {bool}:
            return pa.bool_()
        if kinds == {int}:
            return pa.int64()
        return pa.float64() if kinds <= {int, float} else pa.string()
    return pa.float64()


def _cell(value: Any, kind: pa.DataType) -> Any:
    if value is not None and kind == pa.string() and not isinstance(value, str):
        return json.dumps(value, sort_keys=True)
    return value
