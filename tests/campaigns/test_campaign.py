"""Whole campaigns as a user starts them: any number of workers, any order, and whatever kills them."""

import json
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path
from types import SimpleNamespace

import pytest

from swarm_mj.campaigns import pools, runner
from swarm_mj.campaigns.loading import load_campaign
from swarm_mj.campaigns.runner import replay, run_campaign
from swarm_mj.campaigns.sampling import Sample
from swarm_mj.campaigns.store import RESULTS, Store, read_results, schema_in
from swarm_mj.cli.main import main
from swarm_mj.errors import OutputError
from swarm_mj.io.lock import only_one

from .conftest import QUICK, rows

pytestmark = [pytest.mark.slow, pytest.mark.robust]


def finished(folder):
    try:
        return read_results(folder).num_rows
    except OutputError:
        return 0


def wait_for(condition, process, seconds=90.0):
    end = time.monotonic() + seconds
    while not condition():
        assert process.poll() is None, process.communicate()[1]
        assert time.monotonic() < end, "nothing happened"
        time.sleep(0.01)


def interrupted(begin, folder, done, signalled):
    """A campaign that was signalled after `done` runs, its answer and its workers; begun anew if it ended before that.

    It has two seconds to end; what else this machine does may cost some more.
    """
    for attempt in range(8):
        process = begin(folder / str(attempt))
        wait_for(lambda out=folder / str(attempt): finished(out) >= done, process)
        workers = children(process)
        signalled(process)
        said = process.communicate(timeout=8)
        if process.returncode != 0:
            return folder / str(attempt), process, said, workers
    raise AssertionError("the campaign was always over before the signal came")


def children(process):
    """Workers of a process: forks of its fork server."""
    (server,) = (pid for pid in born_of(process.pid) if ".forkserver" in Path(f"/proc/{pid}/cmdline").read_text())
    return born_of(server)


def born_of(parent):
    found = []
    for pid in filter(str.isdecimal, os.listdir("/proc")):
        try:
            stat = open(f"/proc/{pid}/stat").read().rsplit(")", 1)[1].split()
        except OSError:
            continue
        if int(stat[1]) == parent:
            found.append(int(pid))
    return found


def alive(pid):
    try:
        return open(f"/proc/{pid}/stat").read().rsplit(")", 1)[1].split()[0] != "Z"
    except OSError:
        return False


def wait_for_the_end_of(workers):
    end = time.monotonic() + 30.0
    while any(map(alive, workers)):
        assert time.monotonic() < end, "workers outlive the campaign"
        time.sleep(0.1)


@pytest.fixture
def command(capsys):
    """`swarm-mj campaign` in this process, which has loaded all that a new one would load first; returns status and errors."""

    def command(*arguments):
        capsys.readouterr()
        status = main(["campaign", *map(str, arguments), "--quiet", "--no-figures"])
        return status, capsys.readouterr().err

    return command


@pytest.mark.parametrize(("method", "many"), [("monte_carlo", 3), ("latin_hypercube", 2)])
def test_results_do_not_depend_on_the_number_of_workers(write, tmp_path, method, many):
    resolved = load_campaign(write(QUICK, runs=3, method=method))
    for workers in (1, many):
        run_campaign(resolved, tmp_path / str(workers), workers=workers, figures=False)
    one = rows(tmp_path / "1")
    assert one.equals(rows(tmp_path / str(many)))
    assert one["row"].to_pylist() == list(range(6))
    assert set(one["status"].to_pylist()) == {"ok"}


def test_a_killed_worker_costs_nothing(reference, tmp_path, monkeypatch):
    path, expected = reference
    made, killed = [], []
    monkeypatch.setattr(runner, "LocalPool", lambda *arguments: made.append(pools.LocalPool(*arguments)) or made[0])

    def kill():
        for done in (2, 5):
            while finished(tmp_path / "out") < done:
                time.sleep(0.01)
            killed.append(made[0]._workers[0].process.pid)
            os.kill(killed[-1], signal.SIGKILL)

    killer = threading.Thread(target=kill, daemon=True)
    killer.start()
    run_campaign(load_campaign(path), tmp_path / "out", workers=2, figures=False)
    assert len(set(killed)) == 2
    assert rows(tmp_path / "out").equals(expected)


@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupted_campaign_goes_on_where_it_was(reference, start, command, tmp_path, how):
    """Ctrl-C reaches the whole group, as a terminal sends it."""
    path, expected = reference
    out, process, (said, errors), workers = interrupted(
        lambda out: start(path, "--out", out, "--workers", 2, "--no-figures"),
        tmp_path,
        3,
        lambda process: (os.killpg if how == signal.SIGINT else os.kill)(process.pid, how),
    )
    assert "Traceback" not in errors
    assert process.returncode == 130
    kept = finished(out)
    assert kept >= 3
    assert f"{kept} of 10 runs are kept" in said and "--resume" in said
    wait_for_the_end_of(workers)
    assert command(path, "--out", out)[0] == 2
    status, errors = command(path, "--out", out, "--resume", "--workers", 1)
    assert status == 0, errors
    assert rows(out).equals(expected)
    assert (out / RESULTS).exists()


