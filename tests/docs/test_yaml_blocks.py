"""YAML on the site: no key stands twice in a block, and the first block on itineraries observes what its page says."""

import re
from pathlib import Path

import pytest
import yaml

from swarm_mj.flight.fly import simulate
from swarm_mj.flight.observe import observe_flight
from swarm_mj.flight.plan import make_plan
from swarm_mj.records.summary import summarise
from swarm_mj.scenarios.loading import load_scenario

DOCS = Path(__file__).parents[2] / "docs"
ITINERARY = "how-to/itinerary.md"
QUICK = {"physics.stepper": "kernel", "observation.observer": "horizon", "target.cell_size_m": 900}


def blocks(page):
    return re.findall(r"^```yaml\n(.*?)^```", (DOCS / page).read_text("utf-8"), re.DOTALL | re.MULTILINE)


def keys_given_twice(node):
    if isinstance(node, yaml.MappingNode):
        keys = [key.value for key, _ in node.value]
        inner = [twice for _, value in node.value for twice in keys_given_twice(value)]
        return [key for key in set(keys) if keys.count(key) > 1] + inner
    return [twice for part in node.value for twice in keys_given_twice(part)] if node.id == "sequence" else []


@pytest.mark.parametrize("page", sorted(str(path.relative_to(DOCS)) for path in DOCS.rglob("*.md")))
def test_no_key_of_a_block_is_given_twice(page):
    assert [keys_given_twice(yaml.compose(text)) for text in blocks(page)] == [[]] * len(blocks(page))


@pytest.mark.parametrize(("longitude_deg", "seen"), [(30, [100.0, 100.0]), (-80, [100.0, 0.0])])
def test_the_first_itinerary_observes_both_targets_by_day_and_one_by_night(longitude_deg, seen):
    data = yaml.safe_load(blocks(ITINERARY)[0])
    assert data["designer"]["extra_targets"][0]["longitude_deg"] == 30
    target = {"latitude_deg": 30 if longitude_deg == 30 else 0, "longitude_deg": longitude_deg, "half_angle_deg": 12}
    plan = make_plan(load_scenario(data, {**QUICK, "designer.extra_targets": [target]}))
    telemetry = simulate(plan)
    summary = summarise(plan, telemetry, observe_flight(plan, telemetry), {})
    assert summary["coverage_percent_by_target"] == seen
    dark = {part["cause"]: part["percent"] for part in summary["not_observed"]}
    assert dark == {} if longitude_deg == 30 else 12.0 < dark["never lit"] < 16.0
