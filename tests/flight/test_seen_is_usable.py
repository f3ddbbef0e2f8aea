"""What counts as observed is what a mission would get: sunlit, resolved, and by the pictures that arrive."""

import re
from contextlib import closing
from dataclasses import replace

import numpy as np
import pytest
import trimesh
from trimesh.ray.ray_pyembree import RayMeshIntersector

import swarm_mj as sm
from swarm_mj.errors import MissionError
from swarm_mj.flight.downlink import deliver, frame_pixels, tiles_of
from swarm_mj.flight.fly import simulate
from swarm_mj.flight.observe import arrival_samples, flight_pictures, observe_flight, observer_from
from swarm_mj.flight.plan import make_plan
from swarm_mj.observation.capture import causes, incidence
from swarm_mj.observation.coverage import Cause
from swarm_mj.scenarios.loading import load_scenario

#: Half a rotation after the packaged epoch: the target lies in the night.
NIGHT = {"epoch": "2018-01-01T05:53:00"}


@pytest.fixture(scope="module")
def bennu():
    plan = make_plan(load_scenario("bennu-slow", {"physics.stepper": "kernel"}))
    telemetry = simulate(plan)
    return plan, telemetry, observe_flight(plan, telemetry)


def test_a_target_in_the_night_is_not_observed_and_the_run_says_so(tmp_path):
    flight = sm.fly("eros-quick", NIGHT)
    summary = sm.open(flight.save(tmp_path / "night", figures=False, report=False)).summary
    assert summary["coverage_percent"] == summary["delivered_percent"] == 0.0
    assert [(part["cause"], part["percent"]) for part in summary["not_observed"]] == [("never lit", 100.0)]
    ignored = sm.fly("eros-quick", {**NIGHT, "observation.light": "ignored"}).summary
    assert ignored["coverage_percent"] == 100.0 and ignored["light"] == "ignored"
    assert ignored["incidence_deg"]["min"] > 90.0


def test_a_design_of_a_dark_target_is_refused_because_of_light_and_told_when_it_is_lit():
    cheap = {"observation.criterion": "arrival", "designer.max_generations": 1, "observation.observer": "raycast"}
    with pytest.raises(MissionError, match=r"\(100 % never lit\).* all of it is lit at the arrival") as refused:
        sm.design("eros-quick", {**NIGHT, **cheap})
    start, end = re.search(r"epoch from (\S+) to (\S+)", str(refused.value)).groups()
    for epoch in (start, end):
        assert _lit_share(make_plan(load_scenario("eros-quick", {"epoch": epoch})), 600.0) > 0.98
    # The same light comes to who waits for it aboard, whose arrival is as long after the named release.
    plan = make_plan(load_scenario("eros-quick", NIGHT))
    assert _lit_share(plan, 600.0) == 0.0
    for release in map(float, re.search(r"release from (\S+) to (\S+) s past", str(refused.value)).groups()):
        assert _lit_share(plan, release + 600.0) > 0.98


def _lit_share(plan, t):
    """Share of the target's area that no other face of the body shades, by trimesh, and that the Sun stands 5 deg above."""
    region, sun_A = plan.region, plan.environment.C_AN(t) @ plan.environment.sun.at(t)
    rays = RayMeshIntersector(trimesh.Trimesh(region.vertices, region.faces, process=False))
    shaded = rays.intersects_any(region.centroid_A + region.normal_A, np.broadcast_to(sun_A, region.centroid_A.shape))
    lit = (incidence(region, sun_A) <= np.radians(85.0)) & ~shaded
    return region.area[lit].sum() / region.total_area


def test_what_is_delivered_has_the_ground_sampling_distance_that_is_told(bennu):
    plan, telemetry, result = bennu
    kept, delivery = result.kept, deliver(plan, telemetry, result.kept, prove=False)
    arrived = delivery.delivered_of(kept.gsd_m)
    assert np.isfinite(arrived).all() and (arrived < 1.1 * 1.1 * kept.by_best(kept.gsd_m)).all()
    # The pictures themselves: no picture shows a cell finer than a tenth below the one by which it is kept.
    finest = np.full(plan.region.n_cells, np.inf)
    camera = plan.scenario.camera
    pixel = 2.0 * np.tan(np.radians(camera.half_angle_deg)) / camera.resolution_px
    for picture in flight_pictures(plan, telemetry):
        way = picture.r_A - plan.region.centroid_A
        distance = np.linalg.norm(way, axis=1)
        cosine = np.einsum("ni,ni->n", way, plan.region.normal_A) / distance
        at_hand = result.kept.taken_s[picture.spacecraft] == picture.t
        told = kept.gsd_m[picture.spacecraft, at_hand]
        assert told == pytest.approx((pixel * distance / cosine)[at_hand])
        finest[at_hand] = np.minimum(finest[at_hand], told)
    assert finest == pytest.approx(kept.by_best(kept.gsd_m))


