"""Results on disk survive crashes, torn files and full disks; no row is lost, none is there twice."""

import json
import os
import resource
import shutil
import subprocess
import sys

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from swarm_mj.campaigns.config import Campaign
from swarm_mj.campaigns.manifest import MANIFEST
from swarm_mj.campaigns.store import (
    JOURNAL,
    RESULTS,
    Store,
    _line,
    read_journal,
    read_results,
    schema_in,
    schema_of,
    table_of,
)
from swarm_mj.errors import OutputError

pytestmark = pytest.mark.robust

CAMPAIGN = Campaign(
    name="c",
    scenarios=("s",),
    parameters={"x": {"distribution": "normal", "mean": 0.0, "std": 1.0}},
    record=("coverage_percent",),
)
SCHEMA = schema_of(CAMPAIGN)
ROWS = 100_000


def row(number, **values):
    plain = {"row": number, "run": number, "scenario": "s", "seed": 2**62 + number, "x": 0.1 * number, "status": "ok"}
    return {**plain, "coverage_percent": 1.0 / (number + 3.0), "events": [], "wall_s": 0.5, **values}


def begun(folder, campaign=CAMPAIGN):
    """A folder with a manifest; its columns with the mark."""
    (folder / MANIFEST).write_text(json.dumps({"campaign": campaign.model_dump(mode="json", by_alias=True)}))
    return schema_in(folder)


def filled(folder, numbers, schema=SCHEMA):
    store = Store(folder, schema, ROWS)
    for number in numbers:
        store.add(row(number))
    return store


def numbers(folder, schema=SCHEMA):
    return read_results(folder, schema)["row"].to_pylist()


def test_rows_are_there_as_soon_as_they_are_added_and_keep_every_bit(tmp_path):
    store = filled(tmp_path, [3, 1])
    store.compact()
    store.add(row(2))
    found = read_results(tmp_path, SCHEMA).to_pylist()
    assert [r["row"] for r in found] == [1, 2, 3]
    assert [r["coverage_percent"] for r in found] == [1.0 / (n + 3.0) for n in (1, 2, 3)]
    assert [r["seed"] for r in found] == [2**62 + n for n in (1, 2, 3)]


def test_rows_that_stand_in_the_journal_alone_are_read_by_anybody(tmp_path):
    schema = begun(tmp_path)
    with pytest.raises(OutputError, match="holds no finished run"):
        read_results(tmp_path)
    store = filled(tmp_path, [2], schema)
    assert read_results(tmp_path).equals(read_results(tmp_path, schema)) and numbers(tmp_path, schema) == [2]
    assert read_results(str(tmp_path)).equals(read_results(tmp_path))
    store.close()


def test_a_store_that_was_never_closed_is_taken_over_whole(tmp_path):
    filled(tmp_path, range(5))
    store = Store(tmp_path, SCHEMA, ROWS)
    assert store.done == set(range(5)) and store.torn == []
    assert numbers(tmp_path) == list(range(5))


def test_compaction_gives_one_sorted_file_and_a_second_one_changes_nothing(tmp_path):
    filled(tmp_path, [4, 0, 3, 1]).compact()
    assert read_journal(tmp_path / JOURNAL, SCHEMA) == ([], 0)
    first = (tmp_path / RESULTS).read_bytes()
    again = Store(tmp_path, SCHEMA, ROWS)
    again.compact()
    assert (tmp_path / RESULTS).read_bytes() == first
    again.add(row(2))
    again.compact()
    assert numbers(tmp_path) == [0, 1, 2, 3, 4]


def test_what_is_empty_at_the_end_is_removed_and_what_holds_rows_stays(tmp_path):
    store = filled(tmp_path, [0, 1])
    store.close()
    assert {p.name for p in tmp_path.iterdir()} == {JOURNAL} and numbers(tmp_path) == [0, 1]
    store = Store(tmp_path, SCHEMA, ROWS)
    store.compact()
    store.close()
    assert {p.name for p in tmp_path.iterdir()} == {RESULTS} and numbers(tmp_path) == [0, 1]


def test_a_row_is_not_counted_twice(tmp_path):
    store = filled(tmp_path, [0, 1, 0])
    store.add(row(1, coverage_percent=9.0))
    found = read_results(tmp_path, SCHEMA)
    assert found["row"].to_pylist() == [0, 1] and 9.0 not in found["coverage_percent"].to_pylist()


def test_a_crash_between_compaction_and_clearing_doubles_nothing(tmp_path):
    store = filled(tmp_path, [0, 1])
    journal = (tmp_path / JOURNAL).read_bytes()
    store.compact()
    (tmp_path / JOURNAL).write_bytes(journal)
    assert numbers(tmp_path) == [0, 1]
    assert Store(tmp_path, SCHEMA, ROWS).done == {0, 1}
    assert numbers(tmp_path) == [0, 1]


