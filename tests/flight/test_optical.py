"""Navigation by pictures in whole flights: what is known, who uses it, and what is told of it."""

import json

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import swarm_mj as sm
from swarm_mj.cli.tables import NAVIGATED, results_table
from swarm_mj.errors import ScenarioError
from swarm_mj.flight.fly import make_simulation
from swarm_mj.flight.optical import WILD, OpticalNavigator, first_sigmas, known_attitude
from swarm_mj.flight.optical_covariance import DrawnKnowledge, known_at_arrivals
from swarm_mj.flight.plan import make_plan
from swarm_mj.records.summary_schema import RunSummary
from swarm_mj.scenarios.loading import load_scenario
from swarm_mj.scenarios.schema_sensors import Sensors
from swarm_mj.simulator.telemetry import position_covariance

#: A body of which nobody says how it reflects light.
OTHER = {
    "navigation.mode": "optical",
    "body.shape": "ellipsoid",
    "body.semi_axes_m": [9e3, 6e3, 6e3],
    "body.gravity.model": "point_mass",
    "body.gravity.parameters": {"gm": 4e5},
}
#: Bennu from 3 km, on its day side, by a camera that has it wholly in view; a flight of some minutes.
CASE = {
    "duration_s": 600,
    "camera.half_angle_deg": 8.0,
    "camera.resolution_px": 256,
    "navigation.mode": "optical",
    "navigation.optical.interval_s": 120,
    "navigation.optical.interval_share": 1.0,
    "spacecraft.sensors": "ideal",
}


@pytest.fixture(scope="module")
def flight():
    return sm.fly("bennu-slow", CASE)


def errors(telemetry):
    return np.linalg.norm((telemetry["r_BN_N_estimate"] - telemetry["r_BN_N"]).values, axis=2)


def widest(telemetry):
    """Standard deviation along the widest axis [m], shape (t, n)."""
    return np.sqrt(np.linalg.eigvalsh(position_covariance(telemetry))[..., -1])


def test_pictures_tell_where_the_spacecraft_are(flight):
    off, sigma = errors(flight.telemetry), widest(flight.telemetry)
    observers = slice(0, flight.plan.n_observers)
    assert off[0, observers].min() > 3.0
    assert off[-1, observers].max() < 0.2 * off[0, observers].min()
    assert (off[-1, observers] < 5.0 * sigma[-1, observers]).all()
    # Who takes no pictures knows what it knew.
    assert off[-1, -1] > 0.3 * off[0, -1] and sigma[-1, -1] >= 0.99 * sigma[0, -1]


def test_what_is_known_grows_old_between_pictures(flight):
    """The relay takes none: its errors grow by those of its velocity, within a percent of gravity's part."""
    telemetry, plan = flight.telemetry, flight.plan
    start = telemetry["r_BN_N"].values[:1, -1], telemetry["v_BN_N"].values[:1, -1]
    sigma, t = first_sigmas(plan.scenario.navigation.optical, *start)[0], telemetry["time"].values
    expected = np.sqrt(sigma[0] ** 2 + (sigma[3] * t) ** 2)
    assert expected[-1] > 1.3 * expected[0]
    assert telemetry["r_BN_N_sigma"].values[:, -1] == pytest.approx(np.tile(expected, (3, 1)).T, rel=0.01)


def test_who_points_uses_what_is_known(flight):
    # At the end of the approach the camera looks where the body is thought to be.
    telemetry, k = flight.telemetry, 50
    known, true = telemetry["r_BN_N_estimate"].values[k, 0], telemetry["r_BN_N"].values[k, 0]
    los = telemetry["line_of_sight_N"].values[k, 0]
    assert (
        np.linalg.norm(los + known / np.linalg.norm(known))
        < 1e-3 * np.linalg.norm(los + true / np.linalg.norm(true)) + 1e-5
    )
    plain = sm.fly("bennu-slow", {**CASE, "navigation.mode": "assumed"})
    assert "r_BN_N_estimate" not in plain.telemetry and "optical" not in plain.summary


def test_the_flight_tells_what_became_of_its_pictures(flight):
    told = flight.summary["optical"]
    records = json.loads(flight.telemetry.attrs["navigation"])
    assert sum(told["used"].values()) + sum(one["count"] for one in told["not_used"]) == len(records) >= 9
    assert set(told["used"]) <= {"centroid", "limb", "landmarks"}
    assert told["position_error_m_arrival"]["sc1"] < told["position_error_m_largest"]
    assert any("navigation by pictures" in words for words in flight.findings)
    RunSummary.model_validate(json.loads(json.dumps(flight.summary)))
    row = list(results_table([flight.summary]).columns[0].cells).index(NAVIGATED.replace("[m]", r"\[m]"))
    shown = list(results_table([flight.summary]).columns[1].cells)[row]
    assert shown == "; ".join(f"{max(told[f'position_{key}_m_arrival'].values()):.3g}" for key in ("error", "3_sigma"))


