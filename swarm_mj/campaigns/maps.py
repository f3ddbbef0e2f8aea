"""Whether horizon maps pay in a campaign.

Maps belong to the target's cells. Where those differ from run to run, every map would be traced, kept on disk and used for a
single run; face-ID buffers, drawn by compiled code in about a millisecond each, need none.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np

from swarm_mj.campaigns.config import Campaign
from swarm_mj.campaigns.sampling import Sample
from swarm_mj.errors import SwarmError
from swarm_mj.flight.plan import load_body_shape, target_from, true_target
from swarm_mj.io.cache import hash_of
from swarm_mj.scenarios.schema import Scenario
from swarm_mj.smallbody.shape import ShapeModel

#: Makes the scenario of a run from its base, drawn values and seed.
Build = Callable[[Scenario, Mapping[str, Any], int], Scenario]

#: Keys and sections of a scenario that decide where the target's cells lie.
CELL_KEYS = (
    "body.shape",
    "body.shape_unit",
    "target",
    "design.imaging_altitude_m",
    "camera.half_angle_deg",
    "dispersions.target_m",
)
#: Runs of a scenario whose targets are compared; they are spread over the campaign.
PROBES = 8


def serve_once(campaign: Campaign, label: str, base: Scenario, build: Build) -> bool:
    """Whether a scenario asks for horizon maps that would serve one run each.

    It depends on the campaign alone, so that rows stay the same whoever flies them and in whichever order. A campaign that
    draws `observation.observer` means what it draws.
    """
    if base.observation.observer != "horizon" or not base.observation.occlusion:
        return False
    if _is_drawn("observation.observer", campaign) or not _cells_may_differ(campaign, base):
        return False
    targets = list(_targets(campaign, label, base, build))
    return len(targets) > 1 and len(set(targets)) == len(targets)


def observed_by_buffers(base: Scenario) -> Scenario:
    """The scenario with face-ID buffers drawn by compiled code for its observer."""
    return base.model_copy(update={"observation": base.observation.model_copy(update={"observer": "raster"})})


def _cells_may_differ(campaign: Campaign, base: Scenario) -> bool:
    return base.dispersions.target_m > 0.0 or any(_is_drawn(key, campaign) for key in CELL_KEYS)


def _is_drawn(key: str, campaign: Campaign) -> bool:
    """Whether a key, its section or something inside it is drawn."""
    return any(f"{key}.".startswith(f"{drawn}.") or drawn.startswith(f"{key}.") for drawn in campaign.parameters)


def _targets(campaign: Campaign, label: str, base: Scenario, build: Build) -> Iterator[str]:
    """Hashes of the targets of some runs; runs whose values allow none are left out."""
    sample = Sample(campaign)
    shapes: dict[str, ShapeModel] = {}
    place, scenarios = sample.names.index(label), len(sample.names)
    for run in np.unique(np.linspace(0, sample.runs - 1, PROBES).astype(int)):
        trial = sample.trial(int(run) * scenarios + place)
        try:
            yield _target(build(base, trial.values, trial.seed), shapes)
        except SwarmError:
            continue


def _target(scenario: Scenario, shapes: dict[str, ShapeModel]) -> str:
    body = scenario.body.model_dump_json()
    if body not in shapes:
        shapes[body] = load_body_shape(scenario.body)
    region = true_target(scenario, shapes[body], target_from(scenario, shapes[body]))
    return hash_of(region.vertices, region.faces, region.corners_A)
