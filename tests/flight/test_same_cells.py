"""Who takes a picture when, and what counts in it, is the same in a run, in a live view and in the environment: bit for bit."""

import numpy as np
import pytest

from swarm_mj.flight.observe import observe_flight

from .flying import fly_environment, fly_live

PACKAGED = ("eros-config1", "eros-config2", "eros-literal", "eros-observe", "eros-faults", "eros-quick")
#: One change of what counts, or when, each.
CRITERIA = [
    {"min_fraction": 0.28},
    {"min_fraction": 1.0},
    {"any_pixel": True},
    {"max_emission_deg": 25.0},
    {"max_range_m": 15_000.0},
    {"max_gsd_m": 2.6},
    {"max_gsd_m": None},
    {"max_incidence_deg": 40.0},
    {"shadows": True},
    {"occlusion": False},
    {"criterion": "visit"},
    {"interval_s": 35.0},
]
#: Those that rays are cast for in another way than for the others.
BY_RAYS = ({"min_fraction": 0.28}, {"any_pixel": True}, {"shadows": True}, {"occlusion": False})


@pytest.mark.parametrize(
    ("name", "observer"),
    [(name, "horizon") for name in PACKAGED]
    + [(name, observer) for name in ("eros-literal", "eros-faults") for observer in ("raster", "raycast")],
)
def test_the_environment_sees_the_cells_of_a_run_at_the_same_times(flight, name, observer):
    plan, telemetry = flight(name, observer=observer)
    result = observe_flight(plan, telemetry)
    first_seen_s, percent = fly_environment(plan, telemetry, observer)
    assert result.observer == observer
    assert np.array_equal(first_seen_s, result.coverage.first_seen_s, equal_nan=True)
    assert percent == result.coverage.percent > 40.0


@pytest.mark.parametrize(
    ("change", "observer"),
    [(change, observer) for change in CRITERIA for observer in ("horizon", "raycast")[: 1 + (change in BY_RAYS)]],
    ids=str,
)
def test_the_environment_judges_as_a_run_does_by_every_part_of_the_criterion(flight, change, observer):
    plan, telemetry = flight("eros-observe", observer=observer, **change)
    result = observe_flight(plan, telemetry)
    first_seen_s, percent = fly_environment(plan, telemetry, observer)
    assert np.array_equal(first_seen_s, result.coverage.first_seen_s, equal_nan=True)
    assert percent == result.coverage.percent > 0.0


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
