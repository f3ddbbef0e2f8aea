"""A flight beside a binary: its path as planned by either stepper, impacts on the moon, what it hides, links it stands in."""

from contextlib import closing
from dataclasses import replace

import numpy as np
import pytest

import swarm_mj as sm
from swarm_mj.dataflow.contacts import Instants
from swarm_mj.designer.candidates import flights
from swarm_mj.designer.candidates.pictures import Judge, Watcher
from swarm_mj.designer.candidates.visibility import imaging_model_from
from swarm_mj.errors import PathError, ScenarioError, SimulationError
from swarm_mj.flight.downlink import contacts_of
from swarm_mj.flight.fly import initial_state, make_simulation, simulate
from swarm_mj.flight.light import lit_sometime
from swarm_mj.flight.observe import observe_flight, screen_of
from swarm_mj.flight.plan import make_plan
from swarm_mj.flight.targets import target_from
from swarm_mj.mission.behaviors import TargetKind
from swarm_mj.mission.links import Obstacle
from swarm_mj.observation.coverage import Cause
from swarm_mj.observation.raycast import RayTracer
from swarm_mj.records.summary import arrival_miss_m
from swarm_mj.rendering.live import LiveFlight
from swarm_mj.smallbody.impact import CompanionWatch
from tests.sample_missions.flights import mission


def binary(folder, **changes):
    return sm.load(mission("binary", folder), {key.replace("__", "."): value for key, value in changes.items()})


@pytest.mark.parametrize("stepper", ["kernel", "mujoco"])
def test_the_flight_arrives_where_it_was_planned_beside_a_heavy_moon(tmp_path, stepper):
    # A moon a tenth as heavy: it moves the arrival by metres, and the flight knows all of it.
    heavy = {"companion__body__gravity__parameters": {"gm": 3.6}, "physics__stepper": stepper}
    near = {
        "design__imaging_altitude_m": 1500,
        "mothership__position_A_m": [-1500, -1240, -6000],
        "companion__orbit__mean_anomaly_deg": 250.0,
        # A quarter of a turn in the flight: A is not N.
        "body__rotation__w_rate_deg_per_day": 10_800.0,
        "body__rotation__w0_deg": 100.0,
    }
    plan = make_plan(binary(tmp_path, **heavy, **near))
    telemetry = simulate(plan)
    assert arrival_miss_m(plan, telemetry).max() < 1e-4
    alone = make_plan(binary(tmp_path, **heavy, **near, companion=None)).deployment.v0_N
    assert 600.0 * np.linalg.norm(alone - plan.deployment.v0_N) > 0.3


def test_a_path_through_the_moon_is_refused_with_its_name(tmp_path):
    plan = make_plan(binary(tmp_path))
    # The visiting point in the moon's orbit, and the moon there at the arrival.
    with pytest.raises(PathError, match=r"sc1 hits Moon at t = \d+ s; change design.visiting_points"):
        make_plan(
            binary(
                tmp_path,
                design__imaging_altitude_m=800,
                companion__orbit__mean_anomaly_deg=float(
                    np.degrees(np.arctan2(plan.points_A[0, 1], plan.points_A[0, 0])) - 60.0
                ),
            )
        )


def test_the_flight_ends_at_the_moon(tmp_path):
    plan = make_plan(binary(tmp_path))
    simulation = make_simulation(plan)
    companion = plan.environment.companion
    simulation.reset(
        simulation_start(plan, companion.position(0.0) + [0.0, 0.0, 500.0], companion.path.state(0.0)[1] + [0, 0, -5.0])
    )
    with pytest.raises(SimulationError, match=r"hits the companion, Moon, at t = (81|82|83)"):
        simulation.run(200.0, 1.0)


def simulation_start(plan, r_N, v_N):
    start = initial_state(plan)
    return replace(start, r_BN_N=np.tile(r_N, (plan.n, 1)), v_BN_N=np.tile(v_N, (plan.n, 1)))


def test_nobody_looks_for_impacts_on_the_moon_in_every_period(tmp_path):
    plan = make_plan(binary(tmp_path))
    watch, companion, looks, period = (
        CompanionWatch(plan.environment.companion, 0.5),
        plan.environment.companion,
        0,
        0.5,
    )
    for tick in range(2400):
        if tick >= watch.due:
            r = companion.position(tick * period) + [5.0, 3.0, 2000.0 - tick]
            v = companion.path.state(tick * period)[1] + [0.0, 0.0, -2.0]
            looks += 1
            if watch.look(tick, r[None], v[None], np.zeros((1, 3)), np.ones(1, bool))[0]:
                break
    assert (2000.0 - tick) == pytest.approx(90.0, abs=2.0)
    assert looks < 400


