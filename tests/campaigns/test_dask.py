"""The same campaign on a Dask cluster: the same bits, and no row lost when workers or the scheduler die."""

import os
import signal
import subprocess
import sys
import time

import pytest

pytest.importorskip("distributed")

from swarm_mj.campaigns.loading import load_campaign  # noqa: E402
from swarm_mj.campaigns.pools import DaskPool  # noqa: E402
from swarm_mj.campaigns.runner import run_campaign  # noqa: E402
from swarm_mj.campaigns.store import read_results  # noqa: E402
from swarm_mj.errors import OutputError  # noqa: E402

from .conftest import QUICK, rows  # noqa: E402

pytestmark = pytest.mark.slow


def test_a_local_cluster_gives_the_same_bits_as_local_processes(write, tmp_path):
    from distributed import LocalCluster

    resolved = load_campaign(write(QUICK, runs=2))
    run_campaign(resolved, tmp_path / "here", workers=1, figures=False)
    with LocalCluster(n_workers=1, threads_per_worker=1, dashboard_address=None) as cluster:
        address = cluster.scheduler_address
        run_campaign(resolved, tmp_path / "there", scheduler=address, figures=False)
    assert rows(tmp_path / "here").equals(rows(tmp_path / "there"))


def test_nobody_at_the_address_is_a_clear_error(write, tmp_path, monkeypatch):
    monkeypatch.setattr("swarm_mj.io.cluster.CONNECT_S", 1.0)
    with pytest.raises(OutputError, match="no Dask scheduler answers"):
        run_campaign(load_campaign(write()), tmp_path / "out", scheduler="tcp://127.0.0.1:9")
    assert not (tmp_path / "out").exists()


#: Asks at several addresses in one process, whose end is as clean as if each had been the only one.
ASK = """
import sys
from swarm_mj.cli.main import main
path, out, *addresses = sys.argv[1:]
for address in addresses:
    print(main(["campaign", path, "--out", out, "--quiet", "--no-figures", "--scheduler", address]), flush=True)
"""


def test_an_address_that_is_none_ends_the_program_at_once_and_cleanly(write, tmp_path):
    addresses = ["garbage", "foo://x", "tls://127.0.0.1:9", ""]
    asked = [sys.executable, "-c", ASK, str(write()), str(tmp_path / "out"), *addresses]
    environment = {**os.environ, "COLUMNS": "200"}
    # Nearly all of it for the start; Dask alone would wait for 40 s more at each.
    done = subprocess.run(asked, capture_output=True, text=True, timeout=60, env=environment)
    assert done.stdout.split() == ["2"] * len(addresses)
    lines = done.stderr.strip().splitlines()
    assert len(lines) == len(addresses)
    assert all("no Dask scheduler answers" in line and "tcp://host:8786" in line for line in lines)
    assert "Traceback" not in done.stderr and "ignored" not in done.stderr
    assert not (tmp_path / "out").exists()


def test_a_worker_that_lacks_this_program_is_a_clear_error(write, monkeypatch):
    class Client:
        closed = False

        def __init__(self, *_, **__):
            pass

        def run(self, function):
            raise ModuleNotFoundError("No module named 'swarm_mj'")

        def close(self, timeout):
            Client.closed = True

    monkeypatch.setattr("distributed.Client", Client)
    monkeypatch.setattr("swarm_mj.io.cluster._knock", lambda scheduler: None)
    with pytest.raises(
        OutputError, match="tcp://there:1: a worker does not say which .*No module named 'swarm_mj'.; install"
    ):
        DaskPool(load_campaign(write()), None, "tcp://there:1")
    assert Client.closed


@pytest.fixture
def cluster(tmp_path):
    """A scheduler and two workers in processes of their own; gives address, scheduler and a way to start workers."""
    started = []
    file = tmp_path / "scheduler.json"

    def start(*arguments):
        command = [
            sys.executable,
            "-m",
            "distributed.cli." + arguments[0],
            *arguments[1:],
            "--scheduler-file",
            str(file),
        ]
        log = open(tmp_path / f"{len(started)}.log", "w")
        started.append(subprocess.Popen([*command, "--no-dashboard"], stdout=log, stderr=log))
        return started[-1]

    scheduler = start("dask_scheduler", "--port", "0")
    while not file.exists():
        assert scheduler.poll() is None
        time.sleep(0.05)

    def worker():
        return start("dask_worker", "--nthreads", "1", "--no-nanny")

    import json

    yield json.loads(file.read_text())["address"], scheduler, worker
    for process in started:
        process.kill()
        process.wait()


def test_workers_that_die_and_join_change_nothing_and_when_the_scheduler_dies_nothing_finished_is_lost(
    reference, start, cluster, tmp_path
):
    address, scheduler, worker = cluster
    first = worker()
    (path, expected), out = reference, tmp_path / "out"
    process = start(path, "--out", out, "--scheduler", address, "--no-figures")
    wait_for_rows(out, 3, process)
    worker()
    os.kill(first.pid, signal.SIGKILL)
    assert process.wait(120) == 0, process.communicate()[1]
    assert rows(out).equals(expected)

    out = tmp_path / "elsewhere"
    process = start(path, "--out", out, "--scheduler", address, "--no-figures")
    wait_for_rows(out, 3, process)
    os.kill(scheduler.pid, signal.SIGKILL)
    _, errors = process.communicate(timeout=90)
    assert process.returncode == 2
    assert "connection to the scheduler was lost" in errors and "--resume" in errors and "Traceback" not in errors
    assert read_results(out).num_rows >= 3
    run_campaign(load_campaign(path), out, workers=1, resume=True, figures=False)
    assert rows(out).equals(expected)


def wait_for_rows(folder, number, process, seconds=90.0):
    end = time.monotonic() + seconds
    while True:
        try:
            if read_results(folder).num_rows >= number:
                return
        except OutputError:
            pass
        assert process.poll() is None, process.communicate()[1]
        assert time.monotonic() < end
        time.sleep(0.05)
