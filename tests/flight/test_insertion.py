"""Deployers that are too slow: thrusters give the rest, and the point is reached."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from swarm_mj.designer.candidates.flights import fly_candidates
from swarm_mj.errors import PathError, ScenarioError
from swarm_mj.flight.burns import check_burns, push_of
from swarm_mj.flight.fly import simulate
from swarm_mj.flight.plan import make_plan
from swarm_mj.mission.deployment import planned_paths
from swarm_mj.mission.trajectories import PlannedBurn
from swarm_mj.records.summary import arrival_miss_m
from swarm_mj.scenarios.loading import load_scenario, parse_overrides

SLOW = "mothership.deployer={max_speed_m_s: 0.5, insertion_after_s: 40}"
REFUSED = "mothership.deployer.beyond_max_speed=refused"
SMALL = "spacecraft.thrusters={thrust_n: 0.5, propellant_kg: 0.01}"
CORRECTED = "trajectory.corrections=[{before_arrival_s: 60}]"
STRONG = "spacecraft.thrusters={thrust_n: 0.5, propellant_kg: 1.0, min_impulse_bit_n_s: 0}"


def plan_of(*keys):
    return make_plan(load_scenario("eros-quick", parse_overrides(["duration_s=620", *keys])))


@pytest.fixture(scope="module")
def slow():
    return plan_of(SLOW, STRONG)


def test_the_deployer_gives_its_most_and_the_burn_begins_after_its_delay(slow):
    free, given = plan_of().deployment, slow.deployment
    assert given.delta_v == pytest.approx([0.5, 0.5]) and len(given.burns) == 2
    for j, burn in enumerate(given.burns):
        wanted, push = (d.v0_N[j] - d.release_mothership_v_N[j] for d in (free, given))
        assert np.cross(wanted, push) == pytest.approx(np.zeros(3), abs=1e-9) and wanted @ push > 0.0
        speed, exhaust = float(np.linalg.norm(burn.delta_v_N)), 65.0 * 9.80665
        lasts = 8.0 * (1.0 - np.exp(-speed / exhaust)) * exhaust / 0.5
        assert burn.t == pytest.approx(40.0 + 0.5 * lasts)
        # What the deployer lacks, and more for the way that was lost until then.
        assert 1.0 < speed / (np.linalg.norm(wanted) - 0.5) < 600.0 / (600.0 - burn.t) * 1.05


def test_an_independent_integration_of_the_burn_leads_to_the_point(slow):
    deployment, exhaust = slow.deployment, 65.0 * 9.80665
    times = np.linspace(0.0, 600.0, 61)
    paths = planned_paths(slow.environment.acceleration_N, deployment, times)[0]
    for burn in deployment.burns:
        j, speed = burn.spacecraft, np.linalg.norm(burn.delta_v_N)
        lasts = 8.0 * (1.0 - np.exp(-speed / exhaust)) * exhaust / 0.5
        begin = burn.t - 0.5 * lasts

        def rhs(t, y, direction=burn.delta_v_N / speed, begin=begin, end=begin + lasts):
            push = 0.5 * direction / y[6] if begin <= t < end else np.zeros(3)
            flow = -0.5 / exhaust if begin <= t < end else 0.0
            return [*y[3:6], *(slow.environment.acceleration_N(t, y[None, :3])[0] + push), flow]

        y0 = [*deployment.r0_N, *deployment.v0_N[j], 8.0]
        found = solve_ivp(rhs, (0.0, 600.0), y0, method="DOP853", t_eval=times, rtol=1e-10, atol=1e-8, max_step=2.0)
        assert np.linalg.norm(found.y[:3, -1] - deployment.destination_N[j]) < 0.5
        assert np.abs(found.y[:3].T - paths[:, j]).max() < 0.5
        assert found.y[6, -1] == pytest.approx(8.0 * np.exp(-speed / exhaust), rel=1e-3)


def test_the_flown_arrival_is_within_metres_of_the_point(slow):
    telemetry = simulate(slow)
    assert arrival_miss_m(slow, telemetry).max() < 5.0
    # Without the burns it would be missed by far.
    idle = replace(slow, deployment=replace(slow.deployment, burns=()))
    times = np.array([0.0, 600.0])
    coast = planned_paths(idle.environment.acceleration_N, idle.deployment, times)[0][-1]
    assert np.linalg.norm(coast - idle.deployment.destination_N, axis=1).min() > 100.0


def test_impacts_and_near_collisions_are_looked_for_on_the_paths_with_burns(slow):
    times = np.linspace(0.0, 620.0, 621)
    r_N = planned_paths(slow.environment.acceleration_N, slow.deployment, times)[0]
    assert slow.least_radius == pytest.approx(np.linalg.norm(r_N, axis=2).min(axis=0))
    without = replace(slow.deployment, burns=())
    coast = planned_paths(slow.environment.acceleration_N, without, times)[0]
    assert np.abs(np.linalg.norm(coast, axis=2).min(axis=0) - slow.least_radius).max() > 10.0


def test_what_the_thrusters_cannot_give_is_refused_where_that_is_asked_for():
    with pytest.raises(
        PathError, match=r"sc1: insertion burn beyond the tank: needs .* m/s and its tank gives 0\.7973 "
    ):
        plan_of(SLOW, SMALL, REFUSED)
    weak = "spacecraft.thrusters={thrust_n: 0.001, propellant_kg: 1.0, min_impulse_bit_n_s: 0}"
    with pytest.raises(PathError, match=r"takes .* s at 0\.001 N and does not end before the arrival at t = 600 s"):
        plan_of(SLOW, weak, REFUSED)
    with pytest.raises(PathError, match=r"mothership\.deployer\.max_speed_m_s = 0\.5 is the most"):
        plan_of(SLOW, REFUSED)
    with pytest.raises(ScenarioError, match=r"trajectory\.corrections: cannot be flown beside insertion burns"):
        plan_of(SLOW, STRONG, CORRECTED, REFUSED)


@pytest.mark.parametrize("keys", [(SLOW, SMALL), (SLOW,), (), (SLOW, STRONG, CORRECTED)], ids=str)
def test_who_cannot_burn_is_else_released_as_if_the_deployer_could_give_any_speed(keys):
    any_speed, plan = plan_of("mothership.deployer.max_speed_m_s=null"), plan_of(*keys)
    assert not plan.deployment.burns and (plan.deployment.delta_v > 2.0).all()
    assert np.array_equal(plan.deployment.v0_N, any_speed.deployment.v0_N)


def test_one_whose_burn_fits_burns_beside_one_whose_burn_does_not(slow):
    least = min(float(np.linalg.norm(burn.delta_v_N)) for burn in slow.deployment.burns)
    most = max(float(np.linalg.norm(burn.delta_v_N)) for burn in slow.deployment.burns)
    tank = 8.0 * (1.0 - np.exp(-0.5 * (least + most) / (65.0 * 9.80665)))
    plan = plan_of(SLOW, STRONG, f"spacecraft.thrusters.propellant_kg={tank}")
    (burn,) = plan.deployment.burns
    other = 1 - burn.spacecraft
    assert plan.deployment.delta_v[burn.spacecraft] == pytest.approx(0.5)
    assert np.array_equal(plan.deployment.v0_N[other], plan_of().deployment.v0_N[other])


def test_candidates_of_thrusters_that_fly_corrections_burn_nothing_as_their_flights_do():
    keys = ["duration_s=620", SLOW, STRONG, CORRECTED, "mothership.velocity=[0, 0, 40]"]
    assert not fly_candidates(load_scenario("eros-quick", parse_overrides(keys))).plan.deployment.burns


def test_burns_that_overlap_or_begin_aboard_are_refused(slow):
    push, one = push_of(slow.properties, None), np.array([1.0, 0.0, 0.0])
    plain = replace(slow.deployment, burns=())
    for burns, words in (
        (
            [PlannedBurn(1, 3.0, one)],
            r"sc2: its burn of 1 m/s about t = 3 s begins at t = .*, before it leaves the moth",
        ),
        (
            [PlannedBurn(0, 100.0, one), PlannedBurn(0, 110.0, one)],
            r"sc1: .* t = 110 s .*, before its earlier burn ends",
        ),
    ):
        with pytest.raises(PathError, match=words):
            check_burns(replace(plain, burns=tuple(burns)), push)
    check_burns(replace(plain, burns=(PlannedBurn(0, 100.0, one), PlannedBurn(0, 130.0, one))), push)


def test_candidates_that_need_more_than_the_tank_are_left_out_with_the_reason():
    rest = "mothership.velocity=[0, 0, 0]"
    keys = ["duration_s=620", rest, "spacecraft.thrusters={thrust_n: 50, propellant_kg: 0.55}"]
    free = fly_candidates(load_scenario("eros-quick", parse_overrides(keys)))
    middle = float(np.median(free.delta_v))
    gives = 65.0 * 9.80665 * np.log(8.0 / 7.45)
    limit = f"mothership.deployer={{max_speed_m_s: {middle - 0.999 * gives}, insertion_after_s: 0, beyond_max_speed: refused}}"
    found = fly_candidates(load_scenario("eros-quick", parse_overrides([*keys, limit])))
    assert set(found.left_out.values()) == {"beyond the tank"}
    assert set(found.points) | set(found.left_out) == set(free.points) and 0 < len(found.left_out) < len(free.points)
    fastest = max(found.left_out, key=lambda p: free.delta_v[free.points.index(p)])
    assert free.delta_v[free.points.index(fastest)] == free.delta_v.max()