def test_an_eclipse_and_an_occultation_take_cells_from_the_pictures(tmp_path):
    plan = make_plan(binary(tmp_path))
    telemetry = simulate(plan)
    beside = observe_flight(plan, telemetry)
    alone = observe_flight(replace(plan, environment=replace(plan.environment, companion=None)), telemetry)
    first, later = alone.coverage.first_seen_by_s[0], beside.coverage.first_seen_by_s[0]
    assert (np.isnan(first) <= np.isnan(later)).all()
    both = ~np.isnan(first) & ~np.isnan(later)
    assert (later[both] >= first[both]).all() and (later[both] > first[both]).sum() > 20
    assert set(np.unique(beside.why)) >= {Cause.NONE, Cause.NEVER_LIT}


def test_the_lit_part_leaves_out_what_is_in_shadow_then(tmp_path):
    # The moon between Sun and body at the arrival.
    at_sun = {"companion__orbit__mean_anomaly_deg": 125.0, "target": {"region": "lit", "lit_at": "arrival"}}
    with_moon = binary(tmp_path, **at_sun)
    plan_shape = make_plan(binary(tmp_path)).shape
    lit_region = target_from(with_moon, plan_shape)
    alone = target_from(binary(tmp_path, **at_sun, companion=None), plan_shape)
    missing = alone.weighted_area.sum() - lit_region.weighted_area.sum()
    assert missing > 0.8 * np.pi * 90.0**2


def test_cells_that_are_eclipsed_at_one_time_are_lit_at_another(tmp_path):
    plan = make_plan(binary(tmp_path))
    region, around = plan.region, plan.environment
    screen, tracer = screen_of(around), RayTracer(region.vertices, region.faces)
    at_once = lit_sometime(region, around, np.array([250.0]), 85.0, tracer=tracer, screen=screen)
    always = lit_sometime(region, around, np.array([250.0, 900.0]), 85.0, tracer=tracer, screen=screen)
    assert always.sum() - at_once.sum() > 50


def test_links_to_earth_break_where_the_moon_stands_in_between(tmp_path):
    plan = make_plan(binary(tmp_path))
    around, times = plan.environment, np.arange(0.0, 80.0, 10.0)
    moon = np.array([around.companion.position(t) for t in times])
    earth = np.array([around.earth.at(t) for t in times])
    to_earth = earth / np.linalg.norm(earth, axis=1)[:, None]
    # Behind the moon as seen from Earth in the first half, beside it in the second.
    r = moon - 700.0 * to_earth
    r[4:] += 300.0 * np.cross(to_earth[4:], [0.0, 0.0, 1.0])
    z = (earth - r) / np.linalg.norm(earth - r, axis=1)[:, None]
    x = np.cross([0.0, 0.0, 1.0], z)
    x /= np.linalg.norm(x, axis=1)[:, None]
    instants = Instants(
        t=times,
        r_BN_N=r[:, None],
        C_BN=np.stack([x, np.cross(z, x), z], axis=1)[:, None],
        C_AN=np.array([around.C_AN(t) for t in times]),
        earth_N=earth,
        mode=np.full((8, 1), int(TargetKind.EARTH)),
        tracked=np.zeros((8, 1), np.int64),
        works=np.ones((8, 1), np.bool_),
    )
    contacts = contacts_of(plan, np.array([0.0, 40.0, 80.0]), instants)
    assert contacts.why_earth[0, 0] == Obstacle.BODY and contacts.earth_bit[0, 0] == 0
    assert contacts.why_earth[1, 0] != Obstacle.BODY


def test_a_design_sees_what_its_flight_sees(tmp_path, monkeypatch):
    """Without the companion the candidate would be credited with cells that its flight finds in shadow."""
    scenario = binary(tmp_path, observation__criterion="arrival", design__time_of_flight_s=300)
    point = scenario.design.visiting_points[0]
    monkeypatch.setattr(flights, "farthest_apart", lambda *_: np.array([point - 1]))
    flown = flights.fly_candidates(scenario)
    plan = make_plan(scenario)
    with closing(Judge(plan.region, imaging_model_from(scenario), scenario.observation, 1)) as judge:
        ((_, seen),) = judge.seen([Watcher(flown, 0)])
    result = observe_flight(plan, simulate(plan)).coverage.seen
    alone = replace(plan, environment=replace(plan.environment, companion=None))
    without = observe_flight(alone, simulate(plan)).coverage.seen
    assert (without & ~result).sum() > 50
    assert (seen != result).sum() < 10


def test_what_knows_one_body_alone_refuses_a_companion(tmp_path):
    with pytest.raises(ScenarioError, match="companion: a flight that is watched live knows one body alone"):
        LiveFlight(make_plan(binary(tmp_path)))
    with pytest.raises(ScenarioError, match="companion: a swarm that coordinates in flight"):
        make_plan(binary(tmp_path, swarm={"class": 4}))
    with pytest.raises(ScenarioError, match="companion: a policy"):
        make_plan(binary(tmp_path, behavior={"name": "trained_policy", "imaging_radius_m": 20000}))
