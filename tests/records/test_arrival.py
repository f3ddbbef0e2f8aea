"""The flown miss at the arrival, by hand; it is told beside the residual of the solver, not mixed up with it."""

from dataclasses import replace

import numpy as np
import pytest

from swarm_mj.figures.run_figures import COMPOSERS
from swarm_mj.flight.fly import simulate
from swarm_mj.flight.observe import arrival_sample, observe_flight
from swarm_mj.records.summary import arrival_miss_m, summarise


@pytest.fixture(scope="module")
def flown(quick_plan):
    return simulate(quick_plan)


def beside(telemetry, plan, metres):
    """The flight with every spacecraft beside its point at the arrival, each 1 m farther than the one before."""
    moved, sample = telemetry.copy(deep=True), arrival_sample(plan.scenario)
    aside = np.array([2.0, -1.0, 2.0]) / 3.0
    moved["r_BN_N"].values[sample] = plan.deployment.destination_N + (metres + np.arange(plan.n))[:, None] * aside
    return moved


def test_the_flown_miss_is_the_distance_from_the_point_at_the_arrival(quick_plan, flown):
    assert arrival_miss_m(quick_plan, flown).max() < 1e-3
    assert arrival_miss_m(quick_plan, beside(flown, quick_plan, 7.0)) == pytest.approx(7.0 + np.arange(quick_plan.n))


def test_summary_and_figure_tell_the_flown_miss_and_the_residual_apart(quick_plan, flown):
    moved, plan = beside(flown, quick_plan, 7.0), quick_plan
    plan = replace(plan, deployment=replace(plan.deployment, miss_m=np.full(plan.n, 0.25)))
    result = observe_flight(plan, moved)
    told = summarise(plan, moved, result, {})
    assert set(told["transfer_miss_mm"].values()) == {250.0}
    assert list(told["arrival_miss_mm"].values()) == pytest.approx([1e3 * (7 + j) for j in range(plan.n)])
    axes = COMPOSERS["trajectories"](plan, moved, result).axes
    texts = " ".join(text for ax in axes for text in (ax.get_title("left"), *(t.get_text() for t in ax.texts)))
    assert f"missed in flight by {6 + plan.n} m at most" in texts and "solver's residual 2.5e+02 mm" in texts


def test_the_ground_sampling_distance_is_that_of_the_best_picture_by_hand(quick_plan, flown):
    result = observe_flight(quick_plan, flown)
    told = summarise(quick_plan, flown, result, {})
    region, pixel, counted = quick_plan.region, 2 * np.tan(np.radians(21.5)) / 128, result.coverage.seen
    kept_m = result.kept.by_best(result.kept.gsd_m)
    assert np.array_equal(counted, ~np.isnan(kept_m))
    assert told["gsd_m"]["min"] == pytest.approx(kept_m[counted].min(), abs=1e-6)
    assert told["gsd_m"]["min"] <= told["gsd_m"]["median"] <= told["gsd_m"]["max"]
    sample = arrival_sample(quick_plan.scenario)
    C_AN = quick_plan.environment.C_AN(float(flown["time"].values[sample]))
    at_arrival = (C_AN @ flown["r_BN_N"].values[sample].T).T
    way = at_arrival[:, None] - region.centroid_A
    distance = np.linalg.norm(way, axis=2)
    gsd = pixel * distance**2 / np.einsum("jni,ni->jn", way, region.normal_A)
    seen_then = result.coverage.first_seen_s <= flown["time"].values[sample]
    assert (kept_m[seen_then] < 1.1 * gsd.min(axis=0)[seen_then]).all()
    only = quick_plan.scenario.observation.model_copy(update={"criterion": "arrival"})
    arrival = replace(quick_plan, scenario=quick_plan.scenario.model_copy(update={"observation": only}))
    seen = observe_flight(arrival, flown)
    here = seen.coverage.seen_by
    arrival_m = seen.kept.by_best(seen.kept.gsd_m)
    assert arrival_m[seen.coverage.seen] == pytest.approx(np.where(here, gsd, np.inf).min(axis=0)[seen.coverage.seen])