@pytest.mark.parametrize("cut", [1, 10, 60])
def test_a_torn_last_line_of_the_journal_costs_only_its_own_row(tmp_path, cut):
    filled(tmp_path, [0, 1, 2])
    with (tmp_path / JOURNAL).open("rb+") as file:
        file.truncate(os.path.getsize(file.name) - cut)
    store = Store(tmp_path, SCHEMA, ROWS)
    assert store.done == {0, 1} and len(store.torn) == 1
    store.add(row(2))
    store.compact()
    assert numbers(tmp_path) == [0, 1, 2]


def test_a_flipped_bit_in_the_journal_costs_only_its_own_row(tmp_path):
    filled(tmp_path, [0, 1, 2])
    lines = (tmp_path / JOURNAL).read_bytes().splitlines(keepends=True)
    lines[1] = lines[1].replace(b"0.25", b"0.75")
    (tmp_path / JOURNAL).write_bytes(b"".join(lines))
    assert Store(tmp_path, SCHEMA, ROWS).done == {0, 2}


@pytest.mark.parametrize(
    "values", [{"coverage_percent": "x"}, {"status": "nonsense"}, {"scenario": None}, {"seed": [1]}]
)
def test_a_line_that_is_whole_and_no_row_of_a_campaign_is_flown_again(tmp_path, values):
    filled(tmp_path, [0]).close()
    with (tmp_path / JOURNAL).open("ab") as file:
        file.write(_line(row(1, **values), SCHEMA))
        file.write(_line({"row": 2}, SCHEMA))
    assert read_journal(tmp_path / JOURNAL, SCHEMA) == ([row(0)], 2)
    assert Store(tmp_path, SCHEMA, ROWS).done == {0}


@pytest.mark.parametrize("damage", ["cut", "emptied", "flipped", "replaced"])
def test_a_torn_file_is_set_aside_and_its_rows_are_missing(tmp_path, damage):
    store = filled(tmp_path, range(20))
    store.compact()
    for number in range(20, 40):
        store.add(row(number))
    file = tmp_path / RESULTS
    data = bytearray(file.read_bytes())
    if damage == "flipped":
        where = data.index(b"PAR1") + 60
        data[where] ^= 0x40
    file.write_bytes({"cut": bytes(data[:-40]), "emptied": b"", "flipped": bytes(data), "replaced": b"hello"}[damage])
    with pytest.raises(OutputError, match="torn"):
        read_results(tmp_path, SCHEMA)
    store = Store(tmp_path, SCHEMA, ROWS)
    assert store.done == set(range(20, 40)) and store.torn == [RESULTS]
    assert file.with_name(f"{RESULTS}.torn").exists()


@pytest.mark.parametrize("compacted", [False, True])
def test_whole_rows_of_another_campaign_are_refused_by_name(tmp_path, compacted):
    other, folder = tmp_path / "other", tmp_path / "ours"
    other.mkdir()
    folder.mkdir()
    store = filled(other, [5, 6], begun(other, CAMPAIGN.model_copy(update={"seed": 1})))
    if compacted:
        store.compact()
    schema, name = begun(folder), RESULTS if compacted else JOURNAL
    ours = b"" if compacted else _line(row(0), schema)
    (folder / name).write_bytes(ours + (other / name).read_bytes())
    words = r"results\.parquet: its 2 rows are" if compacted else r"journal\.jsonl: line 2 is"
    for read in (lambda *of: Store(*of, ROWS), read_results):
        with pytest.raises(OutputError, match=rf"{words} of another campaign; move it elsewhere, or .*--out"):
            read(folder, schema)
    assert (folder / name).read_bytes() == ours + (other / name).read_bytes()


@pytest.mark.parametrize("odd", [3, -1, None])
def test_rows_that_a_campaign_does_not_have_are_refused_and_left_where_they_are(tmp_path, odd):
    pq.write_table(table_of([row(2), {**row(0), "row": odd}], SCHEMA), tmp_path / RESULTS)
    before = (tmp_path / RESULTS).read_bytes()
    with pytest.raises(OutputError, match=f"holds row {odd}; this campaign has rows 0 to 2 alone; move it elsewhere"):
        Store(tmp_path, SCHEMA, 3)
    assert [path.name for path in tmp_path.iterdir()] == [RESULTS]
    assert (tmp_path / RESULTS).read_bytes() == before
    if odd == 3:
        assert Store(tmp_path, SCHEMA, 4).done == {2, 3}


@pytest.mark.parametrize("name", [JOURNAL, RESULTS])
@pytest.mark.parametrize("kind", ["device", "pipe"])
def test_rows_are_read_of_regular_files_alone(tmp_path, name, kind):
    if kind == "pipe":
        os.mkfifo(tmp_path / name)
    else:
        (tmp_path / name).symlink_to("/dev/zero")
    with pytest.raises(OutputError, match=rf"{name}: .*is a.* {kind}, no regular file"):
        read_results(tmp_path, SCHEMA)