def test_a_changed_campaign_is_not_resumed(reference, command, tmp_path):
    path, _ = reference
    out = tmp_path / "out"
    changed = tmp_path / "changed.yaml"
    changed.write_text(path.read_text().replace("telemetry.interval_s: 10", "telemetry.interval_s: 5"))
    assert command(path, "--out", out, "--runs", 2, "--workers", 1)[0] == 0
    for arguments, words in (
        ([path, "--runs", 10], "campaign.runs = 10, was 2"),
        ([changed, "--runs", 2], "telemetry.interval_s = 5"),
    ):
        status, errors = command(*arguments, "--out", out, "--resume")
        assert status == 2 and words in errors, errors
    store = Store(out, schema_in(out), 10_000)
    store.add({**read_results(out).to_pylist()[0], "row": 9999})
    store.close()
    status, errors = command(path, "--runs", 2, "--out", out, "--resume")
    assert status == 2 and "holds row 9999; this campaign has rows 0 to 1 alone" in errors


def test_of_two_campaigns_in_one_folder_one_wins_and_the_other_goes_on_once_it_is_killed(
    reference, start, command, tmp_path
):
    path, expected = reference
    first = start(path, "--out", tmp_path / "out", "--workers", 1, "--no-figures")
    wait_for(lambda: finished(tmp_path / "out") >= 1, first)
    # Held where it is, lest it finishes before the second one asks.
    first.send_signal(signal.SIGSTOP)
    try:
        assert finished(tmp_path / "out") < len(expected)
        for more in ((), ("--resume",)):
            status, errors = command(path, "--out", tmp_path / "out", "--workers", 1, *more)
            assert status == 2
            assert f"another campaign is writing here (process {first.pid}" in errors
        workers = children(first)
    finally:
        first.kill()
    assert "Traceback" not in first.communicate(timeout=60)[1]
    assert first.returncode == -signal.SIGKILL
    wait_for_the_end_of(workers)
    assert 1 <= finished(tmp_path / "out") < len(expected)
    assert command(path, "--out", tmp_path / "out")[0] == 2
    status, errors = command(path, "--out", tmp_path / "out", "--resume", "--workers", 1)
    assert status == 0, errors
    assert rows(tmp_path / "out").equals(expected)
    assert (tmp_path / "out" / RESULTS).exists()


HOLD = """
import sys, time
from pathlib import Path
from swarm_mj.io.lock import only_one
with only_one(Path(sys.argv[1])):
    print("held", flush=True)
    time.sleep(120)
"""


def test_a_lock_does_not_outlive_a_killed_process(tmp_path):
    holder = subprocess.Popen([sys.executable, "-c", HOLD, str(tmp_path / "out")], stdout=subprocess.PIPE, text=True)
    try:
        assert holder.stdout.readline() == "held\n"
        with pytest.raises(OutputError, match=f"process {holder.pid} on"), only_one(tmp_path / "out"):
            pass
    finally:
        holder.kill()
        holder.communicate()
    with only_one(tmp_path / "out"):
        pass


def test_a_foreign_folder_is_not_written_to(write, tmp_path):
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.tex").write_text("years")
    with pytest.raises(OutputError, match="holds thesis.tex and no campaign"):
        run_campaign(load_campaign(write()), tmp_path / "mine")
    with pytest.raises(OutputError, match="holds thesis.tex and no campaign"):
        replay(load_campaign(write()), 0, tmp_path / "mine")
    assert [p.name for p in (tmp_path / "mine").iterdir()] == ["thesis.tex"]


def test_every_row_replays_bit_for_bit_and_a_forged_one_is_told_apart(reference, command, tmp_path, capsys):
    path, expected = reference
    out = tmp_path / "out"
    assert command(path, "--out", out, "--runs", 3, "--workers", 1)[0] == 0
    assert command(path, "--out", out, "--runs", 3, "--replay", 2)[0] == 0
    assert {"scenario.yaml", "telemetry.nc", "coverage.npz"} <= {p.name for p in (out / "replays" / "2").iterdir()}
    # The same row of a longer campaign: monte_carlo draws are its own.
    assert main(["campaign", str(path), "--out", str(out), "--runs", "4", "--replay", "2", "--quiet"]) == 0
    assert "is the same, bit for bit" in capsys.readouterr().out
    import pyarrow as pa
    import pyarrow.parquet as pq

    table = read_results(out)
    column = table.schema.get_field_index("coverage_percent")
    values = table["coverage_percent"].to_pylist()
    values[2] = values[2] * (1 - 2**-52)
    pq.write_table(table.set_column(column, "coverage_percent", pa.array(values)), out / RESULTS)
    assert command(path, "--out", out, "--runs", 3, "--replay", 2)[0] == 1


