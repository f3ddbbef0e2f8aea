"""Full, read-only and shared places: a clear error, the earlier result intact, nothing left behind."""

import json
import os
import resource
import signal
import subprocess
import sys
import threading
import time
from contextlib import contextmanager
from pathlib import Path

import pytest

from swarm_mj.cli.main import main
from swarm_mj.errors import OutputError
from swarm_mj.io.atomic import MARKER, atomic_folder

pytestmark = pytest.mark.robust

QUICK = ["fly", "eros-quick", "--quiet", "--no-figures"]
#: A program that may write no file beyond a size, as on a full disk, for each size in a process of its own, which is forked
#: when everything is loaded; the kernel's signal is ignored as Python does. It is run with -B, because Python would keep
#: bytecode that is cut off.
LIMITED = """
import os, resource, sys
import swarm_mj.api.flight
from swarm_mj.cli.main import main
sizes = sys.argv[1].split(",")
for size in sizes:
    child = os.fork()
    if not child:
        os.dup2(os.open(f"{size}.err", os.O_WRONLY | os.O_CREAT), 2)
        resource.setrlimit(resource.RLIMIT_FSIZE, (int(size), resource.RLIM_INFINITY))
        sys.exit(main([*sys.argv[2:], f"{size}/run"]))
    print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), flush=True)
"""


def command(*arguments):
    return [sys.executable, "-m", "swarm_mj.cli.main", *map(str, arguments)]


def result(text):
    """A summary of eros-quick, which a run of that scenario may replace."""
    return json.dumps({"scenario": "eros-quick", "description": text, "versions": {"swarm_mj": "0"}})


def put(folder, text):
    with atomic_folder(folder) as partial:
        (partial / MARKER).write_text(result(text))


def read(folder):
    return json.loads((folder / MARKER).read_text())["description"]


@contextmanager
def small_disk(place, size):
    """A disk of a few kilobytes, where this process may mount one."""
    place.mkdir()
    options = ["mount", "-t", "tmpfs", "-o", f"size={size}", "tmpfs", str(place)]
    try:
        mounted = subprocess.run(options, capture_output=True).returncode == 0
    except OSError:
        mounted = False
    if not mounted:
        pytest.skip("may not mount a disk")
    try:
        yield place
    finally:
        subprocess.run(["umount", str(place)], check=True)


@pytest.fixture(scope="module")
def warm(tmp_path_factory):
    """Compiled kernels and maps are in their caches, so that a limit meets only the results."""
    assert main([*QUICK, "--out", str(tmp_path_factory.mktemp("warm") / "run")]) == 0


def test_a_full_disk_is_a_clear_error_and_the_earlier_result_stays(tmp_path, warm):
    sizes = ("1000", "60000")
    for size in sizes:
        (tmp_path / size).mkdir()
        put(tmp_path / size / "run", "earlier")
    arguments = [sys.executable, "-B", "-c", LIMITED, ",".join(sizes), *QUICK, "--out"]
    done = subprocess.run(arguments, cwd=tmp_path, capture_output=True, text=True, timeout=300)
    assert len(done.stdout.split()) == len(sizes), done.stderr
    for size, status in zip(sizes, done.stdout.split(), strict=True):
        said = (tmp_path / f"{size}.err").read_text()
        assert int(status) in {1, 2}, said  # and not a crash of the interpreter
        assert said.count("swarm-mj: error:") == 1
        assert f"{size}/run: cannot be written" in said
        assert "Traceback" not in said
        assert read(tmp_path / size / "run") == "earlier"
        assert [p.name for p in (tmp_path / size).iterdir()] == ["run"]


def test_a_disk_without_room_is_a_clear_error_and_stays_clean(tmp_path, capsys):
    with small_disk(tmp_path / "disk", "64k") as disk:
        put(disk / "run", "earlier")
        assert main([*QUICK, "--out", str(disk / "run")]) in {1, 2}
        assert "No space left on device" in capsys.readouterr().err
        assert read(disk / "run") == "earlier"
        assert [p.name for p in disk.iterdir()] == ["run"]


def test_a_read_only_disk_is_a_clear_error(tmp_path, capsys):
    with small_disk(tmp_path / "disk", "64k") as disk:
        put(disk / "run", "earlier")
        subprocess.run(["mount", "-o", "remount,ro", str(disk)], check=True)
        assert main([*QUICK, "--out", str(disk / "run")]) in {1, 2}
        assert main(["build-shape", "--frequency", "2", "--out", str(disk / "eros.obj")]) in {1, 2}
        message = capsys.readouterr().err
        assert message.count("cannot be written (Read-only file system)") == 2
        assert read(disk / "run") == "earlier"


@pytest.mark.parametrize("stage", ["telemetry.nc", "coverage.npz"])
def test_a_disk_that_fills_up_at_any_file_keeps_the_earlier_result(tmp_path, monkeypatch, stage, capsys):
    """The same without a process of its own: the write of one file fails."""
    put(tmp_path / "run", "earlier")
    (tmp_path / "run" / "overview.mp4").write_text("a film")
    opened = Path.open

    def full(path, *arguments, **keywords):
        if stage in path.name and ".partial" in str(path):
            raise OSError(28, "No space left on device")
        return opened(path, *arguments, **keywords)

    monkeypatch.setattr(Path, "open", full)
    if stage == "coverage.npz":  # numpy opens its files itself
        monkeypatch.setattr("numpy.savez_compressed", lambda path, **arrays: full(path))
    assert main([*QUICK, "--set", "duration_s=600", "--out", str(tmp_path / "run")]) in {1, 2}
    assert "No space left on device" in capsys.readouterr().err
    assert read(tmp_path / "run") == "earlier"
    assert (tmp_path / "run" / "overview.mp4").read_text() == "a film"
    assert [p.name for p in tmp_path.iterdir()] == ["run"]


