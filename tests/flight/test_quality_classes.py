"""Quality classes of a flight: its looks are the pictures that count, and files, tables and report tell what they map."""

from dataclasses import replace
from io import StringIO
from itertools import combinations

import numpy as np
import pytest
from rich.console import Console

import swarm_mj as sm
from swarm_mj.campaigns.flying import outcome
from swarm_mj.cli.tables import results_table
from swarm_mj.errors import InteropError, ScenarioError
from swarm_mj.flight.observe import flight_pictures, observe_flight, observer_from
from swarm_mj.flight.plan import make_plan
from swarm_mj.interop.external_flight import ForeignFlight
from swarm_mj.observation.capture import observe
from swarm_mj.observation.quality import Quality
from swarm_mj.observation.radiometry import electrons, signal_to_noise
from swarm_mj.records.observed import mapped_by_class
from swarm_mj.records.run_files import read_coverage
from swarm_mj.reports.sections import summary_section
from swarm_mj.scenarios.loading import load_scenario
from swarm_mj.scenarios.schema_quality import QualityClass

DIM = {"camera.exposure_s": 2e-5, "body.albedo": 0.25}
OWN = {"name": "low_sun", "demands": [{"incidence_deg": [15, 90], "looks": 2}]}
CLASSES = {
    "observation.classes": ["seen", "stereo", {"name": "resolved", "max_gsd_m": 110}, OWN],
    "physics.stepper": "kernel",
    "observation.observer": "raycast",
    "target.cell_size_m": 700,
}


def own(demand):
    return QualityClass(name="own", demands=(demand,))


@pytest.fixture(scope="module")
def flight():
    return sm.fly("eros-quick", CLASSES)


@pytest.fixture(scope="module")
def looks(flight):
    """Of each cell the directions to camera and Sun and the distance, by the pictures in which it counts."""
    plan, found = flight.plan, [[] for _ in range(flight.plan.region.n_cells)]
    observer = observer_from(plan.scenario, plan.region)
    for p in flight_pictures(plan, flight.telemetry):
        for cell in np.flatnonzero(observe(observer, p.r_A, p.C_CA, plan.scenario.observation, p.sun_A)):
            away = p.r_A - plan.region.centroid_A[cell]
            distance = np.linalg.norm(away)
            found[cell].append((away / distance, p.sun_A / np.linalg.norm(p.sun_A), distance))
    return found


def degrees(a, b):
    return np.degrees(np.arccos(np.clip(a @ b, -1.0, 1.0)))


def test_looks_are_the_pictures_in_which_a_cell_counts(flight, looks):
    figures = flight.result.quality.figures
    assert np.array_equal(figures.looks, [len(each) for each in looks])
    normal, pixel = flight.plan.region.normal_A, 2 * np.tan(np.radians(21.5)) / 128
    gsd = [
        min((d * pixel / (u @ n) for u, _, d in each), default=np.nan) for each, n in zip(looks, normal, strict=True)
    ]
    assert figures.best_gsd_m == pytest.approx(gsd, rel=1e-5, nan_ok=True)
    assert np.nanmax(figures.convergence_deg) > 30.0


def test_each_class_maps_the_cells_whose_looks_fulfil_it(flight, looks):
    normal, pixel = flight.plan.region.normal_A, 2 * np.tan(np.radians(21.5)) / 128
    mapped = flight.result.quality.mapped
    assert np.array_equal(mapped["seen"], flight.coverage.seen)
    shares = {}
    for name, cells in mapped.items():
        for cell, each in enumerate(looks):
            n = normal[cell]
            fair = [(u, s, d) for u, s, d in each if degrees(u, n) <= 60 and degrees(s, n) <= 70]
            expected = {
                "seen": len(each) > 0,
                "resolved": any(d * pixel / (u @ n) <= 110 for u, s, d in fair),
                "stereo": any(
                    10 <= degrees(a[0], b[0]) <= 60 and degrees(a[1], b[1]) <= 20 for a, b in combinations(fair, 2)
                ),
                "low_sun": sum(degrees(s, n) >= 15 for _, s, _ in each) >= 2,
            }
            assert cells[cell] == expected[name], (name, cell)
        shares[name] = flight.plan.region.area[cells].sum() / flight.plan.region.total_area
    told = flight.summary["classes"]
    assert {name: found["percent"] for name, found in told.items()} == pytest.approx(
        {k: 100 * v for k, v in shares.items()}
    )
    assert told["stereo"]["area_km2"] == pytest.approx(shares["stereo"] * flight.summary["target_area_km2"], rel=1e-5)
    assert 0.0 < shares["stereo"] < 1.0 and 0.0 < shares["resolved"] < 1.0 and 0.0 < shares["low_sun"] < 1.0


