"""`swarm-mj bench`: works take turns, rows compare themselves with targets, files hold what was printed."""

import json

import numpy as np
import pytest

from swarm_mj.bench.measure import in_turn, rates, row
from swarm_mj.bench.runner import GROUPS, page, run_bench
from swarm_mj.cli import main
from swarm_mj.errors import OutputError


def test_the_works_take_turns_and_the_warm_up_is_not_counted():
    calls = []
    times = in_turn({"a": lambda: calls.append("a"), "b": lambda: calls.append("b")}, rounds=3, warm_up=2)
    assert calls == ["a", "b"] * 5
    assert {name: len(values) for name, values in times.items()} == {"a": 3, "b": 3}


def test_rates_count_what_the_work_says_it_did():
    done = []
    per_second, _ = rates(lambda: done.append(1) or 7, 0.01)
    assert per_second > 0 and len(done) >= 1


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


def test_unknown_benchmarks_and_unwritable_files_are_clear_errors(tmp_path, capsys):
    with pytest.raises(OutputError, match="'speed' is unknown; there are start, loop"):
        run_bench(["speed"])
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match="cannot be written"):
        run_bench(["start"], as_json=tmp_path / "file" / "x.json")
    assert main(["bench", "--only", "speed"]) == 2
    assert "speed" in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in GROUPS if name not in ("start", "job")])
def test_every_benchmark_runs_in_its_quick_version(name):
    rows = run_bench([name])
    assert rows and all(np.isfinite(r.value) and r.group for r in rows)
    assert all(r.low <= r.value <= r.high for r in rows)
