"""No cell counts beyond a limit of the criterion, whoever judges: the angles and distances are worked out here once more."""

import numpy as np
import pytest

from swarm_mj.designer.candidates.flights import fly_candidates
from swarm_mj.flight.observe import observe_flight
from swarm_mj.spacecraft.attitude.mrp import dcm
from tests.designer.judging import seen_cells

from .flying import fly_live

#: Limits that some pictures of `eros-observe` do not keep, in the units of their keys.
LIMITS = {"max_emission_deg": 25.0, "max_range_m": 15_000.0, "max_gsd_m": 2.6, "max_incidence_deg": 40.0}
EVERY_LIMIT = pytest.mark.parametrize("limit", LIMITS)


def angle_deg(a, b):
    """Between vectors [deg]."""
    return np.degrees(np.arctan2(np.linalg.norm(np.cross(a, b), axis=-1), (a * b).sum(axis=-1)))


def measure(limit, plan, t, r_A):
    """What the limit bounds, for a camera at `r_A` (3,) [m] at time t [s], of every cell."""
    region, camera, environment = plan.region, plan.scenario.camera, plan.environment
    way = r_A - region.centroid_A
    distance, emission = np.linalg.norm(way, axis=1), angle_deg(way, region.normal_A)
    if limit == "max_emission_deg":
        return emission
    if limit == "max_range_m":
        return distance
    if limit == "max_gsd_m":
        pixel = 2.0 * np.tan(np.radians(camera.half_angle_deg)) / camera.resolution_px
        return distance * pixel / np.cos(np.radians(emission))
    sun_A = environment.C_AN(t) @ (environment.sun.position + t * environment.sun.velocity)
    return angle_deg(np.broadcast_to(sun_A, way.shape), region.normal_A)


def measures_in(limit, plan, telemetry):
    """The same at every sample for every observer, shape (time, n, cells)."""
    r_N, C_AN = telemetry["r_BN_N"].values[:, : plan.n_observers], dcm(telemetry["sigma_AN"].values)
    every = round(plan.scenario.observation.interval_s / plan.scenario.telemetry.interval_s)
    return {
        float(t): np.array([measure(limit, plan, float(t), C_AN[k] @ r) for r in r_N[k]])
        for k, t in enumerate(telemetry["time"].values)
        if k % every == 0
    }


def worst(found, first_seen_s):
    """Largest of the measures with which cells were first seen, the nearest spacecraft's where it is not told whose picture."""
    cells = np.flatnonzero(~np.isnan(first_seen_s))
    return max(float(found[first_seen_s[i]][..., i].min()) for i in cells)


@EVERY_LIMIT
@pytest.mark.parametrize("judge", ["run", "live"])
def test_no_cell_is_seen_beyond_a_limit_in_flight(flight, limit, judge):
    plan, telemetry = flight("eros-observe", observer="horizon", max_gsd_m=None)
    found = measures_in(limit, plan, telemetry)
    free = worst(found, observe_flight(plan, telemetry).coverage.first_seen_s)
    plan, _ = flight("eros-observe", observer="horizon", **{"max_gsd_m": None, limit: LIMITS[limit]})
    coverage = fly_live(plan).coverage if judge == "live" else observe_flight(plan, telemetry).coverage
    assert worst(found, coverage.first_seen_s) <= LIMITS[limit] * (1.0 + 1e-12) < free


@EVERY_LIMIT
def test_no_candidate_sees_a_cell_beyond_a_limit(flight, limit):
    plan, _ = flight("eros-observe", observer="horizon", max_gsd_m=None)
    flights = fly_candidates(plan.scenario)
    least = np.full((flights.n, plan.region.n_cells), np.inf)
    for k, j in zip(*np.nonzero(flights.observing & flights.counts[:, None]), strict=True):
        least[j] = np.minimum(least[j], measure(limit, plan, float(flights.times[k]), flights.r_A[k, j]))
    for told in ({}, {limit: LIMITS[limit]}):
        limited, _ = flight("eros-observe", observer="horizon", **{"max_gsd_m": None, **told})
        seen = seen_cells(limited.scenario, flights, plan.region)
        assert seen.any()
        beyond = seen & (least > LIMITS[limit] * (1.0 + 1e-12))
        assert beyond.any() == (not told)
