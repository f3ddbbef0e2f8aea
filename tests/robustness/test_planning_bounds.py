"""Numbers that no plan can hold end in a clear error, and soon."""

import pytest

from swarm_mj.errors import SwarmError
from swarm_mj.flight.plan import make_plan
from swarm_mj.mission import trajectories
from swarm_mj.scenarios.loading import load_scenario, parse_overrides

from .limits import HANG_S, bounded

pytestmark = pytest.mark.robust


@pytest.mark.parametrize(
    ("overrides", "words"),
    [
        (["body.gravity={model: point_mass, parameters: {gm: 1e15}}"], "MAX_EVALUATIONS"),
        (["body.gravity.parameters.reference_radius_m=1e300"], "reference_radius_m"),
    ],
)
def test_a_field_of_absurd_strength_is_refused(overrides, words, monkeypatch):
    # A tenth of the evaluations in a tenth of the time.
    monkeypatch.setattr(trajectories, "MAX_EVALUATIONS", trajectories.MAX_EVALUATIONS // 10)
    with bounded(HANG_S // 10), pytest.raises(SwarmError, match=words):
        make_plan(load_scenario("eros-quick", parse_overrides(overrides)))
