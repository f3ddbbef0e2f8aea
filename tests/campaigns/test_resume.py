"""What may change between a campaign's beginning and its `--resume`: words for the reader, and nothing else."""

import pytest

from swarm_mj.campaigns.loading import load_campaign
from swarm_mj.campaigns.manifest import require_same
from swarm_mj.campaigns.runner import run_campaign
from swarm_mj.campaigns.store import read_results
from swarm_mj.errors import OutputError

FILE = """\
name: words
description: {campaign}
runs: 1
scenarios:
  - {{scenario: mine.yaml, name: one, set: {{description: {given}}}}}
  - {{scenario: mine.yaml, name: two}}
set: {{observation.observer: raycast, telemetry.interval_s: {interval}, description: {common}}}
"""
SCENARIO = """\
name: mine
description: {scenario}
duration_s: 1200
design: {{visiting_points: [12, 40]}}
physics: {{timestep_s: 0.5}}
"""
WORDS = {"campaign": "a", "given": "b", "common": "c", "scenario": "d", "interval": 10}


@pytest.fixture
def fly(tmp_path):
    """Flies the campaign with some words changed, or goes on with it."""

    def fly(**changed):
        words = {**WORDS, **changed}
        (tmp_path / "mine.yaml").write_text(SCENARIO.format(**words))
        (tmp_path / "words.yaml").write_text(FILE.format(**words))
        resolved = load_campaign(tmp_path / "words.yaml")
        begun = (tmp_path / "out").exists()
        return run_campaign(resolved, tmp_path / "out", workers=1, resume=begun, figures=False).summary

    return fly


def test_a_campaign_goes_on_whatever_its_descriptions_say_now(fly, tmp_path):
    fly()
    before = read_results(tmp_path / "out")
    summary = fly(campaign="other", given="words", common="for", scenario="the reader")
    assert summary["description"] == "other" and summary["finished"] == 2
    assert read_results(tmp_path / "out").equals(before)
    with pytest.raises(OutputError, match=r"telemetry.interval_s = 5, was 10"):
        fly(campaign="other", interval=5)


def test_a_parameter_that_is_called_description_is_compared(tmp_path):
    def manifest(words):
        base = {"description": words, "control": {"parameters": {"description": words}}}
        return {"campaign": {"scenarios": []}, "bases": {"one": base}, "shapes": {}, "versions": {}}

    with pytest.raises(OutputError, match=r"began: bases\.one\.control\.parameters\.description = 'b', was 'a'\. "):
        require_same(manifest("a"), manifest("b"), tmp_path)
    require_same(manifest("a"), manifest("a"), tmp_path)


@pytest.mark.parametrize("broken", [{}, {"campaign": 3, "bases": [1]}, {"campaign": {"scenarios": [1], "set": 2}}])
def test_a_manifest_that_is_damaged_is_not_taken_for_this_campaign(tmp_path, broken):
    ours = {"campaign": {"set": {}, "scenarios": []}, "bases": {"one": {}}, "shapes": {}, "versions": {"numpy": "2"}}
    with pytest.raises(OutputError, match="has changed since it began"):
        require_same(broken, ours, tmp_path)