@pytest.fixture
def hurried(monkeypatch):
    """A function of rows that take long: when nothing else flies, the clock goes on to half a second before their limit."""
    ahead, made, real = [0.0], [], pools.wait
    monkeypatch.setattr(pools, "time", SimpleNamespace(monotonic=lambda: time.monotonic() + ahead[0]))
    monkeypatch.setattr(runner, "LocalPool", lambda *arguments: made.append(pools.LocalPool(*arguments)) or made[0])

    def hurry(slow):
        def wait(pipes, timeout):
            busy = {worker.row for worker in made[0]._workers} - {None}
            if busy and busy <= slow and timeout > 1.0:
                ahead[0] += timeout - 0.5
                timeout = 0.5
            return real(pipes, timeout=timeout)

        monkeypatch.setattr(pools, "wait", wait)

    return hurry


def test_a_run_that_takes_too_long_has_failed_and_the_others_go_on(write, tmp_path, hurried):
    steps = "{distribution: choice, values: [0.5, 0.001], weights: [0.8, 0.2]}"
    more = f"parameters: {{physics.timestep_s: {steps}}}\ntime_limit_s: 1000"  # however busy the machine is
    resolved = load_campaign(write(runs=4, more=more))
    sample = Sample(resolved.campaign)
    late = {row for row in range(4) if sample.trial(row).values["physics.timestep_s"] == 0.001}
    hurried(late)
    run_campaign(resolved, tmp_path / "out", workers=2, figures=False)
    found = read_results(tmp_path / "out").to_pylist()
    assert len(found) == 4
    slow = [r for r in found if r["physics.timestep_s"] == 0.001]
    assert {r["row"] for r in slow} == late
    assert slow and all(r["status"] == "failed" and "time_limit_s = 1000" in r["error"] for r in slow)
    assert sum(r["status"] == "ok" for r in found) == 4 - len(slow) > 0


def test_a_run_that_kills_its_worker_every_time_is_recorded_as_failed(write):
    from swarm_mj.campaigns.pools import MAX_DEATHS, LocalPool

    long = "parameters: {physics.timestep_s: {distribution: choice, values: [0.001]}}"  # a million steps
    pool, killed = LocalPool(load_campaign(write(runs=1, more=long)), None, workers=1), set()

    def kill():
        while len(killed) < MAX_DEATHS:
            for worker in list(pool._workers):
                if worker.row == 0 and worker.process.pid not in killed:
                    killed.add(worker.process.pid)
                    os.kill(worker.process.pid, signal.SIGKILL)
            time.sleep(0.01)

    killer = threading.Thread(target=kill, daemon=True)
    killer.start()
    try:
        (row,) = pool.results([0])
    finally:
        pool.close()
    assert row["status"] == "failed"
    assert row["error"] == "its process died 3 times, the last time by signal SIGKILL"


def test_the_folder_is_printed_as_it_was_given_and_wheels_in_percent_as_of_a_run(write, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "200")
    assert main(["campaign", str(write(runs=1)), "--out", "out", "--workers", "1", "--quiet", "--no-figures"]) == 0
    printed, summary = capsys.readouterr().out, json.loads(Path("out/summary.json").read_text())
    assert "plain: files in out\n" in printed
    (line,) = [line for line in printed.splitlines() if "wheel speed" in line]
    fastest = summary["scenarios"]["eros-quick"]["outcomes"]["max_wheel_speed_fraction"]["quantiles"]["0.95"]["value"]
    assert "[% of limit]" in line and f" {100 * fastest:.4g} " in line


def test_telemetry_is_kept_if_asked_for_and_figures_and_summary_are_written(write, tmp_path):
    import xarray as xr

    resolved = load_campaign(write(QUICK, runs=4, more="telemetry: true"))
    run_campaign(resolved, tmp_path / "out", workers=1)
    names = {p.name for p in (tmp_path / "out").iterdir()}
    assert {RESULTS, "summary.json", "campaign.json", "coverage.png", "pointing.png"} <= names
    assert len(list((tmp_path / "out" / "telemetry").iterdir())) == 8
    with xr.open_dataset(tmp_path / "out" / "telemetry" / "000003.nc", engine="h5netcdf") as telemetry:
        assert telemetry.sizes["time"] == 121
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["finished"] == 8 and summary["failed"] == 0
    one = summary["scenarios"]["one"]
    assert one["covered"]["flights"] == 4
    low, high = one["covered"]["clopper_pearson"]
    assert low <= one["covered"]["probability"] <= high
