"""Own targets, altitudes, times of flight and releases: flown as asked; and refused with reasons."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from swarm_mj.errors import MissionError, ScenarioError
from swarm_mj.figures.histories import compose_pointing_error
from swarm_mj.flight.fly import simulate
from swarm_mj.flight.observe import observe_flight, picture_count, schedule_from
from swarm_mj.flight.plan import make_plan
from swarm_mj.mission.deployer import check_deployer
from swarm_mj.records.modes import ABOARD, held_s, modes_shown
from swarm_mj.records.summary import summarise
from swarm_mj.scenarios.loading import load_scenario
from swarm_mj.scenarios.schema_mothership import Deployer

BALL = {
    "name": "Ball",
    "shape": "ellipsoid",
    "semi_axes_m": [9e3, 7e3, 6e3],
    # A point mass; in a series, which compiled code knows.
    "gravity": {
        "model": "spherical_harmonics",
        "parameters": {"gm": 4e5, "reference_radius_m": 9e3, "coefficients": [[0, 0, 1.0, 0.0]]},
    },
}
OBSERVERS = [
    {"visiting_point": 3},
    {"visiting_point": 5, "imaging_altitude_m": 9e3, "time_of_flight_s": 200, "release_s": 40},
    {"target": 1, "visiting_point": 2, "time_of_flight_s": 300, "release_s": 70},
]
DATA = {
    "name": "itinerary",
    "duration_s": 400,
    "body": BALL,
    "target": {"longitude_deg": 90, "half_angle_deg": 15},
    "designer": {"extra_targets": [{"latitude_deg": -30, "longitude_deg": 20, "half_angle_deg": 10}]},
    "design": {"imaging_altitude_m": 12e3, "time_of_flight_s": 250, "observers": OBSERVERS},
    "mothership": {"position_A_m": [0, 5e3, -25e3], "velocity": [1.0, 20.0, 60.0]},
    "camera": {"resolution_px": 64},
    "observation": {"observer": "horizon"},
    "telemetry": {"interval_s": 10},
    # Turns who has left, and nobody aboard.
    "perturbations": {"gravity_gradient_torque": True},
}


def scenario(**sections):
    return load_scenario({**DATA, **{k: {**DATA.get(k, {}), **v} for k, v in sections.items()}})


@pytest.fixture(scope="module")
def plan():
    return make_plan(scenario())


@pytest.fixture(scope="module")
def telemetry(plan):
    return simulate(plan)


@pytest.fixture(scope="module")
def seen(plan, telemetry):
    return observe_flight(plan, telemetry)


def coasting(plan, until):
    """The mothership by another integrator: its place and velocity."""

    def rates(t, y):
        return np.concatenate((y[3:], -4e5 * y[:3] / np.linalg.norm(y[:3]) ** 3))

    start = np.concatenate((plan.deployment.r0_N, plan.deployment.mothership_velocity_N))
    found = solve_ivp(rates, (0.0, until), start, method="LSODA", rtol=1e-12, atol=1e-9).y[:, -1]
    return found[:3], found[3:]


def test_aboard_a_spacecraft_is_where_the_mothership_coasts_and_does_nothing(plan, telemetry):
    for j, release in ((1, 40.0), (2, 70.0)):
        k = int(release / 10)
        r, v = coasting(plan, release)
        assert np.allclose(plan.deployment.release_r_N[j], r, atol=1e-6)
        assert np.allclose(plan.deployment.release_mothership_v_N[j], v, atol=1e-9)
        assert np.allclose(telemetry["r_BN_N"].values[k, j], r, atol=1e-3)
        assert np.array_equal(telemetry["released"].values[:, j], telemetry["time"].values >= release)
        aboard = slice(0, k)
        assert not telemetry["wheel_torque"].values[aboard, j].any()
        assert np.abs(telemetry["sigma_BN"].values[aboard, j] - telemetry["sigma_BN"].values[0, j]).max() < 1e-6
        assert not telemetry["link_closed"].values[aboard, j].any()
        push = telemetry["v_BN_N"].values[k, j] - v
        assert np.linalg.norm(push) == pytest.approx(plan.deployment.delta_v[j], rel=1e-6)
        rates = np.abs(telemetry["omega_BN_B"].values[:, j]).max(axis=1)
        assert rates[k - 1] < 1e-6 < rates[k]


def test_each_is_above_its_own_vertex_of_its_own_target_at_its_own_time(plan, telemetry):
    for j, (target, point, altitude, arrival) in enumerate(
        ((0, 3, 12e3, 250.0), (0, 5, 9e3, 240.0), (1, 2, 12e3, 370.0))
    ):
        part = plan.region.targets[target]
        ground = plan.shape.vertices[part.visiting_vertex[point - 1]]
        wanted_A = ground * (1.0 + altitude / np.linalg.norm(ground))
        flown_N = telemetry["r_BN_N"].values[int(arrival / 10), j]
        assert np.linalg.norm(plan.environment.C_AN(arrival) @ flown_N - wanted_A) < 0.05


def test_the_kernel_lets_go_and_turns_who_has_left_as_mujoco_does(telemetry):
    other = simulate(make_plan(scenario(physics={"stepper": "kernel"})))
    assert other.attrs["stepper"] == "kernel"
    for name, most in (("r_BN_N", 1e-8), ("v_BN_N", 1e-10), ("omega_BN_B", 1e-8)):
        assert np.abs(other[name].values - telemetry[name].values).max() < most


def test_the_whole_is_the_union_of_the_targets_and_each_is_counted(plan, telemetry, seen):
    region = plan.region
    first, second = region.targets
    assert region.n_cells == len(np.union1d(first.target, second.target))
    assert np.array_equal(region.target[region.cells_of(1)], second.target)
    found = summarise(plan, telemetry, seen, {})
    share = [
        seen.coverage.seen[region.cells_of(k)] @ part.area / part.total_area for k, part in enumerate(region.targets)
    ]
    assert found["coverage_percent_by_target"] == pytest.approx(100 * np.array(share), abs=1e-5)
    assert found["itinerary"]["sc3"]["arrival_s"] == 370.0
    assert max(found["arrival_miss_mm"].values()) < 50.0


def test_pictures_of_the_arrival_are_each_ones_own(plan, telemetry):
    schedule = schedule_from(scenario(observation={"criterion": "arrival"}), 10.0)
    assert schedule.arrivals == (25, 24, 37)
    assert schedule.takers(24, 4).tolist() == [False, True, False, False]
    assert schedule.ticks(40).tolist() == [24, 25, 37]
    # Every 10 s, by three observers from their releases on while they look at the body, and no more at the arrivals.
    body = telemetry["mode"].values[:, :3] == 0
    assert picture_count(plan, telemetry) == int((body & (telemetry["released"].values[:, :3] == 1)).sum())


def test_overlapping_targets_count_their_common_area_once():
    twice = {"designer": {"extra_targets": [{"latitude_deg": 0, "longitude_deg": 95, "half_angle_deg": 15}]}}
    region = make_plan(scenario(**twice)).region
    first, second = region.targets
    assert region.total_area < first.total_area + second.total_area
    common = np.intersect1d(first.target, second.target)
    assert region.total_area == pytest.approx(
        first.total_area + second.total_area - region.mesh.face_areas[common].sum(), rel=1e-12
    )


def test_what_the_deployer_cannot_do_is_refused_by_name(plan):
    speed = plan.deployment.delta_v
    worst = int(np.argmax(speed)) + 1
    with pytest.raises(MissionError, match=rf"sc{worst} is released at .*max_speed_m_s = 1 is the most"):
        make_plan(scenario(mothership={"deployer": {"max_speed_m_s": 1.0, "beyond_max_speed": "refused"}}))
    enough = {"max_speed_m_s": float(speed.max()) + 1e-3, "beyond_max_speed": "refused"}
    make_plan(scenario(mothership={"deployer": enough}))
    push = plan.deployment.v0_N[0] - plan.deployment.release_mothership_v_N[0]
    with pytest.raises(
        MissionError, match="deg off cone_axis_N: mothership.deployer.cone_half_angle_deg = 1 is the most"
    ):
        make_plan(scenario(mothership={"deployer": {"cone_axis_N": push.tolist(), "cone_half_angle_deg": 1}}))
    # Every push by another formula: the cone that just holds all, and one that does not hold the farthest.
    pushes = plan.deployment.v0_N - plan.deployment.release_mothership_v_N
    off = np.degrees(np.arccos(pushes @ push / np.linalg.norm(pushes, axis=1) / np.linalg.norm(push)))
    cone = {"cone_axis_N": push.tolist()}
    check_deployer(Deployer(**cone, cone_half_angle_deg=off.max() + 0.01), plan.deployment, None)
    with pytest.raises(MissionError, match=f"sc{np.argmax(off) + 1} is released"):
        check_deployer(Deployer(**cone, cone_half_angle_deg=off.max() - 0.01), plan.deployment, None)
    with pytest.raises(
        MissionError, match="sc4 is released 0 s after sc1: mothership.deployer.spacing_s = 20 is the least"
    ):
        make_plan(scenario(mothership={"deployer": {"spacing_s": 20}}))


@pytest.mark.parametrize(
    ("design", "words"),
    [
        ({"observers": [{"target": 2, "visiting_point": 1}]}, "observers.0.target = 2"),
        ({"observers": [{"target": 1}]}, "observers.0.visiting_point: must be given"),
        ({"observers": [{"visiting_point": 1, "release_s": 3}]}, "observers.0.release_s = 3: must be a whole multiple"),
        ({"observers": [{"visiting_point": 1, "release_s": 380}]}, "must not end before design.observers.0.release_s"),
        ({"observers": [{"visiting_point": 1}], "visiting_points": [1, 2]}, "observers: has 1 entries"),
        ({"observers": [{"visiting_point": 3}], "visiting_points": [1]}, "observers.0.visiting_point = 3: must be 1"),
    ],
)
def test_entries_that_do_not_fit_are_refused_by_name(design, words):
    with pytest.raises(ScenarioError, match=words):
        scenario(design=design)


def test_the_communications_spacecraft_goes_with_observers_none_of_which_flies_at_the_common_times():
    late = {"release_s": 40, "time_of_flight_s": 200}
    observers = [{"visiting_point": 3, **late}, {"visiting_point": 5, **late}, {"visiting_point": 2, "release_s": 10}]
    deployment = make_plan(scenario(design={"observers": observers}, designer={"extra_targets": []})).deployment
    assert (deployment.release_s[-1], deployment.arrival_s[-1]) == (40.0, 240.0)
    observers[2] = {"visiting_point": 2}
    deployment = make_plan(scenario(design={"observers": observers}, designer={"extra_targets": []})).deployment
    assert (deployment.release_s[-1], deployment.arrival_s[-1]) == (0.0, 250.0)


def test_statistics_and_modes_begin_at_the_release(plan, telemetry, seen):
    found = summarise(plan, telemetry, seen, {})
    switched = telemetry["mode"].copy()
    switched.values[2, 2] = 1 - switched.values[2, 2]  # aboard; what is tracked there is no switch of the flight
    doctored = telemetry.assign(mode=switched)
    again = summarise(plan, doctored, seen, {})
    assert again["mode_switches"]["sc3"] == found["mode_switches"]["sc3"]
    shown = modes_shown(telemetry)
    assert (shown[:7, 2] == ABOARD).all() and (shown[7:, 2] == telemetry["mode"].values[7:, 2]).all()
    assert (shown[:, 0] == telemetry["mode"].values[:, 0]).all()
    assert held_s(telemetry)[7, 2] == 0.0
    figure = compose_pointing_error(plan, telemetry, seen)
    lines = [ax.lines[0] for ax in figure.axes if ax.lines and len(ax.lines[0].get_ydata()) == telemetry.sizes["time"]]
    gaps = [int(np.isnan(line.get_ydata()).sum()) for line in lines]
    assert gaps == [0, 4, 7, 0]
