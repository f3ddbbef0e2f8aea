"""Who takes a picture when, and what counts in it, is the same in a run and in a live view: bit for bit."""

import numpy as np
import pytest

from swarm_mj.flight.observe import observe_flight

from .flying import fly_live

PACKAGED = ("eros-config1", "eros-config2", "eros-literal", "eros-observe", "eros-faults", "eros-quick")


@pytest.mark.parametrize("occlusion", [True, False])
@pytest.mark.parametrize("name", PACKAGED)
def test_a_live_view_shows_at_the_end_what_a_run_reports(flight, name, occlusion):
    plan, telemetry = flight(name, observer="raster", occlusion=occlusion)
    result = observe_flight(plan, telemetry)
    live = fly_live(plan)
    assert np.array_equal(live.coverage.first_seen_by_s, result.coverage.first_seen_by_s, equal_nan=True)
    assert np.array_equal(live.instant().seen, result.coverage.seen)
    assert live.coverage.percent == result.coverage.percent


def test_whether_the_body_hides_cells_matters_in_a_flight_that_live_views_are_compared_in(flight):
    seen = []
    for occlusion in (True, False):
        plan, telemetry = flight("eros-literal", observer="raycast", occlusion=occlusion)
        seen.append(observe_flight(plan, telemetry).coverage.first_seen_by_s)
    assert not np.array_equal(*seen, equal_nan=True)


def test_a_live_view_judges_whole_faces_as_a_run_does(flight):
    plan, telemetry = flight("eros-observe", observer="raster", min_fraction=1.0)
    result, live = observe_flight(plan, telemetry), fly_live(plan)
    assert np.array_equal(live.coverage.first_seen_by_s, result.coverage.first_seen_by_s, equal_nan=True)
    assert "whole faces by geometry" in result.note and result.coverage.percent > 0.0
