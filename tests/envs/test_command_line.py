"""Policies from the command line: `swarm-mj run --policy`."""

import json

import pytest

from swarm_mj.cli import main

RUN = ["run", "eros-observe", "--quiet", "--no-figures", "--no-report", "--set", "observation.observer=horizon"]


@pytest.mark.parametrize(("policy", "least"), [("trained", 90.0), ("greedy", 70.0), ("body_centre", 35.0)])
def test_a_policy_by_name_flies_a_scenario(policy, least, tmp_path, capsys):
    assert main([*RUN, "--policy", policy, "--out", str(tmp_path / "out")]) == 0
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["coverage_percent"] > least
    assert "eros-observe" in capsys.readouterr().out


def test_an_unknown_policy_is_a_clear_error(tmp_path, capsys):
    assert main([*RUN, "--policy", "gready", "--out", str(tmp_path / "out")]) == 2
    error = capsys.readouterr().err
    assert "gready" in error and "greedy" in error
    assert not (tmp_path / "out").exists()