def test_files_table_and_report_tell_what_classes_map_and_what_that_leaves_out(flight, tmp_path):
    run = flight.save(tmp_path / "run", figures=False, report=False)
    names = ("looks", "best_gsd_m", "height_dop", "mapped_stereo", "mapped_low_sun", "mapped_none")
    arrays = read_coverage(run / "coverage.npz", names)
    assert "mapped_none" not in arrays and arrays["looks"].sum() == flight.result.quality.figures.looks.sum()
    assert np.array_equal(arrays["mapped_stereo"], flight.result.quality.mapped["stereo"])
    percent = f"{flight.summary['classes']['stereo']['percent']:.1f}"
    page, table = str(summary_section(flight.record)), StringIO()
    Console(file=table, width=200).print(results_table([flight.summary]))
    for text in (page, table.getvalue()):
        assert "mapped, class stereo" in text and percent in text
    told = [words for words in flight.findings if "mapped, class stereo" in words]
    assert len(told) == 1 and "not by matched pictures" in told[0]
    assert sm.open(run).summary["classes"] == flight.summary["classes"]


def test_a_campaign_keeps_the_share_that_a_class_maps(flight):
    kept = outcome(flight.plan, flight.telemetry, flight.result, {"stereo": "classes.stereo"})
    assert kept["stereo"] == flight.summary["classes"]["stereo"]["percent"]


def test_only_the_pictures_of_the_arrival_count_where_the_criterion_says_so(flight):
    plan = make_plan(load_scenario("eros-quick", {**CLASSES, "observation.criterion": "arrival"}))
    figures = observe_flight(plan, flight.telemetry).quality.figures
    assert figures.looks.max() == 2 and figures.looks.sum() < flight.result.quality.figures.looks.sum() / 4


def test_without_classes_no_looks_are_kept(flight):
    plan = make_plan(load_scenario("eros-quick", {**CLASSES, "observation.classes": []}))
    result = observe_flight(plan, flight.telemetry)
    assert result.quality is None and np.array_equal(result.coverage.seen, flight.coverage.seen)


def test_signal_to_noise_takes_the_faces_in_slanting_light_first(flight, looks):
    plan = make_plan(load_scenario("eros-quick", {**CLASSES, **DIM}))
    region, camera, pixel = flight.plan.region, plan.scenario.camera, 2 * np.tan(np.radians(21.5)) / 128
    sun_m = np.linalg.norm(plan.environment.sun.at(600.0))
    highest = [max((s @ n for _, s, _ in each), default=0.0) for each, n in zip(looks, region.normal_A, strict=True)]
    middle = np.median([cosine for cosine in highest if cosine])
    limit = float(signal_to_noise(camera, electrons(camera, pixel, np.array(0.25 * middle), sun_m)))
    observation = plan.scenario.observation.model_copy(update={"classes": (own({"min_snr": limit}),)})
    plan = replace(plan, scenario=plan.scenario.model_copy(update={"observation": observation}))
    mapped = observe_flight(plan, flight.telemetry).quality.mapped["own"]
    bright, dim = (np.array(highest)[choice] for choice in (mapped, ~mapped))
    assert 0.0 < dim.max() < middle + 1e-4 and bright.min() > middle - 1e-4


def test_limits_that_need_an_exposure_or_an_albedo_are_refused_without_them():
    for key, limit in (("min_snr", 10), ("max_motion_blur_px", 1)):
        asked = {"observation.classes": [{"name": "own", "demands": [{key: limit}]}]}
        with pytest.raises(ScenarioError, match=f"own asks for {key}, which needs camera.exposure_s"):
            load_scenario("eros-quick", asked)
    asked = {"observation.classes": [{"name": "own", "demands": [{"min_snr": 10}]}], "camera.exposure_s": 1e-3}
    with pytest.raises(ScenarioError, match=r"own asks for min_snr, which needs body\.photometry"):
        load_scenario("eros-quick", {**asked, "body.shape": "ellipsoid", "body.semi_axes_m": [9e3, 6e3, 6e3]})


def test_motion_blur_limits_motion_and_is_refused_of_flights_from_files(flight):
    plan = make_plan(load_scenario("eros-quick", {**CLASSES, "camera.exposure_s": 0.05}))

    def observed(**asked):
        observation = plan.scenario.observation.model_copy(update={"classes": (), **asked})
        scenario = plan.scenario.model_copy(update={"observation": observation})
        return scenario, observe_flight(replace(plan, scenario=scenario), flight.telemetry)

    scenario, result = observed(classes=(own({"max_motion_blur_px": 0.02}),))
    sharp = observed(max_motion_blur_px=0.02)[1].coverage.seen
    assert np.array_equal(result.quality.mapped["own"], sharp) and 0.0 < sharp.mean() < result.coverage.seen.mean()
    with pytest.raises(InteropError, match=r"observation\.classes: own: motion blur needs velocities"):
        ForeignFlight(scenario, [], [])


def test_what_a_class_maps_is_weighted_as_the_target_is():
    region = plan_of_weights().region
    cells = region.weight > 1.0
    told = mapped_by_class(region, Quality({"mine": cells}, None))["mine"]
    heavy, light = region.area[cells].sum(), region.area[~cells].sum()
    assert told["percent"] == pytest.approx(100.0 * 3.0 * heavy / (3.0 * heavy + light), abs=1e-5)
    assert told["area_km2"] == pytest.approx(heavy / 1e6, abs=1e-5)


def plan_of_weights():
    extra = {"latitude_deg": 0.0, "longitude_deg": 60.0, "half_angle_deg": 10.0, "weight": 3.0}
    return make_plan(load_scenario("eros-quick", {"designer.extra_targets": [extra]}))
