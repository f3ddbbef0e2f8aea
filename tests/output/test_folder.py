"""A result folder appears whole or not at all."""

import json
import os
from pathlib import Path

import pytest

from swarm_mj.errors import OutputError
from swarm_mj.output.folder import MARKER, atomic_folder

FIRST, SECOND = (json.dumps({"scenario": name, "versions": {"swarm_mj": "0"}}) for name in ("first", "the second"))


def leftovers(parent):
    return [p.name for p in parent.iterdir() if p.name.startswith(".")]


def test_the_folder_appears_when_all_is_done(tmp_path):
    with atomic_folder(tmp_path / "deep" / "run") as partial:
        (partial / MARKER).write_text(FIRST)
        assert not (tmp_path / "deep" / "run").exists()
    assert (tmp_path / "deep" / "run" / MARKER).read_text() == FIRST
    assert leftovers(tmp_path / "deep") == []


@pytest.mark.parametrize("failure", [ValueError, KeyboardInterrupt])
def test_a_failure_leaves_nothing_and_the_earlier_result_intact(tmp_path, failure):
    run = tmp_path / "run"
    with atomic_folder(run) as partial:
        (partial / MARKER).write_text(FIRST)
    with pytest.raises(failure), atomic_folder(run) as partial:
        (partial / MARKER).write_text(SECOND)
        raise failure
    assert (run / MARKER).read_text() == FIRST
    assert leftovers(tmp_path) == []


def test_an_earlier_result_is_replaced_whole(tmp_path):
    for text in (FIRST, SECOND):
        with atomic_folder(tmp_path / "run") as partial:
            (partial / MARKER).write_text(text)
            (partial / f"{len(text)}.png").touch()
    assert sorted(p.name for p in (tmp_path / "run").iterdir()) == [f"{len(SECOND)}.png", MARKER]
    assert leftovers(tmp_path) == []


def test_a_folder_that_is_no_result_is_never_touched(tmp_path):
    (tmp_path / "thesis.tex").write_text("years of work")
    with pytest.raises(OutputError, match="not an earlier result"), atomic_folder(tmp_path):
        pass
    assert (tmp_path / "thesis.tex").read_text() == "years of work"


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("summary.json", "{}"),
        ("summary.json", '{"scenario": "a"}'),
        ("summary.json", '{"scenario": "a", "versions": null}'),
        ("summary.json", '{"scenario": "a", "versions": 3}'),
        ("summary.json", '{"scenario": "a", "versions": ["swarm_mj"]}'),
        ("thesis.txt", ""),
        ("notes.json", "{}"),
    ],
)
def test_a_folder_that_only_looks_like_a_result_is_not_replaced(tmp_path, name, content):
    run = tmp_path / "run"
    run.mkdir()
    if name != MARKER:
        (run / MARKER).write_text("{}" if name == "notes.json" else FIRST)
    (run / name).write_text(content)
    with pytest.raises(OutputError, match="not an earlier result"), atomic_folder(run):
        pass
    assert (run / name).read_text() == content


def test_a_result_with_a_folder_inside_and_the_current_folder_are_not_replaced(tmp_path, monkeypatch):
    run = tmp_path / "run"
    (run / "inner").mkdir(parents=True)
    (run / MARKER).write_text(FIRST)
    with pytest.raises(OutputError, match="inner"), atomic_folder(run):
        pass
    monkeypatch.chdir(run / "inner")
    with pytest.raises(OutputError, match="folder you are in"), atomic_folder(run):
        pass


def test_a_link_to_a_result_stays_a_link(tmp_path):
    with atomic_folder(tmp_path / "run") as partial:
        (partial / MARKER).write_text(FIRST)
    (tmp_path / "link").symlink_to(tmp_path / "run")
    with atomic_folder(tmp_path / "link") as partial:
        (partial / MARKER).write_text(SECOND)
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "run" / MARKER).read_text() == SECOND


def test_a_file_in_the_place_is_refused(tmp_path):
    (tmp_path / "run").write_text("")
    with pytest.raises(OutputError, match="is a file"), atomic_folder(tmp_path / "run"):
        pass


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_a_read_only_parent_is_a_clear_error(tmp_path):
    tmp_path.chmod(0o500)
    with pytest.raises(OutputError, match="cannot be written"), atomic_folder(tmp_path / "run"):
        pass


def test_an_unwritable_place_is_a_clear_error():
    with pytest.raises(OutputError, match="cannot be written"), atomic_folder(Path("/proc/nowhere/run")):
        pass
