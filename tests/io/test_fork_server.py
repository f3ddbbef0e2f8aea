"""Processes that are forks of one that has imported everything: what they see, how they end, and that none is left behind."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from swarm_mj.io import fork_server
from swarm_mj.io.cores import ONE_THREAD

ROOT = Path(__file__).parents[2]
pytestmark = pytest.mark.skipif(not fork_server.FORKS, reason="processes are forks on Linux alone")


def echo(pipe, *more):
    """Tell about itself, then answer until nobody asks."""
    loaded = "json.tool" in sys.modules
    threads = {os.environ.get(name) for name in ONE_THREAD}
    pipe.send((os.getpid(), os.getppid(), os.environ.get("ASKED"), os.getcwd(), loaded, threads, more))
    while True:
        pipe.send(pipe.recv())


def end_with_three(pipe):
    os._exit(3)


def begin(work=echo, *arguments):
    return fork_server.begin(work, arguments, modules=("json.tool", "no_such_module"))


@pytest.fixture
def fresh(monkeypatch):
    """No fork server has been started yet; the one of this test ends with it."""
    monkeypatch.setattr(fork_server, "_SERVERS", {})
    yield
    fork_server._end()


def test_processes_are_forks_of_one_and_see_what_the_one_that_asks_for_them_sees(fresh, monkeypatch, tmp_path):
    first, pipe = begin()
    pid, parent, asked, _, loaded, threads, more = pipe.recv()
    assert (pid, asked, loaded, threads, more) == (first.pid, None, True, {"1"}, ())
    monkeypatch.setenv("ASKED", "later")
    monkeypatch.chdir(tmp_path)
    second, other = begin(echo, "a", 2)
    pid, again, asked, folder, _, _, more = other.recv()
    assert (pid, again, asked, folder, more) == (second.pid, parent, "later", str(tmp_path), ("a", 2))
    assert first.pid != second.pid and parent != os.getpid()
    pipe.send("x")
    assert pipe.recv() == "x" and first.exitcode is None
    for process in (first, second):
        process.kill()
        process.join()
        assert process.exitcode == -signal.SIGKILL
    with pytest.raises(EOFError):
        pipe.recv()


def test_a_process_ends_with_its_work_or_when_nobody_listens_any_more(fresh):
    process, _ = begin(end_with_three)
    while process.pid is None:
        time.sleep(0.01)
    process.join()
    assert process.exitcode == 3
    process, pipe = begin()
    pipe.recv()
    pipe.close()
    process.join()
    assert process.exitcode == 0


def test_one_that_is_killed_before_it_is_born_is_not_waited_for_and_leaves_nothing(fresh):
    process, pipe = begin()
    process.kill()
    pipe.close()
    process.join()
    while process.pid is None:
        time.sleep(0.01)
    process.join()
    assert process.exitcode == 0


def test_when_the_fork_server_dies_its_processes_count_as_dead_and_the_next_has_a_new_one(fresh):
    process, pipe = begin()
    _, parent, *_ = pipe.recv()
    os.kill(parent, signal.SIGKILL)
    process.join()
    assert process.exitcode == -signal.SIGKILL
    pipe.close()
    while fork_server._SERVERS[os.getpid()].is_there:
        time.sleep(0.01)
    process, pipe = begin()
    assert pipe.recv()[1] != parent
    pipe.close()


BUSY = """
import time
from swarm_mj.io import fork_server
from tests.io.test_fork_server import busy
process, pipe = fork_server.begin(busy, (), modules=())
print(pipe.recv(), flush=True)
time.sleep(60)
"""


def busy(pipe):
    pipe.send(os.getpid())
    time.sleep(60)


def test_no_process_outlives_the_one_that_asked_for_it_however_busy_it_is():
    asking = subprocess.Popen([sys.executable, "-c", BUSY], stdout=subprocess.PIPE, text=True, cwd=ROOT)
    worker = int(asking.stdout.readline())
    asking.kill()
    asking.wait()
    asking.stdout.close()
    end = time.monotonic() + 30.0
    while os.path.exists(f"/proc/{worker}"):
        assert time.monotonic() < end
        time.sleep(0.02)


def test_a_process_can_be_had_where_none_can_be_forked(fresh, monkeypatch):
    monkeypatch.setattr(fork_server, "FORKS", False)
    process, pipe = begin()
    pid, parent, *_ = pipe.recv()
    assert (pid, parent) == (process.pid, os.getpid())
    process.kill()
    process.join()
    assert process.exitcode == -signal.SIGKILL
