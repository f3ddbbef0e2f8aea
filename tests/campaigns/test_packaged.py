"""The packaged campaigns can be flown, and their two-fold design is what it is called."""

import numpy as np
import pytest

from swarm_mj.campaigns.flying import Flyer
from swarm_mj.campaigns.loading import load_campaign
from swarm_mj.errors import ScenarioError
from swarm_mj.scenarios.bodies import packaged_files


def test_there_are_packaged_campaigns_and_an_unknown_one_lists_them():
    assert {"eros-losses", "eros-sensitivity", "eros-each-fault"} <= set(packaged_files("campaigns"))
    with pytest.raises(ScenarioError, match="eros-each-fault, eros-losses"):
        load_campaign("eros-nothing")


@pytest.mark.parametrize("name", packaged_files("campaigns"))
def test_a_packaged_campaign_flies_its_first_run_without_opengl(name):
    row = Flyer(load_campaign(name, runs=2)).fly(0)
    assert row["status"] == "ok", row["error"]
    assert 50.0 < row["coverage_percent"] <= 100.0


def test_without_losses_the_two_fold_design_sees_every_face_twice():
    from swarm_mj.flight.fly import simulate
    from swarm_mj.flight.observe import observe_flight
    from swarm_mj.flight.plan import make_plan

    base = load_campaign("eros-losses").bases["config 2 two-fold"]
    plan = make_plan(base.model_copy(update={"faults": ()}))
    coverage = observe_flight(plan, simulate(plan)).coverage
    twice = coverage.seen_by.sum(axis=0) >= 2
    assert 100.0 * coverage.area[twice].sum() / coverage.area.sum() >= 99.9
    # Whoever is lost, the others see it all: the same said the long way round.
    for j in range(plan.n):
        left = np.delete(coverage.seen_by, j, axis=0).any(axis=0)
        assert 100.0 * coverage.area[left].sum() / coverage.area.sum() >= 99.9


def test_losses_happen_as_often_as_asked_and_are_counted(tmp_path):
    import json

    flyer = Flyer(load_campaign("eros-losses"))
    rows = [flyer.fly(row) for row in range(2, 42, 4)]  # configuration 2, minimal
    for row in rows:
        kinds = [e["kind"] for e in row["events"]]
        assert kinds.count("spacecraft_lost") == row["lost"]
        assert all(0.0 <= e["time_s"] <= 600.0 for e in row["events"] if e["kind"] == "spacecraft_lost")
        json.dumps(row, allow_nan=False)
    assert 0 < sum(row["lost"] for row in rows) < 15  # 50 chances of a tenth