def test_first_pictures_are_coarser_than_the_best_seen_and_delivered_alike():
    best, first = (sm.fly("eros-quick", {"data.pictures": rule}).summary for rule in ("best", "first"))
    for told in (best, first):
        assert told["gsd_delivered_m"]["median"] == pytest.approx(told["gsd_m"]["median"], rel=0.1)
    assert first["gsd_delivered_m"]["median"] > 1.3 * best["gsd_delivered_m"]["median"]


def test_all_pictures_are_sent_where_all_are_asked_for(bennu):
    plan, telemetry, _ = bennu
    sent = {}
    for rule in ("best", "all"):
        told = replace(plan, scenario=load_scenario(plan.scenario, {"data.pictures": rule}))
        kept = observe_flight(told, telemetry).kept
        sent[rule] = len(kept.pictures()), tiles_of(told, telemetry, kept).bits.sum()
        frames = sent[rule][0] * frame_pixels(told.scenario) * told.scenario.data.sent_bits_per_pixel
        assert sent[rule][1] == pytest.approx(frames, rel=1e-3)
    assert sent["all"][0] > 1.5 * sent["best"][0]


@pytest.mark.parametrize(
    ("limit", "cause"),
    [
        ({"observation.max_emission_deg": 1.0}, Cause.OBLIQUE),
        ({"observation.max_gsd_m": 0.01}, Cause.COARSE),
        ({"observation.min_pixels": 1e7}, Cause.COARSE),
        ({"observation.max_motion_blur_px": 1e-9, "camera.exposure_s": 0.1}, Cause.BLURRED),
        ({"observation.max_incidence_deg": 0.1}, Cause.NEVER_LIT),
        ({"camera.half_angle_deg": 0.01}, Cause.OUT_OF_VIEW),
    ],
    ids=str,
)
def test_what_is_not_observed_has_its_cause(bennu, limit, cause):
    plan, telemetry, _ = bennu
    told = replace(plan, scenario=load_scenario(plan.scenario, limit))
    result = observe_flight(told, telemetry)
    assert (result.why == Cause.NONE).tolist() == result.coverage.seen.tolist()
    area = np.bincount(result.why, plan.region.area, len(Cause))
    assert area.argmax() == cause and area[cause] > 0.6 * plan.region.total_area


@pytest.mark.parametrize("limits", [(0.2, 3.0), (0.001, 1.0)])
def test_pictures_from_too_far_away_are_judged_as_all_others(bennu, limits):
    plan, telemetry, _ = bennu
    asked = dict(zip(("observation.max_gsd_m", "camera.half_angle_deg"), limits, strict=True))
    told = replace(plan, scenario=load_scenario(plan.scenario, {**asked, "observation.light": "ignored"}))
    result, why, arrivals = observe_flight(told, telemetry), *np.zeros((2, plan.region.n_cells), np.int8)
    times_s = telemetry["time"].values[arrival_samples(told.scenario)]
    with closing(observer_from(told.scenario, plan.region)) as observer:
        for picture in flight_pictures(told, telemetry):
            cause = causes(observer, picture.pose, told.scenario.observation)
            why = np.maximum(why, cause)
            if picture.t == times_s[picture.spacecraft]:
                arrivals = np.maximum(arrivals, cause)
    assert np.array_equal(result.why, why) and not np.array_equal(arrivals, why)
    assert result.images == len(list(flight_pictures(told, telemetry)))


def test_a_camera_that_was_off_is_the_cause_where_all_else_was_right(bennu):
    plan, telemetry, _ = bennu
    off = telemetry.assign(camera_on=telemetry["mode"] * 0)
    result = observe_flight(plan, off)
    assert result.images == 0 and (result.why == Cause.CAMERA_OFF).all()
