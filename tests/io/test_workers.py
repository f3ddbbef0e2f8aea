"""Processes that share work: what they see, answer and raise, how they end, and that none is left behind."""

import operator
import os
import signal
import subprocess
import sys
import time
from multiprocessing import forkserver, resource_tracker
from pathlib import Path

import pytest

from swarm_mj.errors import SwarmError
from swarm_mj.io import workers
from swarm_mj.io.machine import ONE_THREAD

ROOT = Path(__file__).parents[2]
on_linux = pytest.mark.skipif(not workers.FORKS, reason="processes are forks on Linux alone")


def echo(pipe, *more):
    """Tell about itself, then answer until nobody asks."""
    threads = {os.environ.get(name) for name in ONE_THREAD}
    pipe.send(
        (os.getpid(), os.getppid(), os.environ.get("ASKED"), os.getcwd(), "json.tool" in sys.modules, threads, more)
    )
    while True:
        pipe.send(pipe.recv())


def begin(work=echo, *arguments):
    return workers.begin(work, arguments, modules=("json.tool", "no_such_module"))


@pytest.fixture
def fresh():
    """No fork server has been started yet; the one of this test ends with it."""
    forkserver._forkserver._stop()
    yield
    forkserver._forkserver._stop()


@on_linux
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


@on_linux
def test_new_processes_import_nothing_of_the_current_folder(fresh, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [str(ROOT), *filter(None, sys.path)])
    for name in ("multiprocessing", "socket", "struct", "tests", "swarm_mj", "scipy"):
        Path(f"{name}.py").write_text(f"open({str(tmp_path / 'trap')!r}, 'w').close()\n")
    resource_tracker._resource_tracker._stop()  # another interpreter, which starts with the fork server
    process, pipe = begin()
    assert pipe.recv()[0] == process.pid
    process.kill()
    assert not Path("trap").exists()


def test_a_process_ends_without_a_word_when_nobody_listens_any_more(capfd):
    process, pipe = begin()
    pipe.recv()
    pipe.close()
    process.join()
    assert process.exitcode == 0 and capfd.readouterr().err == ""


@on_linux
def test_when_the_fork_server_dies_the_next_process_has_a_new_one(fresh):
    process, pipe = begin()
    _, parent, *_ = pipe.recv()
    os.kill(parent, signal.SIGKILL)
    os.waitid(os.P_PID, parent, os.WEXITED | os.WNOWAIT)
    process.kill()
    process.join()
    process, pipe = begin()
    assert pipe.recv()[1] != parent
    pipe.close()


BUSY = """
import time
from swarm_mj.io import workers
from tests.io.test_workers import busy
process, pipe = workers.begin(busy, (), modules=())
print(*pipe.recv(), flush=True)
time.sleep(60)
"""


def busy(pipe):
    pipe.send((os.getpid(), os.getppid()))
    sum(range(10**12))  # deaf, as compiled code is


@on_linux
def test_no_process_outlives_the_one_that_asked_for_it_however_busy_it_is():
    asking = subprocess.Popen([sys.executable, "-c", BUSY], stdout=subprocess.PIPE, text=True, cwd=ROOT)
    started = asking.stdout.readline().split()
    asking.kill()
    asking.wait()
    asking.stdout.close()
    end = time.monotonic() + 30.0
    while any(os.path.exists(f"/proc/{pid}") for pid in started):
        assert time.monotonic() < end
        time.sleep(0.02)


def root(half, x):
    if x < 0:
        raise ValueError(f"{x} has none")
    if x > 100:
        os._exit(3)
    return x**half


def half(value):
    if value is None:
        raise SwarmError("not here")
    return value


def ask(*jobs, exponent=0.5):
    return dict(workers.run_jobs([(x, (x,)) for x in jobs], root, workers=2, setup=half, arguments=(exponent,)))


def test_every_job_is_done_and_an_error_comes_back():
    assert ask(0.0, 1.0, 4.0, 9.0) == {0.0: 0.0, 1.0: 1.0, 4.0: 2.0, 9.0: 3.0}
    with pytest.raises(ValueError, match="-1.0 has none"):
        ask(-1.0)
    with pytest.raises(SwarmError, match="not here"):
        ask(1.0, exponent=None)


def test_a_process_that_dies_is_a_clear_error():
    with pytest.raises(SwarmError, match="a process that shared the work died with exit status 3; if memory is short"):
        ask(101.0)


@pytest.mark.parametrize("start_method", ["forkserver", "spawn"] if workers.FORKS else ["spawn"])
def test_a_script_of_the_users_own_is_not_run_again(start_method, tmp_path):
    script = tmp_path / "script.py"
    script.write_text(
        "import multiprocessing, operator\nfrom swarm_mj.io import workers\nprint('run')\n"
        f"workers.FORKS = {start_method == 'forkserver'}\n"
        f"workers._CONTEXT = multiprocessing.get_context({start_method!r})\n"
        "print(*workers.run_jobs([(0, (1,))], operator.add, workers=2, setup=int, arguments=(2,)))\n"
    )
    done = subprocess.run([sys.executable, script], capture_output=True, text=True, timeout=120)
    assert (done.returncode, done.stdout.split("\n"), done.stderr) == (0, ["run", "(0, 3)", ""], "")


def test_processes_are_gone_once_nobody_waits_for_their_results():
    results = workers.run_jobs([(k, (k,)) for k in range(9)], operator.add, workers=2, setup=int, modules=())
    next(results)
    started = [process.pid for process in workers.multiprocessing.active_children()]
    results.close()
    assert len(started) >= 2 and not [pid for pid in started if os.path.exists(f"/proc/{pid}")]
