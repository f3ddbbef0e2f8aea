"""How often a swarm sees enough, by whichever class counts."""

import pytest

from swarm_mj.campaigns.promise import fly_promise
from swarm_mj.scenarios.loading import load_scenario


@pytest.mark.parametrize(("name", "covered"), [("stereo", 2), ("shape", 0)])
def test_flights_count_by_the_class_that_is_asked_for(tmp_path, name, covered):
    changes = {
        "observation.classes": [{"name": name}],
        "designer.tolerance_percent": 1.0,
        "physics.stepper": "kernel",
    }
    scenario = load_scenario("eros-quick", changes)
    found = fly_promise(scenario, tmp_path / "campaign", 2, 0.5, quality_class=name, workers=1)
    assert (found.flights, found.failed, found.covered) == (2, 0, covered)
    assert 0.0 <= found.low <= covered / 2 <= found.high <= 1.0
