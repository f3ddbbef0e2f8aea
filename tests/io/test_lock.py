"""The lock of a campaign's folder leaves no file behind, and is held by one process at a time whoever removes it meanwhile."""

import os
import subprocess
import sys

import pytest

from swarm_mj.errors import OutputError
from swarm_mj.io import lock
from swarm_mj.io.lock import LOCK, only_one

pytestmark = pytest.mark.robust


def test_no_lock_file_stays_behind_however_the_block_ends(tmp_path):
    with only_one(tmp_path):
        assert (tmp_path / LOCK).exists()
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(ZeroDivisionError), only_one(tmp_path):
        1 / 0  # noqa: B018
    assert list(tmp_path.iterdir()) == []


def test_a_second_one_is_told_who_holds_it_and_takes_nothing_away(tmp_path):
    with only_one(tmp_path):
        for _ in range(2):
            with pytest.raises(OutputError, match=f"another campaign is writing here .process {os.getpid()} on"):
                with only_one(tmp_path):
                    pass
        assert (tmp_path / LOCK).exists()


@pytest.mark.parametrize("another", [False, True], ids=["removed", "replaced"])
def test_a_file_that_was_removed_between_opening_and_locking_is_not_taken_for_the_lock(tmp_path, monkeypatch, another):
    """Its last holder removes the file that has just been opened; a third process may have made a new one by then."""
    flock, third = lock.fcntl.flock, []

    def late(handle, how):
        if not third:
            (tmp_path / LOCK).unlink()
            third.append(os.open(tmp_path / LOCK, os.O_RDWR | os.O_CREAT) if another else None)
            if another:
                flock(third[0], how)
        flock(handle, how)

    monkeypatch.setattr(lock.fcntl, "flock", late)
    if another:
        with pytest.raises(OutputError, match="another campaign is writing here"), only_one(tmp_path):
            pass
        os.close(third[0])
    else:
        with only_one(tmp_path):
            assert (tmp_path / LOCK).read_text().startswith(f"process {os.getpid()}")
            with pytest.raises(OutputError, match="another campaign"), only_one(tmp_path):
                pass


def test_the_lock_of_somebody_else_is_not_removed(tmp_path):
    with only_one(tmp_path):
        (tmp_path / LOCK).unlink()
        (tmp_path / LOCK).write_text("process 1 on elsewhere\n")
    assert (tmp_path / LOCK).read_text() == "process 1 on elsewhere\n"


def test_a_link_in_place_of_the_lock_is_not_followed(tmp_path):
    (tmp_path / "thesis.tex").write_text("years")
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / LOCK).symlink_to(tmp_path / "thesis.tex")
    with pytest.raises(OutputError, match="cannot be written"), only_one(tmp_path / "out"):
        pass
    assert (tmp_path / "thesis.tex").read_text() == "years"


TAKE_TURNS = """
import os, sys
from pathlib import Path
from swarm_mj.io.lock import only_one
from swarm_mj.errors import OutputError
folder, turns = Path(sys.argv[1]), 400
while turns:
    try:
        with only_one(folder):
            os.close(os.open(folder / "inside", os.O_CREAT | os.O_EXCL | os.O_WRONLY))
            (folder / "inside").unlink()
        turns -= 1
    except OutputError:
        pass
"""


def test_processes_that_take_and_remove_the_lock_all_the_time_are_never_inside_together(tmp_path):
    started = [
        subprocess.Popen([sys.executable, "-c", TAKE_TURNS, str(tmp_path)], stderr=subprocess.PIPE, text=True)
        for _ in range(3)
    ]
    said = [process.communicate(timeout=90)[1] for process in started]
    assert [process.returncode for process in started] == [0, 0, 0], said
    assert list(tmp_path.iterdir()) == []
