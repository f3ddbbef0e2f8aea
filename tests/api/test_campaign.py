"""Campaigns through the public API: one table, the same rows as on disk."""

import pytest

import swarm_mj as sm

pytest.importorskip("pyarrow")

CAMPAIGN = """
name: small
runs: 2
scenarios: [{scenario: eros-quick, set: {telemetry.interval_s: 60, observation.interval_s: 600}}]
"""


@pytest.fixture
def file(tmp_path):
    (tmp_path / "small.yaml").write_text(CAMPAIGN)
    return tmp_path / "small.yaml"


def test_a_campaign_is_a_table_and_leaves_nothing_unless_asked_to(file, tmp_path):
    table = sm.campaign(file, workers=1)
    assert len(table) == 2 and (table["status"] == "ok").all()
    assert table.attrs["summary"]["finished"] == 2
    assert [p.name for p in tmp_path.iterdir()] == ["small.yaml"]
    kept = sm.campaign(file, workers=1, out=tmp_path / "out", figures=False)
    assert kept.drop(columns="wall_s").equals(table.drop(columns="wall_s"))
    again = sm.replay(file, 1, tmp_path / "out")
    assert again.differs == []


def test_what_cannot_be_gone_on_with_is_said(file):
    with pytest.raises(sm.SwarmError, match="give the folder to go on from"):
        sm.campaign(file, resume=True)
    with pytest.raises(sm.SwarmError, match="workers = 0"):
        sm.campaign(file, workers=0)