def test_late_pictures_are_known_later_and_ranges_bind_the_swarm(flight):
    changes = {"navigation.optical.delay_s": 90, "navigation.optical.range_m": 1.0}
    late = sm.fly("bennu-slow", {**CASE, **changes})
    sigma, times = widest(late.telemetry), late.telemetry["time"].values
    # The first pictures are taken when there is a target, 120 s after the start.
    assert sigma[times < 205, 0].min() > 0.9 * sigma[0, 0] and sigma[times > 215, 0].max() < 0.5 * sigma[0, 0]
    records = json.loads(late.telemetry.attrs["navigation"])
    assert {one["kind"] for one in records} >= {"range"} and "sc1-sc2" in {one["spacecraft"] for one in records}
    # The relay, which takes no pictures, knows its distances to those that do.
    alone, bound = (np.linalg.norm(one.telemetry["r_BN_N_sigma"].values[-1, -1]) for one in (flight, late))
    assert bound < 0.7 * alone
    assert errors(late.telemetry)[-1, -1] < 5.0 * sigma[-1, -1]


def test_corrections_burn_by_what_is_known():
    case = {
        **CASE,
        "trajectory.corrections": [{"before_arrival_s": 300}],
        "spacecraft.thrusters": {},
        "dispersions.deployment_velocity_m_s": 0.02,
        "seed": 3,
    }
    flight = sm.fly("bennu-slow", case)
    uncorrected = sm.fly("bennu-slow", {**case, "trajectory.corrections": [], "navigation.mode": "assumed"})
    miss, before = (each.summary["arrival_miss_mm"] for each in (flight, uncorrected))
    assert np.mean([miss[f"sc{j}"] for j in (1, 2, 3)]) < 0.5 * np.mean([before[f"sc{j}"] for j in (1, 2, 3)])
    found = sm.navigate("bennu-slow", case, optical=True)
    expected = found.table["position_3_sigma_m"].xs(1, level="corrections")
    assert 1e-3 * max(miss[f"sc{j}"] for j in (1, 2, 3)) < 1.5 * expected[["sc1", "sc2", "sc3"]].max()
    assert found.summary["known_3_sigma_m"]["sc1"] < 5.0
    assert any("pictures on the way" in words for words in found.findings)


def test_where_a_burn_has_carried_the_spacecraft_is_known_before_the_next_picture():
    case = {
        **CASE,
        "trajectory.corrections": [{"before_arrival_s": 280}],
        "spacecraft.thrusters": {},
        "dispersions.deployment_velocity_m_s": 0.02,
        "seed": 3,
        "navigation.optical.interval_s": 200,
        "navigation.optical.interval_share": 0.5,
    }
    flight = sm.fly("bennu-slow", case)
    assert flight.telemetry["delta_v_m_s"].values[-1, :2].min() > 0.03
    assert max(flight.summary["optical"]["nees_per_component_arrival"].values()) < 6.0
    # Pictures after the burn agree with what was believed.
    assert all(one["why"] != WILD for one in json.loads(flight.telemetry.attrs["navigation"]))


def test_beforehand_pictures_that_poor_knowledge_cannot_match_tell_nothing():
    """Itokawa's first observer believes to be 100 m elsewhere, and sees other ground: a flight finds nothing either."""
    found = sm.navigate("itokawa-slow", optical=True)
    assert not found.found.pictures[0] and sum(found.found.pictures[1].values()) >= 5
    known = found.summary["known_3_sigma_m"]
    assert known["sc1"] > 200.0 and known["sc2"] < 2.0  # flown: 233 m and 0.9 m
    ranged = sm.navigate("bennu-slow", {**CASE, "navigation.optical.range_m": 1.0}, optical=True)
    assert any("navigation.optical.range_m) are left out" in words for words in ranged.findings)


def test_designs_allow_for_what_pictures_will_tell(flight):
    """The covariance at the arrivals against the errors of a flight by pictures; and draws of it against itself."""
    plan, n = flight.plan, flight.plan.n_observers
    known = known_at_arrivals(plan)
    arrival_s, times = plan.deployment.arrival_s, flight.telemetry["time"].values
    assert np.allclose(arrival_s, times[-1])
    off = (flight.telemetry["r_BN_N_estimate"] - flight.telemetry["r_BN_N"]).values[-1, :n]
    size = np.einsum("nk,nk->n", off, np.linalg.solve(known[:n, :3, :3], off[..., None])[..., 0])
    assert 0.3 < size.sum() < 30.0  # chi-square of nine
    said = np.sqrt(np.linalg.eigvalsh(known[:n, :3, :3])[:, -1]) / widest(flight.telemetry)[-1, :n]
    assert 0.92 < said.min() and said.max() < 1.1  # cameras do not point at the body when they are released
    simulation = make_simulation(plan, navigator=DrawnKnowledge(known, arrival_s, 0))
    drawn = []
    for seed in range(600):
        DrawnKnowledge(known, arrival_s, seed).reset(simulation)
        drawn.append(simulation.state.known()[0][0] - simulation.state.r_N[0])
    # At the epoch velocities have grown for as long as it is to the arrival.
    back = np.hstack((np.eye(3), -arrival_s[0] * np.eye(3)))
    expected = back @ known[0] @ back.T
    share = np.linalg.eigvals(np.linalg.solve(expected, np.cov(np.array(drawn).T))).real
    assert 0.75 < share.min() and share.max() < 1.3