def test_a_journal_that_is_a_link_is_not_written_through(tmp_path):
    mine = tmp_path / "mine.txt"
    mine.write_bytes(b"")
    folder = tmp_path / "campaign"
    folder.mkdir()
    (folder / JOURNAL).symlink_to(mine)
    with pytest.raises(OutputError, match="cannot be written"):
        filled(folder, [0])
    assert mine.read_bytes() == b""


def test_what_a_killed_writer_left_half_written_is_cleared(tmp_path):
    filled(tmp_path, [0])
    (tmp_path / ".results.parquet.partial").write_bytes(b"half")
    assert Store(tmp_path, SCHEMA, ROWS).done == {0}
    assert not [p for p in tmp_path.rglob("*.partial")]


FILL = """
import resource, signal, sys
from pathlib import Path
sys.path.insert(0, {tests!r})
from test_store import ROWS, SCHEMA, row
from swarm_mj.campaigns.store import Store
from swarm_mj.errors import OutputError
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
{limit}
store, added = Store(Path({folder!r}), SCHEMA, ROWS), 0
try:
    for number in range(100_000):
        store.add(row(number, events=["x" * 100]))
        added += 1
except OutputError as error:
    print(added, error)
    sys.exit(0)
sys.exit("the disk never filled")
"""


def fill(folder, limit=""):
    code = FILL.format(tests=os.path.dirname(__file__), folder=str(folder), limit=limit)
    # Without -B Python might keep bytecode that is cut off.
    done = subprocess.run([sys.executable, "-B", "-c", code], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    added, _, words = done.stdout.partition(" ")
    return int(added), words


def test_a_file_that_may_not_grow_stops_the_campaign_with_every_added_row_kept(tmp_path):
    added, words = fill(tmp_path, f"resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, {resource.RLIM_INFINITY}))")
    assert "go on with --resume" in words and added > 20
    store = Store(tmp_path, SCHEMA, ROWS)
    assert store.done >= set(range(added)) and store.torn == []


@pytest.mark.skipif(os.geteuid() != 0 or shutil.which("mount") is None, reason="only root can make a small disk")
def test_a_full_disk_stops_the_campaign_with_every_added_row_kept(tmp_path):
    disk = tmp_path / "disk"
    disk.mkdir()
    if subprocess.run(["mount", "-t", "tmpfs", "-o", "size=256k", "tmpfs", disk], capture_output=True).returncode:
        pytest.skip("this root may not mount")
    try:
        added, words = fill(disk)
        assert "No space left on device" in words and added > 20
        roomy = tmp_path / "roomy"
        shutil.copytree(disk, roomy)
        store = Store(roomy, SCHEMA, ROWS)
        assert store.done >= set(range(added)) and store.torn == []
    finally:
        subprocess.run(["umount", disk], check=True)


def bombs():
    """Small files of much: one text of a megabyte in every row, and a column that no campaign has."""
    count = 20_000
    same = pa.DictionaryArray.from_arrays(pa.array([0] * count, pa.int32()), pa.array(["x" * 1_000_000]))
    plain = {f.name: pa.nulls(count, f.type) for f in SCHEMA}
    return {
        "20 GB of text": ({**plain, "error": same}, r"would take more than 4294967296 bytes \(MAX_BYTES\)"),
        "lists": (
            {**plain, "x": pa.array([[0.0]] * count)},
            "x is of type list<.*must be one of int64, double, bool, string",
        ),
    }


@pytest.mark.parametrize("bomb", ["20 GB of text", "lists"])
def test_a_small_file_that_unpacks_to_much_is_refused_in_one_line_before_it_does(tmp_path, bomb):
    columns, words = bombs()[bomb]
    file = tmp_path / RESULTS
    pq.write_table(pa.table(columns), file, store_schema=False)
    assert file.stat().st_size < 1_000_000
    before = pa.default_memory_pool().max_memory()
    with pytest.raises(OutputError, match=words) as told:
        read_results(tmp_path, SCHEMA)
    assert "\n" not in str(told.value) and str(file) in str(told.value)
    assert pa.default_memory_pool().max_memory() < before + 100_000_000


def test_more_rows_than_memory_should_hold_are_refused_before_they_are_read(tmp_path, monkeypatch):
    filled(tmp_path, range(50)).compact()
    monkeypatch.setattr("swarm_mj.campaigns.store.MAX_BYTES", 8 * 50 * len(SCHEMA) - 1)
    monkeypatch.setattr(pq, "read_table", lambda *_, **__: pytest.fail("was read"))
    with pytest.raises(OutputError, match="its rows would take more than"):
        read_results(tmp_path, SCHEMA)


def test_a_file_that_unpacks_to_too_much_is_set_aside_and_its_runs_are_flown_again(tmp_path):
    columns, _ = bombs()["20 GB of text"]
    pq.write_table(pa.table(columns), tmp_path / RESULTS, store_schema=False)
    store = Store(tmp_path, SCHEMA, ROWS)
    assert store.torn == [RESULTS] and store.done == set()
    store.close()
