"""Policies from the command line: `swarm-mj run --policy`."""

import json

import pytest

from swarm_mj.cli.main import main
from swarm_mj.flight import plan as planning

RUN = ["run", "eros-observe", "--quiet", "--no-figures", "--no-report", "--set", "observation.observer=horizon"]


@pytest.mark.parametrize(("policy", "least"), [("trained", 90.0), ("greedy", 70.0), ("body_centre", 35.0)])
def test_a_policy_by_name_flies_a_scenario(policy, least, tmp_path, capsys):
    assert main([*RUN, "--policy", policy, "--out", str(tmp_path / "out")]) == 0
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["coverage_percent"] > least
    assert "eros-observe" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("scenario", "policy", "change", "words"),
    [
        (
            "eros-quick",
            "trained",
            "seed=1",
            "trained for 5 spacecraft, but design.visiting_points of eros-quick gives 2",
        ),
        (
            "eros-config1",
            "trained",
            "seed=1",
            "trained for 5 spacecraft, but design.visiting_points of eros-config1 gives 5 and "
            "behavior.parameters.dedicated_communications = true one more",
        ),
        ("eros-observe", "trained", "duration_s=1505", "duration_s = 1505"),
        ("eros-observe", "greedy", "duration_s=1505", "duration_s = 1505"),
    ],
)
def test_a_scenario_that_does_not_fit_the_policy_is_refused_before_anything_is_planned(
    scenario, policy, change, words, tmp_path, capsys, monkeypatch
):
    monkeypatch.setattr(planning, "load_body_shape", lambda body: pytest.fail("planned already"))
    arguments = [*RUN, "--policy", policy, "--set", change, "--out", str(tmp_path / "out")]
    assert main([scenario if part == "eros-observe" else part for part in arguments]) == 2
    assert words in capsys.readouterr().err


def test_one_of_several_scenarios_that_does_not_fit_is_refused_before_any_is_flown(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(planning, "load_body_shape", lambda body: pytest.fail("planned already"))
    several = [*RUN[:2], "eros-quick", *RUN[2:], "--policy", "trained", "--out", str(tmp_path / "out")]
    assert main(several) == 2
    assert "eros-quick gives 2" in capsys.readouterr().err


def test_a_design_with_a_policy_is_refused_for_what_it_is(tmp_path, capsys):
    arguments = ["design", "eros-observe", "--quiet", "--out", str(tmp_path / "out")]
    assert main([*arguments, "--set", "behavior={name: trained_policy}"]) == 2
    assert "no design can be made with it" in capsys.readouterr().err


def test_an_unknown_policy_is_a_clear_error(tmp_path, capsys):
    assert main([*RUN, "--policy", "gready", "--out", str(tmp_path / "out")]) == 2
    error = capsys.readouterr().err
    assert "gready" in error and "greedy" in error
    assert not (tmp_path / "out").exists()