def test_what_is_known_at_first_goes_with_the_distance():
    asked = load_scenario("eros-config2").navigation.optical
    sigma = first_sigmas(
        asked, np.array([[3e4, 0.0, 0.0], [1e9, 0.0, 0.0]]), np.array([[5.0, 0.0, 0.0], [7e3, 0.0, 0.0]])
    )
    assert np.allclose(sigma[0], [300.0] * 3 + [0.05] * 3) and np.allclose(sigma[1], [1e5] * 3 + [0.1] * 3)


def test_what_cannot_be_is_refused():
    with pytest.raises(ScenarioError, match=r"body\.photometry = null: pictures need"):
        sm.fly("eros-quick", OTHER)
    with pytest.raises(ScenarioError, match="runs = 100"):
        sm.navigate("bennu-slow", runs=100, optical=True)
    with pytest.raises(ScenarioError, match=r"navigation\.mode"):
        load_scenario("eros-quick", {"navigation.mode": "visual"})
    make_plan(load_scenario("eros-quick"))


@pytest.mark.parametrize("walk", [0.15, 1.5])
def test_attitudes_err_as_their_filters_say(walk, monkeypatch):
    seen = []
    honest = OpticalNavigator._known_attitudes

    def watched(self, simulation):
        q_BN, sigma = honest(self, simulation)
        true = Rotation.from_quat(simulation.state.q_BN, scalar_first=True)
        off = (true.inv() * Rotation.from_quat(q_BN, scalar_first=True)).as_rotvec()
        released = np.flatnonzero(simulation.state.released)
        if simulation.time > 60.0:
            seen.extend((off / sigma[:, None])[released].ravel())
        return q_BN, sigma

    monkeypatch.setattr(OpticalNavigator, "_known_attitudes", watched)
    changes = {
        **CASE,
        "spacecraft.sensors": {"gyro_angular_random_walk_deg_sqrt_h": walk, "star_tracker_bias_arcsec": 0.0},
        "navigation.optical.interval_s": 5,
        "navigation.optical.methods": ["centroid"],
        "camera.resolution_px": 64,
        "physics.stepper": "kernel",
    }
    sm.fly("bennu-slow", changes)
    assert len(seen) > 500 and 0.85 < np.sqrt(np.mean(np.square(seen))) < 1.15


def test_attitudes_that_settle_err_as_scalar_theory_says():
    # Without a bias that walks: p^2 = q (p + r), p before and q between readings, r of the tracker.
    sensors = Sensors(gyro_rate_random_walk_deg_h_sqrt_h=0.0, gyro_angular_random_walk_deg_sqrt_h=0.6)
    q, r = 0.6**2 * 60.0**2 * 0.5, 25.0**2
    p = 0.5 * (q + np.sqrt(q * q + 4.0 * q * r))
    after = np.sqrt(p * r / (p + r))
    assert 3600.0 * np.degrees(known_attitude(sensors, 0.5)) == pytest.approx(after, rel=1e-3)
    assert known_attitude(Sensors(star_tracker_noise_arcsec=0.0), 0.5) == 0.0


def test_cameras_that_are_pointed_by_poor_knowledge_lose_the_body():
    # By the draw of this seed the first looks beside the body, and the second at it.
    known = known_at_arrivals(make_plan(load_scenario("itokawa-slow", {"navigation.mode": "optical", "seed": 1})))
    widest = np.sqrt(np.linalg.eigvalsh(known[:, :3, :3])[:, -1])
    assert widest[0] > 30.0 > 3.0 > widest[1]


def test_summaries_with_long_reasons_are_read_again(flight):
    summary = json.loads(json.dumps(flight.summary))
    summary["optical"]["not_used"] = [{"why": "limb: the fit does not settle; " * 20, "count": 3}]
    assert RunSummary.model_validate(summary).optical.not_used[0].count == 3
    found = sm.navigate("bennu-slow", CASE, optical=True)
    assert any("pictures on the way that tell something" in words for words in found.findings)
