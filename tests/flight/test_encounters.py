"""Encounters as they were flown: the body tracked past 8.6 km/s with a second axis, and pictures by a table."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import swarm_mj as sm
from swarm_mj.errors import ScenarioError
from swarm_mj.flight.encounter_table import encounter_of
from swarm_mj.flight.fly import simulate
from swarm_mj.flight.observe import flight_pictures, observe_flight, sequence_of
from swarm_mj.flight.plan import make_plan
from swarm_mj.mission.behaviors import TargetKind
from swarm_mj.observation.camera import motion_blur_px
from swarm_mj.spacecraft.mounting import nominal_mount

SPEED, MISS = 8600.0, 802_600.0
CLOSEST = 200.0
ENCOUNTER = {
    "name": "encounter",
    "epoch": "2008-09-05T18:35:00Z",
    "duration_s": 400,
    "body": {
        "shape": "ellipsoid",
        "semi_axes_m": [3300, 2900, 2200],
        "gravity": {"model": "point_mass", "parameters": {"gm": 6000}},
    },
    "target": {"region": "body"},
    "initial_states": [
        {
            "approach": {
                "v_infinity_m_s": SPEED,
                "closest_approach": "2008-09-05T18:38:20Z",
                "distance_m": MISS,
                "phase": {"approach_deg": 38.6, "least_deg": 0.27},
            }
        }
    ],
    "behavior": {"name": "body_tracking"},
    "camera": {"half_angle_deg": 1.0, "resolution_px": 1024, "exposure_s": 0.1},
    "observation": {"min_pixels": 0, "observer": "raster"},
    "spacecraft": {"sensors": "ideal", "initial_rate_range_rpm": 0},
    "telemetry": {"interval_s": 1},
}


def plan_of(**changes):
    return make_plan(sm.load(ENCOUNTER, {key.replace("__", "."): value for key, value in changes.items()}))


def attitudes(telemetry):
    return Rotation.from_mrp(telemetry["sigma_BN"].values[:, 0])


AXIS = [0.0, 1.0, 0.0]
APPROACH = ENCOUNTER["initial_states"][0]["approach"]


@pytest.mark.parametrize("boresight", [(0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (0.3, -0.5, 0.6)])
def test_the_camera_follows_the_body_and_the_second_axis_the_sun(boresight):
    plan = plan_of(
        control__second_axis={"axis_B": AXIS, "towards": "sun"},
        camera__boresight_B=boresight,
        control__period_s=0.1,
        # The Sun stays 40 deg from the line of sight.
        initial_states=[{"approach": {**APPROACH, "phase": {"approach_deg": 70, "least_deg": 40}}}],
    )
    telemetry = simulate(plan)
    t, turned = telemetry["time"].values, attitudes(telemetry)
    tracked = t > 150.0
    line = -telemetry["r_BN_N"].values[:, 0]
    line /= np.linalg.norm(line, axis=1, keepdims=True)
    looks = turned.apply(nominal_mount(boresight)[2])
    error = np.degrees(np.linalg.norm(np.cross(looks, line), axis=1))
    assert error[tracked].max() < 0.01
    assert np.degrees(telemetry["pointing_error"].values[tracked, 0]).max() == pytest.approx(
        error[tracked].max(), abs=1e-6
    )
    sun = np.array([plan.environment.sun.at(float(one)) for one in t])
    sun /= np.linalg.norm(sun, axis=1, keepdims=True)
    # The plane of line of sight and Sun holds what the pointing leaves of the axis.
    side = np.cross(line, sun)
    clear = tracked & (np.linalg.norm(side, axis=1) > 0.2)
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    axis = turned.apply(AXIS)
    assert clear.sum() > 100
    assert np.degrees(np.abs(np.einsum("ij,ij->i", side, axis)))[clear].max() < 0.02
    assert (np.einsum("ij,ij->i", axis - np.einsum("ij,ij->i", axis, line)[:, None] * line, sun) > 0.0)[clear].all()


def test_the_peak_rate_is_speed_over_distance():
    telemetry = simulate(plan_of(control__period_s=0.1))
    rates = np.linalg.norm(telemetry["omega_BN_B"].values[:, 0], axis=1)
    late = telemetry["time"].values > 100.0
    assert rates[late].max() == pytest.approx(SPEED / MISS, rel=1e-3)
    assert telemetry["time"].values[late][np.argmax(rates[late])] == pytest.approx(CLOSEST, abs=2.0)


def test_both_steppers_turn_to_the_second_axis_alike():
    made = {"control__second_axis": {"axis_B": AXIS, "towards": "velocity"}, "camera__boresight_B": [1, 0, 0]}
    own, mujoco = (
        simulate(plan_of(**made, physics__stepper=stepper, duration_s=300)) for stepper in ("kernel", "mujoco")
    )
    np.testing.assert_allclose(own["sigma_RN"].values, mujoco["sigma_RN"].values, rtol=0, atol=1e-9)
    np.testing.assert_allclose(own["sigma_BN"].values[-100:], mujoco["sigma_BN"].values[-100:], rtol=0, atol=1e-5)


TRIPLETS = [150, 151, 152, 200.4, {"time": "2008-09-05T18:38:30Z", "exposure_s": 0.02}, 211]


def test_pictures_of_a_table_are_taken_and_no_others():
    plan = plan_of(observation__sequence=TRIPLETS)
    telemetry = simulate(plan)
    taken = list(flight_pictures(plan, telemetry))
    assert [picture.t for picture in taken] == [150.0, 151.0, 152.0, 200.0, 210.0, 211.0]
    short, long = taken[4:]
    assert (short.exposure_s, long.exposure_s) == (0.02, None)
    result = observe_flight(plan, telemetry)
    assert result.images == 6
    times = result.coverage.first_seen_by_s[0]
    assert set(times[~np.isnan(times)]) <= {150.0, 151.0, 152.0, 200.0, 210.0, 211.0}


def test_a_picture_of_a_table_blurs_by_its_own_exposure():
    from swarm_mj.flight.observe import camera_from

    plan = plan_of(observation__sequence=TRIPLETS, duration_s=300)
    short = list(flight_pictures(plan, simulate(plan)))[4]
    camera = camera_from(plan.scenario)
    region = plan.region
    blurs = [
        motion_blur_px(region, camera, short.r_A, short.C_CA, short.motion._replace(exposure_s=exposure))
        for exposure in (short.exposure_s, None)
    ]
    np.testing.assert_allclose(5.0 * blurs[0], blurs[1])


def test_of_two_spacecraft_each_takes_the_pictures_of_its_own():
    other = {**APPROACH, "distance_m": 900_000.0}
    states = [*ENCOUNTER["initial_states"], {"approach": other}]
    sequence = [{"time": 150, "spacecraft": 2}, {"time": 160, "spacecraft": 1}, 170]
    plan = plan_of(initial_states=states, observation__sequence=sequence, duration_s=250)
    assert sorted((t, who) for who, t, _ in sequence_of(plan.scenario)) == [(150, 1), (160, 0), (170, 0), (170, 1)]
    taken = [(picture.t, picture.spacecraft) for picture in flight_pictures(plan, simulate(plan))]
    assert taken == [(150.0, 1), (160.0, 0), (170.0, 0), (170.0, 1)]


@pytest.mark.parametrize(
    ("sequence", "says"),
    [
        ([500], r"sequence.0.time = 500.0: is 500 s past the epoch; must be 0 to duration_s = 400"),
        (["2008-09-05T18:34:00Z"], r"sequence.0.time = .*: is -60 s past"),
        ([10, 10.2], r"sequence.1.time = 10.2: falls on the sample of the telemetry of observation.sequence.0"),
        ([{"time": 10, "spacecraft": 1}, 10], "falls on the sample"),
        ([10, {"time": 10, "spacecraft": 1}], "falls on the sample"),
        ([{"time": 10, "spacecraft": 2}], r"sequence.0.spacecraft = 2: must be an observer, from 1 to 1"),
        (["soon"], "must be a date and time"),
        ([{"time": 10, "exposure": 1}], "unknown key"),
        ([{"time": 10, "exposure_s": -1}], "exposure_s"),
    ],
)
def test_a_table_that_cannot_be_flown_is_refused_by_its_key(sequence, says):
    with pytest.raises(ScenarioError, match=says):
        sm.load(ENCOUNTER, {"observation.sequence": sequence})


def test_a_table_is_read_from_a_file_beside_the_scenario(tmp_path):
    (tmp_path / "p.csv").write_text("time, exposure_s, spacecraft\n150,,\n2008-09-05T18:38:30Z,0.02,1\n")
    scenario = sm.load(ENCOUNTER, {"observation.sequence": str(tmp_path / "p.csv")})
    assert list(sequence_of(scenario)) == [(0, 150.0, None), (0, 210.0, 0.02)]


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("when\n1\n", "has the columns when; must be time"),
        ("time,exposure_s\n1\n", "line 2: must have 2 values"),
        ("time,exposure_s\n1,2,3\n", "line 2: must have 2 values"),
        ("time,exposure_s\n1,long\n", "line 2, exposure_s = 'long': must be a number"),
        ("time,spacecraft\n1,1.5\n", "line 2, spacecraft = '1.5': must be a whole number"),
        ("time\n", "has no pictures"),
        ("", "has the columns none"),
        ("time\nnan\n", "nan"),
        ("time\n" + "1\n" * 600_000, "larger|at most|MB"),
        ("time\n" + "1\n" * 10_001, "10000"),
    ],
)
def test_a_file_that_is_no_table_is_refused_with_its_line(tmp_path, text, says):
    (tmp_path / "p.csv").write_text(text)
    with pytest.raises(ScenarioError, match=says):
        sm.load(ENCOUNTER, {"observation.sequence": str(tmp_path / "p.csv")})


def test_swarms_that_plan_their_pictures_refuse_a_table():
    with pytest.raises(ScenarioError, match=r"observation.sequence: a swarm that plans its pictures"):
        encounter_of(plan_of(observation__sequence=[10]))


def test_after_its_tracking_a_spacecraft_holds_where_the_body_was_or_turns_to_earth():
    for then, kind in (("hold", TargetKind.DIRECTION), ("earth", TargetKind.EARTH), ("body", TargetKind.ASTEROID)):
        plan = plan_of(behavior__parameters={"until_s": 160, "then": then}, duration_s=260)
        telemetry = simulate(plan)
        mode, t = telemetry["mode"].values[:, 0], telemetry["time"].values
        assert (mode[t < 160] == TargetKind.ASTEROID).all()
        assert (mode[t >= 160] == kind).all()
        if then == "hold":
            line = telemetry["line_of_sight_N"].values[t >= 160, 0]
            r = telemetry["r_BN_N"].values[t == 160, 0][0]
            np.testing.assert_allclose(line, np.broadcast_to(-r / np.linalg.norm(r), line.shape), atol=1e-12)


@pytest.mark.parametrize(
    ("parameters", "says"),
    [
        ({"until_s": -1}, "until_s = -1"),
        ({"then": "moon"}, "then = 'moon': must be hold, earth or body"),
        ({"bus": "sun"}, "bus = 'sun': must be body, velocity"),
        ({"bus": [0, 0, 0]}, "must be three finite numbers, not all zero"),
    ],
)
def test_a_behaviour_that_cannot_be_is_refused_by_its_key(parameters, says):
    with pytest.raises(Exception, match=says):
        plan_of(behavior__parameters=parameters)