def test_of_two_runs_into_one_folder_one_wins_and_the_other_says_so(tmp_path, capsys):
    first = subprocess.Popen(command(*QUICK, "--out", tmp_path / "run"), stderr=subprocess.PIPE)
    lock = tmp_path / ".run.lock"
    # The file is there a moment before it is locked; who holds it writes its number there.
    while first.poll() is None and not (lock.exists() and lock.read_text()):
        time.sleep(0.01)
    # Held where it is, lest it finishes before the second one asks.
    first.send_signal(signal.SIGSTOP)
    try:
        assert main([*QUICK, "--out", str(tmp_path / "run")]) in {1, 2}
    finally:
        first.send_signal(signal.SIGCONT)
    message = capsys.readouterr().err
    assert "another run is writing there" in message
    assert f"process {first.pid}" in message
    assert first.wait(300) == 0, first.stderr.read()
    assert read(tmp_path / "run").startswith("Two adaptable spacecraft")
    assert [p.name for p in tmp_path.iterdir()] == ["run"]
    assert main([*QUICK, "--out", str(tmp_path / "run")]) == 0


def test_of_many_at_once_exactly_one_wins(tmp_path):
    together, over = (threading.Barrier(8, timeout=60) for _ in range(2))
    won, refused = [], []

    def run(number):
        together.wait()
        try:
            with atomic_folder(tmp_path / "run") as partial:
                (partial / MARKER).write_text(result(str(number)))
                over.wait()  # hold the place until all have tried
                won.append(str(number))
        except OutputError as error:
            refused.append(str(error))
            over.wait()

    threads = [threading.Thread(target=run, args=(number,)) for number in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert won == [read(tmp_path / "run")]
    assert len(refused) == 7
    assert all("another run is writing there" in message for message in refused)
    assert [p.name for p in tmp_path.iterdir()] == ["run"]


def test_what_a_killed_run_left_behind_is_cleared_by_the_next(tmp_path):
    code = (
        "import sys, time\nfrom pathlib import Path\nfrom swarm_mj.io.atomic import atomic_folder\n"
        "with atomic_folder(Path(sys.argv[1])) as partial:\n"
        "    (partial / 'summary.json').write_text('half')\n    print(partial, flush=True)\n    time.sleep(600)\n"
    )
    put(tmp_path / "run", "earlier")
    process = subprocess.Popen([sys.executable, "-c", code, str(tmp_path / "run")], stdout=subprocess.PIPE, text=True)
    partial = Path(process.stdout.readline().strip())
    process.send_signal(signal.SIGKILL)
    process.wait()
    assert partial.exists()
    assert read(tmp_path / "run") == "earlier"
    put(tmp_path / "run", "later")
    assert read(tmp_path / "run") == "later"
    assert [p.name for p in tmp_path.iterdir()] == ["run"]


def test_a_result_that_a_killed_run_had_moved_aside_comes_back(tmp_path):
    put(tmp_path / "run", "earlier")
    (tmp_path / "run").rename(tmp_path / ".run.abcd1234.old")
    with pytest.raises(ValueError, match="stop"), atomic_folder(tmp_path / "run"):
        raise ValueError("stop")
    assert read(tmp_path / "run") == "earlier"
    assert [p.name for p in tmp_path.iterdir()] == ["run"]


def test_the_leftovers_of_others_are_not_touched(tmp_path):
    others = [".run.x.abcd1234.partial", ".runner.abcd1234.partial", ".run.partial", "run.abcd1234.partial", ".run.old"]
    for name in others:
        (tmp_path / name).mkdir()
    put(tmp_path / "run", "mine")
    assert sorted(p.name for p in tmp_path.iterdir()) == sorted([*others, "run"])


@pytest.mark.parametrize("place", ["a\0b", "loop/run", "file/run", "x" * 300, "x/" * 3000])
def test_a_place_that_cannot_be_is_a_clear_error(tmp_path, place):
    (tmp_path / "loop").symlink_to(tmp_path / "loop")
    (tmp_path / "file").touch()
    with pytest.raises(OutputError), atomic_folder(tmp_path / place):
        pass
    assert sorted(p.name for p in tmp_path.iterdir()) == ["file", "loop"]


def test_a_process_that_may_open_no_more_files_says_so(tmp_path):
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    held = []
    try:
        resource.setrlimit(resource.RLIMIT_NOFILE, (64, hard))
        while True:
            held.append(os.open(os.devnull, os.O_RDONLY))
    except OSError:
        with pytest.raises(OutputError, match="Too many open files"), atomic_folder(tmp_path / "run"):
            pass
    finally:
        for number in held:
            os.close(number)
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))
    assert not list(tmp_path.iterdir())
