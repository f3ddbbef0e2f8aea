"""Sobol' indices of a campaign: given where the sample allows them, and said where it does not, in every place."""

import json

import numpy as np
import pytest

from swarm_mj.campaigns.figures import NOT_TOLD, compose_sobol
from swarm_mj.campaigns.loading import load_campaign
from swarm_mj.campaigns.sampling import Sample
from swarm_mj.campaigns.store import schema_of, table_of
from swarm_mj.campaigns.summary import sobol_findings, summarise_campaign

from .conftest import ONE

#: Two drawn parameters, and runs in groups of a sample for Sobol' indices.
DRAWN = """
parameters:
  camera.half_angle_deg: {distribution: uniform, low: 15, high: 16}
  mothership.position_A_m.2: {distribution: uniform, low: -31000, high: -30000}
record: [coverage_percent]
"""


def results(resolved, area):
    """A table of flights whose observed area is a function of the drawn angle and the seed."""
    sample = Sample(resolved.campaign)
    trials = [sample.trial(row) for row in range(sample.rows)]
    rows = [
        {"row": t.row, "run": t.run, "scenario": t.scenario, "seed": t.seed, **t.values, "status": "ok", "covered": False,
         "coverage_percent": area(t.values["camera.half_angle_deg"], t.seed)}
        for t in trials
    ]  # fmt: skip
    return table_of(rows, schema_of(resolved.campaign))


def rare(angle, seed):
    """An outcome that hardly ever varies, as an area capped at 100 % does."""
    return 100.0 - 40.0 * (np.random.default_rng(seed).random() < 0.1)


def smooth(angle, seed):
    return 50.0 + 10.0 * angle


@pytest.fixture
def resolved(write):
    return load_campaign(write(ONE, runs=16, method="saltelli", more=DRAWN))


def indices(summary):
    return summary["scenarios"]["one"]["sobol"]["coverage_percent"]


def texts(figure):
    return [text.get_text() for ax in figure.axes for text in ax.texts]


def test_indices_that_a_sample_does_not_allow_are_not_shown(resolved):
    table = results(resolved, rare)
    summary = summarise_campaign(resolved, table)
    seed = indices(summary)["seed"]
    assert not seed["first"]["told"] and seed["first"]["high"] - seed["first"]["low"] > 0.5
    assert indices(summary)["camera.half_angle_deg"]["first"]["told"]
    (remark,) = sobol_findings(summary)
    assert "does not allow those of seed" in remark and "raise runs" in remark
    figure = compose_sobol(resolved, table, summary)
    assert NOT_TOLD in texts(figure)
    low, high = figure.axes[0].get_xlim()
    assert low > -0.5 and high < 1.6  # what is not shown does not stretch the axis
    bottom, top = figure.axes[0].get_ylim()
    assert all(top < text.xy[1] < bottom for ax in figure.axes for text in ax.texts)
    json.dumps(summary, allow_nan=False)


def test_indices_that_a_sample_allows_are_shown_without_remarks(write):
    resolved = load_campaign(write(ONE, runs=256, method="saltelli", more=DRAWN))
    table = results(resolved, smooth)
    summary = summarise_campaign(resolved, table)
    assert all(part["told"] for entry in indices(summary).values() for part in entry.values())
    assert indices(summary)["camera.half_angle_deg"]["total"]["value"] == pytest.approx(1.0, abs=0.05)
    assert sobol_findings(summary) == []
    assert NOT_TOLD not in texts(compose_sobol(resolved, table, summary))


def test_the_page_on_robustness_says_it_in_its_table():
    page = pytest.importorskip("scripts.pages.robustness")
    entries = {
        "first": {"value": 0.81, "low": 0.09, "high": 1.58, "told": False},
        "total": {"value": 0.2, "low": 0.1, "high": 0.3, "told": True},
    }
    table = page.sobol_table({"scenarios": {"one": {"sobol": {"coverage_percent": {"seed": entries}}}}})
    assert table[-1] == "| seed | the sample does not allow it (0.09 to 1.58) | 0.20 (0.10 to 0.30) |"


def test_the_page_on_robustness_gives_the_time_that_it_needed_itself(monkeypatch):
    page = pytest.importorskip("scripts.pages.robustness")
    monkeypatch.setattr(page, "usable_cores", lambda: 2)
    assert "It needed 9 min on 2 cores" in page.time_needed(540.0, went_on=False)
    assert "It needed 1.5 min" in page.time_needed(90.0, went_on=False)
    assert "min" not in page.time_needed(540.0, went_on=True)
