"""The benchmarks of speed: works take turns, rows compare themselves with targets, files hold what was printed."""

import json
import os
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from swarm_mj.errors import OutputError

ROOT = Path(__file__).parents[2]
sys.path.append(str(ROOT))  # the benchmarks are no part of the installed package

from benchmarks.measure import STATUS, in_turn, rates, row  # noqa: E402
from benchmarks.performance import designer, environment, job, loop, observers, pictures  # noqa: E402
from benchmarks.performance.runner import GROUPS, on_gpu, page, run_bench  # noqa: E402


def test_the_works_take_turns_and_the_warm_up_is_not_counted():
    calls = []
    times = in_turn({"a": lambda: calls.append("a"), "b": lambda: calls.append("b")}, rounds=3, warm_up=2)
    assert calls == ["a", "b"] * 5
    assert {name: len(values) for name, values in times.items()} == {"a": 3, "b": 3}


@pytest.mark.parametrize(
    ("values", "target", "met"),
    [
        ([1.0, 1.1, 9.0], "<= 1.15", True),
        ([1.2, 1.3, 1.0], "<= 1.15", False),
        ([30.0], ">= 25", True),
        ([3.0], "", None),
    ],
)
def test_a_row_compares_its_median_with_its_target(values, target, met):
    assert row("group", "name", np.array(values), "ratio", target).met is met


def test_the_files_hold_the_rows_and_the_machine(tmp_path):
    rows = run_bench(["start"], as_json=tmp_path / "a" / "b.json", markdown=tmp_path / "p.md")
    content = json.loads((tmp_path / "a" / "b.json").read_text())
    assert [r["name"] for r in content["rows"]] == [r.name for r in rows]
    assert content["machine"]["mujoco"] and all(r["value"] > 0 for r in content["rows"])
    text = (tmp_path / "p.md").read_text()
    assert all(r.name in text for r in rows) and "## Start" in text
    assert page(rows) == text


def test_unknown_benchmarks_and_unwritable_files_are_clear_errors(tmp_path):
    with pytest.raises(OutputError, match="'speed' is unknown; there are start, loop"):
        run_bench(["speed"])
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match="cannot be written"):
        run_bench(["start"], as_json=tmp_path / "file" / "x.json")
    command = [sys.executable, "-m", "benchmarks.performance", "--quick", "--only", "speed"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 2 and done.stderr.startswith("error: benchmark 'speed' is unknown")


@pytest.mark.skipif(not STATUS.exists(), reason="other systems do not hand the memory of the parent down")
def test_the_memory_of_a_process_is_not_that_of_its_parent():
    ballast = np.ones(60_000_000)
    code = "from benchmarks.measure import peak_memory_mib; print(peak_memory_mib())"
    told = subprocess.run([sys.executable, "-c", code], cwd=ROOT, check=True, capture_output=True, text=True).stdout
    assert 5.0 < float(told) < 300.0 < ballast.nbytes / 2**20


def test_the_full_run_measures_single_and_vector_and_what_goes_wrong(monkeypatch):
    for name in ("raw_steps", "single_steps", "vector_steps"):
        monkeypatch.setattr(environment, name, lambda *a, **k: lambda: 1)
    monkeypatch.setattr(environment, "rates", lambda work, seconds: (1.0, 1.0))
    names = {r.name for r in environment.rows(quick=False)}
    assert {"single", "vector of 64", "vector of 64, eight missions"} <= names
    wrong = ["masses", "friction and a wheel that fails", "perturbations", "sensors and filter"]
    for name in (*wrong, environment.POLYHEDRAL):
        assert f"{name} / as planned, by processor time" in names


def test_first_flights_are_flown_before_what_they_fill_is_measured(monkeypatch):
    flown = []

    class Flown:
        action_space = SimpleNamespace(seed=lambda seed: None, sample=lambda: 0)

        def reset(self, seed):
            flown.clear()

        def step(self, action):
            flown.append(action)
            return None, None, np.array([False]), np.array([len(flown) == 5]), {}

    monkeypatch.setattr(environment.gymnasium, "make_vec", lambda *a, **k: Flown())
    for first, expected in ((False, 0), (True, 5)):
        work = environment.vector_steps(3, first)
        assert len(flown) == expected and work() == 3 and len(flown) == expected + 1


def write_run(folder, wall_s, report_s):
    folder.mkdir(parents=True)
    (folder / "summary.json").write_text(json.dumps({"wall_s": wall_s}))
    (folder / "report.html").write_text("")
    for name, t in (("summary.json", 1_000), ("report.html", 1_000 + report_s)):
        os.utime(folder / name, (t, t))


def test_the_stages_of_the_job_sum_to_the_whole(tmp_path):
    write_run(tmp_path / "a", {"figures": 2.0, "design": 1.0}, 3)
    write_run(tmp_path / "b", {"design": 0.5, "figures": 1.0}, 1)
    found = job.stages(tmp_path, 10.0)
    assert list(found.items()) == [("design", 1.5), ("figures", 3.0), ("report", 4.0), (job.REST, 1.5)]


def test_only_a_job_that_was_run_before_is_called_warm(monkeypatch):
    calls = []

    def run(scenarios, out, caches):
        calls.append((out.name, caches))
        return 3.0, {"design": 2.0, job.REST: 1.0}

    monkeypatch.setattr(job, "run", run)
    monkeypatch.setattr(job, "drawing", lambda scenario, rounds: row("main job", scenario, np.ones(1), "ratio"))
    quick = [r.name for r in job.rows(quick=True)]
    assert calls == [("once", {})] and quick[0] == "eros-quick, once, caches as found"
    assert not [name for name in quick if "warm" in name or "cold" in name]
    full = [r.name for r in job.rows(quick=False)]
    assert [name for name, _ in calls[1:]] == ["cold", "warm"] and calls[1][1] == calls[2][1] != {}
    assert [name for name in full if name.startswith("eros-config1 and")] == [
        f"eros-config1 and eros-config2, {name}" for name in ("cold", "warm")
    ]
    assert full[-2:] == ["first run, cold, over the next one, warm", "eros-config1"]


def test_the_page_says_whether_a_gpu_was_measured():
    for found in ((True, "llvmpipe (LLVM 15.0.6, 256 bits)"), (False, "OpenGL 3.3 cannot be loaded")):
        text = on_gpu(*found)
        assert "none was at hand" in text and "nothing was measured on one" in text
        assert "python -m benchmarks.performance --only observers --only pictures" in text
    assert "draws on Some GPU/PCIe/SSE2" in on_gpu(True, "Some GPU/PCIe/SSE2")
    assert "GPU: " in page([])


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in GROUPS if name not in ("start", "job")])
def test_every_benchmark_runs_in_its_quick_version(name, monkeypatch):
    """Of fewer pictures, spacecraft and generations, and sooner: how well rates are known is not judged here."""
    opened = pictures._page_rows
    monkeypatch.setattr(pictures, "PICTURES", 6)
    monkeypatch.setattr(pictures, "_page_rows", lambda page, openings: opened(page, 1))
    monkeypatch.setattr(loop, "QUICK_SIZES", (6,))
    monkeypatch.setattr(observers, "PICTURES", 2)
    monkeypatch.setattr(environment, "rates", lambda work, seconds: rates(work, 0.05 * seconds))
    monkeypatch.setattr(designer, "GENERATIONS", 7)
    rows = run_bench([name])
    assert rows and all(np.isfinite(r.value) and r.group for r in rows)
    assert all(r.low <= r.value <= r.high for r in rows)
